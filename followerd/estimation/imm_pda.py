"""A calm and an agile filter of a target's direction, mixed, for looks that may be wrong."""

from math import exp, pi, radians, sqrt

from followerd.estimation.direction import Look
from followerd.estimation.direction_kf import Axis
from followerd.estimation.pan_flow import Pair


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
        agreeing: int = 4,
    ) -> None:
        """`calm` and `agile` are accelerations, rad/s²; `stay` is the probability that a model
        holds from one look to the next; `agreeing` refused looks in a row show the target."""
        self._accels, self._sigma, self._stay = (calm, agile), sigma, stay
        self._agreeing = agreeing
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
        return _Mixture(*models, self._stay, self._clutter, self._density, self._agreeing)


class _Mixture:
    """The two models of one angle, their probabilities, and looks refused lately."""

    __slots__ = ("agile", "agreeing", "calm", "clutter", "density", "mu", "refused", "stay")

    def __init__(
        self, calm: Axis, agile: Axis, stay: float, right: float, density: float, agreeing: int
    ) -> None:
        self.calm, self.agile = calm, agile
        self.mu = 0.5  # probability of the calm model
        self.stay, self.clutter, self.density, self.agreeing = stay, right, density, agreeing
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
        """Refused looks in a row that agree with each other: start anew there."""
        wide = self.agile
        off = z - wide.p
        if off * off < 16.0 * (wide.P00 + wide.R):
            self.refused.clear()
            return False
        if self.refused and abs(z - self.refused[-1]) > 6.0 * sqrt(wide.R) + radians(4.0):
            self.refused.clear()
        self.refused.append(z)
        if len(self.refused) < self.agreeing:
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
