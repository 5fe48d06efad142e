"""Where a target will be seen next: Kalman filter, optical flow, and Motai's choice between them.

Motai, Jha and Kruse 2012, repaired where it cannot work; each predictor is told of every look at
the target and says where it will be `dt` later. Plain floats: a step costs microseconds.
"""

from dataclasses import dataclass
from math import cos, exp, hypot, pi, radians, sqrt
from typing import Literal, Protocol

import numpy as np

from followerd.estimation.pan_flow import Pair, angles, camera_flow, following_turn
from followerd.geometry import Array

Kind = Literal["kf", "of", "ofkf", "pf", "imm_pda"]

FRESH_RATE = radians(30.0)  # rad/s, deviation of a fresh particle's
AGREEING = 4  # refused looks that agree: the target is there


@dataclass(frozen=True, slots=True)
class Look:
    """The target in one image, and how the head stood; image and angles as in pan_flow."""

    stamp: float  # s
    x: float  # px
    y: float  # px
    pan: float  # rad
    tilt: float  # rad
    focal: float  # px
    flow: Pair | None = None  # px/s, measured; None: from this look and the one before
    ahead: float = 0.0  # m/s, of the camera along its axis
    depth: float | None = None  # m, of the target

    @property
    def angles(self) -> Pair:
        """Its direction (pan, tilt), rad."""
        return angles(self.x, self.y, self.pan, self.tilt, self.focal)


class Predictor(Protocol):
    """Takes looks, foresees directions."""

    def step(self, look: Look) -> None:
        """Take the next look; later than the one before."""

    def ahead(self, dt: float) -> Pair:
        """The direction (pan, tilt), rad, `dt` s after the newest look."""


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


class Of:
    """Eq. 21-45: the last place carried on by the target's own flow; no memory, no lag."""

    def __init__(self) -> None:
        self._look: Look | None = None
        self._turn: Pair = (0.0, 0.0)  # rad/s, of a head that follows
        self._angles: Pair = (0.0, 0.0)

    def step(self, look: Look) -> None:
        """See Predictor."""
        self.take(look.angles, look)

    def take(self, direction: Pair, look: Look) -> None:
        """The target was seen at `direction`, which is that of `look`."""
        before, self._look = self._look, look
        self._angles = direction
        if before is None:
            return
        dt = look.stamp - before.stamp
        flow = look.flow or ((look.x - before.x) / dt, (look.y - before.y) / dt)  # eq. 31-32
        turn = (look.pan - before.pan) / dt, (look.tilt - before.tilt) / dt
        x, y = 0.5 * (look.x + before.x), 0.5 * (look.y + before.y)
        camera = camera_flow(x, y, turn, look.focal, look.ahead, look.depth)
        own = flow[0] - camera[0], flow[1] - camera[1]  # eq. 35-36
        self._turn = following_turn(x, y, own, look.focal)

    def ahead(self, dt: float) -> Pair:
        """See Predictor."""
        return self._angles[0] + dt * self._turn[0], self._angles[1] + dt * self._turn[1]


class OfKf:
    """Eq. 46-49: the Kalman filter on straights, the flow in turns, told apart by a triangle.

    The triangle's corners are the last three directions: in pixels of a moving camera it would be
    another one. Below `floor` px between two looks its angle is noise, and the filter is taken.
    """

    def __init__(
        self,
        accel: float = radians(40.0),
        sigma: float = radians(0.7),
        straight: float = radians(160.0),
        floor: float = 8.0,
        reopen: float = 0.0,
    ) -> None:
        """`reopen`, rad/s, is added to the filter's rate in a turn (ours; 0 is the paper)."""
        self._kf, self._of = Kf(accel, sigma), Of()
        self._least, self._floor, self._reopen = cos(straight), floor, reopen * reopen
        self._path: list[Pair] = []
        self.turns = False

    def step(self, look: Look) -> None:
        """See Predictor."""
        direction = look.angles
        self._kf.take(direction, look.stamp)
        self._of.take(direction, look)
        self._path = [*self._path[-2:], direction]
        self.turns = len(self._path) == 3 and self._is_turn(look.focal)
        if self.turns and self._reopen and self._kf.axes is not None:
            for axis in self._kf.axes:
                axis.P11 += self._reopen

    def ahead(self, dt: float) -> Pair:
        """See Predictor."""
        return (self._of if self.turns else self._kf).ahead(dt)

    def _is_turn(self, focal: float) -> bool:
        (ax, ay), (bx, by), (cx, cy) = self._path
        ux, uy, wx, wy = cx - bx, cy - by, ax - bx, ay - by
        a, b = hypot(ux, uy), hypot(wx, wy)
        if min(a, b) * focal < self._floor:
            return False
        return ux * wx + uy * wy > self._least * a * b


class Pf:
    """A particle filter of each angle and its rate; `floor` and `fresh` keep it from dying."""

    def __init__(
        self,
        rng: np.random.Generator,
        count: int = 50,
        accel: float = radians(200.0),
        sigma: float = radians(0.7),
        floor: float = 1e-4,
        fresh: int = 2,
    ) -> None:
        """`floor` is the least likelihood of a particle, `fresh` are drawn anew at each look."""
        self._rng, self._count, self._accel, self._sigma = rng, count, accel, sigma
        self._floor, self._fresh = floor, fresh
        self._stamp = 0.0
        self._cloud: Array | None = None  # (2 axes, 2, N): angles, rates
        self._mean = np.zeros((2, 2))

    def step(self, look: Look) -> None:
        """See Predictor."""
        z = np.array(look.angles)[:, None]
        rng, n = self._rng, self._count
        if self._cloud is None:
            self._cloud = rng.standard_normal((2, 2, n))
            self._cloud *= np.array([self._sigma, radians(20.0)])[:, None]
            self._cloud[:, 0] += z
        else:
            dt = look.stamp - self._stamp
            push = self._accel * rng.standard_normal((2, n))
            self._cloud[:, 0] += dt * self._cloud[:, 1] + 0.5 * dt * dt * push
            self._cloud[:, 1] += dt * push
            # without fresh ones a burst of wrong looks leads the cloud away for ever
            spread = np.array([self._sigma, FRESH_RATE])[:, None]
            drawn = spread * rng.standard_normal((2, 2, self._fresh))
            drawn[:, 0] += z
            self._cloud[:, :, : self._fresh] = drawn
        self._stamp = look.stamp
        off = (self._cloud[:, 0] - z) / self._sigma
        weights = np.exp(-0.5 * off * off) + self._floor
        weights /= weights.sum(axis=1, keepdims=True)
        self._mean = (self._cloud * weights[:, None]).sum(axis=2)
        combs = (np.arange(n) + rng.random()) / n
        for axis in (0, 1):
            chosen = np.minimum(weights[axis].cumsum().searchsorted(combs), n - 1)
            self._cloud[axis] = self._cloud[axis].take(chosen, axis=1)

    def ahead(self, dt: float) -> Pair:
        """See Predictor."""
        pan, tilt = (self._mean[:, 0] + dt * self._mean[:, 1]).tolist()
        return pan, tilt


class ImmPda:
    """Ours: a calm and an agile filter, mixed by how well each foresees; looks may be wrong.

    Interacting multiple models with probabilistic data association: a look is the target's with
    probability 1 - `clutter`, else anywhere within `field`.
    """

    def __init__(
        self,
        calm: float = radians(20.0),
        agile: float = radians(400.0),
        sigma: float = radians(0.7),
        stay: float = 0.97,
        clutter: float = 0.03,
        field: float = radians(60.0),
    ) -> None:
        """`calm` and `agile` are accelerations, rad/s²; `stay` is the probability that a model
        holds from one look to the next."""
        self._accels, self._sigma, self._stay = (calm, agile), sigma, stay
        self._clutter, self._density = 1.0 - clutter, clutter / field
        self._stamp = 0.0
        self._axes: tuple[_Mixture, _Mixture] | None = None

    def step(self, look: Look) -> None:
        """See Predictor."""
        pan, tilt = look.angles
        if self._axes is None:
            self._axes = self._mixture(pan), self._mixture(tilt)
        else:
            dt = look.stamp - self._stamp
            self._axes[0].step(pan, dt)
            self._axes[1].step(tilt, dt)
        self._stamp = look.stamp

    def ahead(self, dt: float) -> Pair:
        """See Predictor."""
        assert self._axes is not None
        return self._axes[0].ahead(dt), self._axes[1].ahead(dt)

    def _mixture(self, z: float) -> "_Mixture":
        models = Axis(z, self._accels[0], self._sigma), Axis(z, self._accels[1], self._sigma)
        return _Mixture(*models, self._stay, self._clutter, self._density)


class _Mixture:
    """The two models of one angle, their probabilities, and looks refused lately."""

    __slots__ = ("agile", "calm", "clutter", "density", "mu", "refused", "stay")

    def __init__(self, calm: Axis, agile: Axis, stay: float, right: float, density: float) -> None:
        self.calm, self.agile = calm, agile
        self.mu = 0.5  # probability of the calm model
        self.stay, self.clutter, self.density = stay, right, density
        self.refused: list[float] = []  # rad, looks that agreed with each other, not with us

    def ahead(self, dt: float) -> float:
        a, b, mu = self.calm, self.agile, self.mu
        return mu * (a.p + dt * a.v) + (1.0 - mu) * (b.p + dt * b.v)

    def step(self, z: float, dt: float) -> None:
        a, b, stay = self.calm, self.agile, self.stay
        calm = stay * self.mu + (1.0 - stay) * (1.0 - self.mu)
        _interact(a, b, stay * self.mu / calm, (1.0 - stay) * self.mu / (1.0 - calm))
        a.predict(dt)
        b.predict(dt)
        if self._is_somewhere_else(z):
            return
        la = _associate(a, z, self.clutter, self.density)
        lb = _associate(b, z, self.clutter, self.density)
        self.mu = min(max(calm * la / (calm * la + (1.0 - calm) * lb), 0.01), 0.99)

    def _is_somewhere_else(self, z: float) -> bool:
        """Four refused looks in a row that agree with each other: start anew there."""
        wide = self.agile
        off = z - wide.p
        if off * off < 16.0 * (wide.P00 + wide.R):
            self.refused.clear()
            return False
        if self.refused and abs(z - self.refused[-1]) > 6.0 * sqrt(wide.R) + radians(4.0):
            self.refused.clear()
        self.refused.append(z)
        if len(self.refused) < AGREEING:
            return False
        for axis in (self.calm, self.agile):
            axis.p, axis.v = z, 0.0
            axis.P00, axis.P01, axis.P11 = axis.R, 0.0, radians(20.0) ** 2
        self.refused.clear()
        return True


def _interact(a: Axis, b: Axis, a_in_a: float, a_in_b: float) -> None:
    """Each model starts from the mixture that leads to it; `a_in_b` is the share of a in b."""
    mixed = []
    for share in (a_in_a, a_in_b):
        rest = 1.0 - share
        p, v = share * a.p + rest * b.p, share * a.v + rest * b.v
        ap, av, bp, bv = a.p - p, a.v - v, b.p - p, b.v - v
        P00 = share * (a.P00 + ap * ap) + rest * (b.P00 + bp * bp)
        P01 = share * (a.P01 + ap * av) + rest * (b.P01 + bp * bv)
        P11 = share * (a.P11 + av * av) + rest * (b.P11 + bv * bv)
        mixed.append((p, v, P00, P01, P11))
    a.p, a.v, a.P00, a.P01, a.P11 = mixed[0]
    b.p, b.v, b.P00, b.P01, b.P11 = mixed[1]


def _associate(axis: Axis, z: float, right: float, density: float) -> float:
    """Update by a look that may be clutter; the look's likelihood."""
    S = axis.P00 + axis.R
    y = z - axis.p
    hit = right * exp(-0.5 * y * y / S) / sqrt(2.0 * pi * S)
    likelihood = hit + density
    beta = hit / likelihood
    K, L = axis.P00 / S, axis.P01 / S
    axis.p += beta * K * y
    axis.v += beta * L * y
    # the covariance shrinks by the share that believes the look, and grows by the doubt
    spread = beta * (1.0 - beta) * y * y
    P00, P01 = axis.P00, axis.P01
    axis.P00 += -beta * K * P00 + spread * K * K
    axis.P01 += -beta * K * P01 + spread * K * L
    axis.P11 += -beta * L * P01 + spread * L * L
    return likelihood


def predictor(kind: Kind, sigma: float, rng: np.random.Generator) -> Predictor:
    """One of Motai's predictors, or ours, for looks with deviation `sigma`, rad."""
    match kind:
        case "kf":
            return Kf(sigma=sigma)
        case "of":
            return Of()
        case "ofkf":
            return OfKf(sigma=sigma)
        case "pf":
            return Pf(rng, sigma=sigma)
        case "imm_pda":
            return ImmPda(sigma=sigma)
