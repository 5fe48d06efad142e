"""From a scan to what a person filter is given: who may be a person, on the map."""

import numpy as np

from followerd.estimation.occluded import Sweep
from followerd.geometry import Pose2
from followerd.messages import Scan
from followerd.perception.legs import People

PAIRED = 0.4  # m from somebody with two legs, a single leg is one of theirs


def sweep_of(
    scan: Scan, people: People, map_from_base: Pose2, sigmas: tuple[float, float]
) -> Sweep:
    """The candidates of a scan taken at a pose known to `sigmas`, m and rad."""
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
