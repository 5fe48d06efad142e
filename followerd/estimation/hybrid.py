"""Zhuang's hybrid filter: particles carry the position, a Kalman filter carries the size.

State (eq. 10): X = [x y x' y' | w h w' h'], px and px/s. The predicted size gates the candidates
that the particles may use; the particles' estimate chooses the candidate that updates the size.
"""

from dataclasses import dataclass

import numpy as np

from followerd.estimation import kalman, particles
from followerd.estimation.particles import Estimator
from followerd.geometry import Array

SMALLEST = 4.0  # px, of either side; the largest is twice the image
HOPELESS = -60.0  # log weight below which all particles are equally wrong


@dataclass(frozen=True, slots=True)
class Noise:
    """Spectral densities and measurement deviations of an image `scale` times 192 px wide."""

    q_position: tuple[float, float]  # px²/s³
    q_size: tuple[float, float]  # px²/s³
    sigma_position: tuple[float, float]  # px
    sigma_size: tuple[float, float]  # px

    def scaled(self, scale: float) -> "Noise":
        """The same noise in an image (or of a target) `scale` times as wide."""

        def by(pair: tuple[float, float], factor: float) -> tuple[float, float]:
            return pair[0] * factor, pair[1] * factor

        return Noise(
            by(self.q_position, scale**2),
            by(self.q_size, scale**2),
            by(self.sigma_position, scale),
            by(self.sigma_size, scale),
        )


# q: the cloud must close a box jump of 12 px in a few frames; sigma: jitter of a 30 px blob
PAPER_NOISE = Noise((3e4, 1e4), (400.0, 800.0), (3.0, 3.0), (3.0, 5.0))


@dataclass(frozen=True, slots=True)
class Estimate:
    """Outcome of one update."""

    state: Array  # (4,) x y x' y'
    support: float  # 0..1, share of the particles' mass behind it
    shape: float  # 0..1, how well the chosen candidate's size fits
    candidate: int  # its index


class HybridFilter:
    """N weighted particles of the position, mean and covariance (see kalman) of the size."""

    def __init__(
        self,
        box: Array,
        count: int,
        noise: Noise,
        frame: tuple[float, float],
        rng: np.random.Generator,
    ) -> None:
        """Start at `box` (4,) x y w h (centre and size, px) in an image of size `frame` (w, h)."""
        self.noise = noise
        self.particles: Array
        self.state: Array
        width, height = frame
        speed = 2.0 * width
        self._largest = 2.0 * width, 2.0 * height
        self._limits = (
            np.array([-0.1 * width, -0.1 * height, -speed, -speed]),
            np.array([1.1 * width, 1.1 * height, speed, speed]),
        )
        self._rng = rng
        self._count = count
        self._together = np.zeros(count, dtype=np.intp)
        self._alike = np.full(count, 1.0 / count)
        self.size: Array = np.array([box[2], box[3], 0.0, 0.0])
        self.P: Array = np.zeros((3, 2))
        self.seed(box, np.zeros(2))
        self.state = np.array([box[0], box[1], 0.0, 0.0])

    def seed(self, box: Array, velocity: Array) -> None:
        """All particles at `box` (4,) again, the size sure within the measurement noise."""
        sigma = np.array([*self.noise.sigma_position, 0.0, 0.0])
        sigma[2:] = 5.0 * sigma[:2]  # px/s: a third of it per frame
        self.particles = self._rng.standard_normal((self._count, 4)) * sigma
        self.particles += [box[0], box[1], *velocity]
        self.weights = self._alike
        self.state = np.array([box[0], box[1], *velocity])
        self.size[2:] = 0.0
        self.size[:2] = box[2:]
        variance = np.square(self.noise.sigma_size)
        self.P = np.array([variance, (0.0, 0.0), variance])

    def move_camera(self, homography: Array, below: float, zoom: float) -> None:
        """Carry the whole state into the new image plane (section 4; figure 3, steps 1 and 2).

        `zoom` scales the size; velocities then are the person's own.
        """
        everything = np.concatenate([self.particles, self.state[None]])
        moved = particles.warp(everything, homography, below)
        if below:  # the foot was mapped; the centre stands above it by the new half height
            moved[:, 1] += below * (1.0 - zoom)
        self.particles, self.state = moved[:-1], moved[-1]
        self.size *= zoom
        self.P *= zoom * zoom

    def predict(self, dt: float) -> None:
        """Steps 1-3: resample, predict both halves, keep them inside reason."""
        chosen = particles.resample(self.weights, self._rng)
        self.weights = self._alike
        cloud = self.particles.T.take(chosen, axis=1).T
        cloud = particles.predict(cloud, dt, self.noise.q_position, self._rng)
        lowest, highest = self._limits
        np.minimum(np.maximum(cloud, lowest, out=cloud), highest, out=cloud)
        self.particles = cloud
        x, y, vx, vy = self.state.tolist()
        self.state = np.array([x + dt * vx, y + dt * vy, vx, vy])
        self.size, self.P = kalman.predict(self.size, self.P, dt, self.noise.q_size)
        self._bound_size()

    def shape_distance(self, sizes: Array) -> Array:
        """Squared Mahalanobis distances (M,) of sizes (M, 2) to the predicted one (step 4)."""
        y = sizes - self.size[:2]
        S = self.P[0] + np.square(self.noise.sigma_size)
        distances: Array = (y * y / S).sum(axis=1)
        return distances

    def propose(self, centres: Array, share: float) -> None:
        """Redraw `share` of the particles on the centres (M, 2) near the cloud (mixture)."""
        reach = 1.2 * self.size[0]
        near = centres[np.hypot(*(centres - self.particles[:, :2].mean(axis=0)).T) < reach]
        if len(near):
            self.scatter(near, share)

    def scatter(self, centres: Array, share: float) -> None:
        """Redraw `share` of the particles around the centres (M, 2), wherever the cloud is."""
        n = int(share * self._count)
        picks = centres.take(self._rng.integers(len(centres), size=n), axis=0)
        spread = self._rng.standard_normal((n, 2)) * self.noise.sigma_position
        self.particles[:n, :2] = picks + spread

    def update(self, boxes: Array, how: Estimator) -> Estimate | None:
        """Steps 4-6 with gated candidates (M, 4) x y w h; None if none explains any particle."""
        if len(boxes) == 0:
            return None
        groups, offsets = particles.nearest(self.particles, boxes[:, :2])
        logs = particles.log_gaussian(offsets, self.noise.sigma_position)
        if logs.max() < HOPELESS:
            return None
        self.weights = particles.normalised(logs)
        self.state = particles.estimate(self.particles, self.weights, groups, how)
        if how == "cluster":
            chosen = int(np.argmax(np.bincount(groups, self.weights)))
        else:
            chosen = int(np.argmin(np.hypot(*(boxes[:, :2] - self.state[:2]).T)))
        support = float(self.weights[groups == chosen].sum())
        fit = float(np.exp(-0.1 * self.shape_distance(boxes[chosen : chosen + 1, 2:])[0]))
        self.measure_size(boxes[chosen, 2:])
        return Estimate(self.state, support, fit, chosen)

    def update_soft(self, log_likelihood: Array, how: Estimator) -> None:
        """Step 4 with a likelihood (N,) of every particle instead of candidates."""
        self.weights = particles.normalised(log_likelihood)
        self.state = particles.estimate(self.particles, self.weights, self._together, how)

    def measure_size(self, size: Array) -> None:
        """Step 5: the chosen candidate's size (2,) updates the Kalman half."""
        R = np.array([sigma * sigma for sigma in self.noise.sigma_size])
        self.size, self.P = kalman.update(self.size, self.P, size, R)
        self._bound_size()

    def _bound_size(self) -> None:
        (w, h), (widest, tallest) = self.size[:2].tolist(), self._largest
        self.size[:2] = min(max(w, SMALLEST), widest), min(max(h, SMALLEST), tallest)

    def coast(self, dt: float) -> None:
        """Nothing seen: velocities fade, the size is frozen and its uncertainty capped."""
        fade = 0.8 ** (15.0 * dt)  # 0.8 a frame at 15 frames a second
        self.particles[:, 2:] *= fade
        self.state[2:] *= fade
        self.state[:2] = self.weights @ self.particles[:, :2]
        self.size[2:] = 0.0
        cap = 16.0 * np.square(self.noise.sigma_size)
        excess = self.P[0] / cap
        if excess.max() > 1.0:
            self.P /= excess.max()

    def box(self) -> Array:
        """(4,) x y w h: centre and size, px."""
        box = np.empty(4)
        box[:2], box[2:] = self.state[:2], self.size[:2]
        return box
