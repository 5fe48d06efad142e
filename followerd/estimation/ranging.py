"""Where on the ground the person is: a filter of bearings and ranges, whoever measured them.

State x = [px, py, vx, vy] of the person in `odom`, constant velocity; x P F Q z H R y S K as in
the textbook. A measurement is taken along (range) and across (bearing) its own line of sight,
one scalar at a time, so that either half may be missing.
"""

from dataclasses import dataclass
from math import atan2, cos, hypot, inf, nan, sin

from pydantic import Field

from followerd.estimation.moving_point import MovingPoint
from followerd.geometry import Array, Pose2
from followerd.settings import Settings

START_VARIANCE = 0.5  # (m/s)², of the velocity of somebody just found


class RangingSettings(Settings):
    """What is believed about the person's motion."""

    accel_density: float = Field(0.6, gt=0, description="of the walking person, m^2/s^3")
    gate: float = Field(3.5, gt=0, description="standard deviations a measurement may be off")
    max_sigma_m: float = Field(0.6, gt=0, description="more uncertain than this is unknown")
    max_rejected: int = Field(5, ge=1, description="measurements refused in a row: start anew")


@dataclass(frozen=True, slots=True)
class Sighting:
    """The person seen from `base`: a line of sight in `odom`, and perhaps how far along it."""

    stamp: float  # s
    base: Pose2  # odom_from_base then
    sight: float  # rad in `odom`
    bearing_sigma: float  # rad
    distance: float | None = None  # m
    sigma: float = inf  # m, of the distance
    gate: float = 1.0  # share of the filter's gate within which it fits


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """Where the followed person is, in `odom`."""

    state: MovingPoint
    sigma: float  # m, largest standard deviation of the position

    @property
    def position(self) -> tuple[float, float]:
        """In m."""
        return self.state[:2]

    @property
    def velocity(self) -> tuple[float, float]:
        """In m/s."""
        return self.state[2:4]

    @property
    def covariance(self) -> Array:
        """Of both, (4, 4)."""
        return self.state.covariance

    def seen_from(self, base: Pose2) -> tuple[float, float]:
        """Range in m and bearing in rad from the robot at `odom_from_base`."""
        x, y = (~base).apply_point(*self.position)
        return hypot(x, y), atan2(y, x)

    def velocity_in(self, base: Pose2) -> tuple[float, float]:
        """Velocity over the ground along the axes of the robot at `odom_from_base`, m/s."""
        return Pose2(theta=-base.theta).apply_point(*self.velocity)


class Ranging:
    """The ground position of one person."""

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

    @property
    def begun(self) -> bool:
        """Whether there is a person, and measurements still fit them."""
        return self._state is not None and self._rejected < self.settings.max_rejected

    @property
    def knows(self) -> bool:
        """Whether there is a person."""
        return self._state is not None

    def person(self, stamp: float) -> Person | None:
        """The person at `stamp`; None when the position is unknown."""
        state = self._state
        if state is None:
            return None
        if stamp != self._foreseen_at:
            then = state.after(stamp - self._stamp, self.settings.accel_density)
            sigma = then.sigma
            self._foreseen = Person(then, sigma) if sigma <= self.settings.max_sigma_m else None
            self._foreseen_at = stamp
        return self._foreseen

    def place(self, state: MovingPoint, stamp: float) -> None:
        """Take what another filter says of the person at `stamp`."""
        self._state = state
        self._stamp, self._foreseen_at, self._rejected = stamp, nan, 0

    def start(self, seen: Sighting, across_sigma: float) -> None:
        """Begin anew where somebody is `seen`, whose distance must be known."""
        assert seen.distance is not None
        a, b = cos(seen.sight), sin(seen.sight)
        base, distance = seen.base, seen.distance
        across = max(distance * seen.bearing_sigma, across_sigma)
        along2, across2 = seen.sigma * seen.sigma, across * across
        self._state = MovingPoint(
            *(base.x + distance * a, base.y + distance * b, 0.0, 0.0),
            *(along2 * a * a + across2 * b * b, (along2 - across2) * a * b),
            along2 * b * b + across2 * a * a,
            *(0.0, 0.0, 0.0, 0.0),
            *(START_VARIANCE, 0.0, START_VARIANCE),
        )
        self._stamp = seen.stamp
        self._foreseen_at = nan
        self._rejected = 0

    def measure(self, seen: Sighting) -> bool:
        """Take a line of sight, and a distance along it; False when some of it does not fit."""
        self._foreseen_at = nan
        assert self._state is not None
        if seen.stamp > self._stamp:
            density = self.settings.accel_density
            self._state = self._state.after(seen.stamp - self._stamp, density)
            self._stamp = seen.stamp
        u, gate = (cos(seen.sight), sin(seen.sight)), seen.gate * self.settings.gate
        t = (-u[1], u[0])
        then = self._state
        dt = seen.stamp - self._stamp  # negative: an image that took longer than the scan after it
        x, y = then.x + dt * then.u - seen.base.x, then.y + dt * then.v - seen.base.y
        reach = max(0.3, x * u[0] + y * u[1])
        fits = self._update(t, -(x * t[0] + y * t[1]), (reach * seen.bearing_sigma) ** 2, dt, gate)
        if seen.distance is not None:
            off = seen.distance - (x * u[0] + y * u[1])
            fits &= self._update(u, off, seen.sigma**2, dt, gate)
        self._rejected = 0 if fits else self._rejected + 1
        return fits

    def _update(
        self, direction: tuple[float, float], off: float, variance: float, dt: float, gate: float
    ) -> bool:
        """One scalar along `direction`, `dt` from the state's time; False when it is gated out."""
        assert self._state is not None
        corrected = self._state.corrected(direction, off, variance, dt, gate)
        self._state = corrected or self._state
        return corrected is not None
