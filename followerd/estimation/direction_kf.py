"""A Kalman filter of a target's direction (Motai, Jha and Kruse 2012, eq. 1-19)."""

from math import radians

from followerd.estimation.direction import Look
from followerd.estimation.pan_flow import Pair


class Axis:
    """Kalman filter of one angle and its rate, driven by accelerations held for a step (eq. 1-19).

    Eq. 19 is used with the innovation's covariance, not with S_z; the filter starts at the first
    measurement, not at zero (eq. 13-14 claim that the target is there).
    """

    __slots__ = ("P00", "P01", "P11", "R", "p", "q", "v")

    def __init__(self, z: float, accel: float, sigma: float) -> None:
        """At angle `z`, rad; `accel` rad/s² and `sigma` rad are standard deviations."""
        self.q, self.R = accel * accel, sigma * sigma
        self.p, self.v = z, 0.0
        self.P00, self.P01, self.P11 = self.R, 0.0, radians(20.0) ** 2

    def predict(self, dt: float) -> None:
        """`dt` s on (eq. 6, 8)."""
        self.p += dt * self.v
        q, dt2 = self.q, dt * dt
        self.P00 += dt * (2.0 * self.P01 + dt * self.P11) + 0.25 * q * dt2 * dt2
        self.P01 += dt * self.P11 + 0.5 * q * dt2 * dt
        self.P11 += q * dt2

    def update(self, z: float) -> None:
        """With a measured angle (eq. 15-19 in filter form)."""
        S = self.P00 + self.R
        K, L, y = self.P00 / S, self.P01 / S, z - self.p
        self.p += K * y
        self.v += L * y
        self.P11 -= L * self.P01
        self.P01 -= K * self.P01
        self.P00 -= K * self.P00


class Kf:
    """Eq. 1-19."""

    def __init__(self, accel: float = radians(40.0), sigma: float = radians(0.7)) -> None:
        """Standard deviations of the target's acceleration, rad/s², and of a look, rad."""
        self._noise = accel, sigma
        self._stamp = 0.0
        self.axes: tuple[Axis, Axis] | None = None

    def step(self, look: Look) -> None:
        """See Predictor."""
        self.take(look.angles, look.stamp)

    def take(self, direction: Pair, stamp: float) -> None:
        """The target was seen at `direction`."""
        if self.axes is None:
            self.axes = Axis(direction[0], *self._noise), Axis(direction[1], *self._noise)
        else:
            dt = stamp - self._stamp
            for axis, z in zip(self.axes, direction, strict=True):
                axis.predict(dt)
                axis.update(z)
        self._stamp = stamp

    def ahead(self, dt: float) -> Pair:
        """See Predictor."""
        assert self.axes is not None
        pan, tilt = self.axes
        return pan.p + dt * pan.v, tilt.p + dt * tilt.v
