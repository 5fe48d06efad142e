"""A square window of the image, brought to a size in which the person is always as large."""

from dataclasses import dataclass
from math import ceil, floor, sqrt

import cv2
import numpy as np
from cv2.typing import MatLike

from followerd.geometry import Array
from followerd.messages import Pixels

Part = tuple[slice, slice]  # rows and columns, from start to stop

SIDE = 72  # px of the window
BODY = 24.0  # px of the window, square root of the person's area


@dataclass(frozen=True, slots=True)
class Window:
    """Where a window lies: window px = (image px - corner) / scale; both count from edges."""

    left: float  # px of the image
    top: float  # px of the image
    scale: float  # image px per window px
    frame: tuple[int, int]  # width and height of the image, px

    @classmethod
    def around(cls, box: Array, frame: tuple[int, int]) -> "Window":
        """The window centred on a box (4,) x y w h."""
        x, y, w, h = box.tolist()
        scale = sqrt(w * h) / BODY
        half = 0.5 * SIDE * scale
        return cls(x - half, y - half, scale, frame)

    def cut(self, pixels: Pixels) -> Pixels:
        """The window (SIDE, SIDE, 3) of an image, (SIDE, SIDE) of a grey one; the image's border is
        repeated outside.

        Halving, one or four channels and nothing outside are what OpenCV has the fastest code for.
        """
        x, y, pixels = self._part(pixels)
        left, top, scale = self.left - x, self.top - y, self.scale
        while scale >= 2.0 and min(pixels.shape[:2]) >= 32:  # or fine texture would alias
            height, width = pixels.shape[0] // 2, pixels.shape[1] // 2
            whole = pixels[: 2 * height, : 2 * width]
            reduced = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
            pixels = np.asarray(reduced, np.uint8)
            left, top, scale = 0.5 * left, 0.5 * top, 0.5 * scale
        # pixel i covers i..i+1: centres lie half a pixel inside
        left, top = left + 0.5 * scale - 0.5, top + 0.5 * scale - 0.5
        beside, above = max(-floor(left), 0), max(-floor(top), 0)
        framed = cv2.copyMakeBorder(
            pixels,
            above,
            max(floor(top + scale * SIDE) + 2 - pixels.shape[0], 0),
            beside,
            max(floor(left + scale * SIDE) + 2 - pixels.shape[1], 0),
            cv2.BORDER_REPLICATE,
        )
        matrix = np.array([[scale, 0.0, left + beside], [0.0, scale, top + above]])
        if pixels.ndim == 2:
            return _warped(framed, matrix)
        patch = _warped(cv2.cvtColor(framed, cv2.COLOR_BGR2BGRA), matrix)
        return np.asarray(cv2.cvtColor(patch, cv2.COLOR_BGRA2BGR), np.uint8)

    def _part(self, pixels: Pixels) -> tuple[int, int, Pixels]:
        """Corner and pixels of the part of the image under the window, at least 16 px a side."""
        height, width = pixels.shape[:2]
        reach = SIDE * self.scale
        x = int(min(max(self.left, 0), width - 16))
        y = int(min(max(self.top, 0), height - 16))
        right = int(min(max(self.left + reach + 1, x + 16), width))
        bottom = int(min(max(self.top + reach + 1, y + 16), height))
        return x, y, pixels[y:bottom, x:right]

    def inside(self) -> Part:
        """The part of the window that lies in the image."""
        return self._covered(self.top, self.frame[1]), self._covered(self.left, self.frame[0])

    def _covered(self, start: float, length: int) -> slice:
        """The rows or columns whose middle lies between 0 and `length` px of the image."""
        first = min(max(floor(-start / self.scale - 0.5) + 1, 0), SIDE)
        return slice(first, max(min(ceil((length - start) / self.scale - 0.5), SIDE), first))

    def to_window(self, points: Array) -> Array:
        """Image points (N, 2) in window px."""
        moved: Array = points - (self.left, self.top)
        moved /= self.scale
        return moved

    def to_image(self, points: Array) -> Array:
        """Window points (N, 2) in image px."""
        return points * self.scale + (self.left, self.top)


def _warped(framed: MatLike, matrix: Array) -> Pixels:
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(framed, matrix, (SIDE, SIDE), flags=flags), np.uint8)
