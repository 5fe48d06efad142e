"""Scans of people on two legs among walls, for scanners of any resolution."""

from math import inf, pi, radians, sin

import numpy as np

from followerd.geometry import Array, Pose2
from followerd.messages import Scan
from followerd.sim.raycast import cast

LEG = 0.06  # m, radius
STRIDE = 1.2  # m
NOTHING = np.empty((0, 4))


def legs(at: tuple[float, float], heading: float, walked: float = 0.0) -> Array:
    """Two circles (2, 3) of somebody who has walked so far, m; standing, they are side by side."""
    along = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-along[1], along[0]])
    swing = 0.22 * sin(2 * pi * walked / STRIDE)
    middle = np.array(at)
    feet = middle + 0.1 * left + swing * along, middle - 0.1 * left - swing * along
    return np.array([[*foot, LEG] for foot in feet])


def scan_of(
    circles: Array,
    stamp: float = 0.0,
    *,
    walls: Array = NOTHING,
    step_deg: float = 0.5,
    pose: Pose2 | None = None,
    mount: Pose2 | None = None,
    rng: np.random.Generator | None = None,
) -> Scan:
    """180 degrees to 8 m from a base at `pose`, with 1 cm of noise where there is an `rng`."""
    base_from_laser = mount or Pose2()
    laser = (pose or Pose2()) @ base_from_laser
    angles = np.radians(np.arange(-90.0, 90.0 + 0.5 * step_deg, step_deg))
    ways = np.column_stack([np.cos(angles + laser.theta), np.sin(angles + laser.theta)])
    ranges = cast(np.array([laser.x, laser.y]), ways, walls, circles)
    if rng is not None:
        ranges = ranges + 0.01 * rng.standard_normal(ranges.size)
    ranges = np.where(ranges < 8.0, ranges, inf)
    times = np.zeros(ranges.size)
    step = radians(step_deg)
    return Scan(stamp, stamp, angles[0], step, ranges, 8.0, times, base_from_laser)
