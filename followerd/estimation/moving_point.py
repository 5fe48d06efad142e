"""A point that moves over the ground with nearly constant velocity: a Kalman filter in closed form.

State (x, y, u, v): place in m and velocity in m/s along two fixed axes. Of the symmetric covariance
the ten different elements are kept, each named by the two states it belongs to. Plain numbers take
a fraction of the time of 4 x 4 matrices. Checked against matrices in the tests.
"""

from math import hypot, sqrt
from typing import NamedTuple

import numpy as np

from followerd.geometry import Array


class MovingPoint(NamedTuple):
    """Mean and covariance."""

    x: float  # m
    y: float  # m
    u: float  # m/s
    v: float  # m/s
    xx: float
    xy: float
    yy: float
    xu: float
    xv: float
    yu: float
    yv: float
    uu: float
    uv: float
    vv: float

    @classmethod
    def of(
        cls, place: tuple[float, float], velocity: tuple[float, float], covariance: Array
    ) -> "MovingPoint":
        """With a covariance (4, 4) of (x, y, u, v)."""
        upper = covariance[np.triu_indices(4)].tolist()
        xx, xy, xu, xv, yy, yu, yv, uu, uv, vv = upper
        return cls(*place, *velocity, xx, xy, yy, xu, xv, yu, yv, uu, uv, vv)

    @property
    def sigma(self) -> float:
        """Largest standard deviation of the place, m."""
        mean, half = 0.5 * (self.xx + self.yy), 0.5 * (self.xx - self.yy)
        return sqrt(max(0.0, mean + hypot(half, self.xy)))

    @property
    def covariance(self) -> Array:
        """Of (x, y, u, v), (4, 4)."""
        _, _, _, _, xx, xy, yy, xu, xv, yu, yv, uu, uv, vv = self
        return np.array([[xx, xy, xu, xv], [xy, yy, yu, yv], [xu, yu, uu, uv], [xv, yv, uv, vv]])

    def after(self, t: float, density: float) -> "MovingPoint":
        """`t` seconds later; `density` is of the white acceleration noise, m²/s³.

        A time before the state's is met without noise.
        """
        x, y, u, v, xx, xy, yy, xu, xv, yu, yv, uu, uv, vv = self
        speed = density * max(0.0, t)
        both, place = speed * t / 2, speed * t * t / 3
        return MovingPoint(
            x + t * u,
            y + t * v,
            u,
            v,
            xx + t * (2 * xu + t * uu) + place,
            xy + t * (xv + yu + t * uv),
            yy + t * (2 * yv + t * vv) + place,
            xu + t * uu + both,
            xv + t * uv,
            yu + t * uv,
            yv + t * vv + both,
            uu + speed,
            uv,
            vv + speed,
        )

    def corrected(
        self, direction: tuple[float, float], off: float, variance: float, t: float, gate: float
    ) -> "MovingPoint | None":
        """After the place along a unit `direction`, `t` seconds from now, was found `off` m off.

        None where that is more than `gate` standard deviations.
        """
        x, y, u, v, xx, xy, yy, xu, xv, yu, yv, uu, uv, vv = self
        a, b = direction
        # covariances of the state with what is measured: P H' for H = (a, b, t a, t b)
        px, py = a * (xx + t * xu) + b * (xy + t * xv), a * (xy + t * yu) + b * (yy + t * yv)
        pu, pv = a * (xu + t * uu) + b * (yu + t * uv), a * (xv + t * uv) + b * (yv + t * vv)
        s = a * (px + t * pu) + b * (py + t * pv) + variance
        if off * off > gate * gate * s:
            return None
        k = off / s
        return MovingPoint(
            x + k * px,
            y + k * py,
            u + k * pu,
            v + k * pv,
            xx - px * px / s,
            xy - px * py / s,
            yy - py * py / s,
            xu - px * pu / s,
            xv - px * pv / s,
            yu - py * pu / s,
            yv - py * pv / s,
            uu - pu * pu / s,
            uv - pu * pv / s,
            vv - pv * pv / s,
        )
