"""Which legs in a scan are the followed person's, and whose the others are.

Scan by scan: legs that come in from outside the gate stay somebody else's.
"""

from dataclasses import dataclass
from math import atan2, dist, hypot, inf, nan, radians

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.geometry import Pose2, wrap_angle
from followerd.messages import Clusters
from followerd.settings import Settings

LONGEST_STEP = 0.12  # s, over which a leg is known again by its place alone
LONGEST_SWING = 0.2  # s


class OwnLegsSettings(Settings):
    """What the legs of one person look like, and what hides them."""

    leg_radius_m: float = Field(0.05, ge=0, description="from a leg's visible side to its middle")
    leg_width_m: float = Field(0.2, gt=0, description="widest that one leg looks")
    stride_m: float = Field(0.7, gt=0, description="farthest apart two legs of one person are")
    cone_deg: float = Field(7.0, gt=0, description="half width of the bearing cone for legs")
    sight_m: float = Field(0.4, gt=0, description="aside of the camera's line, at first")
    before_m: float = Field(0.35, gt=0, description="nearer than the person: somebody else's legs")
    hides_m: float = Field(0.25, gt=0, description="aside of the line of sight, that still hide")
    others_m: float = Field(1.0, ge=0, description="beyond the reach of the person's own legs")
    leap_m: float = Field(0.15, gt=0, description="farthest that a leg moves between two scans")
    swing_mps: float = Field(
        2.5, gt=0, description="or as fast as a leg swings, where they are few"
    )
    others_s: float = Field(
        0.25, ge=0, description="somebody else's legs may go unseen, as when two look like one"
    )
    pair_m: float = Field(0.5, gt=0, description="a leg so near somebody else's is theirs, too")
    max_hidden_s: float = Field(
        1.0, ge=0, description="behind somebody's legs the person is foreseen, not looked for"
    )
    mistaken_s: float = Field(
        1.5, ge=0, description="without the person's legs somebody else's may be theirs after all"
    )


@dataclass(frozen=True, slots=True)
class Expected:
    """Where the legs are looked for, from `base`."""

    bearing: float  # rad
    distance: float | None = None  # m; None = nothing is known but the direction
    reach: float = inf  # m, off that place
    sight: float | None = None  # rad; legs not seen just before stand near the camera's line
    believed: bool = True  # whoever looks there is; else nobody else's legs become the person's


@dataclass(frozen=True, slots=True)
class Other:
    """A leg that is somebody else's."""

    place: tuple[float, float]  # m in `odom`
    seen: float  # s, last
    is_sure: bool  # once seen well apart from the person's own in one scan
    is_lasting: bool  # seen in two scans: no mixed return of a beam that grazed an edge


class OwnLegs:
    """The person's legs and the others' near them, when last seen."""

    def __init__(self, settings: OwnLegsSettings) -> None:
        self.settings = settings
        self.forget()

    def forget(self) -> None:
        """Nobody's legs are known."""
        self.seen_at = -inf  # s
        self.hidden = False  # by somebody else's legs, in the newest scan
        self.alone = False  # nobody else's were in reach in the newest scan, or the one before
        self._was_alone = False  # in the newest
        self._own: list[tuple[float, float]] = []  # m in `odom`
        self._others: list[Other] = []  # not farther than `others_m`

    @property
    def middle(self) -> tuple[float, float]:
        """Of the legs found last, in `odom`, m; nan before the first."""
        n = len(self._own)
        if not n:
            return nan, nan
        return sum(x for x, _ in self._own) / n, sum(y for _, y in self._own) / n

    def find(self, clusters: Clusters, base: Pose2, expected: Expected) -> npt.NDArray[np.intp]:
        """The one or two clusters that are the person's legs; `base` is `odom_from_base` then.

        Nearest to the expected place within the gate, and none while somebody else's legs stand
        before it; with no expectation the nearest of the cone, for whoever stood before the person
        would hide them from the camera too.
        """
        s = self.settings
        fits: list[tuple[float, int]] = []
        others: list[tuple[float, float]] = []
        crowd = 0
        self.hidden = False
        stamp = clusters.stamp
        if expected.believed and stamp - self.seen_at > s.mistaken_s:
            self._others = [other for other in self._others if other.is_sure]

        def at(k: int) -> tuple[float, float]:
            return base.apply_point(*clusters.centre[k].tolist())

        # what is too thin to be told for a leg may still be one that was known
        for k in (clusters.leg_like | clusters.thin).nonzero()[0].tolist():
            near = clusters.range.item(k)
            distance = near + s.leg_radius_m
            angle = abs(wrap_angle(clusters.bearing.item(k) - expected.bearing))
            aside = near * angle
            in_cone = angle < radians(s.cone_deg) + atan2(0.5 * s.stride_m, max(near, 0.3))
            known = expected.distance
            off = distance + aside if known is None else hypot(distance - known, aside)
            if off > expected.reach + s.others_m:
                continue
            point = at(k)
            was_anothers = self._was_anothers(point, clusters.width.item(k), stamp)
            if not (was_anothers or clusters.leg_like.item(k)):
                continue
            if off > expected.reach or was_anothers:
                others.append(point)
                crowd += off <= expected.reach
            elif in_cone and self._is_in_line(near, clusters.bearing.item(k), expected.sight):
                fits.append((off, k))
            if known is not None and known - distance > s.before_m and aside < s.hides_m:
                self.hidden |= not self._are_own(point, stamp)
        late = [other.place for other in self._late(stamp)]
        theirs = [k for _, k in fits if self._is_beside(at(k), others + late)]
        others += map(at, theirs)
        if self.hidden:
            self.alone = self._was_alone = False
            self._remember(others, stamp)
            return np.empty(0, np.intp)
        found = np.array([k for _, k in sorted(fits) if k not in theirs], np.intp)
        if found.size:
            gaps = np.hypot(*(clusters.centre[found] - clusters.centre[found[0]]).T)
            found = found[gaps < s.stride_m][:2]
            self._own = [base.apply_point(*centre) for centre in clusters.centre[found].tolist()]
            self.seen_at = clusters.stamp
        self._remember(others, stamp)
        is_alone = not crowd and found.size == len(fits)
        self.alone, self._was_alone = is_alone or self._was_alone, is_alone
        return found

    def is_hidden(self, stamp: float) -> bool:
        """Whether the person has just gone behind somebody else's legs."""
        return self.hidden and stamp - self.seen_at <= self.settings.max_hidden_s

    def _is_in_line(self, near: float, bearing: float, sight: float | None) -> bool:
        return sight is None or near * abs(wrap_angle(bearing - sight)) < self.settings.sight_m

    def _are_own(self, point: tuple[float, float], stamp: float) -> bool:
        """Whether the person's leg can have swung to `point`, and nobody else's can."""
        s, since = self.settings, stamp - self.seen_at
        leap = max(s.leap_m, s.swing_mps * min(since, LONGEST_SWING))
        own = min((dist(point, leg) for leg in self._own), default=inf)
        theirs = min((dist(point, other.place) for other in self._others), default=inf)
        return own < min(leap, theirs)

    def _was_anothers(self, point: tuple[float, float], width: float, stamp: float) -> bool:
        """Whether a leg at `point` in odom was somebody else's just before, or touches one."""
        near = [
            off
            for other in self._others
            if (off := dist(point, other.place)) <= self._leap(stamp - other.seen) + 0.5 * width
        ]
        if not near:
            return False
        is_several = width > self.settings.leg_width_m
        return is_several or all(dist(point, own) > min(near) for own in self._own)

    def _is_beside(self, point: tuple[float, float], others: list[tuple[float, float]]) -> bool:
        """Whether a leg stands beside somebody else's, and nearer to it than to the person's."""
        theirs = min((dist(point, other) for other in others), default=inf)
        if theirs > self.settings.pair_m:
            return False
        return all(dist(point, own) > theirs for own in self._own)

    def _remember(self, others: list[tuple[float, float]], stamp: float) -> None:
        """Whose legs are somebody else's; where one was that is not seen now, it may yet be."""
        s, here, own_seen = self.settings, [], self.seen_at == stamp
        gone = self._late(stamp)
        for place in others:
            same = [o for o in self._others if dist(place, o.place) <= self._leap(stamp - o.seen)]
            gone = [other for other in gone if other not in same]
            is_apart = own_seen and dist(place, self.middle) > s.others_m
            is_sure = is_apart or any(other.is_sure for other in same)
            is_lasting = bool(same) or any(
                o.is_lasting and dist(place, o.place) <= s.pair_m for o in self._others
            )
            here.append(Other(place, stamp, is_sure, is_lasting))
        self._others = here + gone

    def _late(self, stamp: float) -> list[Other]:
        """Somebody else's legs that may still be there if they are not seen at `stamp`."""
        lasts = self.settings.others_s
        return [o for o in self._others if o.is_lasting and stamp - o.seen <= lasts]

    def _leap(self, since: float) -> float:
        """How far a leg goes between two scans, m."""
        s = self.settings
        return max(s.leap_m, s.swing_mps * min(since, LONGEST_STEP))
