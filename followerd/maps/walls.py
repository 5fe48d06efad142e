"""The straight walls of a grid: contours of its free floor, split and merged."""

from itertools import pairwise
from math import pi, radians

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array, wrap_angle
from followerd.maps.floor import OccupancyGrid

SPLIT = 1.1  # cells off its chord that split a contour
SHORTEST = 0.4  # m
TURN = radians(6.0)  # between neighbours that are one wall
BULGE = 0.6  # cells, deviation of what is one wall

Mask = npt.NDArray[np.bool_]


def walls_of(grid: OccupancyGrid) -> Array:
    """Faces (K, 2, 2) of walls, m, each with the free floor on its left from end to end.

    A wall with free floor on both sides has two faces. They lie in the middle of the occupied
    cells nearest to the free ones.
    """
    contours, _ = cv2.findContours(
        grid.free.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
    )
    # with rows upward, OpenCV goes round with the free cells on the right
    rounds = [np.asarray(contour, np.int32).reshape(-1, 2)[::-1] for contour in contours]
    walls = [
        wall for cells in rounds for run in _runs(cells, grid.occupied) for wall in _straight(run)
    ]
    if not walls:
        return np.empty((0, 2, 2))
    ends = (np.array(walls) + 0.5) * grid.cell + np.array(grid.origin)
    lengths = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    long: Array = ends[lengths >= SHORTEST]
    return long


def _runs(contour: npt.NDArray[np.int32], occupied: Mask) -> list[Array]:
    """The parts of a closed contour of free cells (N, 2) that follow occupied cells.

    Each is given by the occupied cells beside it, x and y in cells; the floor lies on the left.
    """
    ahead = np.roll(contour, -2, axis=0) - np.roll(contour, 2, axis=0)
    # to the right of the way, where the wall is: the first occupied of a few cells outward
    right = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    sizes = np.maximum(np.abs(right).max(axis=1), 1)
    height, width = occupied.shape
    beside = np.full((len(contour), 2), np.nan)
    for reach in (2, 1):
        at = contour + np.rint(right * (reach / sizes[:, None])).astype(int)
        inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
        at = np.where(inside[:, None], at, 0)
        hit = inside & occupied[at[:, 1], at[:, 0]]
        beside[hit] = at[hit]
    gaps = np.flatnonzero(np.isnan(beside[:, 0]))
    if gaps.size:
        beside = np.roll(beside, -int(gaps[0]) - 1, axis=0)
    parts = np.split(beside, np.flatnonzero(np.isnan(beside[:, 0])) + 1)
    return [run for run in (part[np.isfinite(part[:, 0])] for part in parts) if len(run) > 2]


def _straight(run: Array) -> list[Array]:
    """Walls (2, 2) in cells along a run of cells: split at corners, neighbours in line merged."""
    corners = _corners(run)
    pieces = [run[a : b + 1] for a, b in pairwise(corners) if b - a >= 2]
    merged: list[Array] = []
    for piece in pieces:
        if merged and _is_one(merged[-1], piece):
            merged[-1] = np.concatenate([merged[-1], piece])
        else:
            merged.append(piece)
    return [fitted(piece) for piece in merged]


def _corners(run: Array) -> list[int]:
    """Indices at which a run is split so that no cell lies farther than SPLIT from its chord."""
    waiting, corners = [(0, len(run) - 1)], [0]
    while waiting:
        a, b = waiting.pop()
        chord, off = run[b] - run[a], run[a : b + 1] - run[a]
        length = float(np.hypot(*chord))
        # a closed run ends where it begins
        apart = (
            np.abs(off[:, 0] * chord[1] - off[:, 1] * chord[0]) / length
            if length > 1.0
            else np.hypot(*off.T)
        )
        worst = int(apart.argmax())
        if apart[worst] > SPLIT and 0 < worst < b - a:
            waiting += [(a + worst, b), (a, a + worst)]
        else:
            corners.append(b)
    return corners


def _is_one(one: Array, other: Array) -> bool:
    """Whether two neighbouring pieces lie in one line and go the same way."""
    a, b = fitted(one), fitted(other)
    turn = wrap_angle(_direction(b) - _direction(a))
    noise = 1.0 / max(min(len(one), len(other)), 1)  # a cell's width of doubt
    if abs(turn) > TURN + noise:
        return False
    both = np.concatenate([one, other])
    way = fitted(both)
    normal = np.array([-np.sin(_direction(way)), np.cos(_direction(way))])
    return float(((both - both.mean(axis=0)) @ normal).std()) < BULGE


def _direction(wall: Array) -> float:
    dx, dy = (wall[1] - wall[0]).tolist()
    return float(np.arctan2(dy, dx))


def fitted(points: Array) -> Array:
    """The segment (2, 2) through points (N, 2) by total least squares, in their order."""
    centre = points.mean(axis=0)
    x, y = (points - centre).T
    theta = 0.5 * np.arctan2(2.0 * float(x @ y), float(x @ x - y @ y))
    if abs(wrap_angle(theta - _direction(points[[0, -1]]))) > 0.5 * pi:
        theta += pi
    along = np.array([np.cos(theta), np.sin(theta)])
    t = (points - centre) @ along
    return np.asarray(centre + np.outer([t.min(), t.max()], along))
