"""The region a person is enrolled by: a rectangle as drawn, or one grown from a click."""

import cv2
import numpy as np

from followerd.errors import UsageError
from followerd.messages import Box, Pixels

SMALLEST = 4.0  # px, of a rectangle's sides


def region_of(pixels: Pixels, region: Box | tuple[float, float]) -> Box:
    """The part of a rectangle that lies in the image, or the region grown around a click.

    Raises UsageError when the region lies outside the image or is too small.
    """
    height, width = pixels.shape[:2]
    if isinstance(region, Box):
        return _clipped(region, width, height)
    x, y = region
    if not (0 <= x < width and 0 <= y < height):
        raise UsageError(
            f"the point {x:g},{y:g} lies outside the image of {width}x{height} px; "
            "click on the person"
        )
    return grow(pixels, x, y)


def _clipped(box: Box, width: int, height: int) -> Box:
    left, top = max(box.x, 0.0), max(box.y, 0.0)
    right, bottom = min(box.x + box.w, float(width)), min(box.y + box.h, float(height))
    share = max(right - left, 0.0) * max(bottom - top, 0.0) / max(box.w * box.h, 1e-9)
    if not share >= 0.5 or not np.isfinite(share):
        raise UsageError(
            f"the box {box.x:g},{box.y:g},{box.w:g},{box.h:g} lies outside the image of "
            f"{width}x{height} px; draw it around the person"
        )
    if min(right - left, bottom - top) < SMALLEST:
        raise UsageError(
            f"the box {box.x:g},{box.y:g},{box.w:g},{box.h:g} is too small; "
            f"both sides must be at least {SMALLEST:g} px"
        )
    return Box(left, top, right - left, bottom - top)


def grow(pixels: Pixels, x: float, y: float) -> Box:
    """The rectangle around the pixels that look like those at a click and are joined to it.

    Colour tolerances widen until the region has a person's least size and stop before it spills;
    a region that stays too small becomes a rectangle of a person's usual shape.
    """
    height, width = pixels.shape[:2]
    scale = width / 192.0
    smooth = cv2.GaussianBlur(pixels, (0, 0), max(0.6 * scale, 0.6))
    if smooth.ndim == 3:
        smooth = cv2.cvtColor(smooth, cv2.COLOR_BGR2Lab)
    least, most = (6.0 * scale, 12.0 * scale), (0.4 * width, 0.98 * height)
    best = Box.around(x, y, 14.0 * scale, 36.0 * scale)
    seed = (int(x), int(y))
    for tolerance in (6, 9, 13, 18, 24, 31):
        mask = np.zeros((height + 2, width + 2), np.uint8)
        reach = (tolerance * 2.0, tolerance, tolerance) if smooth.ndim == 3 else tolerance
        flags = 8 | cv2.FLOODFILL_FIXED_RANGE | cv2.FLOODFILL_MASK_ONLY
        _, _, _, (left, top, w, h) = cv2.floodFill(smooth, mask, seed, 0, reach, reach, flags)
        if w > most[0] or h > most[1]:
            break
        if w >= least[0] and h >= least[1]:
            best = Box(left, top, w, h)
    return _clipped(best, width, height)
