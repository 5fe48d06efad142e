"""A place in an image of known depth, and the same in the robot's axes.

Depth here lies along the floor, straight ahead: before a camera that looks down, head and feet of
an upright body are of one depth.
"""

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from followerd.geometry import Array, Camera
from followerd.perception.depth_band import Depth

BEHIND = 0.1  # m from the side of a body that is seen to its axis


@dataclass(frozen=True, slots=True)
class Spot:
    """The middle of a person in the image, and the depth of their near side."""

    u: float  # px
    v: float  # px
    depth: float  # m, along the floor


def levelled(camera: Camera, depth: Depth) -> Depth:
    """Depth (H, W) along the floor from depth along the optical axis, m."""
    if camera.elevation == 0.0:
        return depth
    share = _share(camera, np.arange(depth.shape[0], dtype=float))
    return np.asarray(depth * share[:, None].astype(np.float32), np.float32)


def _share(camera: Camera, v: Array) -> Array:
    """Of a depth along the axis that lies along the floor, in rows `v`."""
    slope = (v - camera.cy) / camera.fy
    share: Array = cos(camera.elevation) + sin(camera.elevation) * slope
    return np.maximum(share, 0.1)


def scale(camera: Camera, v: float, depth: float) -> tuple[float, float]:
    """Pixels a metre, across and up, of an upright body around row `v`."""
    share = float(_share(camera, np.array(v)))
    return camera.fy * share / depth, camera.fy * share**2 / depth


def in_base(camera: Camera, spot: Spot) -> Array:
    """The middle (3,) of the person's axis in `base`, m."""
    right, down, forward = camera.axes
    ray = forward + (spot.u - camera.cx) / camera.fx * right
    ray = ray + (spot.v - camera.cy) / camera.fy * down
    away = (spot.depth + BEHIND) / float(_share(camera, np.array(spot.v)))
    place: Array = away * ray + (camera.x, camera.y, camera.z)
    return place


def in_image(camera: Camera, place: Array) -> Spot | None:
    """Where the middle (3,) of a person's axis is seen; None behind the camera."""
    u, v, depth = camera.project(place[None, :3])[0].tolist()
    ahead = depth * float(_share(camera, np.array(v)))
    return Spot(u, v, ahead - BEHIND) if depth > 2 * BEHIND else None


def row(camera: Camera, depth: float, height: float) -> float:
    """Image row of a person's middle `height` m above the floor, near the middle column."""
    slope = (height - camera.z) / (depth + BEHIND)
    up, level = camera.axes[2, 2], -camera.axes[1, 2]
    return float(camera.cy + camera.fy * (up - slope * level) / max(level + slope * up, 0.1))
