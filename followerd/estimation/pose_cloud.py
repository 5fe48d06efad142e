"""Particles of a robot's pose: clouds (3, N) of x, y in m and theta in rad, weights (N,).

Kwolek 2004, section 5. His motion model lacks an absolute value (right turns get a negative
deviation) and counts the length of the way twice; his means are not normalised. Here the variance
grows with the way, whatever the steps it is cut into.
"""

from math import atan2, cos, hypot, pi, radians, sqrt

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.geometry import Array, Pose2
from followerd.settings import Settings

Indices = npt.NDArray[np.intp]

CUBE_M = 0.25  # half edge
CUBE = radians(15.0)


class MotionNoise(Settings):
    """Of the odometry, as the filter takes it: more than the wheels' own."""

    along_m: float = Field(0.05, ge=0, description="deviation after 1 m of way")
    drift_deg: float = Field(8.0, ge=0, description="of the heading, after 1 m of way")
    turn_share: float = Field(0.12, ge=0, description="of a turn")
    turn_deg: float = Field(0.5, ge=0, description="of the heading, at every update")
    tail_share: float = Field(0.05, ge=0, le=0.5, description="of the particles doubt the odometry")
    tail_of_step: float = Field(1.0, ge=0, description="their deviation")


def moved(poses: Array, step: Pose2, noise: MotionNoise, rng: np.random.Generator) -> Array:
    """The cloud after `step` (`base_before_from_base_now`).

    The heading's random walk bends the way: its mean over the way has 1/3 of the final variance,
    and 1/2 of it in common (the limit of the paper's J steps).
    """
    n = poses.shape[1]
    way = hypot(step.x, step.y)
    toward = atan2(step.y, step.x)
    e_way, e_drift, e_bend, e_turn = rng.standard_normal((4, n))
    drift = radians(noise.drift_deg) * sqrt(way) * e_drift
    bend = 0.5 * drift + radians(noise.drift_deg) * sqrt(way / 12.0) * e_bend
    length = way + noise.along_m * sqrt(way) * e_way
    turn = step.theta + (noise.turn_share * abs(step.theta) + radians(noise.turn_deg)) * e_turn
    tail = rng.permutation(n)[: int(noise.tail_share * n)]
    if tail.size:
        wild = noise.tail_of_step * rng.standard_normal((2, tail.size))
        length[tail] += (way + 0.05) * wild[0]
        turn[tail] += (abs(step.theta) + radians(2.0)) * wild[1]
    ahead = poses[2] + toward + bend
    out = np.empty_like(poses)
    np.multiply(length, np.cos(ahead), out=out[0])
    np.multiply(length, np.sin(ahead), out=out[1])
    out[:2] += poses[:2]
    np.add(poses[2], turn + drift, out=out[2])
    return out


def mean_pose(poses: Array, weights: Array) -> Pose2:
    """The weighted mean, normalised; the heading as a sum of directions."""
    total = float(weights.sum())
    theta = atan2(float(weights @ np.sin(poses[2])), float(weights @ np.cos(poses[2])))
    return Pose2(float(weights @ poses[0]) / total, float(weights @ poses[1]) / total, theta)


def in_cubes(poses: Array, chosen: Indices) -> npt.NDArray[np.bool_]:
    """Which particles (K, N) lie in the sub-cube around each of those `chosen` (K,)."""
    x, y, theta = poses
    facing = np.stack([np.cos(theta), np.sin(theta)])
    near: npt.NDArray[np.bool_] = np.abs(x - x[chosen, None]) < CUBE_M
    near &= np.abs(y - y[chosen, None]) < CUBE_M
    near &= facing[:, chosen].T @ facing > cos(CUBE)
    return near


def cube_estimate(poses: Array, weights: Array, candidates: int = 8) -> tuple[Pose2, float]:
    """The mean in the heaviest sub-cube around one of the best particles, and that cube's weight.

    The paper takes the best particle alone, which jumps.
    """
    if candidates < weights.size:
        best = weights.argpartition(-candidates)[-candidates:]
    else:
        best = np.arange(weights.size)
    cubes = in_cubes(poses, best)
    masses = cubes @ weights
    heaviest = int(np.argmax(masses))
    cube = cubes[heaviest]
    return mean_pose(poses[:, cube], weights[cube]), float(masses[heaviest])


def covariance(poses: Array, weights: Array, about: Pose2) -> Array:
    """Of the whole cloud (3, 3) about a pose: rivals elsewhere count."""
    off = poses - np.array([[about.x], [about.y], [about.theta]])
    off[2] = (off[2] + pi) % (2 * pi) - pi
    spread: Array = (weights * off) @ off.T
    return spread


def perturbed(
    poses: Array, likelihoods: Array, place: float, turn: float, rng: np.random.Generator
) -> Array:
    """Each moved a little at random, the less likely ones more (m, rad)."""
    g = 0.1 + 0.9 * (1.0 - likelihoods / max(float(likelihoods.max()), 1e-300))
    scale = np.array([[place], [place], [turn]])
    shaken: Array = poses + scale * g * rng.standard_normal(poses.shape)
    return shaken


def array_of(pose: Pose2) -> Array:
    """(3, 1)."""
    return np.array([[pose.x], [pose.y], [pose.theta]])
