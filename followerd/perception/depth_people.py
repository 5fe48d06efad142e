"""Upright bodies in a depth image: the outline around a place, and all that may be a person."""

from math import ceil

import cv2
import numpy as np

from followerd.geometry import Array, Camera
from followerd.messages import Box
from followerd.perception.depth_band import FARTHEST, HALF_BAND, Depth
from followerd.perception.spot import row

NEAREST = 0.8  # m
SPACING = 0.25  # m between two layers that are searched
SHRINK = 8  # px of the image for one that is searched
WIDTH = (0.2, 1.0)  # m, of a body
TALL = 0.5  # m, least height of what is in view of it
ARM = 0.6  # m, nothing of a person is farther aside
THIN = 0.05  # m, a row that shows less of a body has none
GAP = 0.1  # m of missing rows that are bridged


def outline(depth: Depth, seed: Box, middle: float, camera: Camera, downward: bool = False) -> Box:
    """`seed`, made as high, or as tall, as the body at depth `middle` (m) that it lies on.

    Rows are added as long as they show some of that depth, but not as much as a floor does.
    """
    metre = camera.fx / middle  # px
    centre = seed.x + 0.5 * seed.w
    left, right = max(0, int(centre - ARM * metre)), ceil(centre + ARM * metre)
    with np.errstate(invalid="ignore"):
        band = np.abs(depth[:, left:right] - np.float32(middle)) < HALF_BAND
    width = band.sum(axis=1) / metre
    body = (width > THIN) & (width < WIDTH[1])
    top, bottom = int(max(seed.y, 0)), min(int(seed.y + seed.h), depth.shape[0]) - 1
    top = _reached(body, top, -1, GAP * metre)
    if downward:
        bottom = _reached(body, bottom, 1, GAP * metre)
    return Box(seed.x, top, seed.w, bottom + 1 - top)


def _reached(body: Array, start: int, way: int, gap: float) -> int:
    """The last row from `start` on, up (-1) or down (+1), before a gap of more than `gap` rows."""
    last = here = start
    while 0 <= here < len(body) and abs(here - last) <= gap:
        if body[here]:
            last = here
        here += way
    return last


def bodies(depth: Depth, camera: Camera) -> list[tuple[Box, float]]:
    """Boxes that a body may fill, each with its depth in m, the largest first."""
    small = depth[SHRINK // 2 :: SHRINK, SHRINK // 2 :: SHRINK]
    found: list[tuple[float, Box, float]] = []
    for middle in np.arange(NEAREST, FARTHEST - SPACING, SPACING).tolist():
        with np.errstate(invalid="ignore"):
            layer = np.abs(small - np.float32(middle)) < HALF_BAND
        floor = row(camera, middle + HALF_BAND, 0.0)
        layer[max(ceil(floor / SHRINK), 0) :] = False  # feet and floor are of one depth
        if not layer.any():
            continue
        _, _, stats, _ = cv2.connectedComponentsWithStats(layer.view(np.uint8), connectivity=4)
        metre = camera.fx / middle / SHRINK
        for x, y, w, h, area in np.asarray(stats)[1:].tolist():
            if WIDTH[0] * metre < w < WIDTH[1] * metre and h > TALL * metre:
                box = Box(SHRINK * x, SHRINK * y, SHRINK * w, SHRINK * h)
                inside = small[y : y + h, x : x + w][layer[y : y + h, x : x + w]]
                found.append((area / metre**2, box, float(np.median(inside))))
    found.sort(key=lambda item: -item[0])
    kept: list[tuple[Box, float]] = []
    for _, box, middle in found:
        if all(abs(middle - other) > HALF_BAND or _apart(box, there) for there, other in kept):
            kept.append((box, middle))
    return kept


def _apart(a: Box, b: Box) -> bool:
    return abs(a.centre[0] - b.centre[0]) > 0.5 * min(a.w, b.w)
