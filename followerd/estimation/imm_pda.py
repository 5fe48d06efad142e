"""A calm and an agile filter of a target's direction, mixed, for looks that may be wrong."""

from itertools import pairwise
from math import exp, pi, radians, sqrt

from followerd.estimation.direction import Look
from followerd.estimation.direction_kf import Axis
from followerd.estimation.pan_flow import Pair

FIELD = radians(60.0)  # within which a wrong look may be anywhere
BESIDE = radians(1.2)  # deviation of a wrong look from the wrong one before it
LEAST = 0.01  # what is less probable than this beside the rest is given up
MOST = 4  # stories told at once
ROOT = sqrt(2.0 * pi)


class ImmPda:
    """Ours: a calm and an agile filter, mixed by how well each foresees; looks may be wrong.

    Interacting multiple models with probabilistic data association. Wrong looks come in bursts, so
    the question whether a look was wrong is kept open until the next ones answer it: while both
    answers are probable, both stories are told on, each with its own two models.
    """

    def __init__(
        self,
        calm: float = radians(20.0),
        agile: float = radians(400.0),
        sigma: float = radians(0.7),
        stay: float = 0.97,
        clutter: float = 0.02,
        linger: float = 0.5,
        agreeing: int = 4,
    ) -> None:
        """`calm` and `agile` are accelerations, rad/s²; `stay` is the probability that a model
        holds from one look to the next, `clutter` that a wrong look follows a right one, `linger`
        that one follows a wrong one; `agreeing` wrong looks in a row show the target."""
        self._accels, self._sigma = (calm, agile), sigma
        self._odds = stay, clutter, linger
        self._agreeing = agreeing
        self._stamp = 0.0
        self._axes: tuple[_Stories, _Stories] | None = None

    def step(self, look: Look) -> None:
        """See Predictor."""
        pan, tilt = look.angles
        if self._axes is None:
            self._axes = self._stories(pan), self._stories(tilt)
        else:
            dt = look.stamp - self._stamp
            self._axes[0].step(pan, dt)
            self._axes[1].step(tilt, dt)
        self._stamp = look.stamp

    def ahead(self, dt: float) -> Pair:
        """See Predictor."""
        assert self._axes is not None
        return self._axes[0].ahead(dt), self._axes[1].ahead(dt)

    def _stories(self, z: float) -> "_Stories":
        calm, agile = (Axis(z, accel, self._sigma) for accel in self._accels)
        return _Stories(_Story(calm, agile), *self._odds, self._agreeing)


class _Stories:
    """One angle: which looks were wrong, as far as it is open; the most probable story first."""

    __slots__ = ("agreeing", "clutter", "linger", "seen", "stay", "told")

    def __init__(
        self, story: "_Story", stay: float, clutter: float, linger: float, agreeing: int
    ) -> None:
        self.told = [story]
        self.stay, self.clutter, self.linger, self.agreeing = stay, clutter, linger, agreeing
        self.seen = [story.calm.p]  # rad, the newest looks

    def ahead(self, dt: float) -> float:
        return sum(story.weight * story.ahead(dt) for story in self.told)

    def step(self, z: float, dt: float) -> None:
        beside = self._beside(z)
        going_on: list[tuple[float, _Story, bool]] = []
        for story in self.told:
            likelihood = story.foresee(z, dt, self.stay)
            wrong = self.linger if story.wrong else self.clutter
            elsewhere = beside if story.wrong else 1.0 / FIELD
            going_on.append((story.weight * (1.0 - wrong) * likelihood, story, True))
            going_on.append((story.weight * wrong * elsewhere, story, False))
        going_on.sort(key=_weight, reverse=True)
        least = LEAST * going_on[0][0]
        self.told = _told_on([one for one in going_on[:MOST] if one[0] >= least], z)
        self.seen = [*self.seen, z][-self.agreeing :]
        if self.told[0].wrong >= self.agreeing and self._agree():
            self.told = [self.told[0].anew(z)]

    def _beside(self, z: float) -> float:
        """How probable a wrong look is after another: where that was (heat sources stand still),
        or anywhere."""
        off = (z - self.seen[-1]) / BESIDE
        return 0.5 * exp(-0.5 * off * off) / (ROOT * BESIDE) + 0.5 / FIELD

    def _agree(self) -> bool:
        apart = 6.0 * sqrt(self.told[0].agile.R) + radians(4.0)
        return all(abs(after - before) <= apart for before, after in pairwise(self.seen))


class _Story:
    """Two models of one angle, given which looks were wrong."""

    __slots__ = ("agile", "calm", "mu", "of_agile", "of_calm", "weight", "wrong")

    def __init__(self, calm: Axis, agile: Axis, mu: float = 0.5) -> None:
        self.calm, self.agile = calm, agile
        self.mu = mu  # probability of the calm model
        self.weight = 1.0  # of this story among those told
        self.wrong = 0  # newest looks in a row that were wrong in it
        self.of_calm = self.of_agile = 0.0  # likelihoods of the newest look

    def ahead(self, dt: float) -> float:
        a, b, mu = self.calm, self.agile, self.mu
        return mu * (a.p + dt * a.v) + (1.0 - mu) * (b.p + dt * b.v)

    def foresee(self, z: float, dt: float, stay: float) -> float:
        """Go `dt` on; the likelihood of a right look at `z`."""
        a, b, mu = self.calm, self.agile, self.mu
        calm = stay * mu + (1.0 - stay) * (1.0 - mu)
        _interact(a, b, stay * mu / calm, (1.0 - stay) * mu / (1.0 - calm))
        a.predict(dt)
        b.predict(dt)
        self.mu, self.of_calm, self.of_agile = calm, _likelihood(a, z), _likelihood(b, z)
        return calm * self.of_calm + (1.0 - calm) * self.of_agile

    def take(self, z: float) -> None:
        """It was a right look."""
        self.calm.update(z)
        self.agile.update(z)
        calm = self.mu * self.of_calm
        self.mu = min(max(calm / (calm + (1.0 - self.mu) * self.of_agile), 0.01), 0.99)
        self.wrong = 0

    def twin(self) -> "_Story":
        """The same, to be told on otherwise."""
        twin = _Story(_copied(self.calm), _copied(self.agile), self.mu)
        twin.of_calm, twin.of_agile, twin.wrong = self.of_calm, self.of_agile, self.wrong
        return twin

    def anew(self, z: float) -> "_Story":
        """The target was somewhere else: at `z`."""
        for axis in (self.calm, self.agile):
            axis.p, axis.v = z, 0.0
            axis.P00, axis.P01, axis.P11 = axis.R, 0.0, radians(20.0) ** 2
        return _Story(self.calm, self.agile, self.mu)


def _weight(one: tuple[float, _Story, bool]) -> float:
    return one[0]


def _told_on(chosen: list[tuple[float, _Story, bool]], z: float) -> list[_Story]:
    """Each with the look taken (True) or left out; those that have become the same are told once.

    The weights add up to 1.
    """
    parents = [story for _, story, _ in chosen]
    told: list[_Story] = []
    for i, (weight, parent, right) in enumerate(chosen):
        story = parent.twin() if parent in parents[i + 1 :] else parent
        if right:
            story.take(z)
        else:
            story.wrong += 1
        story.weight = weight
        if not any(_same(story, other) for other in told):
            told.append(story)
    total = sum(story.weight for story in told)
    for story in told:
        story.weight /= total
    return told


def _same(one: _Story, other: _Story) -> bool:
    off = one.agile.p - other.agile.p
    return 4.0 * off * off < one.agile.R


def _copied(axis: Axis) -> Axis:
    copied = Axis.__new__(Axis)
    copied.q, copied.R, copied.p, copied.v = axis.q, axis.R, axis.p, axis.v
    copied.P00, copied.P01, copied.P11 = axis.P00, axis.P01, axis.P11
    return copied


def _likelihood(axis: Axis, z: float) -> float:
    S, y = axis.P00 + axis.R, z - axis.p
    return exp(-0.5 * y * y / S) / (ROOT * sqrt(S))


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
