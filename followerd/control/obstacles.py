"""What the robot must not touch: laser returns and sonar echoes, in `base` now."""

from dataclasses import dataclass
from math import cos, pi, radians

import numpy as np

from followerd.control.plausible import is_plausible_pose
from followerd.geometry import Array, Pose2, wrap_angle
from followerd.messages import Odometry, Scan

LOOKS = 0.4  # cosine, from which a disc looks along the way
SEEN_ASIDE = radians(40.0)  # on either side of the way, that a laser must see to see the way


@dataclass(frozen=True, slots=True, eq=False)
class Obstacles:
    """Points of `base` now, each with the margin it is owed."""

    points: Array  # (N, 2) m
    margins: Array  # (N,) m


NOTHING = Obstacles(np.empty((0, 2)), np.empty(0))


@dataclass(frozen=True, slots=True)
class Echo:
    """A sonar reading, kept where it was heard in `odom`."""

    stamp: float  # s
    ahead: float  # cosine of the disc's direction: 1 looks forward, -1 backward
    x: float  # m
    y: float  # m
    range: float  # m


class Echoes:
    """The newest reading of every sonar disc."""

    def __init__(self, max_age: float, reach: float) -> None:
        """Readings older than `max_age` s or farther than `reach` m say nothing."""
        self.max_age = max_age
        self.reach = reach
        self._by_disc: dict[int, Echo] = {}
        self._near: list[Echo] = []
        self._heard: Array = np.empty((0, 2))  # m in `odom`, where all of `_near` are fresh

    def sense(self, odometry: Odometry) -> None:
        """Take the readings of a base report; a range that is no number tells nothing."""
        for reading in odometry.sonar:
            if not reading.range >= 0.0 or not is_plausible_pose(reading.pose):
                continue
            x, y = (odometry.pose @ reading.pose).apply_point(reading.range, 0.0)
            ahead = cos(reading.pose.theta)
            self._by_disc[reading.disc] = Echo(odometry.stamp, ahead, x, y, reading.range)
        self._near = [e for e in self._by_disc.values() if e.range < self.reach]
        self._heard = np.array([(e.x, e.y) for e in self._near]).reshape(-1, 2)

    def along(self, v: float, now: float) -> list[float]:
        """Ranges of the fresh discs that look where the robot goes at speed `v`, m."""
        way = 1.0 if v > 0.0 else -1.0
        looking = [e for e in self._by_disc.values() if way * e.ahead > LOOKS]
        return [echo.range for echo in looking if self._is_fresh(echo, now)]

    def obstacles(self, base: Pose2, margin: float, now: float) -> Obstacles:
        """Fresh echoes within reach, each owed `margin` m; the robot is at `odom_from_base`."""
        fresh = [self._is_fresh(echo, now) for echo in self._near]
        heard = self._heard if all(fresh) else self._heard[fresh]
        if not heard.size:
            return NOTHING
        return Obstacles((~base).apply(heard), np.full(len(heard), margin))

    def _is_fresh(self, echo: Echo, now: float) -> bool:
        return 0.0 <= now - echo.stamp <= self.max_age


def sees_way(scan: Scan, v: float) -> bool:
    """Whether the laser looks where the robot goes at speed `v`, wherever it is mounted."""
    field = (scan.ranges.size - 1) * scan.angle_increment
    middle = scan.base_from_laser.theta + scan.angle_min + 0.5 * field
    way = 0.0 if v >= 0.0 else pi
    return abs(wrap_angle(way - middle)) + SEEN_ASIDE <= 0.5 * field


def returns(
    points: Array, moved: Pose2, claimed: tuple[slice, ...], margins: tuple[float, float],
    reach: float,
) -> Obstacles:  # fmt: skip
    """A scan's end points in `base` now.

    `points` (N, 2), nan where nothing was seen, are in the `base` of the scan, `moved` is
    base_now_from_base_then; `margins` are (of anything, of the `claimed` beams).
    """
    owed = np.full(points.shape[0], margins[0])
    for beams in claimed:
        owed[beams] = margins[1]
    near = np.einsum("ij,ij->i", points, points) < reach * reach  # False for nan
    return Obstacles(moved.apply(points[near]), owed[near])


def together(*parts: Obstacles) -> Obstacles:
    """All of them."""
    parts = tuple([part for part in parts if part.margins.size])
    if len(parts) <= 1:
        return parts[0] if parts else NOTHING
    return Obstacles(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.margins for part in parts]),
    )
