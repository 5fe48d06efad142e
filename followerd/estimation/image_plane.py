"""What a move of the robot does to the image plane (Zhuang 2008, section 4, figure 3)."""

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from followerd.geometry import Array, Camera, Pose2

HORIZON_MARGIN = 8.0  # px under the horizon (of 192 px wide images) that a foot must lie
ZOOM = (0.7, 1.3)  # per frame; more is no motion of a robot


@dataclass(frozen=True, slots=True)
class PlaneChange:
    """The map from the last image to the present one for things that stand still."""

    homography: Array  # (3, 3) pixels to pixels
    below: float = 0.0  # px under a box centre that the mapped point lies
    zoom: float = 1.0  # growth of the size


def by_odometry(camera: Camera, before: Pose2, now: Pose2, box: Array) -> PlaneChange:
    """Change between two poses `odom_from_base` for a person seen at `box` (4,) x y w h.

    The foot moves on the ground (eq. 15, 16 there and back: one homography), and the size with
    its inverse depth. A foot at or above the horizon is no foot: then only the turn is undone.
    """
    now_from_before = ~now @ before
    x, y, _, h = box.tolist()
    half, horizon = 0.5 * h, camera.horizon
    depth = y + half - horizon  # px, proportional to inverse distance
    if depth < HORIZON_MARGIN * camera.width / 192.0:
        return PlaneChange(_turn(camera, now_from_before.theta))
    c, s = cos(now_from_before.theta), sin(now_from_before.theta)
    motion = np.array([[c, -s, now_from_before.x], [s, c, now_from_before.y], [0.0, 0.0, 1.0]])
    homography = camera.image_from_ground @ motion @ camera.ground_from_image
    row, z = (a * x + b * (y + half) + c for a, b, c in homography.tolist()[1:])
    if z / float(homography[2, 2]) <= 0.0:  # the robot would have passed over the foot
        return PlaneChange(_turn(camera, now_from_before.theta))
    zoom = min(max((row / z - horizon) / depth, ZOOM[0]), ZOOM[1])
    return PlaneChange(homography, half, zoom)


def _turn(camera: Camera, theta: float) -> Array:
    """Homography of a pure rotation about the vertical by -theta (K R K^-1)."""
    c, s = cos(theta), sin(theta)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    rotation = camera.axes @ turn @ camera.axes.T
    homography: Array = camera.intrinsics @ rotation @ np.linalg.inv(camera.intrinsics)
    return homography
