"""The person walks on a stream field toward a goal nobody knows: Tseng and Tang 2009.

The goal, 2 m from the person, is sampled in its direction and in the strength of its draw. The
person's place given the goal is a Kalman filter (`StreamFieldRbpf`) or sampled like the goal
(`StreamFieldSir`, the PF-SF of Table 4). Repaired where the paper cannot work:

1. eq. (3)-(4): signs of sink and source, see `stream_field`;
2. Algorithm 1, line 13 zeroes the weights, so that a scan without the person would wipe the set:
   they stay as they are;
3. line 20 weighs by the person's place after line 19 has corrected it, which uses the measurement
   twice: the weight is the predictive likelihood;
4. line 21 keeps goal and place of step k-1: those of step k;
5. several discs: images are summed, a first order; a wall rule keeps the flow out of the nearest;
6. the variance is not carried along the field, whose goal goes with the person: it only grows, and
   is then the same for every particle.

Left open by the paper, and chosen here: goals go on being sampled while the person is hidden.
"""

from math import pi, sqrt

import numpy as np
from pydantic import Field

from followerd.estimation.occluded import Complex, Sweep
from followerd.estimation.person_filters import Cloud
from followerd.geometry import Array
from followerd.settings import Settings
from followerd.stream_field import Floats, discs, lines, velocity

BLOCK = 256  # particles whose flow is computed at once, so that it stays in the cache
STEP = 0.25  # s, to which the paper's noise per step refers


class StreamFieldSettings(Settings):
    """The goal, and how freely it moves."""

    particles: int = Field(1000, ge=1)
    goal_m: float = Field(2.0, gt=0, description="from the person")
    turn_rad: float = Field(0.5, gt=0, description="noise of the goal's direction, per 0.25 s")
    speed_noise_mps: float = Field(0.15, gt=0, description="of the draw, per 0.25 s")
    fastest_mps: float = Field(1.5, gt=0)
    first_speed_mps: float = Field(1.2, gt=0, description="most, at the start")
    step_noise_m: float = Field(0.1, gt=0, description="of the place, per axis and 0.25 s")
    start_m: float = Field(0.1, gt=0, description="deviation of the first place, per axis")
    disc_m: float = Field(0.28, gt=0, description="radius of the discs that make up a board")
    wall_m: float = Field(0.15, ge=0, description="nobody walks nearer to the room's walls")


class StreamField:
    """Particles on the field: places z, goals' directions phi and speeds at goal_m."""

    def __init__(
        self,
        boards: Array,
        bounds: Array,
        rng: np.random.Generator,
        settings: StreamFieldSettings | None = None,
    ) -> None:
        """`boards` (K, 2, 2) become discs; `bounds` (2, 2) are the room's corners, m."""
        self.settings = s = settings or StreamFieldSettings()
        self.cloud = Cloud(s.particles, rng)
        self.centres = discs(boards, s.disc_m)
        self.radii = np.full(self.centres.size, s.disc_m)
        (self._left, self._low), (self._right, self._high) = (
            np.asarray(bounds) + [[s.wall_m], [-s.wall_m]]
        ).tolist()
        self.phi: Array = np.zeros(s.particles)
        self.speed: Floats = np.zeros(s.particles)

    def start(self, at: complex) -> None:
        """Everybody at `at`, bound for anywhere."""
        s, cloud = self.settings, self.cloud
        cloud.z = np.full(cloud.count, at)
        cloud.w = np.full(cloud.count, 1.0 / cloud.count)
        self.phi = cloud.rng.uniform(-pi, pi, cloud.count)
        self.speed = cloud.rng.uniform(0.0, s.first_speed_mps, cloud.count)

    @property
    def goals(self) -> Complex:
        """Where the particles (N,) want to go."""
        goals: Complex = self.cloud.z + self.settings.goal_m * np.exp(1j * self.phi)
        return goals

    def courses(self, count: int) -> Complex:
        """Ways (count, N) that the person may take, for drawing: stream lines to likely goals."""
        order = self.phi.argsort()
        share = self.cloud.w[order].cumsum()
        middles = (np.arange(count) + 0.5) / count * share[-1]
        picks = order[np.minimum(share.searchsorted(middles), order.size - 1)]
        starts = np.full(count, self.cloud.mean())
        return lines(starts, self.goals[picks], self.centres, self.radii, 0.1, 25)

    def advance(self, dt: float) -> None:
        """Sample goals (line 15), then go with the flow (line 16, eq. 6)."""
        s, cloud = self.settings, self.cloud
        steps = sqrt(dt / STEP)
        self.phi = self.phi + steps * s.turn_rad * cloud.rng.standard_normal(cloud.count)
        self.speed = self.speed + steps * s.speed_noise_mps * cloud.rng.standard_normal(cloud.count)
        self.speed = self.speed.clip(0.0, s.fastest_mps)
        goals, moved = self.goals, np.empty(cloud.count, complex)
        for first in range(0, cloud.count, BLOCK):
            some = slice(first, first + BLOCK)
            strength = s.goal_m * self.speed[some]
            flow = velocity(cloud.z[some], goals[some], strength, self.centres, self.radii)
            moved[some] = cloud.z[some] + dt * flow
        cloud.z = self._inside(moved)

    def thin(self) -> None:
        """Resample (line 22), if it is time."""
        kept = self.cloud.thin()
        if kept is not None:
            self.cloud.z = self.cloud.z[kept]
            self.phi, self.speed = self.phi[kept], self.speed[kept]

    def _inside(self, z: Complex) -> Complex:
        x, y = z.real.clip(self._left, self._right), z.imag.clip(self._low, self._high)
        inside: Complex = x + 1j * y
        return inside


class StreamFieldRbpf:
    """RBPF-SF: sampled goals, and of the place given the goal a Kalman filter."""

    def __init__(self, field: StreamField) -> None:
        self.field = field
        self.cloud = field.cloud
        self.P = 0.0  # m² per axis, of every particle

    def start(self, at: complex) -> None:
        """About `at`."""
        self.field.start(at)
        self.P = self.field.settings.start_m**2

    def predict(self, dt: float) -> None:
        """Lines 15 and 16."""
        self.field.advance(dt)
        self.P += self.field.settings.step_noise_m**2 * dt / STEP

    def nearness(self, at: complex, variance: float) -> tuple[float, float]:
        """Of the mixture."""
        return self.cloud.nearness(at, self.P + variance)

    def correct(self, at: complex, variance: float) -> None:
        """Lines 19, 20 and 22."""
        S = self.P + variance
        weighed = self.cloud.weigh(np.exp(-0.5 * self.cloud.offsets2(at) / S))
        gain = self.P / S
        self.cloud.z = self.cloud.z + gain * (at - self.cloud.z)
        self.P *= 1.0 - gain
        if weighed:
            self.field.thin()

    def miss(self, sweep: Sweep) -> None:
        """Not being seen says nothing here: the weights stay."""

    def courses(self, count: int) -> Complex:
        """See StreamField."""
        return self.field.courses(count)

    def position(self) -> complex:
        """The mean."""
        return self.cloud.mean()

    def covariance(self) -> Array:
        """Of the mixture."""
        covariance: Array = self.cloud.covariance(self.cloud.mean()) + self.P * np.eye(2)
        return covariance


class StreamFieldSir:
    """PF-SF: the place is sampled like the goal."""

    def __init__(self, field: StreamField) -> None:
        self.field = field
        self.cloud = field.cloud

    def start(self, at: complex) -> None:
        """About `at`."""
        self.field.start(at)
        self.cloud.z = self.cloud.z + self.cloud.noise(self.field.settings.start_m)

    def predict(self, dt: float) -> None:
        """Lines 15 and 16, with noise on the place."""
        self.field.advance(dt)
        noise = self.field.settings.step_noise_m * sqrt(dt / STEP)
        self.cloud.z = self.cloud.z + self.cloud.noise(noise)

    def nearness(self, at: complex, variance: float) -> tuple[float, float]:
        """Of the samples."""
        return self.cloud.nearness(at, variance)

    def correct(self, at: complex, variance: float) -> None:
        """Lines 20 and 22."""
        if self.cloud.weigh(np.exp(-0.5 * self.cloud.offsets2(at) / variance)):
            self.field.thin()

    def miss(self, sweep: Sweep) -> None:
        """Not being seen says nothing here: the weights stay."""

    def courses(self, count: int) -> Complex:
        """See StreamField."""
        return self.field.courses(count)

    def position(self) -> complex:
        """The mean."""
        return self.cloud.mean()

    def covariance(self) -> Array:
        """Of the samples."""
        return self.cloud.covariance(self.cloud.mean())
