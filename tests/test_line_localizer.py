"""The robot on a map, scan by scan: from a rough start, from nowhere, and carried off."""

from dataclasses import replace
from math import hypot, radians

import numpy as np
import pytest

from followerd.geometry import Array, Pose2, wrap_angle
from followerd.localizers.line_ekf import LineLocalizer, LineLocalizerSettings
from followerd.maps.plan import from_segments
from followerd.messages import RobotPose, Scan, Twist
from followerd.perception.deskew import deskewed
from tests.laser_scenes import scan_of

PERIOD = 0.1  # s
NOBODY = np.empty((0, 3))


def room() -> Array:
    """No two corners of it look alike: segments (M, 2, 2)."""
    corners = [(0, 0), (8, 0), (8, 4.2), (6.1, 4.2), (6.1, 6), (1.4, 6), (1.4, 5), (0, 5)]
    walls = list(zip(corners, [*corners[1:], corners[0]], strict=True))
    walls += [((3.0, 1.6), (4.3, 1.9)), ((4.3, 1.9), (4.28, 1.96)), ((4.28, 1.96), (3.0, 1.6))]
    return np.array(walls, float)


WALLS = room()


class Drive:
    """A robot that drives through the room, and its localizer."""

    def __init__(self, start: Pose2, believed: Pose2 | None, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.pose, self.ego, self.stamp = start, Pose2(3.0, -1.0, 2.0), 0.0
        self.localizer = LineLocalizer(LineLocalizerSettings(), from_segments(WALLS), self.rng)
        self.localizer.start(believed)
        self.thought: RobotPose | None = None

    def scan(self, circles: Array = NOBODY) -> Scan:
        walls = WALLS.reshape(-1, 4)
        mount = Pose2(0.1, 0.0, 0.0)
        return scan_of(circles, self.stamp, walls=walls, pose=self.pose, mount=mount, rng=self.rng)

    def go(self, twist: Twist, seconds: float) -> "Drive":
        for _ in range(round(seconds / PERIOD)):
            self.stamp += PERIOD
            self.pose = self.pose.moved(twist.v, twist.omega, PERIOD)
            slip = 1.0 + 0.02 * self.rng.standard_normal()
            self.ego = self.ego.moved(slip * twist.v, 1.02 * twist.omega, PERIOD)
            self.thought = self.localizer.step(self.scan(), self.ego)
        return self

    @property
    def off(self) -> tuple[float, float]:
        """How far the belief is from the truth: m, and rad."""
        assert self.thought is not None
        at = self.thought.map_from_base
        turned = wrap_angle(at.theta - self.pose.theta)
        return hypot(at.x - self.pose.x, at.y - self.pose.y), abs(turned)


START = Pose2(2.0, 3.2, 0.2)
BEND = Twist(0.3, 0.2)


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2, 3))]
)
def test_a_start_wrong_by_15_degrees_and_40_cm_is_mended(seed: int) -> None:
    sign = 1.0 if seed % 2 else -1.0
    wrong = Pose2(START.x + sign * 0.28, START.y - 0.28, START.theta + sign * radians(15))
    drive = Drive(START, wrong, seed).go(BEND, 4.0)
    away, turned = drive.off
    assert away < 0.03
    assert turned < radians(1.0)
    assert drive.thought is not None
    assert not drive.thought.lost
    at = drive.thought
    assert hypot(
        (at.map_from_odom @ drive.ego).x - at.map_from_base.x,
        (at.map_from_odom @ drive.ego).y - at.map_from_base.y,
    ) == pytest.approx(0.0, abs=1e-9)


def test_from_nowhere_the_pose_is_found_on_the_whole_map() -> None:
    drive = Drive(START, None).go(BEND, 3.0)
    assert drive.off[0] < 0.05


@pytest.mark.slow
def test_a_robot_that_was_carried_off_says_that_it_is_lost_and_is_found() -> None:
    drive = Drive(START, START).go(BEND, 1.0)
    drive.pose = Pose2(5.2, 3.4, -2.0)
    lost = False
    for _ in range(60):
        drive.go(Twist(0.1, 0.1), PERIOD)
        if drive.thought is not None and drive.thought.lost:
            lost = True
            drive.localizer.start(None)
    assert lost
    assert drive.off[0] < 0.05


def test_scans_in_quick_succession_move_the_pose_by_odometry_alone() -> None:
    drive = Drive(START, START).go(BEND, 1.0)
    before = drive.thought
    assert before is not None
    drive.stamp += 0.02
    moved = drive.ego.moved(0.3, 0.2, 0.02)
    after = drive.localizer.step(drive.scan(), moved)
    assert after is not None
    assert after.stamp == drive.stamp
    assert after.map_from_odom == before.map_from_odom
    assert after.map_from_base == before.map_from_odom @ moved


def test_whom_the_robot_follows_is_no_wall_of_the_map() -> None:
    """With a suitcase as flat as a wall, a hand's breadth before one."""
    with_it = np.concatenate([WALLS, [[[7.75, 0.8], [7.75, 1.6]]]]).reshape(-1, 4)
    here = Pose2(6.2, 1.2, 0.0)
    off = {}
    for person in (None, (1.55, 0.0)):
        drive = Drive(here, here)
        thought: RobotPose | None = None
        for k in range(30):
            drive.ego = drive.ego.moved(0.0, 0.02 if k % 2 else -0.02, 1.0)
            at = here if k % 2 else here.moved(0.0, -0.02, 1.0)
            scan = scan_of(NOBODY, 0.1 * (k + 1), walls=with_it, pose=at)
            narrow = replace(scan, ranges=np.where(np.abs(scan.angles) < 0.25, scan.ranges, np.inf))
            thought = drive.localizer.step(narrow, drive.ego, person)
        assert thought is not None
        off[person] = abs(thought.map_from_base.x - here.x)
    assert off[(1.55, 0.0)] < 0.05
    assert off[None] > 0.15


def test_the_beams_of_a_moving_robot_are_put_where_it_was_at_first() -> None:
    """A wall seen while the robot turns by a degree between first and last beam is straight."""
    twist = Twist(0.5, radians(50.0))
    still = scan_of(NOBODY, walls=np.array([[2.0, -3.0, 2.0, 3.0]]), step_deg=1.0)
    times = np.linspace(0.0, 0.02, still.ranges.size)
    ranges = []
    for bearing, time in zip(still.angles, times, strict=True):
        at = Pose2().moved(twist.v, twist.omega, float(time))
        ahead = np.cos(bearing + at.theta)
        ranges.append((2.0 - at.x) / ahead if ahead > 0.3 else np.inf)
    scan = replace(still, ranges=np.array(ranges), beam_times=times)
    points = deskewed(scan, twist)
    seen = np.isfinite(points[:, 0])
    assert np.abs(points[seen, 0] - 2.0).max() < 1e-3
    assert np.abs(scan.points()[seen, 0] - 2.0).max() > 0.01
    assert deskewed(scan, Twist())[seen] == pytest.approx(scan.points()[seen])
