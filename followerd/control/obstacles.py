"""What the robot must not touch: laser returns and sonar echoes, in `base` now."""

from dataclasses import dataclass
from math import cos

import numpy as np

from followerd.geometry import Array, Pose2
from followerd.messages import Odometry


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
    rear: bool  # the disc looks backward
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

    def sense(self, odometry: Odometry) -> None:
        """Take the readings of a base report."""
        for reading in odometry.sonar:
            x, y = (odometry.pose @ reading.pose).apply_point(reading.range, 0.0)
            rear = cos(reading.pose.theta) < -0.4
            self._by_disc[reading.disc] = Echo(odometry.stamp, rear, x, y, reading.range)

    def behind(self, now: float) -> list[float]:
        """Ranges of the fresh discs that look backward, m."""
        return [e.range for e in self._by_disc.values() if e.rear and self._is_fresh(e, now)]

    def obstacles(self, base: Pose2, margin: float, now: float) -> Obstacles:
        """Fresh echoes within reach, each owed `margin` m; the robot is at `odom_from_base`."""
        near = [e for e in self._by_disc.values() if e.range < self.reach]
        heard = [(e.x, e.y) for e in near if self._is_fresh(e, now)]
        if not heard:
            return NOTHING
        points = np.array(heard)
        return Obstacles((~base).apply(points), np.full(len(heard), margin))

    def _is_fresh(self, echo: Echo, now: float) -> bool:
        return 0.0 <= now - echo.stamp <= self.max_age


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
