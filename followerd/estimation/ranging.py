"""How far away the person is: image bearing and range, and legs in the laser, in one filter.

The person is a point in `odom` that moves with nearly constant velocity. A measurement is taken
along (range) and across (bearing) its own line of sight, one scalar at a time, so that either half
may be missing.
"""

from dataclasses import dataclass, replace
from math import atan2, cos, dist, hypot, inf, nan, radians, sin, sqrt

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.estimation.moving_point import MovingPoint
from followerd.geometry import Array, Pose2, wrap_angle
from followerd.messages import Clusters, Place, TrackPhase, TrackState
from followerd.settings import Settings

START_VARIANCE = 0.5  # (m/s)², of the velocity of somebody just found


class RangingSettings(Settings):
    """What is believed about the person's motion, the camera and the laser."""

    accel_density: float = Field(0.6, gt=0, description="of the walking person, m^2/s^3")
    bearing_sigma_deg: float = Field(1.5, gt=0, description="of the tracker's bearing")
    beside_legs: float = Field(3.0, ge=1, description="times that, while the laser sees the legs")
    range_sigma_m: float = Field(0.3, gt=0, description="of a track's range that names none")
    range_share: float = Field(0.1, ge=0, description="share of its range a track errs at least")
    legs_sigma_m: float = Field(0.08, gt=0, description="of the middle between the legs")
    leg_sigma_m: float = Field(0.2, gt=0, description="of it, where only one leg is seen")
    leg_radius_m: float = Field(0.05, ge=0, description="from a leg's visible side to its middle")
    leg_width_m: float = Field(0.2, gt=0, description="widest that one leg looks")
    stride_m: float = Field(0.7, gt=0, description="farthest apart two legs of one person are")
    cone_deg: float = Field(7.0, gt=0, description="half width of the bearing cone for legs")
    before_m: float = Field(0.35, gt=0, description="nearer than the person: somebody else's legs")
    hides_m: float = Field(0.25, gt=0, description="aside of the line of sight, that still hide")
    others_m: float = Field(1.0, ge=0, description="beyond the reach of the person's own legs")
    leap_m: float = Field(0.15, gt=0, description="farthest that a leg moves between two scans")
    gate: float = Field(3.5, gt=0, description="standard deviations a measurement may be off")
    max_track_age_s: float = Field(0.3, gt=0, description="older tracks claim no legs")
    max_hidden_s: float = Field(
        1.0, ge=0, description="behind somebody's legs the person is foreseen, not looked for"
    )
    max_sigma_m: float = Field(0.6, gt=0, description="more uncertain than this is unknown")
    max_rejected: int = Field(5, ge=1, description="measurements refused in a row: start anew")


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """Where the followed person is, in `odom`."""

    position: tuple[float, float]  # m
    velocity: tuple[float, float]  # m/s
    covariance: Array  # (4, 4)

    @property
    def sigma(self) -> float:
        """Largest standard deviation of the position, m."""
        P = self.covariance
        a, b, c = P.item(0, 0), P.item(0, 1), P.item(1, 1)
        return sqrt(max(0.0, 0.5 * (a + c) + hypot(0.5 * (a - c), b)))

    def seen_from(self, base: Pose2) -> tuple[float, float]:
        """Range in m and bearing in rad from the robot at `odom_from_base`."""
        x, y = (~base).apply_point(*self.position)
        return hypot(x, y), atan2(y, x)

    def velocity_in(self, base: Pose2) -> tuple[float, float]:
        """Velocity over the ground along the axes of the robot at `odom_from_base`, m/s."""
        return Pose2(theta=-base.theta).apply_point(*self.velocity)


class Ranging:
    """The ground position of the tracked person, from whatever knows it."""

    def __init__(self, settings: RangingSettings | None = None) -> None:
        self.settings = settings or RangingSettings()
        self.forget()

    def forget(self) -> None:
        """Drop the person."""
        self._state: MovingPoint | None = None
        self._stamp = -inf
        self._foreseen: Person | None = None  # by the last call of `person`
        self._foreseen_at = nan  # s; nan: the state has changed since
        self._rejected = 0
        self._track: TrackState | None = None
        self._sight = 0.0  # rad in odom, direction in which the track was seen
        self._legs_seen = -inf  # s
        self._hidden = False  # by somebody else's legs, in the newest scan
        self._own: list[tuple[float, float]] = []  # m in odom, the person's legs when last seen
        self._others: list[tuple[float, float]] = []  # m in odom, legs near them that are not
        self.claimed: tuple[slice, ...] = ()  # beams of the newest scan that show the person

    def see(self, track: TrackState, base: Pose2) -> None:
        """Take a track of an image; `base` is `odom_from_base` at its stamp."""
        self._track = track
        if track.phase is not TrackPhase.CONFIRMED:
            self.claimed = ()
        if track.bearing is None or track.phase not in (TrackPhase.CONFIRMED, TrackPhase.TENTATIVE):
            return
        self._sight = wrap_angle(base.theta + track.bearing)
        sigma = track.range_sigma or self.settings.range_sigma_m
        sigma = max(sigma, self.settings.range_share * (track.range or 0.0))
        if self._state is None or self._rejected >= self.settings.max_rejected:
            if track.range is not None:
                self._start(track.range, sigma, base, track.stamp)
            return
        if self._is_hidden(track.stamp):
            return  # the box is as likely on whoever stands before the person
        has_legs = track.stamp - self._legs_seen < self.settings.max_track_age_s
        doubt = self.settings.beside_legs if has_legs else 1.0
        self._measure(track.range, sigma, doubt * self._bearing_sigma(), base, track.stamp)

    def scan(self, clusters: Clusters, base: Pose2) -> None:
        """Take the legs the current track points at; `base` is `odom_from_base` at the scan."""
        self.claimed = ()
        track = self._track
        if track is None or track.bearing is None:
            return
        is_sure = track.phase is TrackPhase.CONFIRMED
        if not is_sure and (track.phase is not TrackPhase.OCCLUDED or self._state is None):
            return
        if abs(clusters.stamp - track.stamp) > self.settings.max_track_age_s:
            return
        legs = self._legs(clusters, base)
        if not legs.size:
            return
        middle = clusters.centre[legs].mean(axis=0)
        distance = hypot(*middle) + self.settings.leg_radius_m
        direction = atan2(middle[1], middle[0])
        along = wrap_angle(base.theta + direction)
        sigma = self.settings.legs_sigma_m if legs.size == 2 else self.settings.leg_sigma_m
        if self._state is None:
            self._sight = along
            self._start(distance, sigma, base, clusters.stamp)
        else:
            self._measure(distance, sigma, sigma / distance, base, clusters.stamp, along)
        self._legs_seen = clusters.stamp
        if is_sure:
            self.claimed = tuple(
                slice(int(clusters.first[k]), int(clusters.last[k]) + 1) for k in legs
            )

    def person(self, stamp: float) -> Person | None:
        """The person at `stamp`; None when the position is unknown."""
        if self._state is None:
            return None
        if stamp != self._foreseen_at:
            state = self._state.after(stamp - self._stamp, self.settings.accel_density)
            person = Person((state.x, state.y), (state.u, state.v), state.covariance)
            self._foreseen = person if person.sigma <= self.settings.max_sigma_m else None
            self._foreseen_at = stamp
        return self._foreseen

    def bearing(self, base: Pose2) -> float | None:
        """Where the track was last seen from the robot at `odom_from_base`, rad; None if lost."""
        if self._track is None or self._track.phase is TrackPhase.LOST:
            return None
        return wrap_angle(self._sight - base.theta)

    def measured(self, base: Pose2, stamp: float) -> Place | None:
        """Where the laser sees the person's legs, or just saw them go behind somebody else's."""
        person = self.person(stamp)
        is_seen = stamp - self._legs_seen <= self.settings.max_track_age_s
        if person is None or not (is_seen or self._is_hidden(stamp)):
            return None
        return Place(*person.seen_from(base), person.sigma, is_seen)

    def located(self, track: TrackState, base: Pose2, stamp: float) -> TrackState:
        """The track with what is known at `stamp`, when the robot is at `base`."""
        if track.phase is TrackPhase.LOST:
            return track
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

    def _is_hidden(self, stamp: float) -> bool:
        return self._hidden and stamp - self._legs_seen <= self.settings.max_hidden_s

    def _legs(self, clusters: Clusters, base: Pose2) -> npt.NDArray[np.intp]:
        """The one or two clusters that are the person's legs.

        Nearest to the expected place within the gate, and none while somebody else's legs stand
        before it; with no expectation the nearest of the cone, for whoever stood before the person
        would hide them from the camera too. Legs that come in from outside the gate stay somebody
        else's, scan after scan.
        """
        person = self.person(clusters.stamp)
        if person is None:
            expected, bearing, reach = None, wrap_angle(self._sight - base.theta), inf
        else:
            expected, bearing = person.seen_from(base)
            reach = self.settings.gate * person.sigma + 0.5 * self.settings.stride_m
        s, fits, others = self.settings, [], []
        self._hidden = False
        if clusters.stamp - self._legs_seen > s.max_hidden_s:
            self._others = []
        for k in clusters.leg_like.nonzero()[0].tolist():
            near = clusters.range.item(k)
            distance = near + s.leg_radius_m
            angle = abs(wrap_angle(clusters.bearing.item(k) - bearing))
            aside = near * angle
            in_cone = angle < radians(s.cone_deg) + atan2(0.5 * s.stride_m, max(near, 0.3))
            off = distance + aside if expected is None else hypot(distance - expected, aside)
            if off > reach + s.others_m:
                continue
            point = base.apply_point(*clusters.centre[k].tolist())
            if off > reach or self._was_anothers(point, clusters.width.item(k)):
                others.append(point)
            elif in_cone:
                fits.append((off, k))
            if expected is not None and expected - distance > s.before_m and aside < s.hides_m:
                self._hidden = True
        self._others = others
        if self._hidden:
            return np.empty(0, np.intp)
        found = np.array([k for _, k in sorted(fits)], np.intp)
        if found.size:
            gaps = np.hypot(*(clusters.centre[found] - clusters.centre[found[0]]).T)
            found = found[gaps < s.stride_m][:2]
            self._own = [base.apply_point(*centre) for centre in clusters.centre[found].tolist()]
        return found

    def _was_anothers(self, point: tuple[float, float], width: float) -> bool:
        """Whether a leg at `point` in odom was somebody else's in the last scan, or touches one."""
        theirs = min((dist(point, other) for other in self._others), default=inf)
        if theirs > self.settings.leap_m + 0.5 * width:
            return False
        is_several = width > self.settings.leg_width_m
        return is_several or all(dist(point, own) > theirs for own in self._own)

    def _bearing_sigma(self) -> float:
        return radians(self.settings.bearing_sigma_deg)

    def _start(self, distance: float, sigma: float, base: Pose2, stamp: float) -> None:
        a, b = cos(self._sight), sin(self._sight)
        across = max(distance * self._bearing_sigma(), self.settings.legs_sigma_m)
        along2, across2 = sigma * sigma, across * across
        self._state = MovingPoint(
            *(base.x + distance * a, base.y + distance * b, 0.0, 0.0),
            *(along2 * a * a + across2 * b * b, (along2 - across2) * a * b),
            along2 * b * b + across2 * a * a,
            *(0.0, 0.0, 0.0, 0.0),
            *(START_VARIANCE, 0.0, START_VARIANCE),
        )
        self._stamp = stamp
        self._foreseen_at = nan
        self._rejected = 0

    def _measure(
        self,
        distance: float | None,
        range_sigma: float,
        bearing_sigma: float,
        base: Pose2,
        stamp: float,
        sight: float | None = None,
    ) -> None:
        """Take a line of sight in `odom`, and a distance along it."""
        assert self._state is not None
        self._foreseen_at = nan
        if stamp > self._stamp:
            density = self.settings.accel_density
            self._state, self._stamp = self._state.after(stamp - self._stamp, density), stamp
        along = self._sight if sight is None else sight
        u, t = (cos(along), sin(along)), (-sin(along), cos(along))
        then = self._state
        dt = stamp - self._stamp  # negative: an image that took longer than the scan after it
        x, y = then.x + dt * then.u - base.x, then.y + dt * then.v - base.y
        reach = max(0.3, x * u[0] + y * u[1])
        fits = self._update(t, -(x * t[0] + y * t[1]), (reach * bearing_sigma) ** 2, dt)
        if distance is not None:
            off = distance - (x * u[0] + y * u[1])
            fits &= self._update(u, off, range_sigma**2, dt)
        self._rejected = 0 if fits else self._rejected + 1

    def _update(
        self, direction: tuple[float, float], off: float, variance: float, dt: float
    ) -> bool:
        """One scalar along `direction`, `dt` from the state's time; False when it is gated out."""
        assert self._state is not None
        corrected = self._state.corrected(direction, off, variance, dt, self.settings.gate)
        self._state = corrected or self._state
        return corrected is not None
