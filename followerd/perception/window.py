"""A square window of the image, brought to a size in which the person is always as large."""

from dataclasses import dataclass
from math import ceil, floor, sqrt

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.messages import Pixels

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
        """The window (SIDE, SIDE, …) of an image; the image's border is repeated outside."""
        shrink = min(int(self.scale), min(pixels.shape[:2]) // 16)
        left, top, scale = self.left, self.top, self.scale
        if shrink >= 2:  # average first, or fine texture would alias
            x, y, pixels = self._part(pixels)
            height, width = pixels.shape[0] // shrink, pixels.shape[1] // shrink
            whole = pixels[: height * shrink, : width * shrink]
            reduced = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
            pixels = np.asarray(reduced, np.uint8)
            left, top, scale = (left - x) / shrink, (top - y) / shrink, scale / shrink
        # pixel i covers i..i+1: centres lie half a pixel inside
        shift = 0.5 * scale - 0.5
        matrix = np.array([[scale, 0.0, left + shift], [0.0, scale, top + shift]])
        patch = cv2.warpAffine(
            pixels,
            matrix,
            (SIDE, SIDE),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return np.asarray(patch, np.uint8)

    def _part(self, pixels: Pixels) -> tuple[int, int, Pixels]:
        """Corner and pixels of the part of the image under the window, at least 16 px a side."""
        height, width = pixels.shape[:2]
        reach = SIDE * self.scale
        x = int(min(max(self.left, 0), width - 16))
        y = int(min(max(self.top, 0), height - 16))
        right = int(min(max(self.left + reach + 1, x + 16), width))
        bottom = int(min(max(self.top + reach + 1, y + 16), height))
        return x, y, pixels[y:bottom, x:right]

    def inside(self) -> npt.NDArray[np.float32]:
        """(SIDE, SIDE): 1 where the window lies in the image, else 0."""
        seen = np.zeros((SIDE, SIDE), np.float32)
        seen[self._covered(self.top, self.frame[1]), self._covered(self.left, self.frame[0])] = 1.0
        return seen

    def _covered(self, start: float, length: int) -> slice:
        """The rows or columns whose middle lies between 0 and `length` px of the image."""
        first = max(floor(-start / self.scale - 0.5) + 1, 0)
        return slice(first, max(min(ceil((length - start) / self.scale - 0.5), SIDE), first))

    def to_window(self, points: Array) -> Array:
        """Image points (N, 2) in window px."""
        return (points - (self.left, self.top)) / self.scale

    def to_image(self, points: Array) -> Array:
        """Window points (N, 2) in image px."""
        return points * self.scale + (self.left, self.top)
