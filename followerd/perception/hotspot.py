"""What is warm in a thermal image: its grey levels without the camera's gain, columns, regions.

The most salient column is Motai, Jha and Kruse's detector (2012, section 3). Nothing is subtracted
but the scene's own middle level, so the camera may move and its automatic gain may jump.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from followerd.geometry import Array
from followerd.messages import Box, Pixels
from followerd.perception.blobs import rectangles

SPARSE = 4  # px between the pixels that the levels are read from
SPREAD = 1.5, 25.0  # grey levels: an even wall's noise is not blown up to a scene, and a scene
# that fills its range, as visible ones do, is not flattened
REST, STEP = 80.0, 50.0  # evened levels: of the middle, and per e-fold above or below
HOT = 2.0  # deviations above the middle
FULL = 6.0  # same: warmer is no more salient, or a lamp would outweigh a person
GAP = 0.15  # of the image's height that one warm body's parts lie apart
ROWS = 240  # that suffice for a column
SMALLEST = 12  # px of the reduced image, area of a warm region


@dataclass(frozen=True, slots=True)
class Levels:
    """Middle and spread of a scene's grey levels: what automatic gain and offset change."""

    middle: float
    spread: float  # about a standard deviation

    @classmethod
    def of(cls, grey: Pixels) -> "Levels":
        """Median and 80 % range, to fractions of a level, so that they do not jump by one."""
        sparse = grey[::SPARSE, ::SPARSE].ravel()
        shares = np.bincount(sparse, minlength=256).cumsum() / sparse.size
        low, middle, high = np.interp((0.1, 0.5, 0.9), shares, EDGES).tolist()
        return cls(middle, min(max((high - low) / 2.56, SPREAD[0]), SPREAD[1]))

    def even(self, grey: Pixels) -> Pixels:
        """The image with its middle at REST, differences kept near it, compressed far from it."""
        levels = REST + STEP * np.arcsinh(0.5 * (np.arange(256) - self.middle) / self.spread)
        return np.asarray(
            cv2.LUT(grey, np.clip(np.rint(levels), 0, 255).astype(np.uint8)), np.uint8
        )


EDGES = np.arange(256) + 0.5
WARMTH = 2.0 * np.sinh((np.arange(256) - REST) / STEP)  # deviations, of evened levels
WARMTH = np.clip((WARMTH - HOT) * 255.0 / (FULL - HOT), 0, 255).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class Column:
    """The most salient column of a part of an image."""

    x: float  # px from the image's left edge
    y: float  # px, middle of what is warm in it
    share: float  # 0..1 of it that is hot


def grey_of(pixels: Pixels) -> Pixels:
    """An image (H, W, 3) or (H, W) as grey levels (H, W)."""
    if pixels.ndim == 2:
        return pixels
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8)


def warmth(even: Pixels) -> Pixels:
    """0 (not hot) … 255 of an evened image."""
    return np.asarray(cv2.LUT(even, WARMTH), np.uint8)


def salient_column(even: Pixels, width: float, within: Box | None = None) -> Column | None:
    """Where a body `width` px wide is warmest in `within` (None: the whole image), to a fraction
    of a pixel; None where nothing is hot."""
    rows, columns = _part(even, within)
    step = max((rows.stop - rows.start) // ROWS, 1)
    part = even[rows.start : rows.stop : step, columns]
    if part.shape[0] < 1 or part.shape[1] < 3:
        return None
    hot = warmth(part)
    reduced = cv2.reduce(hot, 0, cv2.REDUCE_SUM, dtype=cv2.CV_32F)
    sums = np.asarray(reduced, np.float32).reshape(1, -1)
    size = (max(int(width) | 1, 3), 1)
    smooth = np.asarray(cv2.blur(sums, size, borderType=cv2.BORDER_CONSTANT), np.float32).ravel()
    best = int(smooth.argmax())
    if smooth[best] <= 0.0:
        return None
    x = best + 0.5 + vertex(smooth, best)
    half = max(int(0.5 * width), 1)
    profile = hot[:, max(best - half, 0) : best + half + 1].sum(axis=1, dtype=np.float64)
    y = float(profile @ (np.arange(profile.size) + 0.5) / max(profile.sum(), 1e-9))
    share = float(smooth[best]) / (255.0 * part.shape[0])
    return Column(columns.start + x, rows.start + step * y, share)


def hot_regions(even: Pixels, most: int) -> Array:
    """Rectangles (M, 4) x y w h, centre and size in px, of the `most` largest warm regions of the
    whole image; parts above each other, as a head and legs around a coat, are one."""
    step = max(even.shape[1] // 160, 1)
    mask = (warmth(even[::step, ::step].copy()) > 0).astype(np.uint8)
    gap = int(GAP * mask.shape[0]) | 1
    mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((gap, 1), np.uint8)))
    boxes: Array = rectangles(mask, 0, SMALLEST, most) * step
    return boxes


def _part(even: Pixels, within: Box | None) -> tuple[slice, slice]:
    height, width = even.shape
    if within is None:
        return slice(0, height), slice(0, width)
    left, top = max(int(within.x), 0), max(int(within.y), 0)
    right, bottom = int(within.x + within.w) + 1, int(within.y + within.h) + 1
    return slice(top, max(min(bottom, height), top)), slice(left, max(min(right, width), left))


def vertex(values: Array, at: int) -> float:
    """Offset of the vertex of a parabola through a maximum and its neighbours."""
    if not 0 < at < len(values) - 1:
        return 0.0
    left, middle, right = values[at - 1 : at + 2].tolist()
    bend = left - 2.0 * middle + right
    return 0.5 * (left - right) / bend if bend < 0.0 else 0.0
