"""Shortest ways over a mapped floor to many goals, computed once: how far, and which way to go.

Points of the plane are complex numbers x + iy, m. Ways keep `clearance` from every wall and step
between cells to 8 + 8 neighbours, so that they are at most 3 % too long.
"""

from dataclasses import dataclass
from math import ceil, hypot

import cv2
import numpy as np
import numpy.typing as npt

from followerd.errors import ConfigError
from followerd.geometry import Array
from followerd.maps.floor import FloorMap

Complex = npt.NDArray[np.complex128]
Indices = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float32]

BORDER = 2  # cells round the floor, never free: the longest step
STEPS = [(r, c) for r in range(-2, 3) for c in range(-2, 3) if abs(r) + abs(c) in (1, 3)]
STEPS += [(r, c) for r in (-1, 1) for c in (-1, 1)]
DOWN = [(r, c) for r, c in STEPS if r < 0]  # from the rows above
MOST_GOALS = 100
SETTLED = 1e-4  # m


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """Where a person may walk: a grid whose cell (row, column) lies at y, x."""

    free: Mask  # (H, W), its border never free
    corner: complex  # centre of cell (0, 0)
    cell: float  # m

    @classmethod
    def of(cls, segments: Array, clearance: float = 0.28, cell: float = 0.1) -> "Floor":
        """The largest connected free part within the bounds of walls (M, 4) as x0 y0 x1 y1."""
        low, high = segments.reshape(-1, 2).min(axis=0), segments.reshape(-1, 2).max(axis=0)
        columns, rows = (ceil(side / cell) + 1 + 2 * BORDER for side in (high - low).tolist())
        corner = complex(*low.tolist()) - BORDER * cell * (1 + 1j)
        at = corner + cell * (np.arange(columns) + 1j * np.arange(rows)[:, None])
        free = np.ones((rows, columns), np.bool_)
        for ax, ay, bx, by in segments.tolist():
            start, along = complex(ax, ay), complex(bx - ax, by - ay)
            off = at - start
            part = np.clip((off * along.conjugate()).real / max(abs(along) ** 2, 1e-12), 0.0, 1.0)
            free &= np.abs(off - part * along) >= clearance
        for edge in (free, free.T):
            edge[:BORDER] = edge[-BORDER:] = False
        return cls(_largest(free), corner, cell)

    @classmethod
    def on(cls, floor: FloorMap, clearance: float = 0.28, cell: float = 0.1) -> "Floor":
        """The largest connected part of a map's free floor."""
        grid = floor.grid
        away = cv2.distanceTransform(grid.free.astype(np.uint8), cv2.DIST_L2, 5) * grid.cell
        rows, columns = (int(side * grid.cell / cell) for side in away.shape)
        row, column = (
            ((np.arange(count) + 0.5) * cell / grid.cell).astype(np.intp)
            for count in (rows, columns)
        )
        free = np.pad(away[np.ix_(row, column)] >= clearance, BORDER)
        corner = complex(*grid.origin) + (0.5 - BORDER) * cell * (1 + 1j)
        return cls(_largest(free), corner, cell)

    def cells(self, z: Complex) -> Indices:
        """Flat indices (N,) of the cells of points (N,); points outside are in the border."""
        rows, columns = self.free.shape
        at = (z - self.corner) / self.cell + (0.5 + 0.5j)
        row = at.imag.astype(np.intp).clip(0, rows - 1)
        index: Indices = row * columns + at.real.astype(np.intp).clip(0, columns - 1)
        return index

    def centres(self) -> Complex:
        """Centres (H * W,) of the cells."""
        rows, columns = self.free.shape
        steps = np.arange(columns) + 1j * np.arange(rows)[:, None]
        return (self.corner + self.cell * steps.ravel()).astype(np.complex128)


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """Per goal the distance left from every cell, and the direction to walk in.

    The last row of `direction` is for who has no goal: 0 on free floor. Off the free floor every
    row leads back to it, and on.
    """

    floor: Floor
    goals: Complex  # (G,)
    distance: Floats  # (G, H * W) m, inf off the free floor
    direction: npt.NDArray[np.complex64]  # (G + 1, H * W), of length 1 or 0

    @classmethod
    def over(cls, floor: Floor, spacing: float = 0.8) -> "Ways":
        """To goals every `spacing`, m; farther apart where they would be more than MOST_GOALS.

        Raises ConfigError where there is no room to walk.
        """
        area = float(np.count_nonzero(floor.free)) * floor.cell**2
        every = max(round(max(spacing, (area / MOST_GOALS) ** 0.5) / floor.cell), 1)
        lattice = np.zeros_like(floor.free)
        lattice[BORDER + every // 2 :: every, BORDER + every // 2 :: every] = True
        goals = np.flatnonzero(floor.free & lattice)
        if not goals.size:
            raise ConfigError("the map has no free floor that a person could walk on")
        distance = _distances(floor, goals).reshape(goals.size, -1)
        ahead = _next_cells(floor, distance)
        centres = floor.centres()
        off = np.vstack([centres[ahead] - centres, np.zeros((1, centres.size))])
        nearest = _nearest_free(floor)
        off = _unit(_unit(off[:, nearest]) + _unit(centres[nearest] - centres))
        direction = off.astype(np.complex64)
        return cls(floor, centres[goals], distance, direction)


def _largest(free: Mask) -> Mask:
    """The largest connected part of the free cells."""
    _, parts, stats, _ = cv2.connectedComponentsWithStats(free.astype(np.uint8))
    if len(stats) < 2:
        return free
    largest: Mask = parts == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    return largest


def _unit(vectors: Complex) -> Complex:
    """The same directions at length 1; 0 stays 0."""
    return vectors / np.maximum(np.abs(vectors), 1e-9)


def _distances(floor: Floor, goals: Indices) -> Floats:
    """Distance (G, H, W) to each goal, by sweeps over rows and columns until nothing changes."""
    distance = np.full((goals.size, *floor.free.shape), np.inf, np.float32)
    distance.reshape(goals.size, -1)[np.arange(goals.size), goals] = 0.0
    wall = np.where(floor.free, np.float32(0.0), np.float32(np.inf))
    views = [(distance, wall), (distance.swapaxes(1, 2), wall.T)]
    views += [(swept[:, ::-1], limits[::-1]) for swept, limits in views]
    while True:
        before = distance.copy()
        for swept, limits in views:
            _sweep(swept, limits, floor.cell)
        reached = np.isfinite(distance)
        if np.all(before[reached] - distance[reached] < SETTLED):
            return distance


def _sweep(distance: Floats, wall: Floats, cell: float) -> None:
    """Let every row in turn take the better ways that lead over the two rows before it."""
    rows, columns = wall.shape
    for row in range(BORDER, rows - BORDER):
        best = distance[:, row, BORDER : columns - BORDER]
        for dr, dc in DOWN:
            over = distance[:, row + dr, BORDER + dc : columns - BORDER + dc]
            best = np.minimum(best, over + np.float32(cell * hypot(dr, dc)))
        distance[:, row, BORDER : columns - BORDER] = best + wall[row, BORDER : columns - BORDER]


def _next_cells(floor: Floor, distance: Floats) -> Indices:
    """The neighbour (G, H * W) over which the way to each goal leads; the goal leads to itself."""
    free = np.flatnonzero(floor.free)
    chosen = np.tile(np.arange(floor.free.size), (len(distance), 1))
    left = np.where(distance[:, free] == 0.0, np.float32(-1.0), np.float32(np.inf))
    for dr, dc in STEPS:
        there = free + dr * floor.free.shape[1] + dc
        over = distance[:, there] + np.float32(floor.cell * hypot(dr, dc))
        better = over < left
        left = np.where(better, over, left)
        chosen[:, free] = np.where(better, there, chosen[:, free])
    return chosen


def _nearest_free(floor: Floor) -> Indices:
    """The free cell (H * W,) nearest to each."""
    _, labels = cv2.distanceTransformWithLabels(
        (~floor.free).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_label = np.zeros(int(labels.max()) + 1, np.intp)
    of_label[labels[floor.free]] = np.flatnonzero(floor.free)
    nearest: Indices = of_label[labels.ravel()]
    return nearest
