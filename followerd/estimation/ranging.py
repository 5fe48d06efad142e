"""Where on the ground the person is: a filter of bearings and ranges, whoever measured them.

State x = [px, py, vx, vy] of the person in `odom`, constant velocity; x P F Q z H R y S K as in
the textbook. A measurement is taken along (range) and across (bearing) its own line of sight,
one scalar at a time, so that either half may be missing.
"""

from dataclasses import dataclass
from math import atan2, cos, hypot, inf, nan, sin, sqrt

import numpy as np
from pydantic import Field

from followerd.geometry import Array, Pose2
from followerd.settings import Settings


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
    """The ground position of one person."""

    def __init__(self, settings: RangingSettings | None = None) -> None:
        self.settings = settings or RangingSettings()
        self.forget()

    def forget(self) -> None:
        """Drop the person."""
        self._x: Array | None = None
        self._P: Array = np.eye(4)
        self._stamp = -inf
        self._foreseen: Person | None = None  # by the last call of `person`
        self._foreseen_at = nan  # s; nan: the state has changed since
        self._rejected = 0

    @property
    def begun(self) -> bool:
        """Whether there is a person, and measurements still fit them."""
        return self._x is not None and self._rejected < self.settings.max_rejected

    @property
    def knows(self) -> bool:
        """Whether there is a person."""
        return self._x is not None

    def person(self, stamp: float) -> Person | None:
        """The person at `stamp`; None when the position is unknown."""
        if self._x is None:
            return None
        if stamp != self._foreseen_at:
            state, P = self._predicted(stamp)
            x, y, vx, vy = state.tolist()
            person = Person((x, y), (vx, vy), P)
            self._foreseen = person if person.sigma <= self.settings.max_sigma_m else None
            self._foreseen_at = stamp
        return self._foreseen

    def place(self, person: Person, stamp: float) -> None:
        """Take what another filter says of the person at `stamp`."""
        self._x = np.array([*person.position, *person.velocity])
        self._P = person.covariance
        self._stamp, self._foreseen_at, self._rejected = stamp, nan, 0

    def start(self, seen: Sighting, across_sigma: float) -> None:
        """Begin anew where somebody is `seen`, whose distance must be known."""
        assert seen.distance is not None
        u = np.array([cos(seen.sight), sin(seen.sight)])
        t = np.array([-u[1], u[0]])
        base, distance = seen.base, seen.distance
        self._x = np.array([base.x + distance * u[0], base.y + distance * u[1], 0.0, 0.0])
        across = max(distance * seen.bearing_sigma, across_sigma)
        self._P = np.diag([0.0, 0.0, 0.5, 0.5])
        self._P[:2, :2] = seen.sigma**2 * np.outer(u, u) + across**2 * np.outer(t, t)
        self._stamp = seen.stamp
        self._foreseen_at = nan
        self._rejected = 0

    def measure(self, seen: Sighting) -> bool:
        """Take a line of sight, and a distance along it; False when some of it does not fit."""
        self._foreseen_at = nan
        if seen.stamp > self._stamp:
            self._x, self._P = self._predicted(seen.stamp)
            self._stamp = seen.stamp
        u = (cos(seen.sight), sin(seen.sight))
        t = (-u[1], u[0])
        assert self._x is not None
        dt = seen.stamp - self._stamp  # negative: an image that took longer than the scan after it
        x, y = self._x[:2] + dt * self._x[2:] - (seen.base.x, seen.base.y)
        reach = max(0.3, float(x * u[0] + y * u[1]))
        fits = self._update(t, -(x * t[0] + y * t[1]), (reach * seen.bearing_sigma) ** 2, dt)
        if seen.distance is not None:
            off = seen.distance - (x * u[0] + y * u[1])
            fits &= self._update(u, off, seen.sigma**2, dt)
        self._rejected = 0 if fits else self._rejected + 1
        return fits

    def _predicted(self, stamp: float) -> tuple[Array, Array]:
        """State and covariance at `stamp`; a time before the state's is met without noise."""
        assert self._x is not None
        dt = stamp - self._stamp
        if dt == 0.0:
            return self._x, self._P
        x, P = self._x.copy(), self._P.copy()
        # F x and F P F', F being the identity but for dt from velocity to position
        x[:2] += dt * x[2:]
        P[:2] += dt * P[2:]
        P[:, :2] += dt * P[:, 2:]
        P += _accelerated(self.settings.accel_density, max(0.0, dt))
        return x, P

    def _update(self, direction: tuple[float, float], y: float, R: float, dt: float) -> bool:
        """One scalar along `direction`, `dt` from the state's time; False when it is gated out."""
        H = np.array([direction[0], direction[1], dt * direction[0], dt * direction[1]])
        PH = self._P @ H
        S = float(H @ PH) + R
        if y * y > self.settings.gate**2 * S:
            return False
        K = PH / S
        self._x = self._x + K * y
        self._P = self._P - np.outer(K, PH)
        self._P = 0.5 * (self._P + self._P.T)
        return True


def _accelerated(density: float, t: float) -> Array:
    """Q (4, 4) of a white noise of the acceleration after `t` seconds."""
    v, vp, p = density * t, density * (t**2 / 2), density * (t**3 * (1 / 3))
    return np.array([[p, 0, vp, 0], [0, p, 0, vp], [vp, 0, v, 0], [0, vp, 0, v]])
