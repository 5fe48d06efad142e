"""The baselines of Tseng and Tang 2009, Tables 1 and 3: nearly constant velocity, as a Kalman
filter and as a sampling importance resampling particle filter."""

from math import exp, inf, pi

import numpy as np
from pydantic import Field

from followerd.estimation import kalman
from followerd.estimation.occluded import Complex, Sweep
from followerd.estimation.particles import resample
from followerd.geometry import Array
from followerd.settings import Settings


class ConstantVelocitySettings(Settings):
    """How a person with a nearly constant velocity moves."""

    acceleration: float = Field(0.5, gt=0, description="white noise density, m²/s³")
    speed_mps: float = Field(0.7, gt=0, description="deviation of the first velocity, per axis")
    start_m: float = Field(0.1, gt=0, description="deviation of the first position, per axis")
    particles: int = Field(1000, ge=1, description="of the particle filter")


class ConstantVelocityKalman:
    """KF-CV."""

    def __init__(self, settings: ConstantVelocitySettings | None = None) -> None:
        self.settings = settings or ConstantVelocitySettings()

    def start(self, at: complex) -> None:
        """At `at`, velocity unknown."""
        s = self.settings
        self.x: Array = np.array([at.real, at.imag, 0.0, 0.0])
        self.P: Array = np.array([[s.start_m**2] * 2, [0.0] * 2, [s.speed_mps**2] * 2])

    def predict(self, dt: float) -> None:
        """Straight on."""
        self.x, self.P = kalman.predict(self.x, self.P, dt, (self.settings.acceleration,) * 2)

    def nearness(self, at: complex, variance: float) -> tuple[float, float]:
        """Predictive likelihood and squared Mahalanobis distance."""
        S = float(self.P[0, 0]) + variance
        distance2 = abs(at - self.position()) ** 2 / S
        return exp(-0.5 * distance2) / (2.0 * pi * S), distance2

    def correct(self, at: complex, variance: float) -> None:
        """Kalman update."""
        z, r = np.array([at.real, at.imag]), np.array([variance, variance])
        self.x, self.P = kalman.update(self.x, self.P, z, r)

    def miss(self, sweep: Sweep) -> None:
        """Not being seen says nothing here."""

    def position(self) -> complex:
        """The mean."""
        return complex(self.x[0], self.x[1])

    def covariance(self) -> Array:
        """Of the position."""
        return np.diag(self.P[0])


class Cloud:
    """Weighted points (N,): what filters of particles share.

    Sums are not written as products of vectors, which start threads once N is large.
    """

    def __init__(self, count: int, rng: np.random.Generator) -> None:
        self.count = count
        self.rng = rng
        self.z: Complex = np.zeros(count, complex)
        self.w: Array = np.full(count, 1.0 / count)

    def noise(self, sigma: float) -> Complex:
        """Independent Gaussian noise (N,) of `sigma` per axis."""
        drawn: Complex = self.rng.standard_normal(2 * self.count).view(complex)
        return sigma * drawn

    def offsets2(self, at: complex) -> Array:
        """Squared distances (N,) from `at`, m²."""
        off = self.z - at
        squared: Array = off.real**2 + off.imag**2
        return squared

    def nearness(self, at: complex, variance: float) -> tuple[float, float]:
        """Of a measurement with `variance`, that of the particles included, m² per axis."""
        distance2 = self.offsets2(at) / variance
        likelihood = float((self.w * np.exp(-0.5 * distance2)).sum()) / (2.0 * pi * variance)
        return likelihood, float(distance2.min(initial=inf))

    def weigh(self, factors: Array) -> bool:
        """Multiply the weights (N,); whether enough of them was left to go by."""
        weights = self.w * factors
        total = float(weights.sum())
        if total < 1e-9:
            return False
        self.w = weights / total
        return True

    def thin(self) -> np.ndarray | None:
        """Indices (N,) to keep, once half of the particles count for nothing; weights are equal
        then."""
        if float(np.square(self.w).sum()) * self.count < 2.0:
            return None
        indices = resample(self.w, self.rng)
        self.w = np.full(self.count, 1.0 / self.count)
        return indices

    def mean(self) -> complex:
        """Weighted mean."""
        return complex((self.w * self.z).sum())

    def covariance(self, about: complex) -> Array:
        """Second moment (2, 2) about a point, m²."""
        off = self.z - about
        xy = np.stack([off.real, off.imag])
        moment: Array = (self.w * xy) @ xy.T
        return moment


class ConstantVelocityParticles:
    """SIR-PF: the same motion and the same noise, by samples."""

    def __init__(
        self, rng: np.random.Generator, settings: ConstantVelocitySettings | None = None
    ) -> None:
        self.settings = settings or ConstantVelocitySettings()
        self.cloud = Cloud(self.settings.particles, rng)
        self.v: Complex = np.zeros(self.settings.particles, complex)

    def start(self, at: complex) -> None:
        """At `at`, velocities drawn."""
        s, cloud = self.settings, self.cloud
        cloud.z = at + cloud.noise(s.start_m)
        cloud.w = np.full(cloud.count, 1.0 / cloud.count)
        self.v = cloud.noise(s.speed_mps)

    def predict(self, dt: float) -> None:
        """Straight on, with white acceleration noise."""
        cloud, q = self.cloud, self.settings.acceleration
        kick = cloud.noise((q * dt) ** 0.5)
        aside = cloud.noise((q * dt**3 / 12.0) ** 0.5)
        cloud.z = cloud.z + dt * self.v + 0.5 * dt * kick + aside
        self.v = self.v + kick

    def nearness(self, at: complex, variance: float) -> tuple[float, float]:
        """Likelihood of the samples, and distance from the nearest."""
        return self.cloud.nearness(at, variance)

    def correct(self, at: complex, variance: float) -> None:
        """Weights, then resampling."""
        if self.cloud.weigh(np.exp(-0.5 * self.cloud.offsets2(at) / variance)):
            kept = self.cloud.thin()
            if kept is not None:
                self.cloud.z, self.v = self.cloud.z[kept], self.v[kept]

    def miss(self, sweep: Sweep) -> None:
        """Not being seen says nothing here."""

    def position(self) -> complex:
        """The mean."""
        return self.cloud.mean()

    def covariance(self) -> Array:
        """Of the samples."""
        return self.cloud.covariance(self.cloud.mean())
