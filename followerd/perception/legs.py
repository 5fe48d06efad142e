"""People at the height of their legs: one candidate for every leg, and for every pair of legs.

Arras et al. 2007 name the features of a leg (width, returns, neighbours); the figures are ours,
from recordings. A candidate is no verdict: two legs give one each, and one as a pair.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.geometry import Array
from followerd.messages import Clusters, Scan
from followerd.perception.clusters import ClusterSettings, find_clusters
from followerd.settings import Settings

Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]

REACH = 2  # beams to either side in which a return looks for its like
LEG = 0.1  # m, of a leg's width that is counted on
BESIDE = 0.12  # m beside a leg in which the edge of what hides the other one lies
WINDOW = 24  # beams, the most that this can be
SOLID = 0.6  # share of the returns of that width that a leg shows, and noise does not


class LegSettings(Settings):
    """What a leg looks like, at any angular resolution."""

    max_range_m: float = Field(8.0, gt=0, description="legs farther away are too few returns")
    speckle_m: float = Field(0.2, gt=0, description="a return with no neighbour this near is none")
    clusters: ClusterSettings = ClusterSettings(jump_m=0.12, jump_share=0.0)
    one_leg_m: float = Field(0.3, gt=0, description="widest single leg; wider is a pair, touching")
    depth_m: float = Field(0.05, ge=0, description="from a leg's visible side to its middle")
    stride_m: float = Field(0.65, gt=0, description="farthest apart two legs of one person are")
    hidden_by_m: float = Field(0.25, gt=0, description="a neighbour nearer by this hides a leg")
    beside_m: float = Field(0.12, ge=0, description="from one leg to the middle, the other hidden")


@dataclass(frozen=True, slots=True, eq=False)
class People:
    """The M candidates in one scan; in `base`."""

    stamp: float  # s, of the scan
    position: Array  # (M, 2) m, between the legs as far as they are seen
    both: Mask  # (M,) two legs, not one
    legs: Indices  # (M, 2) the leg or the two legs it is made of: rows of `leg`
    width: Array  # (M,) m, of the single cluster, or from leg to leg
    count: Indices  # (M,) returns
    leg: Array  # (K, 2) m, middles of the legs

    def without(self, those: Mask) -> "People":
        """All but the candidates `those` (M,); the legs stay."""
        kept = ~those
        return replace(
            self,
            position=self.position[kept],
            both=self.both[kept],
            legs=self.legs[kept],
            width=self.width[kept],
            count=self.count[kept],
        )


def find_people(scan: Scan, settings: LegSettings, foreground: Mask | None = None) -> People:
    """Every leg and pair of legs; `foreground` (N,) are the beams that no mapped wall explains."""
    real = despeckled(scan, settings)
    shown = real if foreground is None else real & foreground
    kept = replace(scan, ranges=np.where(shown, scan.ranges, np.nan))
    found = find_clusters(kept, kept.points(), settings.clusters)
    share = LEG / (np.maximum(found.range, LEG) * scan.angle_increment)  # returns of a whole leg
    is_leg = (found.count >= np.clip(share * 0.5, 2, 3).astype(int)) & (
        found.width < settings.clusters.max_leg_width_m
    )
    legs = np.flatnonzero(is_leg)
    laser = np.array([scan.base_from_laser.x, scan.base_from_laser.y])
    centre, width, count = found.centre[legs], found.width[legs], found.count[legs]
    ray = centre - laser
    away = np.sqrt(np.einsum("ij,ij->i", ray, ray))
    ray /= np.maximum(away, 1e-6)[:, None]
    middle = centre + settings.depth_m * ray
    wide = width > settings.one_leg_m
    single = np.flatnonzero(~wide)
    one, other = _pairs(middle[single], settings.stride_m)
    one, other = single[one], single[other]
    ranges = np.where(real, scan.ranges, np.inf)
    nearer_than = away - settings.hidden_by_m
    step = scan.angle_increment
    side = np.where(wide, 0.0, _hidden_side(ranges, step, found, legs, nearer_than))
    left = np.column_stack([-ray[:, 1], ray[:, 0]])
    apart = middle[one] - middle[other]
    each = np.arange(legs.size)
    return People(
        stamp=scan.stamp,
        position=np.vstack(
            [
                middle + settings.beside_m * side[:, None] * left,
                0.5 * (middle[one] + middle[other]),
            ]
        ),
        both=np.concatenate([wide, np.ones(one.size, np.bool_)]),
        legs=np.vstack([np.column_stack([each, each]), np.column_stack([one, other])]),
        width=np.concatenate([width, np.sqrt(np.einsum("ij,ij->i", apart, apart))]),
        count=np.concatenate([count, count[one] + count[other]]),
        leg=middle,
    )


def despeckled(scan: Scan, settings: LegSettings) -> Mask:
    """Which beams (N,) are returns in reach with enough neighbours of about their range.

    In the sun single beams report what is not there. A leg far away, or seen by a coarse scanner,
    has few beams: then one neighbour will do.
    """
    ranges = scan.ranges
    real: Mask = np.isfinite(ranges) & (ranges > 0.0) & (ranges < settings.max_range_m)
    r = np.where(real, ranges, np.nan)
    support = np.zeros(r.size, np.intp)
    for k in range(1, REACH + 1):
        alike = np.abs(r[k:] - r[:-k]) < settings.speckle_m
        support[k:] += alike
        support[:-k] += alike
    whole = LEG / (scan.angle_increment * np.maximum(np.where(real, ranges, 1.0), LEG))
    return real & (support >= np.clip(0.5 * whole, 1.0, 2.0).astype(np.intp))


def speckle(scan: Scan) -> float:
    """Share of the beams between two without echo that have one themselves."""
    echo = np.isfinite(scan.ranges)
    free = ~(echo[:-2] | echo[2:])
    return float((echo[1:-1] & free).sum()) / max(float(free.sum()), 1.0)


def _pairs(middle: Array, stride: float) -> tuple[Indices, Indices]:
    apart = middle[:, None] - middle
    near = np.einsum("ijk,ijk->ij", apart, apart) < stride * stride
    one, other = np.nonzero(np.triu(near, 1))
    return one, other


def _hidden_side(
    ranges: Array, step: float, found: Clusters, legs: Indices, nearer_than: Array
) -> Array:
    """Where a nearer edge hides the other leg: 1 left, -1 right of it, 0 if neither or both."""
    beams = np.clip(BESIDE / (np.maximum(found.range[legs], BESIDE) * step), 1, WINDOW)
    off = np.arange(1, WINDOW + 1)
    framed = np.pad(ranges, WINDOW, constant_values=np.inf)
    nearer = off <= beams[:, None]
    right = framed[found.first[legs, None] + WINDOW - off] < nearer_than[:, None]
    left = framed[found.last[legs, None] + WINDOW + off] < nearer_than[:, None]
    side: Array = (left & nearer).any(axis=1).astype(float) - (right & nearer).any(axis=1)
    return side
