"""Groups of neighbouring returns of a scan, split where the range jumps."""

import numpy as np
from pydantic import Field

from followerd.geometry import Array
from followerd.messages import Clusters, Scan
from followerd.settings import Settings


class ClusterSettings(Settings):
    """Where a scan is cut."""

    jump_m: float = Field(0.12, gt=0, description="gap between neighbours that separates them")
    jump_share: float = Field(0.03, ge=0, description="more gap per metre of range")
    max_missing_beams: int = Field(2, ge=0, description="missing beams bridged inside a cluster")
    max_leg_width_m: float = Field(0.55, gt=0, description="widest pair of touching legs")
    hidden_by_m: float = Field(0.4, gt=0, description="a neighbour nearer by this hides a part")
    min_beams: int = Field(2, ge=1, description="fewest returns of a leg")
    leg_m: float = Field(0.1, gt=0, description="of which fewer meet one no wider, far off")


def find_clusters(scan: Scan, points: Array, settings: ClusterSettings) -> Clusters:
    """Jump-distance segmentation; `points` (N, 2) are the scan's end points in `base`."""
    beams = np.flatnonzero(np.isfinite(scan.ranges))
    if beams.size == 0:
        none, empty = np.empty(0, np.intp), np.empty(0)
        return Clusters(
            scan.stamp, none, none, none, np.empty((0, 2)), empty, empty, empty, empty,
            np.empty(0, np.bool_), np.empty(0, np.bool_),
        )  # fmt: skip
    seen, ranges = points[beams], scan.ranges[beams]
    steps = seen[1:] - seen[:-1]
    limit = settings.jump_m + settings.jump_share * np.minimum(ranges[1:], ranges[:-1])
    # beside a missing beam is free space
    gap, cut = np.ones((2, beams.size + 1), np.bool_)
    gap[1:-1] = beams[1:] - beams[:-1] > settings.max_missing_beams + 1
    cut[1:-1] = gap[1:-1] | (np.einsum("ij,ij->i", steps, steps) > limit * limit)
    start, end = cut[:-1].nonzero()[0], cut[1:].nonzero()[0]
    count = end - start + 1
    centre: Array = np.add.reduceat(seen, start, axis=0) / count[:, None]
    extent = seen[end] - seen[start]
    distance = np.sqrt(np.einsum("ij,ij->i", seen, seen))
    before = np.where(gap[start], np.inf, ranges[start - 1])
    after = np.where(gap[end + 1], np.inf, ranges[(end + 1) % ranges.size])
    hides = settings.hidden_by_m
    in_front = (before > ranges[start] - hides) & (after > ranges[end] - hides)
    width = np.sqrt(np.einsum("ij,ij->i", extent, extent))
    is_narrow = in_front & (width < settings.max_leg_width_m)
    is_full = count >= settings.min_beams
    sparse = distance[start] * scan.angle_increment * settings.min_beams > settings.leg_m
    return Clusters(
        stamp=scan.stamp,
        first=beams[start],
        last=beams[end],
        count=count,
        centre=centre,
        bearing=np.arctan2(centre[:, 1], centre[:, 0]),
        range=np.sqrt(np.einsum("ij,ij->i", centre, centre)),
        nearest=np.minimum.reduceat(distance, start),
        width=width,
        leg_like=is_narrow & is_full,
        thin=is_narrow & ~is_full & sparse,
    )
