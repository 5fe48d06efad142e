"""Planar poses and the pinhole camera on the robot (REP-103: x forward, y left, z up; m, rad)."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import atan, cos, pi, sin, tan
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating[Any]]


def wrap_angle(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + pi) % (2 * pi) - pi


@dataclass(frozen=True, slots=True)
class Pose2:
    """A planar pose or transform `a_from_b`: the pose of frame b in frame a."""

    x: float = 0.0  # m
    y: float = 0.0  # m
    theta: float = 0.0  # rad, counter-clockwise

    def __matmul__(self, other: "Pose2") -> "Pose2":
        """`a_from_b @ b_from_c` is `a_from_c`."""
        c, s = cos(self.theta), sin(self.theta)
        return Pose2(
            self.x + c * other.x - s * other.y,
            self.y + s * other.x + c * other.y,
            wrap_angle(self.theta + other.theta),
        )

    def __invert__(self) -> "Pose2":
        """`~a_from_b` is `b_from_a`."""
        c, s = cos(self.theta), sin(self.theta)
        return Pose2(-c * self.x - s * self.y, s * self.x - c * self.y, wrap_angle(-self.theta))

    def apply(self, points: Array) -> Array:
        """Points (N, 2) of frame b, in frame a."""
        c, s = cos(self.theta), sin(self.theta)
        rotated: Array = points @ np.array([[c, s], [-s, c]])
        rotated += np.array([self.x, self.y])
        return rotated

    def apply_point(self, x: float, y: float) -> tuple[float, float]:
        """One point of frame b, in frame a."""
        c, s = cos(self.theta), sin(self.theta)
        return self.x + c * x - s * y, self.y + s * x + c * y

    def moved(self, v: float, omega: float, dt: float) -> "Pose2":
        """This pose after `dt` seconds at constant forward speed `v` and turn rate `omega`."""
        half = 0.5 * omega * dt
        chord = v * dt * (1.0 if abs(half) < 1e-9 else sin(half) / half)
        return Pose2(
            self.x + chord * cos(self.theta + half),
            self.y + chord * sin(self.theta + half),
            wrap_angle(self.theta + omega * dt),
        )


@dataclass(frozen=True)
class Camera:
    """A pinhole camera fixed to the robot: pixels x right, y down; no roll, no distortion.

    The optical axis is turned left by `yaw` and up by `elevation` from the robot's x axis.
    """

    width: int  # px
    height: int  # px
    fx: float  # px
    fy: float  # px
    cx: float  # px
    cy: float  # px
    x: float = 0.0  # m, in `base`
    y: float = 0.0  # m, in `base`
    z: float = 0.6  # m above the ground
    yaw: float = 0.0  # rad, left positive
    elevation: float = 0.0  # rad, up positive

    @classmethod
    def from_hfov(cls, width: int, height: int, hfov: float, **mount: float) -> "Camera":
        """Square pixels, centred principal point; `hfov` is the horizontal field of view in rad."""
        f = 0.5 * width / tan(0.5 * hfov)
        return cls(width, height, f, f, 0.5 * (width - 1), 0.5 * (height - 1), **mount)

    @cached_property
    def axes(self) -> Array:
        """Rows right, down, forward of the camera in `base` (3, 3)."""
        ca, sa, cp, sp = cos(self.elevation), sin(self.elevation), cos(self.yaw), sin(self.yaw)
        return np.array([[sp, -cp, 0.0], [sa * cp, sa * sp, -ca], [ca * cp, ca * sp, sa]])

    @cached_property
    def intrinsics(self) -> Array:
        """K (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @cached_property
    def image_from_ground(self) -> Array:
        """Homography (3, 3) from ground points (x, y, 1) of `base` to pixels (Zhuang eq. 15-16)."""
        axes = self.axes
        offset = axes @ np.array([self.x, self.y, self.z])
        homography: Array = self.intrinsics @ np.column_stack([axes[:, 0], axes[:, 1], -offset])
        return homography

    @cached_property
    def ground_from_image(self) -> Array:
        """Homography (3, 3) from pixels below the horizon to ground points of `base`."""
        return np.linalg.inv(self.image_from_ground)

    @property
    def horizon(self) -> float:
        """Image row of the horizon, px."""
        return self.cy + self.fy * tan(self.elevation)

    def turned(self, pan: float, tilt: float, zoom: float = 1.0) -> "Camera":
        """This camera on a head turned left by `pan` and up by `tilt` (rad) about the lens.

        The pan axis is upright, so that tilt adds to `elevation`; `zoom` multiplies focal lengths.
        """
        if pan == 0.0 and tilt == 0.0 and zoom == 1.0:
            return self
        return replace(
            self,
            fx=zoom * self.fx,
            fy=zoom * self.fy,
            yaw=wrap_angle(self.yaw + pan),
            elevation=self.elevation + tilt,
        )

    def bearing(self, px: float) -> float:
        """Bearing in `base` directions of image column `px` at the camera's height, rad, left +."""
        return wrap_angle(self.yaw - atan((px - self.cx) / self.fx / cos(self.elevation)))

    def column(self, bearing: float) -> float:
        """Image column seen at `bearing` (inverse of `bearing`), px."""
        return self.cx + self.fx * cos(self.elevation) * tan(wrap_angle(self.yaw - bearing))

    def ground_point(self, px: float, py: float) -> tuple[float, float] | None:
        """Ground point (x, y) in `base` of a pixel; None nearer than 3 px to the horizon."""
        if py < self.horizon + 3.0:
            return None
        (a, b, c), (d, e, f), (g, h, i) = self.ground_from_image.tolist()
        z = g * px + h * py + i
        return (a * px + b * py + c) / z, (d * px + e * py + f) / z

    def project(self, points: Array) -> Array:
        """Points (N, 3) of `base` as (N, 3): column px, row px, depth m along the axis."""
        q = (points - (self.x, self.y, self.z)) @ self.axes.T
        depth = q[:, 2]
        safe = np.where(depth > 1e-6, depth, np.nan)
        return np.column_stack(
            [self.cx + self.fx * q[:, 0] / safe, self.cy + self.fy * q[:, 1] / safe, depth]
        )
