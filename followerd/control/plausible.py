"""Data that cannot be: not finite, from the future, faster than the base, or not there."""

from collections.abc import Mapping
from math import isfinite

import numpy as np

from followerd.geometry import Pose2
from followerd.messages import Odometry, Scan, Twist, WheelSpeeds, Wish

FUTURE = 0.05  # s, a stamp may run ahead of now
FASTEST = 3.0  # m/s, no Pioneer drives faster
FASTEST_TURN = 9.0  # rad/s
FARTHEST = 1e6  # m, from where the odometry began


def is_plausible_pose(pose: Pose2) -> bool:
    """Whether a robot can be there: from nowhere nothing would seem in the way."""
    return abs(pose.x) < FARTHEST and abs(pose.y) < FARTHEST and isfinite(pose.theta)


def is_finite_wish(wish: Wish) -> bool:
    """Whether a wish is made of numbers."""
    if isinstance(wish, Twist):
        return isfinite(wish.v) and isfinite(wish.omega)
    if isinstance(wish, WheelSpeeds):
        return isfinite(wish.left) and isfinite(wish.right)
    return isfinite(wish.angle) and isfinite(wish.v)


def is_plausible_odometry(odometry: Odometry) -> bool:
    """Whether a base can be there and that fast."""
    pose, twist = odometry.pose, odometry.twist
    return is_plausible_pose(pose) and abs(twist.v) <= FASTEST and abs(twist.omega) <= FASTEST_TURN


def is_plausible_scan(scan: Scan, max_missing_share: float) -> bool:
    """Whether enough beams were measured, and none backward."""
    missing = int(np.count_nonzero(np.isnan(scan.ranges)))
    measured = scan.ranges.size > 0 and missing <= max_missing_share * scan.ranges.size
    return measured and not bool((scan.ranges < 0).any())


def from_the_future(newest: Mapping[str, float], now: float) -> list[str]:
    """Streams whose newest stamp has not happened yet."""
    return [name for name, stamp in newest.items() if stamp > now + FUTURE]
