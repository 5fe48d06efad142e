"""A head as an ellipse: the colours inside it and the gradient along its outline.

Kwolek 2004, section 3, after Birchfield 1998. Instead of every pixel of a mask, points spread
evenly over the ellipse are looked at, so a score costs the same for every size of the head.
"""

from dataclasses import dataclass
from math import ceil, floor, pi, sqrt

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.messages import Box, Image, Pixels
from followerd.perception.head_colour import BINS, Tone, bins

Floats = npt.NDArray[np.float32]
Places = npt.NDArray[np.intp]  # (K, 2) column and row, px of a patch

INSIDE, OUTLINE = 160, 48  # points
FINE = 16.0  # px, of half a head's width beyond which the patch is reduced
SOFT = 60.0  # of gradient, at which it counts half: one strong texture edge must not dominate
REACH = 40.0 / 27.0  # of half a head's width that the head may be off its expected place
SAME_DEPTH = 0.3  # m, that a head may be off its expected depth
DEPTHS = 4  # of the points inside one is asked for its depth
LARGEST = 400  # px, of a patch's side


def _sunflower(count: int) -> Array:
    """Points (count, 2) spread evenly over the unit disc."""
    k = np.arange(count) + 0.5
    radius, turn = np.sqrt(k / count), k * pi * (3.0 - sqrt(5.0))
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])


DISC = _sunflower(INSIDE)
RIM = np.column_stack(
    [f(2.0 * pi * (np.arange(OUTLINE) + 0.5) / OUTLINE) for f in (np.cos, np.sin)]
)


@dataclass(frozen=True, slots=True)
class Ellipse:
    """An upright ellipse of the image."""

    x: float  # px, of the centre; counts from the edge of the first pixel
    y: float  # px
    a: float  # px, half the width
    aspect: float  # height over width

    @classmethod
    def inside(cls, box: Box) -> "Ellipse":
        """The one that touches all four sides of a box."""
        return cls(*box.centre, 0.5 * box.w, box.h / box.w)

    @property
    def box(self) -> Box:
        """The rectangle around it."""
        return Box.around(self.x, self.y, 2.0 * self.a, 2.0 * self.aspect * self.a)


@dataclass(frozen=True, slots=True)
class Patch:
    """A part of an image, made ready for scores; patch px = (image px - corner) / step."""

    left: float  # px of the image
    top: float  # px
    step: float  # px of the image per px of the patch
    codes: npt.NDArray[np.uint8]  # (H, W) histogram bin of each pixel
    gradient: npt.NDArray[np.complex64]  # (H, W) x + iy, 0..1

    @classmethod
    def around(cls, pixels: Pixels, head: Ellipse, tone: Tone, reach: float = REACH) -> "Patch":
        """The part in which `head` may have moved by `reach` half widths."""
        height, width = pixels.shape[:2]
        far = (reach + 1.2) * head.a, (reach + 1.2 * head.aspect) * head.a
        left = min(max(floor(head.x - far[0]), 0), width - 8)
        top = min(max(floor(head.y - far[1]), 0), height - 8)
        right = min(max(ceil(head.x + far[0]), left + 8), width)
        bottom = min(max(ceil(head.y + far[1]), top + 8), height)
        part = pixels[top:bottom, left:right]
        side = max(part.shape[:2])
        return cls.of(part, max(head.a / FINE, side / LARGEST, 1.0), tone, left, top)

    @classmethod
    def of(
        cls, pixels: Pixels, step: float, tone: Tone, left: float = 0.0, top: float = 0.0
    ) -> "Patch":
        """An image reduced by about `step`."""
        height, width = pixels.shape[:2]
        if step > 1.0:
            size = max(round(width / step), 8), max(round(height / step), 8)
            step = width / size[0]
            pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
        even = tone.evened(pixels)
        grey = even if even.ndim == 2 else cv2.cvtColor(even, cv2.COLOR_BGR2GRAY)
        gradient = np.empty((*even.shape[:2], 2), np.float32)
        gradient[..., 0] = cv2.Sobel(grey, cv2.CV_32F, 1, 0)
        gradient[..., 1] = cv2.Sobel(grey, cv2.CV_32F, 0, 1)
        vectors = gradient.view(np.complex64)[..., 0]
        vectors /= np.abs(vectors) + np.float32(4.0 * SOFT)  # a 3x3 Sobel weighs 4 times
        return cls(left, top, step, bins(even), vectors)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px of the patch."""
        return self.codes.shape[1], self.codes.shape[0]

    def places(self, points: Array) -> Places:
        """Pixels (K, 2) of the patch nearest to image points (K, 2), inside it."""
        at = np.floor((points - (self.left, self.top)) / self.step).astype(np.intp)
        limits = np.array(self.size) - 1
        inside: Places = np.minimum(np.maximum(at, 0), limits)
        return inside

    def points(self, places: Places) -> Array:
        """Image points (K, 2) of the middles of pixels (K, 2)."""
        middles: Array = (places + 0.5) * self.step + (self.left, self.top)
        return middles

    def histogram(self, head: Ellipse) -> Array:
        """Colours (BINS,) inside an ellipse, of mass 1."""
        place = self.places(np.array([[head.x, head.y]]))
        seen = self.codes.ravel().take(self._indices(place, self._disc([head.a], head.aspect)))
        return np.bincount(seen.ravel(), minlength=BINS) / INSIDE

    def colour(self, model: Array, places: Places, sizes: list[float], aspect: float) -> Array:
        """Intersection (S, K), 0..1, of `model` (BINS,) with the colours of ellipses of half
        widths `sizes` (S,), px of the image, at `places` (K, 2); both of equal mass."""
        known = np.flatnonzero(model > 0.0)
        compact = np.zeros(BINS, np.uint8)  # the bins that the model lacks share the first place
        compact[known[:255]] = np.arange(1, min(len(known), 255) + 1)
        mass = np.concatenate([[0.0], model[known[:255]]])
        codes = compact.take(self.codes).ravel()
        seen = codes.take(self._indices(places, self._disc(sizes, aspect)))
        count = len(sizes) * len(places)
        apart = (np.arange(count) * len(mass)).reshape(len(sizes), len(places), 1)
        found = np.bincount((seen + apart).ravel(), minlength=count * len(mass))
        shares = found.reshape(count, len(mass)) / INSIDE
        common: Array = np.minimum(shares, mass, out=shares).sum(axis=1)
        return common.reshape(len(sizes), len(places))

    def near(
        self, image: Image, depth: float, places: Places, sizes: list[float], aspect: float
    ) -> Array:
        """Share (S, K), 0..1, of the same ellipses that is about `depth` m away."""
        assert image.depth is not None
        width, height = self.size
        rows = ((np.arange(height) + 0.5) * self.step + self.top).astype(np.intp)
        columns = ((np.arange(width) + 0.5) * self.step + self.left).astype(np.intp)
        # a reduced side is rounded: its last pixel may reach past the image
        np.minimum(rows, image.depth.shape[0] - 1, out=rows)
        np.minimum(columns, image.depth.shape[1] - 1, out=columns)
        there = np.abs(image.depth[np.ix_(rows, columns)] - np.float32(depth)) < SAME_DEPTH
        seen = there.ravel().take(self._indices(places, self._disc(sizes, aspect)[:, ::DEPTHS]))
        share: Array = seen.mean(axis=2)
        return share

    def outline(self, places: Places, sizes: list[float], aspect: float) -> Array:
        """Mean gradient (S, K), 0..1, along the normals of the same ellipses."""
        normal = RIM * (1.0, 1.0 / aspect)  # not the direction from the centre
        normal /= np.hypot(*normal.T)[:, None]
        offsets = np.array(sizes)[:, None, None] / self.step * RIM * (1.0, aspect)
        seen = self.gradient.ravel().take(self._indices(places, offsets))
        across = seen * (normal[:, 0] - 1j * normal[:, 1]).astype(np.complex64)
        score: Array = np.abs(across.real).mean(axis=2)
        return score

    def _disc(self, sizes: list[float], aspect: float) -> Array:
        offsets: Array = np.array(sizes)[:, None, None] / self.step * DISC * (1.0, aspect)
        return offsets

    def _indices(self, places: Places, offsets: Array) -> npt.NDArray[np.intp]:
        """Flat indices (S, K, M) of `offsets` (S, M, 2) around `places`; the patch's border
        stands for what lies outside."""
        width, height = self.size
        at = np.rint(offsets).astype(np.intp)  # (S, M, 2)
        low = places.min(axis=0) + at.min(axis=(0, 1))
        high = places.max(axis=0) + at.max(axis=(0, 1))
        if low.min() >= 0 and high[0] < width and high[1] < height:
            start = places[:, 1] * width + places[:, 0]
            apart = at[..., 1] * width + at[..., 0]
            return apart[:, None] + start[:, None]
        at = at[:, None] + places[:, None]
        np.minimum(np.maximum(at, 0, out=at), (width - 1, height - 1), out=at)
        indices: npt.NDArray[np.intp] = at[..., 1] * width + at[..., 0]
        return indices
