"""How a laser is turned on the robot: from the way that the room goes by when it rolls ahead.

A robot on wheels moves along its own x axis, so the way that scans tell, in the laser's frame,
says where that axis is. It needs no odometry. Standing or turning on the spot tells nothing: a
turned laser in a turned room looks the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, cos, hypot, sin, sqrt

import numpy as np

from followerd.geometry import Array, Pose2, wrap_angle

ROUNDS = 30
FAR, NEAR = 0.4, 0.1  # m, matches farther apart are none, at first and at last
NEIGHBOURS = 0.3  # m, farther apart are no surface
LEAST = 30  # points matched
STEP = 0.25  # m, of the way between two estimates
LEAST_WAY = 0.8  # m


@dataclass(frozen=True, slots=True)
class LaserYaw:
    """The laser's yaw on the robot and its sigma, rad, from a way in m."""

    yaw: float
    sigma: float
    way: float


def find_yaw(scans: Sequence[Array], x: float, y: float) -> LaserYaw | None:
    """From scans, points (N, 2) each in the laser's frame, of a robot pushed straight ahead.

    (x, y) is where the laser sits in `base`, m. None when the way is too short or the room tells
    nothing.
    """
    way = followed(scans)
    estimates: list[float] = []
    start = 0
    for i, pose in enumerate(way):
        motion = ~way[start] @ pose
        if hypot(motion.x, motion.y) >= STEP:
            estimates.append(_yaw_of(motion, x, y))
            start = i
    total = STEP * len(estimates)
    if total < LEAST_WAY:
        return None
    mean = atan2(sum(map(sin, estimates)), sum(map(cos, estimates)))
    spread = np.array([wrap_angle(yaw - mean) for yaw in estimates])
    return LaserYaw(mean, float(spread.std(ddof=1)) / sqrt(len(estimates)), total)


def followed(scans: Sequence[Array]) -> list[Pose2]:
    """Poses of the laser where each scan was taken, in the first one's; it ends where it is lost.

    Scans are matched to the first, and to a later one when too little of that is left in view.
    """
    poses = [Pose2()]
    key, key_pose = scans[0], Pose2()
    for before, points in pairwise(scans):
        guess = ~key_pose @ poses[-1]
        motion = matched(key, points, guess)
        if motion is None:
            key, key_pose = before, poses[-1]
            motion = matched(key, points, Pose2())
            if motion is None:
                break
        poses.append(key_pose @ motion)
    return poses


def matched(before: Array, after: Array, guess: Pose2) -> Pose2 | None:
    """before_from_after of two scans (N, 2), near `guess`; None when too little fits.

    Iterated closest points, distances along the surfaces' normals.
    """
    surface, normals = _surface(before)
    pose, fits = guess, np.zeros(len(after), bool)
    if len(surface) < LEAST or len(after) < LEAST:
        return None
    for i in range(ROUNDS):
        moved = pose.apply(after)
        gaps = np.linalg.norm(moved[:, None] - surface[None], axis=2)
        nearest = gaps.argmin(axis=1)
        limit = max(NEAR, FAR * 0.8**i)
        fits = gaps[np.arange(len(after)), nearest] < limit
        if np.count_nonzero(fits) < max(LEAST, len(after) // 3):
            return None
        p, n = moved[fits], normals[nearest[fits]]
        r = np.einsum("ij,ij->i", surface[nearest[fits]] - p, n)
        J = np.column_stack([n, p[:, 0] * n[:, 1] - p[:, 1] * n[:, 0]])
        dx, dy, turn = np.linalg.lstsq(J, r, rcond=None)[0].tolist()
        pose = Pose2(dx, dy, turn) @ pose
        if hypot(dx, dy) + abs(turn) < 1e-6:
            break
    return pose


def _surface(points: Array) -> tuple[Array, Array]:
    """Points with neighbours on both sides, and unit normals there."""
    along = points[2:] - points[:-2]
    length = np.linalg.norm(along, axis=1)
    kept = (length > 1e-6) & (length < 2 * NEIGHBOURS)
    tangents = along[kept] / length[kept, None]
    return points[1:-1][kept], np.column_stack([-tangents[:, 1], tangents[:, 0]])


def _yaw_of(motion: Pose2, x: float, y: float) -> float:
    """The yaw with which an arc of the robot shows as `motion` in the laser's frame."""
    c, s = cos(motion.theta), sin(motion.theta)
    lever = Pose2((c - 1) * x - s * y, s * x + (c - 1) * y)
    way = hypot(motion.x, motion.y)
    half = 0.5 * motion.theta
    expected = atan2(way * sin(half) + lever.y, way * cos(half) + lever.x)
    return wrap_angle(expected - atan2(motion.y, motion.x))
