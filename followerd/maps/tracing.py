"""An occupancy grid from scans at known poses, by log odds (Moravec and Elfes 1985).

Every scan votes once for each cell: what lies between the robot and the surfaces it sees is free,
the surfaces are occupied. Between neighbouring beams a surface goes on unless there is a jump.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil, floor, log

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array, Pose2
from followerd.maps.floor import OccupancyGrid
from followerd.messages import Scan

REACH = 20.0  # m, returns from farther away blur more than they tell
GAP, GAP_SHARE = 0.15, 0.10  # m, and of the range: a wider gap between neighbours is a jump
HIT, MISS = 1.6, 0.75  # log odds of one scan: two must see a floor before it is free
OCCUPIED, FREE = log(0.65 / 0.35), log(0.196 / 0.804)  # as map_server's usual thresholds
MARGIN = 0.5  # m around what was seen
FINE = 4  # bits of a cell's fraction when it is drawn
NO_VOTE, IS_FREE, IS_SURFACE = 0, 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What one scan saw, in `map`."""

    origin: tuple[float, float]  # m, the laser
    ends: Array  # (N, 2) m, of the beams in order; nan without a return within REACH

    @classmethod
    def of(cls, scan: Scan, pose: Pose2) -> "View":
        """The view of a scan taken at `pose`, `map_from_base`."""
        origin = pose.apply_point(scan.base_from_laser.x, scan.base_from_laser.y)
        ends = pose.apply(scan.points())
        ends[~(scan.ranges <= REACH)] = np.nan
        return cls(origin, ends)


class Tracer:
    """Collects the votes of scans over the area that `views` cover."""

    def __init__(self, views: Iterable[View], cell: float) -> None:
        seen = [np.vstack([[view.origin], view.ends]) for view in views]
        lowest = np.min([np.nanmin(points, axis=0) for points in seen], axis=0) - MARGIN
        highest = np.max([np.nanmax(points, axis=0) for points in seen], axis=0) + MARGIN
        self.cell = cell
        self.origin = (floor(lowest[0] / cell) * cell, floor(lowest[1] / cell) * cell)
        width, height = (
            ceil((high - low) / cell) for high, low in zip(highest, self.origin, strict=True)
        )
        self._odds = np.zeros((height, width), np.float32)
        self._votes = np.zeros((height, width), np.uint8)

    def add(self, view: View) -> None:
        """Take the votes of one scan."""
        origin = (np.array(view.origin) - self.origin) / self.cell
        ends = (view.ends - self.origin) / self.cell
        seen = np.isfinite(ends[:, 0])
        if not seen.any():
            return
        outline = np.where(seen[:, None], ends, origin)
        around = np.vstack([outline, origin])
        left, bottom = np.floor(around.min(axis=0)).astype(int)
        right, top = np.floor(around.max(axis=0)).astype(int) + 1
        area = (slice(bottom, top), slice(left, right))
        votes = self._votes[area]
        votes[:] = NO_VOTE
        _draw(votes, outline - (left, bottom), origin - (left, bottom), seen, self.cell)
        self._odds[area] += np.array([0.0, -MISS, HIT], np.float32)[votes]

    def grid(self) -> OccupancyGrid:
        """What the votes come to."""
        return OccupancyGrid(self._odds > OCCUPIED, self._odds < FREE, self.cell, self.origin)


def _draw(
    votes: npt.NDArray[np.uint8],
    ends: Array,
    origin: Array,
    seen: npt.NDArray[np.bool_],
    cell: float,
) -> None:
    """Draw the free floor, what is unsure at its rim, and then the surfaces; all in cells."""
    cv2.fillPoly(votes, [_fine(np.vstack([origin, ends]))], IS_FREE, shift=FINE)
    joined, jumps = _chords(ends, origin, GAP / cell)
    # along a wall seen at a grazing angle a jump's chord is the wall itself
    cv2.polylines(votes, list(_fine(jumps)), False, NO_VOTE, shift=FINE)
    points = ends[seen]
    pieces = np.concatenate([joined, np.stack([points, points], axis=1)])
    cv2.polylines(votes, list(_fine(pieces)), False, IS_SURFACE, shift=FINE)


def surfaces(ends: Array, origin: tuple[float, float]) -> Array:
    """Pieces (M, 2, 2) of the surfaces that beams from `origin` met at `ends` (N, 2), m."""
    joined, _ = _chords(ends, np.array(origin), GAP)
    points = ends[np.isfinite(ends[:, 0])]
    return np.concatenate([joined, np.stack([points, points], axis=1)])


def _chords(ends: Array, origin: Array, gap: float) -> tuple[Array, Array]:
    """What lies between neighbouring ends: on one surface, and across jumps (M, 2, 2)."""
    chords = np.stack([ends[:-1], ends[1:]], axis=1)
    away = np.hypot(*(ends - origin).T)
    limit = np.maximum(gap, GAP_SHARE * np.minimum(away[:-1], away[1:]))
    lengths = np.hypot(*(ends[1:] - ends[:-1]).T)
    return chords[lengths <= limit], chords[lengths > limit]


def _fine(points: Array) -> npt.NDArray[np.int32]:
    """For OpenCV, to which a cell's middle is a whole number."""
    return np.asarray(np.rint((points - 0.5) * (1 << FINE)), np.int32)
