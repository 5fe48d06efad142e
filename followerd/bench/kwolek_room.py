"""The office of Kwolek 2004, 5.6 x 4.6 m, and a robot that wanders about it, scan by scan.

The paper's figure 3 shows no dimensions of the furniture: it is ours, and makes the room
asymmetric. The world casts rays on the walls themselves, with a noise of its own; the localizers
get a grid of 2 cm.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, pi, radians, sin, sqrt

import numpy as np

from followerd.geometry import Array, Pose2
from followerd.maps.floor import FloorMap
from followerd.maps.plan import from_segments
from followerd.messages import Scan
from followerd.sim.raycast import cast

SIZE = (5.6, 4.6)  # m
FURNITURE = (  # m: left, bottom, right, top
    (0.0, 3.6, 0.9, 4.6),
    (1.8, 4.0, 3.0, 4.6),
    (4.9, 2.2, 5.6, 3.6),
    (4.2, 0.0, 5.2, 0.55),
    (0.0, 0.9, 0.5, 2.0),
    (2.5, 1.7, 3.2, 2.3),
)
CELL = 0.02  # m
CLEARANCE = 0.25  # m, of the robot
BEAMS = np.radians(np.arange(-90.0, 90.0))
RANGE_SIGMA, RANGE_MAX = 0.01, 8.0  # m
STEP = (0.06, 0.18)  # m between updates
TURN_SIGMA = radians(12.0)
TURN_AWAY = radians(40.0)  # in front of furniture
ODOMETRY_ALONG, ODOMETRY_DRIFT = 0.01, radians(5.0)  # after 1 m: the paper's figure 2
ODOMETRY_TURN = 0.02
PERSON_AT = 1.2  # m
PERSON_NOISE = 0.05  # m, of the person tracker
NOBODY = np.empty((0, 3))


@dataclass(frozen=True, slots=True)
class Trial:
    """What befalls the robot."""

    updates: int = 40
    blocked: float = 0.0  # share of every scan hidden by a person
    is_tracked: bool = True  # the localizer is told where the person is
    kidnapped_at: int | None = None  # update before which it is carried off, unfelt by the wheels


@dataclass(frozen=True, slots=True)
class Moment:
    """What the localizer gets, and the truth."""

    scan: Scan
    ego: Pose2  # odom_from_base
    person: tuple[float, float] | None  # m in `base`, as tracked
    truth: Pose2  # map_from_base


def walls() -> Array:
    """Of room and furniture (K, 2, 2), m."""
    width, height = SIZE
    sides = [
        side
        for left, bottom, right, top in ((0.0, 0.0, width, height), *FURNITURE)
        for side in (
            ((left, bottom), (right, bottom)),
            ((right, bottom), (right, top)),
            ((right, top), (left, top)),
            ((left, top), (left, bottom)),
        )
    ]
    return np.array(sides)


def floor() -> FloorMap:
    """The map, of which every free place counts."""
    return from_segments(walls(), CELL, np.array([[2.0, 3.0]]))


def is_clear(pose: Pose2) -> bool:
    """Whether the robot can stand there."""
    x, y = pose.x, pose.y
    inside = CLEARANCE < x < SIZE[0] - CLEARANCE and CLEARANCE < y < SIZE[1] - CLEARANCE
    return inside and not any(
        left - CLEARANCE < x < right + CLEARANCE and bottom - CLEARANCE < y < top + CLEARANCE
        for left, bottom, right, top in FURNITURE
    )


def anywhere(rng: np.random.Generator) -> Pose2:
    """A place where the robot can stand."""
    while True:
        x, y, theta = rng.uniform((0.0, 0.0, -pi), (*SIZE, pi)).tolist()
        if is_clear(pose := Pose2(x, y, theta)):
            return pose


def wander(trial: Trial, rng: np.random.Generator) -> Iterator[Moment]:
    """A robot set down anywhere."""
    segments = walls().reshape(-1, 4)
    truth, ego = anywhere(rng), Pose2()
    for k in range(trial.updates):
        if k == trial.kidnapped_at:
            truth = anywhere(rng)
        elif k:
            truth, ego = _moved(truth, ego, rng)
        bodies, person = NOBODY, None
        if trial.blocked:
            at, radius = _person(truth, segments, trial.blocked, rng)
            bodies = np.array([(*truth.apply_point(*at), radius)])
            noise = PERSON_NOISE * rng.standard_normal(2)
            if trial.is_tracked:
                person = at[0] + float(noise[0]), at[1] + float(noise[1])
        yield Moment(_scan(truth, float(k), segments, bodies, rng), ego, person, truth)


def _moved(truth: Pose2, ego: Pose2, rng: np.random.Generator) -> tuple[Pose2, Pose2]:
    """Turn and drive on; what the wheels count errs."""
    turn, way = TURN_SIGMA * float(rng.standard_normal()), float(rng.uniform(*STEP))
    there = truth @ Pose2(theta=turn) @ Pose2(way)
    if not is_clear(there):
        turn, way = TURN_AWAY, 0.0
        there = truth @ Pose2(theta=turn)
    e_turn, e_way, e_drift = rng.standard_normal(3).tolist()
    counted = Pose2(theta=turn * (1.0 + ODOMETRY_TURN * e_turn))
    counted @= Pose2(way + ODOMETRY_ALONG * sqrt(way) * e_way)
    counted @= Pose2(theta=ODOMETRY_DRIFT * sqrt(way) * e_drift)
    return there, ego @ counted


def _person(
    robot: Pose2, segments: Array, share: float, rng: np.random.Generator
) -> tuple[tuple[float, float], float]:
    """Where (in `base`) somebody stands before the walls, and the radius that hides the share."""
    bearings = rng.uniform(-1.0, 1.0, 8)
    room = cast(np.array([robot.x, robot.y]), _ways(bearings + robot.theta), segments, NOBODY)
    wide = np.flatnonzero(0.8 * room > PERSON_AT)
    k = int(wide[0]) if wide.size else int(room.argmax())
    away, bearing = min(PERSON_AT, 0.8 * float(room[k])), float(bearings[k])
    return (away * cos(bearing), away * sin(bearing)), away * sin(0.5 * share * pi)


def _scan(
    robot: Pose2, stamp: float, segments: Array, bodies: Array, rng: np.random.Generator
) -> Scan:
    ways = _ways(BEAMS + robot.theta)
    ranges = cast(np.array([robot.x, robot.y]), ways, segments, bodies)
    ranges = ranges + RANGE_SIGMA * rng.standard_normal(BEAMS.size)
    step = float(BEAMS[1] - BEAMS[0])
    times = np.zeros(BEAMS.size)
    return Scan(stamp, stamp, float(BEAMS[0]), step, ranges, RANGE_MAX, times, Pose2())


def _ways(angles: Array) -> Array:
    return np.column_stack([np.cos(angles), np.sin(angles)])
