"""A calm and an agile filter of a target's direction, mixed, for looks that may be wrong."""

from math import exp, pi, radians, sqrt

from followerd.estimation.direction import Look
from followerd.estimation.direction_kf import Axis
from followerd.estimation.false_looks import FalseLooks
from followerd.estimation.pan_flow import Pair

SLOWS = 0.1  # s, in which a target that is not seen may turn back: what is known of its rate fades
MOVES = 4.2  # sigmas between doubted looks, from which they show something that moves
AGREE = 6.0, radians(4.0)  # sigmas, and rad besides, between doubted looks of the same thing
RATE = radians(10.0)  # rad/s, deviation of the rate of what was doubted


class ImmPda:
    """Ours: a calm and an agile filter, mixed by how well each foresees; looks may be wrong.

    Interacting multiple models with probabilistic data association: a look is the target's with
    probability 1 - `clutter`, else anywhere within `field`, or of something warm that stands.
    """

    def __init__(
        self,
        calm: float = radians(20.0),
        agile: float = radians(600.0),
        sigma: float = radians(0.7),
        stay: float = 0.85,
        clutter: float = 0.03,
        field: float = radians(60.0),
        agreeing: int = 4,
    ) -> None:
        """`calm` and `agile` are accelerations, rad/s²; `stay` is the probability that a model
        holds from one look to the next; `agreeing` doubted looks in a row show the target."""
        self._accels, self._sigma, self._stay = (calm, agile), sigma, stay
        self._agreeing = agreeing
        self._clutter, self._field = clutter, field
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
        false = FalseLooks(self._sigma, self._clutter, self._field)
        return _Mixture(*models, self._stay, 1.0 - self._clutter, false, self._agreeing)


class _Mixture:
    """The two models of one angle, their probabilities, and looks doubted lately."""

    __slots__ = ("agile", "agreeing", "calm", "doubted", "false", "mu", "right", "stay")

    def __init__(
        self, calm: Axis, agile: Axis, stay: float, right: float, false: FalseLooks, agreeing: int
    ) -> None:
        self.calm, self.agile = calm, agile
        self.mu = 0.5  # probability of the calm model
        self.stay, self.right, self.false, self.agreeing = stay, right, false, agreeing
        # rad and s since: looks in a row that agreed with each other, not with us
        self.doubted: list[tuple[float, float]] = []

    def ahead(self, dt: float) -> float:
        a, b, mu = self.calm, self.agile, self.mu
        return mu * (a.p + dt * a.v) + (1.0 - mu) * (b.p + dt * b.v)

    def step(self, z: float, dt: float) -> None:
        a, b, stay = self.calm, self.agile, self.stay
        calm = stay * self.mu + (1.0 - stay) * (1.0 - self.mu)
        _interact(a, b, stay * self.mu / calm, (1.0 - stay) * self.mu / (1.0 - calm))
        a.predict(dt)
        b.predict(dt)
        density = self.false.density(z)
        la, believed_a = _associate(a, z, self.right, density)
        lb, believed_b = _associate(b, z, self.right, density)
        self.mu = mu = min(max(calm * la / (calm * la + (1.0 - calm) * lb), 0.01), 0.99)
        false = mu * believed_a + (1.0 - mu) * believed_b < 0.5
        self.false.take(z, false=false)
        if false:
            self._doubt(z, dt)
        elif self.doubted:
            self.false.learn(self.doubted[-1][0])
            self.doubted.clear()

    def _doubt(self, z: float, dt: float) -> None:
        """Looks in a row that agree with each other, not with us: start anew there.

        What else is warm stands still, so of looks that move along fewer suffice: a target that
        turns back is doubted at first, too.
        """
        fade, R = exp(-dt / SLOWS), self.agile.R
        self.calm.v *= fade
        self.agile.v *= fade
        self.doubted = [(before, age + dt) for before, age in self.doubted]
        if self.doubted and abs(z - self.doubted[-1][0]) > AGREE[0] * sqrt(R) + AGREE[1]:
            self.doubted.clear()
        self.doubted.append((z, 0.0))
        first, age = self.doubted[0]
        if len(self.doubted) < self.agreeing and abs(z - first) <= MOVES * sqrt(R):
            return
        age = max(age, dt)  # of a single look
        for axis in (self.calm, self.agile):
            axis.p, axis.v = z, (z - first) / age
            axis.P00, axis.P01, axis.P11 = R, R / age, 2.0 * R / (age * age) + RATE * RATE
        self.doubted.clear()


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


def _associate(axis: Axis, z: float, right: float, density: float) -> tuple[float, float]:
    """Update by a look that may be clutter; the look's likelihood, and how far it is believed."""
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
    return likelihood, beta
