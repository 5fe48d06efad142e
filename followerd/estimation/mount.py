"""Where the camera sits, from places of a person on the floor and where they appear in images.

Unknown are the camera's yaw, elevation and height over the floor, and how far the lowest sole in
the image stands before the leg that the laser sees: that is known roughly, and more when toes
come first. Least squares by Gauss and Newton, outliers by Tukey's weights. Height and elevation
are told apart by distances alone: what the data leave uncertain keeps the value that was assumed,
and is said.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array, Camera

LEG_RADIUS = 0.05  # m, from a leg's visible side, as scanned, to its middle
SOLE, TOES = 0.08, 0.06  # m, of the lowest sole before its leg; more or less, coming or going
PRIOR = 0.04  # m, sigma of both
GAIT = 0.09, 0.04  # m, sigma of the sole along the line of sight, of the legs' middle across it
BLUR = 1.0  # px
LIMITS = {"yaw": radians(0.5), "elevation": radians(0.7), "z": 0.05}  # rad, rad, m
YAW, ELEVATION, HEIGHT = range(3)  # in a solution; sole and toes follow
STEP = 1e-4  # of the numeric derivatives, rad and m
ROUNDS = 40
TUKEY = 4.685  # sigmas beyond which a sample is an outlier
MAD = 1.4826  # sigma of a normal distribution over its median absolute deviation
LEAST = 0.3  # of the expected noise: no foot is seen better
FEWEST = 20  # samples

Free = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Pair:
    """A person at one time: in the laser, m in `base`, and in the image, px."""

    nearest: tuple[float, float]  # visible side of the nearer leg
    middle: tuple[float, float] | None  # of both; None when one hides the other
    column: float  # centre of the person's area
    row: float
    foot: float  # lower edge of the lowest sole
    approach: float = 0.0  # how much the way leads to the robot, 1 straight to it, -1 away


@dataclass(frozen=True, slots=True)
class Mount:
    """The camera as found, and how well."""

    camera: Camera
    sigma: dict[str, float]  # of yaw, elevation (rad) and z (m), without those that were kept
    kept: tuple[str, ...]  # the data do not tell them
    column_rms: float  # px, without outliers
    row_rms: float  # px
    used: int
    outliers: int


class _Solution(NamedTuple):
    x: Array  # yaw, elevation, z, sole, toes
    sigma: Array  # of those that are free, else 0
    residuals: Array  # (2 N,) px: columns, rows
    good: npt.NDArray[np.bool_]  # (2 N,)


def find_mount(pairs: Sequence[Pair], camera: Camera) -> Mount | None:
    """The mount of `camera`, whose own is the first guess; None when the pairs are too few."""
    if sum(pair.middle is not None for pair in pairs) < FEWEST:
        return None
    walk, names = _Walk(pairs, camera), list(LIMITS)
    free = list(range(5))
    limits = np.array([*LIMITS.values(), np.inf, np.inf])
    while np.any((found := _solved(walk, np.array(free, np.intp))).sigma > limits):
        # of height and elevation, which are hard to tell apart, a ruler tells the height
        worst = int(np.argmax(found.sigma / limits))
        free.remove(HEIGHT if HEIGHT in free and worst != YAW else worst)
    columns, rows = (
        float(np.sqrt((r[good] ** 2).mean()))
        for r, good in zip(
            np.split(found.residuals, [walk.columns]),
            np.split(found.good, [walk.columns]),
            strict=True,
        )
    )
    return Mount(
        walk.camera(found.x),
        {names[i]: float(found.sigma[i]) for i in free if i < len(names)},
        tuple(name for i, name in enumerate(names) if i not in free),
        columns,
        rows,
        int(found.good.sum()),
        int((~found.good).sum()),
    )


class _Walk:
    """What was seen of a person who walked about, and what would be seen by a camera."""

    def __init__(self, pairs: Sequence[Pair], camera: Camera) -> None:
        whole = [pair for pair in pairs if pair.middle is not None]
        self.columns = len(whole)  # of the residuals; rows follow
        self._camera = camera
        self._middle = _farther(np.array([pair.middle for pair in whole]), LEG_RADIUS)
        self._row = np.array([pair.row for pair in whole])
        self._nearest = np.array([pair.nearest for pair in pairs])
        self._approach = np.array([pair.approach for pair in pairs])
        self._seen = np.array([*(p.column for p in whole), *(p.foot for p in pairs)])
        along, across = np.linalg.norm(self._nearest, axis=1), np.linalg.norm(self._middle, axis=1)
        self.noise = np.hypot(
            BLUR,
            np.concatenate(
                [camera.fx * GAIT[1] / across, camera.fy * camera.z * GAIT[0] / along**2]
            ),
        )  # px, expected

    @property
    def pixel(self) -> float:
        """Its height in the image, rad."""
        return BLUR / self._camera.fy

    def camera(self, x: Array) -> Camera:
        """The camera with the mount of a solution."""
        yaw, elevation, z = x[:3].tolist()
        return replace(self._camera, yaw=yaw, elevation=elevation, z=z)

    def residuals(self, x: Array) -> Array:
        """Seen less expected: columns of the body, then rows of the sole, px."""
        camera = self.camera(x)
        # a column says the bearing, wherever on the body its row is
        up = camera.elevation + np.arctan((camera.cy - self._row) / camera.fy)
        height = camera.z + np.linalg.norm(self._middle, axis=1) * np.tan(up)
        sole = _farther(self._nearest, LEG_RADIUS - x[3] - x[4] * self._approach)
        expected = np.concatenate(
            [
                camera.project(np.column_stack([self._middle, height]))[:, 0],
                camera.project(np.column_stack([sole, np.zeros(len(sole))]))[:, 1],
            ]
        )
        difference: Array = self._seen - expected
        return difference

    def jacobian(self, x: Array) -> Array:
        """Derivatives (2 N, 5) of the residuals."""
        here = self.residuals(x)
        return np.column_stack(
            [(self.residuals(x + STEP * unit) - here) / STEP for unit in np.eye(x.size)]
        )

    @property
    def first(self) -> Array:
        """The first guess."""
        return np.array([self._camera.yaw, self._camera.elevation, self._camera.z, SOLE, TOES])


def _solved(walk: _Walk, free: Free) -> _Solution:
    """The solution with the parameters `free` unknown; sole and toes have their prior."""
    x = prior = walk.first
    certainty = np.diag([0.0, 0.0, 0.0, PRIOR**-2, PRIOR**-2])
    for _ in range(ROUNDS):
        r = walk.residuals(x)
        z = r / walk.noise
        scale = np.concatenate(
            [np.full(part.size, max(MAD * np.median(np.abs(part)), LEAST))
             for part in np.split(z, [walk.columns])]
        )  # fmt: skip
        z = z / scale
        u = np.clip(np.abs(z) / TUKEY, 0.0, 1.0)
        weights = (1.0 - u * u) ** 2
        J = walk.jacobian(x) / (walk.noise * scale)[:, None]
        N = J.T @ (weights[:, None] * J) + certainty
        b = J.T @ (weights * z) + certainty @ (x - prior)
        step = np.zeros(x.size)
        step[free] = np.linalg.lstsq(N[np.ix_(free, free)], -b[free], rcond=None)[0]
        x = x + step
        if np.abs(step).max() < 1e-7:
            break
    sigma = np.zeros(x.size)
    worth = max(_repeated(part, w) for part, w in zip(
        np.split(z, [walk.columns]), np.split(weights, [walk.columns]), strict=True))  # fmt: skip
    data = N - certainty
    N = data / worth + certainty
    sigma[free] = np.sqrt(np.diag(np.linalg.pinv(N[np.ix_(free, free)])))
    # nobody knows to a pixel where a sole ends, which is the same in all images
    if ELEVATION in free:
        sigma[ELEVATION] = np.hypot(sigma[ELEVATION], walk.pixel)
    return _Solution(x, sigma, r, weights > 0.0)


def _repeated(z: Array, weights: Array) -> float:
    """How many samples in a row are worth one: a walk's errors last for a step or two."""
    good = z[weights > 0.0]
    good = good - good.mean()
    rho = float((good[1:] * good[:-1]).sum() / max((good * good).sum(), 1e-12))
    rho = min(max(rho, 0.0), 0.95)
    return (1.0 + rho) / (1.0 - rho)


def _farther(points: Array, by: float | Array) -> Array:
    """Points (N, 2) moved `by` m away from the robot."""
    distance = np.linalg.norm(points, axis=1)
    moved: Array = points * (1.0 + by / distance)[:, None]
    return moved
