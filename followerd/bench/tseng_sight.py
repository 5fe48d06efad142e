"""From a scan to the candidates that every tracker of suite `tseng` is given."""

import numpy as np

from followerd.estimation.occluded import Sweep
from followerd.geometry import Array, Pose2
from followerd.messages import Scan
from followerd.perception.foreground import ForegroundSettings, foreground
from followerd.perception.legs import LegSettings, find_people

PAIRED = 0.4  # m from somebody with two legs, a single leg is one of theirs


def sighted(
    scan: Scan, map_from_base: Pose2, sigmas: tuple[float, float], segments: Array
) -> Sweep:
    """The candidates in a map of `segments` (M, 4); `sigmas` of the pose, m and rad."""
    shown = foreground(scan, segments.reshape(-1, 2, 2), map_from_base, ForegroundSettings())
    people = find_people(scan, LegSettings(), shown)
    at = map_from_base.apply(people.position)
    z = at[:, 0] + 1j * at[:, 1]
    both = people.both
    kept = both.copy()
    if both.any():
        kept |= np.abs(z[:, None] - z[both]).min(axis=1) > PAIRED
    else:
        kept[:] = True
    return Sweep(
        stamp=scan.stamp,
        map_from_laser=map_from_base @ scan.base_from_laser,
        position_sigma=sigmas[0],
        heading_sigma=sigmas[1],
        angle_min=scan.angle_min,
        angle_increment=scan.angle_increment,
        ranges=scan.ranges,
        people=z[kept],
        both=both[kept],
    )
