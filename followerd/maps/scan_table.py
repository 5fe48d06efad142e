"""A map as the scans that would be taken on it: histograms of x and y of the end points, for every
free place and heading (Kwolek 2004, section 5).

A histogram lies in one 64-bit word, a byte for each bin: 180 beams overflow none. So a place, a
heading and a beam cost one look-up and one addition, whatever the number of bins.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil, cos, pi, radians, sin

import numpy as np
import numpy.typing as npt

from followerd.errors import ConfigError
from followerd.geometry import Array
from followerd.maps.floor import OccupancyGrid

BEAMS = 180  # of a histogram's scan, 1 degree apart, the first one 90 degrees to the right
DIRECTIONS = 360
HEADINGS = 90
HEADING_STEP = 2 * pi / HEADINGS  # rad
LEVELS = 1024  # of a range in the look-up tables
BLOCK = 1024  # places counted at a time: they and their table stay in the cache
REACH_PERCENTILE = 95
COARSEST = 0.3  # m; a table of wider cells tells no places apart

Bytes = npt.NDArray[np.uint8]
Indices = npt.NDArray[np.intp]
Progress = Callable[[float], None]  # share done, 0..1


@dataclass(frozen=True, slots=True)
class TableShape:
    """What a table is made by, beside the map."""

    bins: int = 8  # of x and as many of y, at most 8
    max_range: float = 8.0  # m, echoes from beyond count as none, here and in scans
    max_bytes: int = 100_000_000

    @property
    def row_bytes(self) -> int:
        """Of one place: all its headings."""
        return HEADINGS * 2 * self.bins


@dataclass(frozen=True, slots=True, eq=False)
class ScanTable:
    """Histograms of K free places. Bins: x from 0 to `reach`, y from -reach to reach, ends open."""

    counts: Bytes  # (K, HEADINGS, 2 bins)
    places: npt.NDArray[np.int32]  # (H, W) row of `counts`, -1 where the robot cannot be
    cell: float  # m
    origin: tuple[float, float]  # m, lower left corner of places[0, 0] in `map`
    reach: float  # m
    max_range: float  # m

    @property
    def bins(self) -> int:
        """Of x, and as many of y."""
        return int(self.counts.shape[2]) // 2

    def centres(self) -> Array:
        """The free places (K, 2), m, in the order of `counts`."""
        j, i = np.nonzero(self.places >= 0)
        return (np.column_stack([i, j]) + 0.5) * self.cell + self.origin

    def rows(self, poses: Array) -> Indices:
        """The row (N,) of counts.reshape(-1, 2 bins) for each pose (3, N); -1: not free."""
        x, y, theta = poses
        i = np.floor((x - self.origin[0]) / self.cell).astype(np.intp)
        j = np.floor((y - self.origin[1]) / self.cell).astype(np.intp)
        height, width = self.places.shape
        inside = (i >= 0) & (i < width) & (j >= 0) & (j < height)
        place = np.where(inside, self.places[np.where(inside, j, 0), np.where(inside, i, 0)], -1)
        heading = np.round(theta / HEADING_STEP).astype(np.intp) % HEADINGS
        rows: Indices = np.where(place < 0, -1, place * HEADINGS + heading)
        return rows

    def histogram(self, points: Array) -> Array:
        """Counts (2 bins,) of end points (N, 2) in `laser`, scaled to all BEAMS; 0 if none."""
        near = points[np.hypot(points[:, 0], points[:, 1]) <= self.max_range]
        counts = np.zeros(2 * self.bins)
        x, y = np.clip(bin_of(near.T, self.reach, self.bins), 0, self.bins - 1)
        np.add.at(counts, x, 1.0)
        np.add.at(counts, y + self.bins, 1.0)
        return counts * (BEAMS / max(len(near), 1))


def bin_of(points: Array, reach: float, bins: int) -> Indices:
    """The bin (2, N), not yet clipped, of x and y (2, N)."""
    x, y = points
    share = np.stack([x / reach, 0.5 * (y + reach) / reach])
    indices: Indices = np.floor(share * bins).astype(np.intp)
    return indices


def stride_of(grid: OccupancyGrid, shape: TableShape) -> int:
    """Cells of the map to one of the table, the fewest that fit the memory; raises ConfigError."""
    free = int(grid.free.sum())
    stride = 1
    while free / stride**2 * shape.row_bytes > shape.max_bytes:
        stride += 1
    if stride > 1 and stride * grid.cell > COARSEST + 1e-6:
        coarsest = max(int(COARSEST / grid.cell + 1e-6), 1)
        need = free / coarsest**2 * shape.row_bytes / 1e6
        raise ConfigError(
            f"localizer: the map's {free * grid.cell**2:.0f} m² of floor need {need:.0f} MB of "
            f"scan histograms, {shape.max_bytes / 1e6:.0f} are allowed: raise max_table_mb or use "
            "kind: likelihood_field"
        )
    return stride


def place_rows(grid: OccupancyGrid, stride: int) -> npt.NDArray[np.int32]:
    """Table cells by row and column: their number where the map is free in the middle, else -1."""
    free = grid.free[stride // 2 :: stride, stride // 2 :: stride]
    rows = np.full(free.shape, -1, np.int32)
    rows[free] = np.arange(int(free.sum()))
    return rows


def build(grid: OccupancyGrid, shape: TableShape, progress: Progress | None = None) -> ScanTable:
    """Cast 360 rays once from every place; each heading counts the half circle ahead of it."""
    stride = stride_of(grid, shape)
    places = place_rows(grid, stride)
    ranges = _levels(grid, stride, shape.max_range)
    seen = ranges[ranges < LEVELS]
    reach = float(np.percentile(seen, REACH_PERCENTILE)) if seen.size else LEVELS - 1.0
    reach *= shape.max_range / (LEVELS - 1)
    counts = np.empty((ranges.shape[1], HEADINGS, 2 * shape.bins), np.uint8)
    for block, rows in _counted(ranges, _words(shape, reach), shape.bins):
        counts[block] = rows
        if progress:
            progress(block.stop / len(counts))
    return ScanTable(counts, places, stride * grid.cell, grid.origin, reach, shape.max_range)


def ranges_along(grid: OccupancyGrid, angle: float) -> Array:
    """Range (H, W) m from the middle of every cell to the first wall at `angle`; inf: none.

    The map is sheared so that the ray becomes a row: the next occupied cell of every cell is then
    one running minimum from the end.
    """
    occupied = grid.occupied
    c, s = cos(angle), sin(angle)
    steep = abs(s) > abs(c)
    if steep:
        occupied, c, s = occupied.T, s, c
    back = c < 0.0
    if back:
        occupied, c = occupied[:, ::-1], -c
    height, width = occupied.shape
    shift = np.round(np.arange(width) * (s / c)).astype(np.intp)  # rows that a ray has climbed
    shift -= shift.min()
    column = np.arange(width)
    row = np.arange(height)[:, None] + shift.max() - shift
    sheared = np.zeros((height + int(shift.max()), width), np.bool_)
    sheared[row, column] = occupied
    wall = np.where(sheared, column, 2 * width).astype(np.int32)
    wall = np.minimum.accumulate(wall[:, ::-1], axis=1)[:, ::-1]
    steps = (wall - column)[row, column]
    far: Array = np.where(steps >= width, np.inf, steps * (grid.cell / c))
    if back:
        far = far[:, ::-1]
    return far.T if steep else far


def _levels(grid: OccupancyGrid, stride: int, max_range: float) -> npt.NDArray[np.int16]:
    """Ranges (DIRECTIONS, K) in levels up to `max_range`; LEVELS: no echo."""
    start = stride // 2
    free = grid.free[start::stride, start::stride]
    levels = np.empty((DIRECTIONS, int(free.sum())), np.int16)
    for k in range(DIRECTIONS):
        ranges = ranges_along(grid, radians(k))[start::stride, start::stride][free]
        scaled = np.round(np.minimum(ranges, 2 * max_range) * ((LEVELS - 1) / max_range))
        levels[k] = np.minimum(scaled, LEVELS)
    return levels


def _words(shape: TableShape, reach: float) -> npt.NDArray[np.uint64]:
    """What a beam at a level adds (2, BEAMS, LEVELS + 1): one in the byte of its bin of x, of y."""
    bearings = np.radians(np.arange(BEAMS) - BEAMS // 2)
    ranges = np.arange(LEVELS) * (shape.max_range / (LEVELS - 1))
    ends = np.stack([np.outer(np.cos(bearings), ranges), np.outer(np.sin(bearings), ranges)])
    chosen = np.clip(bin_of(ends.reshape(2, -1), reach, shape.bins), 0, shape.bins - 1)
    words = np.zeros((2, BEAMS, LEVELS + 1), np.uint64)
    one = np.uint64(1) << (np.uint64(8) * chosen.astype(np.uint64))
    words[:, :, :LEVELS] = one.reshape(2, BEAMS, LEVELS)
    return words


def _counted(
    levels: npt.NDArray[np.int16], words: npt.NDArray[np.uint64], bins: int
) -> Iterator[tuple[slice, Bytes]]:
    """The histograms (n, HEADINGS, 2 bins) of one block of places after the other."""
    ahead = (np.arange(HEADINGS) * (DIRECTIONS // HEADINGS))[:, None]
    ahead = (ahead + np.arange(BEAMS) - BEAMS // 2) % DIRECTIONS  # (HEADINGS, BEAMS)
    total = levels.shape[1]
    for number in range(ceil(total / BLOCK)):
        block = slice(number * BLOCK, min((number + 1) * BLOCK, total))
        looked_up = levels[:, block].astype(np.intp)
        sums = np.zeros((2, HEADINGS, looked_up.shape[1]), np.uint64)
        added = np.empty_like(sums[0])
        for beam in range(BEAMS):
            seen = looked_up[ahead[:, beam]]
            for axis in range(2):
                np.take(words[axis, beam], seen, out=added, mode="clip")
                sums[axis] += added
        split = sums.astype("<u8").view(np.uint8).reshape(2, HEADINGS, -1, 8)[..., :bins]
        yield block, split.transpose(2, 1, 0, 3).reshape(-1, HEADINGS, 2 * bins)
