"""What a map does not explain: the beams of a scan that ended on something new.

Two tests, both needed: shorter than the wall behind would allow, and away from every wall. With the
first alone every tenth scan shows a ghost at the end of a board, where a beam just misses it.
"""

from math import radians

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view
from pydantic import Field

from followerd.geometry import Array, Pose2
from followerd.messages import Scan
from followerd.settings import Settings

Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]

PARALLEL = 1e-12  # a beam this parallel to a wall misses it


class ForegroundSettings(Settings):
    """How far map and pose may be wrong."""

    shorter_m: float = Field(0.15, ge=0, description="than the mapped wall, to be before it")
    within_deg: float = Field(2.5, ge=0, description="to either side, whose nearest wall counts")
    from_walls_m: float = Field(0.17, ge=0, description="from every wall")
    from_walls_share: float = Field(0.01, ge=0, description="of the range, more than that")


def foreground(
    scan: Scan, walls: Array, map_from_base: Pose2, settings: ForegroundSettings
) -> Mask:
    """Which beams (N,) end on what is not in the map: `walls` (K, 2, 2), ends in `map`, m."""
    ends = (~map_from_base).apply(walls.reshape(-1, 2)).reshape(-1, 2, 2)
    ends = (~scan.base_from_laser).apply(ends.reshape(-1, 2)).reshape(-1, 2, 2)
    ranges = scan.ranges
    beams = np.flatnonzero(np.isfinite(ranges))
    shown = np.zeros(ranges.size, np.bool_)
    if not len(ends):
        shown[beams] = True
        return shown
    expected = _nearest(_expected(scan.angles, ends), scan.angle_increment, settings)
    beams = beams[ranges[beams] < expected[beams] - settings.shorter_m]
    ways = np.column_stack([np.cos(scan.angles[beams]), np.sin(scan.angles[beams])])
    points = ranges[beams, None] * ways
    margin = settings.from_walls_m + settings.from_walls_share * ranges[beams]
    shown[beams] = _to_walls(points, ends) > margin
    return shown


def on_walls(points: Array, first: Indices, last: Indices, walls: Array, within: float) -> Mask:
    """Which groups (M,) of a scan's end points lie whole on walls, to `within` m.

    `first` and `last` (M,) are a group's first and last row of `points` (N, 2).
    """
    whole = np.zeros(len(first), np.bool_)
    for k, (start, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        group = points[start : end + 1]
        group = group[np.isfinite(group[:, 0])]
        whole[k] = bool((_to_walls(group, walls) < within).all())
    return whole


def _expected(angles: Array, walls: Array) -> Array:
    """Range (N,) at which each beam from the origin meets the first wall; inf where none."""
    dx, dy = np.cos(angles)[:, None], np.sin(angles)[:, None]
    (ax, ay), (ex, ey) = walls[:, 0].T, (walls[:, 1] - walls[:, 0]).T
    across = dx * ey - dy * ex
    across[np.abs(across) < PARALLEL] = np.nan
    along = (ax * ey - ay * ex) / across
    share = (ax * dy - ay * dx) / across
    hit = (along > 0.0) & (share >= 0.0) & (share <= 1.0)
    ranges: Array = np.where(hit, along, np.inf).min(axis=1)
    return ranges


def _nearest(ranges: Array, step: float, settings: ForegroundSettings) -> Array:
    """The least of the neighbours' ranges (N,)."""
    reach = round(radians(settings.within_deg) / step)
    framed = np.pad(ranges, reach, constant_values=np.inf)
    least: Array = sliding_window_view(framed, 2 * reach + 1).min(axis=1)
    return least


def _to_walls(points: Array, walls: Array) -> Array:
    """Distance (N,) of points to the nearest wall."""
    start, along = walls[:, 0], walls[:, 1] - walls[:, 0]
    off = points[:, None] - start
    length = np.maximum(np.einsum("kj,kj->k", along, along), PARALLEL)
    share = np.clip(np.einsum("nkj,kj->nk", off, along) / length, 0.0, 1.0)
    off -= share[..., None] * along
    distance: Array = np.sqrt(np.einsum("nkj,nkj->nk", off, off).min(axis=1, initial=np.inf))
    return distance
