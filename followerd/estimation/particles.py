"""The particle half: clouds (N, 4) of x, y in px and their velocities in px/s, weights (N,).

Zhuang et al. 2008, section 2.2 and steps 1-4 of section 3.3.2. Clouds made here lie in memory
column by column: arithmetic on long columns is several times as fast as on rows of four.
"""

from math import sqrt
from typing import Literal

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array

Estimator = Literal["max", "mean", "cluster"]
Indices = npt.NDArray[np.intp]


def resample(weights: Array, rng: np.random.Generator) -> Indices:
    """Indices (N,) drawn in proportion to `weights` (N,), systematically: one random number.

    Step 1; the paper draws N times with replacement, which adds variance and nothing else.
    """
    n = weights.size
    edges = weights.cumsum()
    picks = (rng.random() + np.arange(n)) * (edges[-1] / n)
    indices: Indices = np.minimum(edges.searchsorted(picks), n - 1)
    return indices


def ncv_noise(n: int, dt: float, q: tuple[float, float], rng: np.random.Generator) -> Array:
    """Noise (n, 4) of the nearly constant velocity model, covariance Q11 of eq. 11 f.

    `q` is the spectral density of x and y, px²/s³. Position and velocity noise are correlated
    (√3/2): four independent draws would be another model.
    """
    a = sqrt(dt**3 / 3)
    b = dt**2 / (2 * a)
    c = sqrt(dt - b * b)
    roots = np.array([[sqrt(q[0])], [sqrt(q[1])]])
    n1, n2 = rng.standard_normal((2, n, 2)).transpose(0, 2, 1)
    noise = np.empty((4, n))
    np.multiply(n1, a * roots, out=noise[:2])
    np.multiply(n1, b * roots, out=noise[2:])
    noise[2:] += n2 * (c * roots)
    return noise.T


def predict(particles: Array, dt: float, q: tuple[float, float], rng: np.random.Generator) -> Array:
    """Particles (N, 4) `dt` seconds later (eq. 9, step 2)."""
    moved = ncv_noise(len(particles), dt, q, rng)
    moved += particles
    moved[:, :2] += dt * particles[:, 2:]
    return moved


def warp(particles: Array, homography: Array, below: float = 0.0) -> Array:
    """Particles (N, 4) carried by a homography (3, 3) of the image (the paper's figure 3).

    The point that is mapped lies `below` px under the particle (the foot). Velocities turn with
    the Jacobian of the map at the mean particle.
    """
    places, speeds = particles.T[:2], particles.T[2:]
    out = np.empty((4, len(particles)))
    mapped = homography[:, :2] @ places
    mapped += homography[:, 2:] + below * homography[:, 1:2]
    np.divide(mapped[:2], mapped[2], out=out[:2])
    out[1] -= below
    middle = places.sum(axis=1) / len(particles)
    middle[1] += below
    np.matmul(jacobian(homography, middle), speeds, out=out[2:])
    return out.T


def jacobian(homography: Array, point: Array) -> Array:
    """Derivative (2, 2) of the map of `homography` (3, 3) at `point` (2,)."""
    (a, b, c), (d, e, f), (g, h, i) = homography.tolist()
    x, y = point.tolist()
    z = g * x + h * y + i
    u, v = (a * x + b * y + c) / z, (d * x + e * y + f) / z
    return np.array([[(a - u * g) / z, (b - u * h) / z], [(d - v * g) / z, (e - v * h) / z]])


def nearest(particles: Array, centres: Array) -> tuple[Indices, Array]:
    """For each particle the index (N,) of its nearest centre (M, 2), and the offsets (N, 2).

    The least uncertain measurement of step 4.
    """
    dx = particles[:, :1] - centres[:, 0]
    dy = particles[:, 1:2] - centres[:, 1]
    chosen: Indices = np.argmin(dx * dx + dy * dy, axis=1)
    return chosen, particles[:, :2] - centres[chosen]


def log_gaussian(offsets: Array, sigma: tuple[float, float]) -> Array:
    """Logarithm of eq. 14 without its constant, (N,); R_U = diag(sigma²) in measurement space."""
    scaled = offsets / sigma
    log_weights: Array = -0.5 * np.einsum("ij,ij->i", scaled, scaled)
    return log_weights


def normalised(log_weights: Array) -> Array:
    """Weights (N,) summing to 1."""
    weights: Array = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    return weights


def estimate(particles: Array, weights: Array, groups: Indices, how: Estimator) -> Array:
    """State (4,): the heaviest particle (the paper's MAP), the mean, or the heaviest group's mean.

    `groups` (N,) holds the index of each particle's candidate.
    """
    if how == "max":
        chosen: Array = particles[weights.argmax()]
        return chosen
    if how == "cluster":
        heaviest = np.argmax(np.bincount(groups, weights))
        weights = np.where(groups == heaviest, weights, 0.0)
    mean: Array = weights @ particles / weights.sum()
    return mean
