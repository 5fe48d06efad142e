"""A person tracked through occlusion: what any motion model needs round it.

Association, gate and re-acquisition stand here once, so that filters differ by their model alone.
Everything is in the map's frame; points of the plane are complex numbers x + iy, m.
Tseng and Tang 2009, Algorithm 1, lines 13-22.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Protocol

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.geometry import Array, Pose2
from followerd.settings import Settings

Complex = npt.NDArray[np.complex128]


class PursuitSettings(Settings):
    """Which candidate is the person, and when to start again elsewhere."""

    leg_sigma_m: float = Field(0.06, gt=0, description="of the middle between two legs")
    one_leg_factor: float = Field(2.5, ge=1, description="variance of a candidate with one leg")
    gate_sigmas: float = Field(4.0, gt=0, description="farther from every hypothesis is not them")
    reacquire_m: float = Field(0.7, gt=0, description="somebody this far off, and none nearer")
    reacquire_step_m: float = Field(0.5, gt=0, description="between the scans that say so")
    reacquire_scans: int = Field(2, ge=1, description="how many scans have to say so")
    reacquire_s: float = Field(0.0, ge=0, description="and for how long")


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """One scan, and who may be a person in it."""

    stamp: float  # s
    map_from_laser: Pose2
    position_sigma: float  # m, of that pose, per axis
    heading_sigma: float  # rad
    angle_min: float  # rad
    angle_increment: float  # rad
    ranges: Array  # (N,) m, inf where nothing was met
    people: Complex  # (J,) candidates
    both: npt.NDArray[np.bool_]  # (J,) two legs were seen, not one

    def variance(self, at: complex) -> float:
        """Of a place seen from this pose, m² per axis, by the doubt about the pose alone."""
        away = abs(at - complex(self.map_from_laser.x, self.map_from_laser.y))
        return self.position_sigma**2 + (away * self.heading_sigma) ** 2


@dataclass(frozen=True, slots=True)
class Estimate:
    """Where the person is believed to be."""

    stamp: float  # s
    position: complex
    covariance: Array  # (2, 2) m²
    seen: bool  # a candidate was taken for them in this scan
    unseen_for: float  # s

    @property
    def spread(self) -> float:
        """Standard deviation of the distance from `position`, m."""
        return sqrt(float(np.trace(self.covariance)))


class PersonFilter(Protocol):
    """A motion model with its way of carrying a belief about one person."""

    def start(self, at: complex) -> None:
        """Forget everything; the person stands about `at`."""
        ...

    def predict(self, dt: float) -> None:
        """Let `dt` seconds pass."""
        ...

    def nearness(self, at: complex, variance: float) -> tuple[float, float]:
        """A measurement's likelihood, and its squared distance from the nearest hypothesis,
        in standard deviations."""
        ...

    def correct(self, at: complex, variance: float) -> None:
        """The person was seen `at` a place known to `variance`, m² per axis."""
        ...

    def miss(self, sweep: Sweep) -> None:
        """The person was not seen in `sweep`."""
        ...

    def position(self) -> complex:
        """Best single guess."""
        ...

    def covariance(self) -> Array:
        """Of the belief about `position` (2, 2), m²."""
        ...


class Pursuit:
    """One person, scan by scan: `step` gives None until somebody has been seen."""

    def __init__(self, belief: PersonFilter, settings: PursuitSettings | None = None) -> None:
        self.belief = belief
        self.settings = settings or PursuitSettings()
        self._stamp: float | None = None
        self._seen_at = 0.0
        self._elsewhere: list[complex] = []  # candidates far off in the scans just before
        self._elsewhere_since = 0.0  # s

    def start(self, at: complex, stamp: float) -> None:
        """The person stands at `at`."""
        self.belief.start(at)
        self._stamp = self._seen_at = stamp
        self._elsewhere = []

    def step(self, sweep: Sweep) -> Estimate | None:
        """Take one scan."""
        if self._stamp is None:
            if not sweep.people.size:
                return None
            self.start(complex(sweep.people[np.argmax(sweep.both)]), sweep.stamp)
            return self._estimate(seen=True)
        self.belief.predict(sweep.stamp - self._stamp)
        self._stamp = sweep.stamp
        seen = self._associate(sweep)
        if not seen:
            self.belief.miss(sweep)
        seen = self._reacquire(sweep) or seen
        if seen:
            self._seen_at = sweep.stamp
        return self._estimate(seen)

    def _associate(self, sweep: Sweep) -> bool:
        """Correct by the likeliest candidate within the gate, if there is one."""
        best: tuple[float, complex, float] | None = None
        for at, both in zip(sweep.people.tolist(), sweep.both.tolist(), strict=True):
            variance = self.settings.leg_sigma_m**2 * (
                1.0 if both else self.settings.one_leg_factor
            )
            variance += sweep.variance(at)
            likelihood, distance2 = self.belief.nearness(at, variance)
            if distance2 < self.settings.gate_sigmas**2 and (best is None or likelihood > best[0]):
                best = likelihood, at, variance
        if best is None:
            return False
        self.belief.correct(*best[1:])
        return True

    def _reacquire(self, sweep: Sweep) -> bool:
        """Start again where scans in a row show somebody far off and nobody near."""
        s, here = self.settings, self.belief.position()
        far = np.abs(sweep.people - here) > s.reacquire_m
        if not far.size or not far.all():
            self._elsewhere = []
            return False
        if not self._elsewhere:
            self._elsewhere_since = sweep.stamp
        at = sweep.people[np.argmax(sweep.both)]
        if self._elsewhere:
            steps = np.abs(sweep.people - self._elsewhere[-1])
            at = sweep.people[steps.argmin()]
            if steps.min() > s.reacquire_step_m:
                self._elsewhere = []
                self._elsewhere_since = sweep.stamp
        self._elsewhere.append(complex(at))
        if len(self._elsewhere) < s.reacquire_scans:
            return False
        if sweep.stamp - self._elsewhere_since < s.reacquire_s:
            return False
        self.start(complex(at), sweep.stamp)
        return True

    def _estimate(self, seen: bool) -> Estimate:
        stamp = self._stamp or 0.0
        belief = self.belief
        return Estimate(
            stamp,
            belief.position(),
            belief.covariance(),
            seen,
            0.0 if seen else stamp - self._seen_at,
        )
