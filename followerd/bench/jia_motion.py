"""The filter of suite `jia` alone: a person seen from a robot that turns on its own.

The robot swings left and right at up to 0.8 rad/s and does not care for the person, who walks from
place to place; a quarter of the time they cannot be seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos
from typing import Literal

import numpy as np

from followerd.bench.rows import Row, mean_row
from followerd.estimation.motion_ekf import Look, MotionEkf, MotionEkfSettings
from followerd.geometry import Array, Pose2
from followerd.sim.people import Walker
from followerd.sim.scenarios import Mover, Stop

Filter = Literal["mekf", "no_ego_motion"]
FILTERS: tuple[Filter, ...] = ("mekf", "no_ego_motion")
# without odometry the robot's turning is the person's acceleration: 2 m/s² serve it best
SETTINGS = {"mekf": MotionEkfSettings(), "no_ego_motion": MotionEkfSettings(accel_mps2=2.0)}

PERIOD = 0.1  # s between looks
LENGTH = 60.0  # s
TURN = 0.8  # rad/s, the largest turn rate
SWING = 1.2  # rad/s, of the sine that it follows
GAP, EVERY = 10, 40  # looks without the person, from gap to gap
HEIGHT = 0.9  # m, of the person's middle
WARM = 2.0  # s before errors count
WHEELS = 0.02  # error of the odometry's turns and paths, ratio


@dataclass(frozen=True, slots=True)
class Job:
    """One walk."""

    filter: Filter
    seed: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """Mean errors on the ground."""

    job: Job
    visible_cm: float
    gap_cm: float  # at the end of each gap


def run(job: Job) -> Outcome:
    """One walk; the same for both filters."""
    rng = np.random.default_rng(job.seed)
    walker = _walker(rng)
    error = WHEELS * rng.standard_normal()
    motion: MotionEkf | None = None
    visible, gaps = [], []
    for k in range(round(LENGTH / PERIOD)):
        now = k * PERIOD
        heading = TURN / SWING * (1.0 - cos(SWING * now))
        odom_from_base = Pose2(theta=heading * (1.0 + error)) if job.filter == "mekf" else None
        at = walker.at(now)
        true = np.array([*(~Pose2(theta=heading)).apply_point(at.x, at.y), HEIGHT])
        hidden = now > WARM and k % EVERY < GAP
        look = Look(now, odom_from_base, None if hidden else measured(true, rng))
        if motion is None:
            motion = MotionEkf(look, SETTINGS[job.filter])
            continue
        motion.step(look)
        off = 100.0 * float(np.hypot(*(motion.estimate.x[:2] - true[:2])))
        if hidden and (k + 1) % EVERY >= GAP:
            gaps.append(off)
        elif now > WARM and not hidden:
            visible.append(off)
    return Outcome(job, float(np.mean(visible)), float(np.mean(gaps)))


def measured(true: Array, rng: np.random.Generator) -> Array:
    """A place (3,) as a Kinect sees it."""
    away = float(np.hypot(true[0], true[1]))
    along = true[:2] / away
    noise = rng.standard_normal(3) * (0.02 + 0.003 * away**2, 0.03, 0.03)
    aside = np.array([-along[1], along[0]])
    return np.array([*(true[:2] + noise[0] * along + noise[1] * aside), true[2] + noise[2]])


def rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """Means over seeds, for each filter."""
    result = []
    for name in FILTERS:
        mine = [one for one in outcomes if one.job.filter == name]
        for metric, values in (
            ("visible_cm", [one.visible_cm for one in mine]),
            ("gap_cm", [one.gap_cm for one in mine]),
        ):
            result.append(mean_row("jia", "mekf-turning", name, metric, "cm", values))
    return result


def _walker(rng: np.random.Generator) -> Walker:
    """Somebody who walks round and round before the robot, slower and faster, cutting corners."""
    corners = [(1.5, -1.2), (3.5, -1.2), (3.5, 1.2), (1.5, 1.2)]
    if rng.random() < 0.5:
        corners.reverse()
    path = tuple(
        Stop(x_m=x + rng.uniform(-0.2, 0.2), y_m=y + rng.uniform(-0.2, 0.2), speed_mps=(0.3, 0.8))
        for x, y in corners
    )
    mover = Mover(name="walker", path=path, start_after_s=0.0, loop=True, corner_radius_m=0.8)
    return Walker(mover, rng)
