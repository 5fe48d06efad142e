"""Scores of boxes on a map of log colour ratios."""

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array

Map = npt.NDArray[np.float32]

RING = 1.5  # outer size of the ring around a box, of the box
REACH = 1.0  # box sizes from its middle that a person's edge is looked for
LEAST_SEEN = 0.3  # share of a box: with less in view, scores fade


def contrast(values: Map, seen: Map, w: float, h: float) -> Map:
    """For boxes (w, h) around every pixel: mean inside less half the mean in a ring around.

    Means are over what is `seen` (a rectangle of 1, else 0), but at least over LEAST_SEEN of the
    box. Sizes are rounded to odd pixels.
    """
    inner, outer = (_odd(w), _odd(h)), (_odd(RING * w), _odd(RING * h))
    area, whole = np.float32(inner[0] * inner[1]), np.float32(outer[0] * outer[1])
    inside = _sums(values, inner)
    ring = _sums(values, outer) - inside
    if seen.min() > 0.0:
        return inside / area - np.float32(0.5) / (whole - area) * ring
    rows, columns = seen.max(axis=1, keepdims=True), seen.max(axis=0, keepdims=True)
    # the box sums of a rectangle of ones: those of its rows times those of its columns
    area_seen = _sums(rows, (1, inner[1])) * _sums(columns, (inner[0], 1))
    ring_seen = _sums(rows, (1, outer[1])) * _sums(columns, (outer[0], 1))
    ring_seen -= area_seen
    least = np.float32(LEAST_SEEN)
    inside /= np.maximum(area_seen, least * area, out=area_seen)
    ring /= np.maximum(ring_seen, least * (whole - area), out=ring_seen)
    ring *= np.float32(0.5)
    inside -= ring
    return inside


def _sums(values: Map, size: tuple[int, int]) -> Map:
    border = cv2.BORDER_CONSTANT
    sums = cv2.boxFilter(values, cv2.CV_32F, size, normalize=False, borderType=border)
    return np.asarray(sums, np.float32)


def _odd(size: float) -> int:
    return 2 * int(0.5 * size) + 1


def sampled(values: Map, points: Array, cell: float = 1.0) -> Array:
    """Interpolated values (N,) of a map at points (N, 2); a value of the map is `cell` px large."""
    at = np.empty((1, len(points), 2), np.float32)
    at[0] = points / cell - 0.5
    nothing = np.empty(0, np.float32)
    found = cv2.remap(values, at, nothing, cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(found, np.float32).ravel()


def reach(values: Map, point: Array, w: float, h: float) -> Array:
    """How far (4,) the positive part of a map reaches left, up, right, down of a point, px.

    The rows and columns of a box (w, h) around the point are summed, and the sums followed
    outward for at most REACH box sizes to where their total is greatest.
    """
    height, width = values.shape
    x, y = (min(max(int(p), 1), n - 2) for p, n in zip(point, (width, height), strict=True))
    rows = values[:, max(x - int(0.5 * w), 0) : x + int(0.5 * w) + 1].sum(axis=1)
    columns = values[max(y - int(0.5 * h), 0) : y + int(0.5 * h) + 1].sum(axis=0)
    far_x, far_y = int(REACH * w) + 2, int(REACH * h) + 2
    lines = columns[x::-1][:far_x], rows[y::-1][:far_y], columns[x:][:far_x], rows[y:][:far_y]
    ends = np.array([line.cumsum().argmax() for line in lines], float)
    ends += (point[0] - x, point[1] - y, x + 1.0 - point[0], y + 1.0 - point[1])
    return ends
