"""A target's direction by particles: what Motai, Jha and Kruse 2012 compare with."""

from math import radians

import numpy as np

from followerd.estimation.direction import Look
from followerd.estimation.pan_flow import Pair
from followerd.geometry import Array

FRESH_RATE = radians(30.0)  # rad/s, deviation of a fresh particle's


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
        """`floor` is the least likelihood of a particle, `fresh` are drawn anew at each look.

        The paper has neither: its cloud is led away by wrong looks and stays there.
        """
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
        squares = np.square((self._cloud[:, 0] - z) / self._sigma)
        if not self._floor:
            squares -= squares.min(axis=1, keepdims=True)  # or far from all, none has any weight
        weights = np.exp(-0.5 * squares) + self._floor
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
