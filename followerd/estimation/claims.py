"""Beams that say nothing of the map, because the followed person stands in them."""

import numpy as np

from followerd.geometry import Array
from followerd.messages import Scan

PERSON = 0.5  # m around the person


def unclaimed(scan: Scan, person: tuple[float, float] | None) -> Array:
    """End points (N, 2) in `base`, m; nan without an echo and on the person."""
    points = scan.points()
    if person is not None:
        with np.errstate(invalid="ignore"):
            points[np.hypot(points[:, 0] - person[0], points[:, 1] - person[1]) < PERSON] = np.nan
    return points


def bridged(points: Array, scan: Scan) -> Array:
    """The same with the gap behind a person filled by a straight wall between its sides."""
    seen = np.isfinite(points[:, 0])
    claimed = np.flatnonzero(np.isfinite(scan.ranges) & ~seen)
    if claimed.size and seen.any():
        known = np.flatnonzero(seen)
        for axis in range(2):
            points[claimed, axis] = np.interp(claimed, known, points[known, axis])
    return points
