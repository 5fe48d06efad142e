"""A place in an image of known depth, and the same in the robot's axes."""

from dataclasses import dataclass

import numpy as np

from followerd.geometry import Array, Camera

BEHIND = 0.1  # m from the side of a body that is seen to its axis


@dataclass(frozen=True, slots=True)
class Spot:
    """The middle of a person in the image, and the depth of their near side."""

    u: float  # px
    v: float  # px
    depth: float  # m, along the optical axis


def in_base(camera: Camera, spot: Spot) -> Array:
    """The middle (3,) of the person's axis in `base`, m."""
    right, down, forward = camera.axes
    ray = forward + (spot.u - camera.cx) / camera.fx * right
    ray = ray + (spot.v - camera.cy) / camera.fy * down
    place: Array = (spot.depth + BEHIND) * ray + (camera.x, camera.y, camera.z)
    return place


def in_image(camera: Camera, place: Array) -> Spot | None:
    """Where the middle (3,) of a person's axis is seen; None behind the camera."""
    u, v, depth = camera.project(place[None, :3])[0].tolist()
    return Spot(u, v, depth - BEHIND) if depth > 2 * BEHIND else None


def row(camera: Camera, depth: float, height: float) -> float:
    """Image row of a person's middle `height` m above the floor, near the middle column."""
    up, forward = -camera.axes[1, 2], camera.axes[2, 2]
    tangent = (height - camera.z) / (depth + BEHIND) - forward
    return float(camera.cy - camera.fy * tangent / np.maximum(up, 0.1))
