"""How far a region of the image has moved: the median of its points' flow (Lucas-Kanade)."""

from math import sqrt
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.messages import Box, Pixels

WINDOW = (11, 11)  # px, around each point
LEVELS = 2  # of the search's own pyramid
STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)
TEXTURE = 1e-3  # least eigenvalue: points without it have no say
MARGIN = 24  # px around the points that they may move
AGREE = 1.0  # px from the median
LEAST = 0.4  # share of the points that must agree
BODY = 40.0  # px, square root of a person's area, that suffice
SCENE = 240  # px, width below which a scene is not reduced further

Points = npt.NDArray[np.float32]  # (N, 2) px
Halves = tuple[Pixels, ...]  # a grey image, and each time half of it


class Flow(NamedTuple):
    """A region's motion from one image to the next."""

    u: float  # px, right
    v: float  # px, down
    agreed: float  # share of the points that moved so


def _grid(columns: int, rows: int) -> Array:
    """Points (N, 2) spread over a square from -0.5 to 0.5."""
    x, y = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
    return np.column_stack([x.ravel(), y.ravel()]) - 0.5


ON_BODY, ON_SCENE = _grid(4, 7), _grid(8, 5)
INNER = np.array([0.7, 0.85])  # of a person's box, where it shows little else


def halves(grey: Pixels) -> Halves:
    """An image (H, W) and its reductions, the last one less than SCENE px wide."""
    images = [grey]
    while (width := images[-1].shape[1]) >= SCENE:
        height, width = images[-1].shape[0] // 2, width // 2
        whole = images[-1][: 2 * height, : 2 * width]
        small = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
        images.append(np.asarray(small, np.uint8))
    return tuple(images)


def body_flow(before: Halves, after: Halves, box: Box) -> Flow | None:
    """Motion of the person who filled `box` of the image before; None where it is unclear."""
    if len(before) != len(after):
        return None
    level, factor = 0, 1
    while level + 1 < len(before) and sqrt(box.w * box.h) >= 2 * factor * BODY:
        level, factor = level + 1, 2 * factor
    points = np.array(box.centre) + ON_BODY * INNER * (box.w, box.h)
    return _scaled(median_flow(before[level], after[level], points / factor), factor)


def scene_flow(before: Halves, after: Halves, person: Box | None) -> Flow | None:
    """Motion of what stands still, against which the camera turns; `person` is left out."""
    height, width = before[0].shape
    factor = 2 ** (len(before) - 1)
    points = (ON_SCENE + 0.5) * (width, height)
    if person is not None:
        apart = np.abs(points - person.centre) / (0.75 * person.w, 0.6 * person.h)
        points = points[(apart > 1.0).any(axis=1)]
    return _scaled(median_flow(before[-1], after[-1], points / factor), factor)


def median_flow(before: Pixels, after: Pixels, points: Array) -> Flow | None:
    """Median motion of `points` (N, 2) of a grey image, to a fraction of a pixel; None where too
    few agree."""
    height, width = before.shape
    x, y = points.T
    inside = (x > 1.0) & (x < width - 1.0) & (y > 1.0) & (y < height - 1.0)
    seen = points[inside].astype(np.float32)
    if before.shape != after.shape or len(seen) < LEAST * len(points) or not len(points):
        return None
    left, top = (max(int(first) - MARGIN, 0) for first in seen.min(axis=0).tolist())
    right, bottom = (int(last) + MARGIN for last in seen.max(axis=0).tolist())
    part = slice(top, bottom), slice(left, right)
    # pixel i covers i..i+1, the library counts from pixels' middles
    start = (seen - np.array([left + 0.5, top + 0.5], np.float32)).reshape(-1, 1, 2)
    end, found, _ = cv2.calcOpticalFlowPyrLK(
        before[part],
        after[part],
        start,
        np.empty(0, np.float32),
        winSize=WINDOW,
        maxLevel=LEVELS,
        criteria=STOP,
        minEigThreshold=TEXTURE,
    )
    moves = (np.asarray(end, np.float32) - start).reshape(-1, 2)[np.asarray(found).ravel() == 1]
    return _agreed(moves, len(points))


def _agreed(moves: Points, asked: int) -> Flow | None:
    if len(moves) < LEAST * asked:
        return None
    # the two middle ones (or one) of each coordinate: np.median takes six times as long
    low, high = np.sort(moves, axis=0)[[(len(moves) - 1) // 2, len(moves) // 2]]
    apart = np.abs(moves - 0.5 * (low + high))
    near = moves[np.maximum(apart[:, 0], apart[:, 1]) < AGREE]
    if len(near) < LEAST * asked:
        return None
    u, v = (near.sum(axis=0) / len(near)).tolist()
    return Flow(u, v, len(near) / asked)


def _scaled(flow: Flow | None, factor: int) -> Flow | None:
    return None if flow is None else Flow(flow.u * factor, flow.v * factor, flow.agreed)
