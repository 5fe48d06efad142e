"""Scores of boxes on a map of log colour ratios."""

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.perception.window import Part

Map = npt.NDArray[np.float32]

RING = 1.5  # outer size of the ring around a box, of the box
REACH = 1.0  # box sizes from its middle that a person's edge is looked for
NONE, HALF, NOTHING = np.float32(0.0), np.float32(0.5), np.empty(0, np.float32)
WIDEST = 32_000  # points: OpenCV remaps onto fewer than 2^15 columns
LEAST_SEEN = 0.3  # share of a box: with less in view, scores fade


def contrast(values: Map, seen: Part, w: float, h: float) -> Map:
    """For boxes (w, h) around every pixel: mean inside less half the mean in a ring around.

    Means are over what is `seen` (elsewhere the values are 0), but at least over LEAST_SEEN of
    the box. Sizes are rounded to odd pixels.
    """
    inner, outer = (_odd(w), _odd(h)), (_odd(RING * w), _odd(RING * h))
    areas = np.array([[[inner[0] * inner[1]]], [[outer[0] * outer[1]]]], np.float32)
    areas[1] -= areas[0]
    sums = np.empty((2, *values.shape), np.float32)
    inside: Map
    inside, ring = sums
    for box, out in ((inner, inside), (outer, ring)):
        border = cv2.BORDER_CONSTANT
        cv2.boxFilter(values, cv2.CV_32F, box, out, normalize=False, borderType=border)
    ring -= inside
    if is_whole(seen, values):
        sums /= areas
    else:
        # what a box holds of a rectangle: its share of the rows times that of the columns
        rows, columns = _overlaps(values.shape, seen, inner, outer)
        areas_seen = rows[:, :, None] * columns[:, None]
        areas_seen[1] -= areas_seen[0]
        sums /= np.maximum(areas_seen, np.float32(LEAST_SEEN) * areas, out=areas_seen)
    ring *= HALF
    inside -= ring
    return inside


def is_whole(part: Part, values: Map) -> bool:
    """Whether nothing of a map (H, W) lies outside `part`."""
    height, width = (s.stop - s.start for s in part)
    return (height, width) == values.shape


def _overlaps(
    shape: tuple[int, ...], seen: Part, inner: tuple[int, int], outer: tuple[int, int]
) -> tuple[Map, Map]:
    """How many rows (2, H) and columns (2, W) of `seen` lie in either box around each place."""
    (height, width), (rows, columns) = shape, seen
    first, last = _ends(max(height, width), inner, outer)
    start, stop = (rows.start, columns.start), (rows.stop, columns.stop)
    overlaps: Map = np.minimum(last, np.array([stop, stop], np.float32).reshape(4, 1))
    overlaps -= np.maximum(first, np.array([start, start], np.float32).reshape(4, 1))
    np.maximum(overlaps, NONE, out=overlaps)
    return overlaps[::2, :height], overlaps[1::2, :width]


@lru_cache(maxsize=8)
def _ends(count: int, inner: tuple[int, int], outer: tuple[int, int]) -> tuple[Map, Map]:
    """Where the rows and columns of the inner box, then of the outer, begin and end (4, count)."""
    reach = np.array([[inner[1] // 2], [inner[0] // 2], [outer[1] // 2], [outer[0] // 2]])
    at = np.arange(count)
    return (at - reach).astype(np.float32), (at + reach + 1).astype(np.float32)


def _odd(size: float) -> int:
    return 2 * int(0.5 * size) + 1


def sampled(values: Map, points: Array, cell: float = 1.0) -> Array:
    """Interpolated values (N,) of a map at points (N, 2); a value of the map is `cell` px large."""
    if len(points) > WIDEST:
        parts = np.array_split(points, -(-len(points) // WIDEST))
        return np.concatenate([sampled(values, part, cell) for part in parts])
    at = np.empty((1, len(points), 2), np.float32)
    np.divide(points, cell, out=at[0], casting="same_kind")
    at -= HALF
    found = cv2.remap(values, at, NOTHING, cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(found, np.float32).ravel()


def reach(values: Map, x: float, y: float, w: float, h: float) -> list[float]:
    """How far the positive part of a map reaches left, up, right, down of a point, px.

    The rows and columns of a box (w, h) around the point are summed, and the sums followed
    outward for at most REACH box sizes to where their total is greatest.
    """
    height, width = values.shape
    column, row = min(max(int(x), 1), width - 2), min(max(int(y), 1), height - 2)
    half_w, half_h = int(0.5 * w), int(0.5 * h)
    rows = values[:, max(column - half_w, 0) : column + half_w + 1].sum(axis=1)
    columns = values[max(row - half_h, 0) : row + half_h + 1].sum(axis=0)
    far_x, far_y = int(REACH * w) + 2, int(REACH * h) + 2
    return [
        int(columns[column::-1][:far_x].cumsum().argmax()) + x - column,
        int(rows[row::-1][:far_y].cumsum().argmax()) + y - row,
        int(columns[column:][:far_x].cumsum().argmax()) + column + 1.0 - x,
        int(rows[row:][:far_y].cumsum().argmax()) + row + 1.0 - y,
    ]
