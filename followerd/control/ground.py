"""The floor around the robot in cells: shortest ways over it, and lines of sight.

The wave that measures the ways spreads by turns to 4 and to 8 neighbours, so that they are within
a tenth of the truth, and at half the speed where it is narrow. Points of the plane are (x, y) in
`odom`, m; cells stay where they are while the robot moves.
"""

from functools import lru_cache
from math import floor

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array

Cells = npt.NDArray[np.uint8]
Indices = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

CELL = 0.1  # m
HALF = 48  # cells from the robot's to the edge
SIDE = 2 * HALF + 1
MOST = 150  # steps of the wave, of which those through narrow places count twice
NEIGHBOURS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
AROUND = np.array([dy * SIDE + dx for dx, dy in NEIGHBOURS])
CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
SQUARE = np.ones((3, 3), np.uint8)
WITHIN = np.ones((9, 9), np.uint8)  # cells that count as the same way
SAMPLE = 0.2  # m between the points of a line that are looked at
SOLID = 0.11  # m; nearer to a return no line of sight is relied on

Point = tuple[float, float]


class Ground:
    """A square of floor with the robot in its middle."""

    def __init__(self, obstacles: Array, here: Point, narrow: float, wide: float) -> None:
        """The returns `obstacles` (N, 2) keep the robot's middle `narrow` m away, best `wide` m."""
        self.here = here
        self._first = floor(here[0] / CELL) - HALF, floor(here[1] / CELL) - HALF
        empty = np.ones(SIDE * SIDE, np.uint8)
        inside = self._inside(obstacles)
        empty[self._cells(obstacles[inside])] = 0
        distance = cv2.distanceTransform(empty.reshape(SIDE, SIDE), cv2.DIST_L2, 5)
        self.clearance: Array = (CELL * distance).ravel()  # m from each cell to the nearest return
        self.narrow = narrow
        self.wide = wide
        self._steps: npt.NDArray[np.int16] | None = None

    def clamped(self, point: Point) -> Point:
        """The point, or where the line to it leaves the square."""
        dx, dy = point[0] - self.here[0], point[1] - self.here[1]
        most = (HALF - 2) * CELL
        share = min(1.0, most / max(abs(dx), abs(dy), most))
        return self.here[0] + share * dx, self.here[1] + share * dy

    def room(self, points: Array) -> Array:
        """From each of the points (N, 2) to the nearest return, m."""
        away: Array = self.clearance[self._cells(points)]
        return away

    def is_open(self, starts: Array, ends: Array, clearance: float) -> Mask:
        """Whether the straight lines to (N, 2), from as many or from one, keep `clearance` m.

        Not at their very start: who stands near something may go away from it.
        """
        start = self._grid(np.atleast_2d(starts))
        off = self._grid(ends) - start
        shares = _shares(int(np.abs(off).max(initial=0.0) * CELL / SAMPLE) + 2)
        column = (start[:, 0] + shares * off[:, 0]).astype(np.intp)
        row = (start[:, 1] + shares * off[:, 1]).astype(np.intp)
        clear = (self.clearance >= clearance)[row * SIDE + column]
        clear |= shares * np.hypot(off[:, 0], off[:, 1]) < clearance / CELL
        lines: Mask = clear.all(axis=0)
        return lines

    def spread(self, goal: Point, last: Array) -> None:
        """Measure the ways from the robot until `goal` is reached.

        Near the `last` way (N, 2) they count a fifth less: of two alike the robot stays on one.
        """
        passable = (self.clearance >= self.narrow).astype(np.uint8).reshape(SIDE, SIDE)
        wide = (self.clearance >= self.wide).astype(np.uint8).reshape(SIDE, SIDE)
        for middle in (self.here, goal):
            spot = self._spot(middle)
            for mask in (passable, wide):
                cv2.circle(mask, spot, round(self.narrow / CELL), 1, -1)
        kept = np.zeros((SIDE, SIDE), np.uint8)
        kept.ravel()[self._cells(last)] = 1
        cv2.dilate(kept, WITHIN, kept)
        cv2.bitwise_and(kept, passable, kept)
        masks = (passable, passable, wide, wide, kept)
        for mask in masks:
            cv2.rectangle(mask, (0, 0), (SIDE - 1, SIDE - 1), 0, 1)
        front = np.zeros((SIDE, SIDE), np.uint8)
        x, y = self._spot(self.here)
        front[y, x] = 1
        reached, grown, at = front.copy(), front.copy(), self._spot(goal)
        for step in range(1, MOST):
            cv2.dilate(front, CROSS if step % 2 else SQUARE, grown)
            cv2.bitwise_and(grown, masks[step % 5], grown)
            cv2.bitwise_or(front, grown, front)
            cv2.add(reached, front, reached)
            if front.item(at[1], at[0]):
                break
        steps = step + 1 - reached.astype(np.int16).ravel()
        steps[reached.ravel() == 0] = 2 * MOST
        self._steps = steps

    def way(self, goal: Point) -> Array:
        """The way (N, 2) from the robot to `goal`, or to the nearest place that can be reached."""
        assert self._steps is not None
        steps, at = self._steps, self._cell(goal)
        last = goal
        if steps[at] > MOST:
            reachable = np.flatnonzero(steps <= MOST)
            centres = self._centres(reachable)
            off = centres - goal
            nearest = int(np.einsum("ij,ij->i", off, off).argmin())
            at, last = int(reachable[nearest]), tuple(centres[nearest].tolist())
        cells = [at]
        while steps[at] > 1:
            around = at + AROUND
            at = int(around[steps[around].argmin()])
            cells.append(at)
        way = self._centres(np.array(cells[::-1]))
        way[0], way[-1] = self.here, last
        return way

    def _inside(self, points: Array) -> Mask:
        x, y = (points / CELL - self._first).T
        inside: Mask = (x >= 0.0) & (x < SIDE)
        inside &= (y >= 0.0) & (y < SIDE)
        return inside

    def _cells(self, points: Array) -> Indices:
        """Flat indices (N,); points outside count as at the edge."""
        at = self._grid(points).astype(np.intp)
        cells: Indices = at[:, 1] * SIDE + at[:, 0]
        return cells

    def _grid(self, points: Array) -> Array:
        """Points (N, 2) in cells from the corner; those outside are moved to the edge."""
        at: Array = np.minimum(np.maximum(points / CELL - self._first, 0.0), SIDE - 1e-6)
        return at

    def _cell(self, point: Point) -> int:
        return self._cells(np.array([point])).item()

    def _spot(self, point: Point) -> tuple[int, int]:
        row, column = divmod(self._cell(point), SIDE)
        return column, row

    def _centres(self, cells: Indices) -> Array:
        at = np.column_stack([cells % SIDE, cells // SIDE]) + self._first
        centres: Array = (at + 0.5) * CELL
        return centres


@lru_cache(maxsize=128)
def _shares(count: int) -> Array:
    """Of a line (count, 1), from its start to its end."""
    shares: Array = np.linspace(0.0, 1.0, count)[:, None]
    return shares
