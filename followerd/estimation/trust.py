"""Whether the camera is believed about who the person is, given what the laser saw.

Once the person's legs were known, a track that is lost, that leaps, or that stands where the laser
sees no legs though nothing hides them, is believed again only together with legs: where the
person can have walked since, and not where somebody else's stood meanwhile. Whoever the camera
finds after a longer time may be anybody in like clothes, and is enrolled anew (FAILSAFES F8, F9).
"""

from math import cos, dist, hypot, inf, sin

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.estimation.own_legs import LONGEST_STEP
from followerd.geometry import Array, Pose2
from followerd.messages import Clusters
from followerd.settings import Settings


class TrustSettings(Settings):
    """What ends trust, and what gives it back."""

    empty_s: float = Field(0.4, gt=0, description="the laser sees through the person's place")
    through_s: float = Field(0.2, gt=0, description="and it sees somebody else's legs there")
    body_m: float = Field(0.25, gt=0, description="aside of a line that a person hides")
    bare_s: float = Field(2.0, gt=0, description="it sees no legs there, nor through")
    hidden_s: float = Field(5.0, gt=0, description="something hides the legs, if there are any")
    walled_s: float = Field(1.0, gt=0, description="something as wide as a wall does")
    wall_m: float = Field(2.0, gt=0, description="that wide")
    hidden_share: float = Field(
        0.4, gt=0, lt=1, description="of the place: less than that leaves one leg to be seen"
    )
    legs_m: float = Field(0.55, gt=0, description="somebody else's legs hide more as they move")
    past_s: float = Field(0.7, gt=0, description="the camera sees somebody beside the legs")
    laser_m: float = Field(5.0, gt=0, description="farther off legs fall between the beams")
    leg_m: float = Field(0.12, gt=0, description="but not where returns are closer together")
    beside_m: float = Field(0.45, gt=0, description="of the place, where legs would be")
    agree_s: float = Field(0.5, gt=0, description="camera and legs agree, before trust returns")
    gap_s: float = Field(0.25, gt=0, description="longest break in that")
    blind_s: float = Field(
        1.0, gt=0, description="without a scan, or a picture, anybody may have come"
    )
    soon_s: float = Field(5.0, gt=0, description="who is agreed on later may be anybody")
    walk_mps: float = Field(2.0, gt=0, description="nobody is farther from where they were last")
    slack_m: float = Field(0.7, gt=0, description="than this speed explains, but for this much")
    others_m: float = Field(0.7, gt=0, description="from the person's legs: somebody else's")
    same_m: float = Field(0.35, gt=0, description="from where those stand now: still theirs")
    off_wall_m: float = Field(
        0.12, gt=0, description="legs stand before the line of their neighbours"
    )
    leap_m: float = Field(0.2, gt=0, description="farthest that those go between two scans")
    swing_mps: float = Field(2.5, gt=0, description="or as fast as a leg swings")
    most_doubt_s: float = Field(2.0, gt=0, description="before the tracker is told to look anew")


class Trust:
    """The laser's word on the camera's claim; positions are in `odom`, m."""

    def __init__(self, settings: TrustSettings | None = None) -> None:
        self.settings = settings or TrustSettings()
        self.forget()

    def forget(self) -> None:
        """Another person: believed until the laser has seen legs."""
        self.given = True
        self.why = ""  # it is not
        self.refuted_at = -inf  # s, the camera's claim was last seen to be wrong
        self.place: tuple[float, float] | None = None  # of the person, when last sure
        self._sure_at = -inf  # s
        self._others: Array = np.empty((0, 2))  # leg-like things that are not the person
        self._against = 0.0  # evidence that nobody is there; 1 suffices
        self._scanned_at = -inf  # s
        self._legs_at = -inf  # s, free-standing legs were last found at the camera's place
        self._agreed_since = self._agreed_at = -inf  # s
        self._held_at = -inf  # s, the camera had the person, and was believed
        self._was_blind = False  # the laser, before the camera was doubted
        self._is_anybody = False  # whom the camera has: only the operator can tell

    def hold(self, stamp: float) -> None:
        """The camera has somebody, and the laser may speak against it."""
        if self.given and stamp - self._scanned_at <= self.settings.gap_s:
            self._held_at = stamp

    def doubt(self, why: str, stamp: float) -> None:
        """From now on the camera must be borne out by legs, if they were ever known."""
        if self.given and self.place is not None:
            self.given, self.why = False, why
            self._agreed_at, self.refuted_at = -inf, stamp

    def doubt_unknown(self) -> None:
        """The camera was blind: who is not known by the legs yet must be shown again."""
        if self.place is None and self._scanned_at > -inf:
            self.given, self.why = False, "the camera was blind before the legs were known"
            self._is_anybody = True

    def agree(self, place: tuple[float, float], stamp: float) -> None:
        """The camera confirms that the legs at `place` are the person's."""
        s = self.settings
        if stamp - self._legs_at > s.gap_s:
            return
        if self.place is not None and not self._can_be(place, stamp):
            self.doubt("the camera has somebody who cannot be the person", stamp)
            self._refute(stamp)
            return
        if self.given:
            self.place, self._sure_at = place, stamp
            return
        if stamp - self._agreed_at > s.gap_s:
            self._agreed_since = stamp
        self._agreed_at = stamp
        is_late = self._agreed_since - self._held_at > s.soon_s or self._is_anybody
        if stamp - self._agreed_since >= s.agree_s and not is_late:
            self.given, self.why, self._was_blind = True, "", False
            self.place, self._sure_at, self._against = place, stamp, 0.0

    def is_on_another(self, base: Pose2, sight: float) -> bool:
        """Whether somebody else's legs are where the camera looks, along `sight` in `odom`."""
        ahead, aside = _along(self._others - (base.x, base.y), sight)
        return bool(((ahead > 0.0) & (np.abs(aside) < self.settings.same_m)).any())

    def reach(self, stamp: float) -> float:
        """How far the person can be from `place` by now, m."""
        return self.settings.slack_m + self.settings.walk_mps * max(0.0, stamp - self._sure_at)

    def scan(
        self,
        clusters: Clusters,
        points: Array,
        base: Pose2,
        claim: tuple[float, float, float] | None,
        found: npt.NDArray[np.intp],
    ) -> None:
        """One scan taken at `base`: end points (N, 2) there.

        `claim`: range, bearing and sigma of the place where the camera has the person, if it has;
        `found` the clusters there that may be legs.
        """
        s, stamp = self.settings, clusters.stamp
        if stamp - self._scanned_at > s.blind_s:
            self._was_blind = self.place is not None
            self.doubt("the laser was blind meanwhile", stamp)
        dt, self._scanned_at = min(stamp - self._scanned_at, s.gap_s), stamp
        maybe = clusters.leg_like | clusters.thin
        legs: Array = base.apply(clusters.centre[maybe])
        leap = max(s.leap_m, s.swing_mps * min(dt, LONGEST_STEP))
        own = [k for k in found.tolist() if _stands_free(clusters, k, points, s.off_wall_m)]
        if own and (self.given or clusters.range[own].min() < s.laser_m):
            self._legs_at = stamp
        if self.given and own:
            middle = base.apply(clusters.centre[own]).mean(axis=0)
            if self._is_anothers(middle):
                self.doubt("the camera has somebody who was another before", stamp)
                self._refute(stamp)
        if self._was_blind and self.place is not None:
            self._is_anybody |= self._are_several(clusters, points, base, self.place)
        if self.given and own and stamp - self._sure_at <= s.gap_s:
            off = np.hypot(*(legs - middle).T)
            beyond = (off > s.others_m) & clusters.leg_like[maybe]
            passing = (off > s.same_m) & self._were_others(legs, leap)
            self._others = legs[beyond | passing]
        elif len(self._others) and len(legs):
            self._follow_others(legs, leap)
        if own:
            self._against = 0.0
        elif claim is not None:
            is_through = self._sees_another_behind(legs, leap, base, *claim[:2])
            against = self._speaks_against(clusters, points, *claim)
            self._against += dt * max(against, is_through / s.through_s)
            if self._against >= 1.0:
                self.doubt("no legs where the camera has the person", stamp)
                self._refute(stamp)
        if not self.given and stamp - self.refuted_at > s.most_doubt_s > 0.0:
            self._refute(stamp)

    def _are_several(
        self, clusters: Clusters, points: Array, base: Pose2, place: tuple[float, float]
    ) -> bool:
        """Whether legs of more than one stand where the person can have come from `place`."""
        s = self.settings
        free = [
            k
            for k in clusters.leg_like.nonzero()[0].tolist()
            if _stands_free(clusters, k, points, s.off_wall_m)
        ]
        legs: Array = base.apply(clusters.centre[free])
        reach = self.reach(clusters.stamp)
        near = legs[np.hypot(*(legs - place).T) < reach]
        return len(near) > 0 and bool((np.hypot(*(near - near[0]).T) > s.others_m).any())

    def _refute(self, stamp: float) -> None:
        self.refuted_at, self._agreed_at, self._against = stamp, -inf, 0.0

    def _can_be(self, place: tuple[float, float], stamp: float) -> bool:
        """Whether the person can have come to `place`, and nobody else was there before."""
        if self.place is None or dist(place, self.place) > self.reach(stamp):
            return False
        return not self._is_anothers(place)

    def _is_anothers(self, place: tuple[float, float] | Array) -> bool:
        """Whether somebody else is known to stand at `place`."""
        apart = np.hypot(*(self._others - place).T)
        return bool((apart < self.settings.same_m).any())

    def _were_others(self, legs: Array, leap: float) -> npt.NDArray[np.bool_]:
        """Which of `legs` (K, 2) somebody else has just brought to where they are."""
        apart = np.hypot(*(legs[:, None] - self._others[None]).transpose(2, 0, 1))
        were: npt.NDArray[np.bool_] = (apart < leap).any(axis=1)
        return were

    def _follow_others(self, legs: Array, leap: float) -> None:
        """Whoever is not the person stays that while walking from scan to scan."""
        apart = np.hypot(*(self._others[:, None] - legs[None]).transpose(2, 0, 1))
        nearest = apart.argmin(axis=1)
        moved = apart[np.arange(len(apart)), nearest] < leap
        self._others[moved] = legs[nearest[moved]]

    def _sees_another_behind(
        self, legs: Array, leap: float, base: Pose2, distance: float, bearing: float
    ) -> bool:
        """Whether legs (K, 2) that are somebody else's are seen through a place in `base`."""
        along, aside = _along((~base).apply(legs[self._were_others(legs, leap)]), bearing)
        behind = along > distance + self.settings.same_m
        return bool((behind & (np.abs(aside) < self.settings.body_m)).any())

    def _speaks_against(
        self, clusters: Clusters, points: Array, distance: float, bearing: float, sigma: float
    ) -> float:
        """Evidence per second that nobody stands at a place in `base` where no legs were found."""
        s = self.settings
        along = points @ (cos(bearing), sin(bearing))
        aside = points @ (-sin(bearing), cos(bearing))
        there = np.flatnonzero(np.abs(distance * aside) < s.beside_m * along)
        if there.size < 2:  # no echo, or not swept
            angles = np.arctan2(points[:, 1], points[:, 0])
            return float((angles < bearing).any() and (angles > bearing).any()) / s.bare_s
        ranges = along[there]
        doubt = hypot(2.0 * sigma, s.beside_m)
        hides = ranges < distance - doubt
        if hides.any():
            width = clusters.width[_cluster(clusters, there[ranges.argmin()])]
            if width < s.legs_m or hides.mean() > s.hidden_share:
                is_wall = hides.all() and width > s.wall_m
                return 1.0 / (s.walled_s if is_wall else s.hidden_s)
        seen = there[~hides]
        is_empty = float(along[seen].min()) > distance + doubt
        is_wall = clusters.width[_cluster(clusters, seen[0])] > s.wall_m
        if is_empty or (is_wall and _bulge(points[seen]) < s.off_wall_m):
            is_dense = seen.size * s.leg_m > 2.0 * s.beside_m
            return 1.0 / (s.empty_s if is_dense or distance <= s.laser_m else s.bare_s)
        return 1.0 / s.bare_s


def _along(points: Array, direction: float) -> tuple[Array, Array]:
    """How far points (N, 2) are ahead in a direction, and aside of it to the left."""
    x, y = points.T
    c, s = cos(direction), sin(direction)
    return x * c + y * s, y * c - x * s


def _cluster(clusters: Clusters, beam: np.intp) -> np.intp:
    """The index of the one that has a beam's return."""
    return clusters.first.searchsorted(beam, "right") - 1


def _bulge(points: Array) -> float:
    """How far anything of a row of returns (N, 2) stands before the line from end to end, m."""
    x, y = (points[-1] - points[0]).tolist()
    off = (x * (points[:, 1] - points[0, 1]) - y * (points[:, 0] - points[0, 0])) / hypot(x, y)
    towards = y * points[0, 0] - x * points[0, 1]  # on which side the robot is
    return float((off if towards > 0.0 else -off).max())


def _stands_free(clusters: Clusters, k: int, points: Array, off_m: float) -> bool:
    """Whether a cluster stands out from its neighbours; a wall seen at a low angle falls apart."""
    before, after = clusters.first.item(k) - 1, clusters.last.item(k) + 1
    if before < 0 or after >= len(points):
        return True
    a, b = points[before], points[after]
    along = b - a
    length = float(np.hypot(*along))
    if not length > 0.0:  # a neighbour without return is free space
        return True
    off = clusters.centre[k] - a
    return bool(abs(along[0] * off[1] - along[1] * off[0]) > off_m * length)
