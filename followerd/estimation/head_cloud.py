"""Particles of a head's centre and velocity in the image (Kwolek 2004, section 4).

Clouds are (N, 4): x, y in px, their velocities in px/s. The size is no part of the state: it
comes from the depth.
"""

from math import sqrt

import numpy as np

from followerd.estimation.particles import resample
from followerd.geometry import Array, Camera, Pose2

NOMINAL = 0.1, 27.0  # s and px: the noise below is for frames so far apart, a head so wide
POSITION_NOISE, VELOCITY_NOISE = (5.0, 3.0), (40.0, 20.0)  # px; px/s
DAMPING = 0.85  # of the velocity, in the nominal time
FASTEST = 400.0  # px/s, for a head of the nominal size
ATTRACTION = 0.03  # of half the width, deviation of particles drawn anew at a place
FARTHEST = 8.0  # m; a head without a depth is taken to be there


class HeadCloud:
    """N weighted particles."""

    def __init__(self, count: int, damped: bool, rng: np.random.Generator) -> None:
        """`damped`: velocities fade; else it is the plain constant velocity model."""
        self.particles: Array = np.zeros((count, 4))
        self.weights: Array = np.full(count, 1.0 / count)
        self._damped = damped
        self._rng = rng

    @property
    def mean(self) -> Array:
        """State (4,)."""
        mean: Array = self.weights @ self.particles
        return mean

    def seed(self, x: float, y: float, a: float) -> None:
        """All particles near (x, y), standing, for a head of half width `a` px."""
        count = len(self.particles)
        noise = self._rng.standard_normal((count, 4)) * (*POSITION_NOISE, *VELOCITY_NOISE)
        self.particles = noise * (0.5 * a / NOMINAL[1]) + (x, y, 0.0, 0.0)
        self.weights = np.full(count, 1.0 / count)

    def predict(self, dt: float, a: float, frame: tuple[int, int]) -> None:
        """Resample and move on by `dt` s; positions stay in the image `frame` (w, h)."""
        count, steps, scale = len(self.particles), dt / NOMINAL[0], a / NOMINAL[1]
        cloud = self.particles[resample(self.weights, self._rng)]
        self.weights = np.full(count, 1.0 / count)
        if self._damped:
            cloud[:, 2:] *= DAMPING**steps
        cloud[:, :2] += dt * cloud[:, 2:]
        noise = self._rng.standard_normal((count, 4)) * (*POSITION_NOISE, *VELOCITY_NOISE)
        cloud += noise * (scale * sqrt(steps))
        fastest = FASTEST * scale
        lowest, highest = (0.0, 0.0, -fastest, -fastest), (*frame, fastest, fastest)
        self.particles = np.minimum(np.maximum(cloud, lowest), highest)

    def weigh(self, logs: Array) -> None:
        """Weights from log likelihoods (N,)."""
        weights = np.exp(logs - logs.max())
        self.weights = weights / weights.sum()

    def attract(
        self, x: float, y: float, a: float, share: float, pace: tuple[float, float]
    ) -> None:
        """Draw a share of the particles anew at (x, y), as much faster as `pace` says, px/s.

        They weigh that share together.
        """
        some = slice(0, None, max(round(1.0 / share), 1))
        count = len(self.particles[some])
        spread = ATTRACTION * a * self._rng.standard_normal((count, 2))
        self.particles[some, :2] = spread + (x, y)
        self.particles[some, 2:] += pace
        self.weights *= 1.0 - share
        self.weights[some] = share / count
        self.weights /= self.weights.sum()

    def still(self) -> None:
        """Nothing seen: velocities fade."""
        self.particles[:, 2:] *= 0.7

    def move_camera(self, camera: Camera, before: Pose2, now: Pose2, depth: float | None) -> None:
        """Shift the particles by what the robot's motion between two `odom_from_base` does to the
        image of a thing that stands still at `depth` m (the paper leaves this out)."""
        motion = ~now @ before
        if motion == Pose2():
            return
        x, y = self.particles[:, 0] - 0.5, self.particles[:, 1] - 0.5
        ways = np.column_stack(
            [(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones(len(x))]
        )
        points = ways * (depth or FARTHEST) @ camera.axes + (camera.x, camera.y, camera.z)
        points[:, :2] = motion.apply(points[:, :2])
        seen = camera.project(points)[:, :2] + 0.5
        self.particles[:, :2] = np.where(np.isfinite(seen), seen, self.particles[:, :2])
