"""Scenario `localization` of suite `tseng`: the robot that trails the person, by its odometry alone
and with the walls of a roughly measured map (Table 2)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import degrees, hypot, radians
from time import perf_counter

import numpy as np
import numpy.typing as npt

from followerd.bench.rows import Row, mean_row
from followerd.bench.tseng_room import Room
from followerd.bench.tseng_world import Plan, furnished, moments
from followerd.estimation.line_ekf import LineEkf, LineEkfSettings, Walls
from followerd.geometry import Array, Pose2, wrap_angle
from followerd.perception.lines import LineSettings, find_lines

MAP_SIGMA = 0.02  # m, error of a wall along its normal
MAP_TURN = radians(0.34)
SCALE = 0.01  # by which the odometry is too long
DRIFT = radians(0.25)  # rad per metre
PAPER = {"odometer": (8.1, 4.3), "line_ekf": (5.7, 3.9)}  # cm, mean and deviation
START = np.diag([0.02, 0.02, 0.01]) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """T poses (T, 3), and what was thought of them."""

    room: Room
    truth: Array
    thought: Mapping[str, Array]  # (T, 3) by tracker
    scan_ms: float  # median, of the filter


def run(seed: int) -> Drive:
    """One drive of a minute."""
    world_rng, rng = np.random.default_rng(seed).spawn(2)
    plan = Plan()
    room = furnished(plan, world_rng)
    seen = list(moments(room, plan, world_rng))
    settings = LineEkfSettings(map_sigma_m=MAP_SIGMA, map_sigma_deg=degrees(MAP_TURN))
    ekf, odom = LineEkf(Walls.of(surveyed(room.segments, rng)), settings), seen[0].robot
    ekf.start(odom, START)
    poses, times = [(odom, odom)], []
    for before, now in pairwise(seen):
        step = _measured(~before.robot @ now.robot, rng)
        odom = odom @ step
        began = perf_counter()
        ekf.predict(step)
        ekf.update(find_lines(now.scan.points(), LineSettings()), now.scan.stamp)
        times.append(1e3 * (perf_counter() - began))
        poses.append((odom, ekf.pose))
    thought = dict(zip(PAPER, (_array(column) for column in zip(*poses, strict=True)), strict=True))
    truth = _array([moment.robot for moment in seen])
    return Drive(room, truth, thought, float(np.median(times)))


def surveyed(segments: Array, rng: np.random.Generator) -> Array:
    """Walls (M, 2, 2) as somebody with a tape measured them."""
    walls = []
    for ax, ay, bx, by in segments.tolist():
        middle = np.array([0.5 * (ax + bx), 0.5 * (ay + by)])
        normal = np.array([ay - by, bx - ax]) / hypot(bx - ax, by - ay)
        turned = Pose2(theta=MAP_TURN * float(rng.standard_normal()))
        ends = turned.apply(np.array([[ax, ay], [bx, by]]) - middle)
        walls.append(ends + middle + MAP_SIGMA * float(rng.standard_normal()) * normal)
    return np.array(walls)


def rows(drives: Sequence[Drive]) -> list[Row]:
    """Means over the drives."""
    result = []
    for tracker, (paper_mean, paper_std) in PAPER.items():
        off = [drive.thought[tracker] - drive.truth for drive in drives]
        place = [100.0 * np.hypot(d[:, 0], d[:, 1]) for d in off]
        turn = [
            float(np.degrees(np.abs((d[:, 2] + np.pi) % (2 * np.pi) - np.pi)).mean()) for d in off
        ]
        means, stds = [float(p.mean()) for p in place], [float(p.std()) for p in place]
        for metric, unit, values, paper in (
            ("error_mean_cm", "cm", means, paper_mean),
            ("error_std_cm", "cm", stds, paper_std),
            ("heading_error_deg", "deg", turn, None),
        ):
            result.append(mean_row("tseng", "localization", tracker, metric, unit, values, paper))
    times = [drive.scan_ms for drive in drives]
    result.append(mean_row("tseng", "localization", "line_ekf", "scan_ms", "ms", times))
    return result


def _measured(step: Pose2, rng: np.random.Generator) -> Pose2:
    """A step as the odometry reports it."""
    drift = DRIFT * hypot(step.x, step.y) + 0.01 * step.theta * float(rng.standard_normal())
    return Pose2((1.0 + SCALE) * step.x, (1.0 + SCALE) * step.y, wrap_angle(step.theta + drift))


def _array(poses: Sequence[Pose2]) -> npt.NDArray[np.float64]:
    return np.array([(pose.x, pose.y, pose.theta) for pose in poses])
