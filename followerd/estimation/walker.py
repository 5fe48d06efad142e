"""Where one walking person is on the ground: particles (N, 4) of x, y in m and velocity in m/s.

A robot without odometry that turns throws its person about, so that the prediction has heavy
tails; candidates are alternatives, so that the likelihood is that of the best one.
"""

from math import exp, sqrt

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.estimation.particles import resample
from followerd.geometry import Array
from followerd.settings import Settings

Mask = npt.NDArray[np.bool_]

START_SIGMA = np.array([0.1, 0.1, 1.2, 1.2])  # m, m/s


class WalkerSettings(Settings):
    """What is believed about how a person moves and is seen."""

    particles: int = Field(1000, ge=50, le=100_000)
    accel_density: float = Field(1.5, gt=0, description="of the walking person, m^2/s^3")
    pace_memory_s: float = Field(2.5, gt=0, description="in which a velocity fades")
    place_density: float = Field(0.004, gt=0, description="of the position besides, m^2/s")
    leaps_hz: float = Field(0.5, ge=0, description="how often a particle may be anywhere near")
    leaps_turning_hz: float = Field(1.5, ge=0, description="the same on a robot without odometry")
    leap_m: float = Field(0.35, gt=0, description="deviation of that")
    pair_sigma_m: float = Field(0.08, gt=0, description="of the middle of two legs")
    leg_sigma_m: float = Field(0.15, gt=0, description="of it, where one leg is seen")
    leg_weight: float = Field(0.4, gt=0, le=1, description="of a leg alone, of that of a pair")
    clutter: float = Field(0.01, gt=0, description="likelihood of being seen nowhere")


class Walker:
    """The cloud of one person."""

    def __init__(
        self, at: tuple[float, float], settings: WalkerSettings, rng: np.random.Generator
    ) -> None:
        self.settings = settings
        self._rng = rng
        self.particles: Array = np.empty((settings.particles, 4))
        self.place(np.array(at))

    def place(self, at: Array) -> None:
        """Begin anew at a point (2,)."""
        cloud = self._rng.standard_normal((len(self.particles), 4))
        cloud *= START_SIGMA
        cloud[:, :2] += at
        self.particles = cloud
        self.state: Array = np.array([*at, 0.0, 0.0])  # (4,) the particles' median, moved on
        self.support = 1.0  # share of the cloud that some candidate bears out
        self.spread = float(START_SIGMA[0])  # m, of the newest weighted cloud

    def predict(self, dt: float, by_odometry: bool) -> None:
        """Walk on for `dt` seconds; `by_odometry` the robot's own turns are accounted for."""
        s, rng, cloud = self.settings, self._rng, self.particles
        n = len(cloud)
        fade = exp(-dt / s.pace_memory_s)
        cloud[:, 2:] *= fade
        cloud[:, 2:] += sqrt(s.accel_density * dt) * rng.standard_normal((n, 2))
        cloud[:, :2] += cloud[:, 2:] * dt
        cloud[:, :2] += sqrt(s.place_density * dt) * rng.standard_normal((n, 2))
        self.state[2:] *= fade
        self.state[:2] += self.state[2:] * dt
        rate = s.leaps_hz if by_odometry else s.leaps_turning_hz
        leaps = int(rng.binomial(n, min(rate * dt, 1.0)))
        cloud[n - leaps :, :2] += s.leap_m * rng.standard_normal((leaps, 2))

    def update(self, position: Array, both: Mask, weight: Array) -> None:
        """Weigh by candidates (M, 2), each a pair of legs or one, trusted by `weight` (M,)."""
        s = self.settings
        xy = self.particles[:, :2]
        seen = np.zeros(len(xy))
        if len(position):
            off = xy[:, None] - position
            scaled = np.einsum("ijk,ijk->ij", off, off)
            scaled *= -0.5 / np.square(np.where(both, s.pair_sigma_m, s.leg_sigma_m))
            scaled += np.log(weight * np.where(both, 1.0, s.leg_weight))
            seen = np.exp(scaled.max(axis=1))
        likelihood = seen + s.clutter
        self.support = float(seen.sum() / likelihood.sum())
        # what no candidate bears out says nothing about how well the person is placed
        share = seen if self.support > 0.5 else likelihood
        share = share / share.sum()
        off = xy - share @ xy
        self.spread = sqrt(share @ np.einsum("ij,ij->i", off, off))
        # shuffled, as it is the last ones that leap
        self.particles = self.particles[self._rng.permutation(resample(likelihood, self._rng))]
        self.state = np.median(self.particles, axis=0)
