"""One person across sensors: the camera's box and the laser's legs, tied by bearing and range.

Either may carry the track for a while. Legs sharpen the box's range; where they vanish, behind low
furniture, the box's range goes on alone. Where the camera fails, legs that were tied to the box and
have been followed scan by scan since, with nobody else's near, go on alone: as confirmed for
`sure_s`, then as occluded until `carry_s` (FAILSAFES F3, F8).
"""

from dataclasses import replace
from math import atan2, hypot, inf, radians, sin

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.estimation.moving_point import MovingPoint
from followerd.estimation.own_legs import Expected, OwnLegs, OwnLegsSettings
from followerd.estimation.ranging import Person, Ranging, RangingSettings, Sighting
from followerd.estimation.trust import Trust, TrustSettings
from followerd.geometry import Array, Pose2, wrap_angle
from followerd.messages import Clusters, Place, TrackPhase, TrackState
from followerd.settings import Settings

SEEN = frozenset({TrackPhase.CONFIRMED, TrackPhase.TENTATIVE})
FOLLOWED = frozenset({TrackPhase.CONFIRMED, TrackPhase.OCCLUDED})
NOBODYS = np.empty(0, np.intp)
STEADY = 0.3  # m/s, of the velocity of who is placed without one


class AssociationSettings(Settings):
    """How well each sensor measures, and how long it may carry the track alone."""

    filter: RangingSettings = RangingSettings()
    legs: OwnLegsSettings = OwnLegsSettings()
    trust: TrustSettings = TrustSettings()
    bearing_sigma_deg: float = Field(1.5, gt=0, description="of the tracker's bearing")
    beside_legs: float = Field(6.0, ge=1, description="times that, while the laser sees the legs")
    first_gate: float = Field(2.5, gt=0, description="of legs that were not seen just before")
    beside_gate: float = Field(0.5, gt=0, le=1, description="share of the gate then")
    range_sigma_m: float = Field(0.3, gt=0, description="of a track's range that names none")
    range_share: float = Field(0.1, ge=0, description="share of its range a track errs at least")
    legs_sigma_m: float = Field(0.08, gt=0, description="of the middle between the legs")
    leg_sigma_m: float = Field(0.2, gt=0, description="of it, where only one leg is seen")
    body_m: float = Field(0.45, gt=0, description="round a place, whose legs are the person's")
    max_track_age_s: float = Field(0.3, gt=0, description="older tracks claim no legs")
    gap_s: float = Field(0.25, gt=0, le=0.25, description="unseen so long, legs are not carried on")
    sure_s: float = Field(2.0, ge=0, le=2.0, description="without the camera legs are confirmed")
    carry_s: float = Field(5.0, ge=0, le=5.0, description="and may be the person at all")


class Association:
    """The ground position of the tracked person, from whatever knows it."""

    def __init__(self, settings: AssociationSettings | None = None) -> None:
        self.settings = settings or AssociationSettings()
        self._filter = Ranging(self.settings.filter)
        self._legs = OwnLegs(self.settings.legs)
        self.trust = Trust(self.settings.trust)
        self.forget()

    def forget(self) -> None:
        """Drop the person."""
        self._filter.forget()
        self._legs.forget()
        self.trust.forget()
        self._track: TrackState | None = None
        self._sight = 0.0  # rad in odom, direction in which the track was seen
        self._tied_at = -inf  # s, the camera confirmed who the legs are; -inf: they are nobody's
        self._confidence = 0.0  # then
        self._looked_past_at = inf  # s, the camera began to see somebody beside the legs
        self.claimed: tuple[slice, ...] = ()  # beams of the newest scan that show the person

    def see(self, track: TrackState, base: Pose2) -> None:
        """Take a track; `base` is `odom_from_base` at its stamp."""
        since = inf if self._track is None else self._track.stamp
        self._track = track
        if track.stamp - since > self.settings.trust.blind_s:
            self.trust.doubt_unknown()
        if track.phase is not TrackPhase.CONFIRMED:
            self.claimed = ()
        if track.phase is TrackPhase.CONFIRMED:
            self.trust.hold(track.stamp)
        elif track.phase is TrackPhase.LOST and not self.vouches(track.stamp):
            self.trust.doubt("the camera lost the person", track.stamp)
        if track.bearing is None:
            return
        if _is_of_scans(track):
            self._place(track, wrap_angle(base.theta + track.bearing))
            return
        if track.phase not in SEEN:
            return
        s, stamp = self.settings, track.stamp
        self._sight = wrap_angle(base.theta + track.bearing)
        sigma = track.range_sigma or s.range_sigma_m
        sigma = max(sigma, s.range_share * (track.range or 0.0))
        if not self._filter.begun:
            if self._filter.knows:
                self.trust.doubt("the camera's person leapt", stamp)
            if track.range is not None:
                self._start(self._seen(base, stamp, track.range, sigma))
            return
        if self._legs.is_hidden(stamp):
            return  # the box is as likely on whoever stands before the person
        has_legs = stamp - self._legs.seen_at < s.max_track_age_s
        aside = self._compare(base, stamp, has_legs=has_legs)
        seen = self._seen(base, stamp, track.range, sigma)
        if has_legs:  # a box's place errs for seconds on end, a leap still tells
            doubtful, gate = s.beside_legs * seen.bearing_sigma, s.beside_gate
            seen = replace(seen, bearing_sigma=doubtful, sigma=sigma / gate, gate=gate)
        fits = self._filter.measure(seen)
        is_theirs = fits and has_legs and aside < s.trust.same_m
        if is_theirs and track.phase is TrackPhase.CONFIRMED:
            self._tied_at, self._confidence = stamp, track.confidence
            self.trust.agree(self._legs.middle, stamp)

    def scan(self, clusters: Clusters, base: Pose2, points: Array | None = None) -> None:
        """Take the legs the current track points at; `base` is `odom_from_base` at the scan.

        `points` (N, 2) are the scan's end points in `base`; without them nothing speaks against
        the camera.
        """
        self.claimed = ()
        track, stamp = self._track, clusters.stamp
        if track is None:
            return
        if _is_of_scans(track):
            self._claim_body(track, clusters, base)
            return
        s, is_led = self.settings, self._is_led(track, stamp)
        if not is_led and not self.vouches(stamp):
            self._tied_at = -inf
            if self.person(stamp) is not None:  # lest they be mixed up until the camera is back
                self._legs.find(clusters, base, self._expected(base, stamp))
            if points is not None:
                self.trust.scan(clusters, points, base, None, NOBODYS)
            return
        is_sure = is_led and track.phase is TrackPhase.CONFIRMED
        if stamp - self._legs.seen_at > s.gap_s:
            self._tied_at = -inf
        legs = self._legs.find(clusters, base, self._expected(base, stamp))
        if points is not None:
            self._ask_laser(clusters, points, base, legs)
        if not (is_sure or self._legs.alone):
            self._tied_at = -inf
        if not legs.size:
            return
        xs, ys = clusters.centre[legs].T.tolist()
        x, y = sum(xs) / len(xs), sum(ys) / len(ys)
        distance = hypot(x, y) + s.legs.leg_radius_m
        direction = atan2(y, x)
        along = wrap_angle(base.theta + direction)
        sigma = s.legs_sigma_m if legs.size == 2 else s.leg_sigma_m
        if not self._filter.knows:
            self._sight = along
            self._start(self._seen(base, stamp, distance, sigma))
        else:
            self._filter.measure(Sighting(stamp, base, along, sigma / distance, distance, sigma))
        if is_sure and self.trust.given:
            self._claim(clusters, legs)

    def person(self, stamp: float) -> Person | None:
        """The person at `stamp`; None when the position is unknown."""
        return self._filter.person(stamp)

    def bearing(self, base: Pose2) -> float | None:
        """Where the track was last seen from the robot at `odom_from_base`, rad; None if lost."""
        if self._track is None or self._track.phase is TrackPhase.LOST:
            return None
        return wrap_angle(self._sight - base.theta)

    def measured(self, base: Pose2, stamp: float) -> Place | None:
        """Where the laser sees the person's legs, or just saw them go behind somebody else's."""
        person = self.person(stamp)
        if not self.trust.given:
            return self._not_there(base, stamp)
        is_seen = stamp - self._legs.seen_at <= self.settings.max_track_age_s
        if person is None or not (is_seen or self._legs.is_hidden(stamp)):
            return None
        return Place(*person.seen_from(base), person.sigma, is_seen)

    def located(self, track: TrackState, base: Pose2, stamp: float) -> TrackState:
        """The track with what is known at `stamp`, when the robot is at `base`.

        One of scans is known as it is, however unsure.
        """
        if track.phase is TrackPhase.LOST or _is_of_scans(track):
            return track
        if not self.trust.given or self._looks_past(track):
            track = replace(track, phase=TrackPhase.TENTATIVE)
        person = self.person(stamp)
        if person is None:
            bearing = None if track.bearing is None else wrap_angle(self._sight - base.theta)
            return replace(track, stamp=stamp, bearing=bearing, range=None, range_sigma=None)
        distance, bearing = person.seen_from(base)
        return replace(
            track,
            stamp=stamp,
            bearing=bearing,
            range=distance,
            range_sigma=person.sigma,
            position=person.position,
            velocity=person.velocity,
            covariance=person.covariance,
        )

    def vouches(self, stamp: float) -> bool:
        """Whether the legs are known to be the person's without the camera."""
        s = self.settings
        return (
            self.trust.given
            and stamp - self._tied_at <= s.carry_s
            and stamp - self._legs.seen_at <= s.gap_s
            and self._legs.alone
        )

    def carried(self, base: Pose2, stamp: float) -> TrackState | None:
        """The track by the legs alone at `stamp`; None while the camera leads, or nobody does."""
        track, s = self._track, self.settings
        if track is None or _is_of_scans(track) or not self.vouches(stamp):
            return None
        if track.phase is not TrackPhase.LOST and stamp - track.stamp <= s.max_track_age_s:
            return None
        alone_for = stamp - self._tied_at
        is_sure = alone_for <= s.sure_s
        state = TrackState(
            stamp,
            TrackPhase.CONFIRMED if is_sure else TrackPhase.OCCLUDED,
            self._confidence * max(0.0, 1.0 - alone_for / s.carry_s) if s.carry_s else 0.0,
            track.frame_id,
            by_legs=True,
        )
        return self.located(state, base, stamp)

    def _ask_laser(
        self, clusters: Clusters, points: Array, base: Pose2, legs: npt.NDArray[np.intp]
    ) -> None:
        """Whether what the laser sees bears out the camera."""
        person, track = self.person(clusters.stamp), self._track
        claim = None
        if person is not None and track is not None and track.phase in SEEN:
            claim = (*person.seen_from(base), person.sigma)
        self.trust.scan(clusters, points, base, claim, legs)

    def _compare(self, base: Pose2, stamp: float, *, has_legs: bool) -> float:
        """How far past the person's place the camera looks, m; who looks well past it sees
        somebody else."""
        person = self.person(stamp)
        place = self._legs.middle if has_legs else None if person is None else person.position
        aside = 0.0
        if place is not None:
            x, y = place[0] - base.x, place[1] - base.y
            aside = abs(hypot(x, y) * sin(self._sight - atan2(y, x)))
        is_past = aside > self.settings.trust.others_m
        self._looked_past_at = min(self._looked_past_at, stamp) if is_past else inf
        for_long = stamp - self._looked_past_at > self.settings.trust.past_s
        if for_long or (is_past and self.trust.is_on_another(base, self._sight)):
            self.trust.doubt("the camera looks past the person", stamp)
        return aside

    def _looks_past(self, track: TrackState) -> bool:
        return track.phase is TrackPhase.CONFIRMED and self._looked_past_at < inf

    def _not_there(self, base: Pose2, stamp: float) -> Place | None:
        """For a tracker that is not believed: where the person was when it last was."""
        if self.trust.place is None:
            return None
        x, y = (~base).apply_point(*self.trust.place)
        refuted = stamp - self.trust.refuted_at <= self.settings.gap_s
        return Place(hypot(x, y), atan2(y, x), self.trust.reach(stamp), seen=False, refuted=refuted)

    def _is_led(self, track: TrackState, stamp: float) -> bool:
        """Whether the camera says where to look for legs."""
        if track.bearing is None or track.phase not in FOLLOWED:
            return False
        if track.phase is TrackPhase.OCCLUDED and not self._filter.knows:
            return False
        return abs(stamp - track.stamp) <= self.settings.max_track_age_s

    def _expected(self, base: Pose2, stamp: float) -> Expected:
        person, s = self.person(stamp), self.settings
        sight = wrap_angle(self._sight - base.theta)
        given = self.trust.given
        if person is None:
            return Expected(sight, sight=sight, believed=given)
        distance, bearing = person.seen_from(base)
        is_seen = stamp - self._legs.seen_at <= s.max_track_age_s
        gate = s.filter.gate if is_seen else s.first_gate
        by_camera = not is_seen and self._track is not None and self._is_led(self._track, stamp)
        reach = gate * person.sigma + 0.5 * s.legs.stride_m
        return Expected(bearing, distance, reach, sight if by_camera else None, given)

    def _place(self, track: TrackState, sight: float) -> None:
        """Take over what a tracker of scans knows."""
        if track.phase is TrackPhase.LOST or track.position is None or track.covariance is None:
            return
        self._sight = sight
        P: Array = np.diag([0.0, 0.0, STEADY**2, STEADY**2])
        n = len(track.covariance)
        P[:n, :n] = track.covariance
        state = MovingPoint.of(track.position, track.velocity or (0.0, 0.0), P)
        self._filter.place(state, track.stamp)

    def _claim_body(self, track: TrackState, clusters: Clusters, base: Pose2) -> None:
        """The legs at the place where a tracker of scans has the person."""
        person = self.person(clusters.stamp)
        if track.phase is not TrackPhase.CONFIRMED or person is None:
            return
        off = clusters.centre - (~base).apply_point(*person.position)
        near = np.einsum("ij,ij->i", off, off) < self.settings.body_m**2
        self._claim(clusters, np.flatnonzero(near & clusters.leg_like))

    def _claim(self, clusters: Clusters, legs: np.ndarray) -> None:
        self.claimed = tuple(slice(int(clusters.first[k]), int(clusters.last[k]) + 1) for k in legs)

    def _seen(self, base: Pose2, stamp: float, distance: float | None, sigma: float) -> Sighting:
        """Along the track's line of sight."""
        bearing_sigma = radians(self.settings.bearing_sigma_deg)
        return Sighting(stamp, base, self._sight, bearing_sigma, distance, sigma)

    def _start(self, seen: Sighting) -> None:
        self._filter.start(seen, self.settings.legs_sigma_m)


def _is_of_scans(track: TrackState) -> bool:
    """Whether a track's own sensor is the laser."""
    return track.frame_id is None
