"""The robot anywhere on a map: two walls of a scan, taken for two of the map, give a pose.

All such poses are tried; the one on whose map the scan's points lie is taken, if no other comes
near it.
"""

from itertools import combinations
from math import pi, radians, sin

import cv2
import numpy as np
from pydantic import Field

from followerd.estimation.line_ekf import Walls
from followerd.geometry import Array, Pose2
from followerd.maps.floor import FloorMap
from followerd.messages import Line
from followerd.settings import Settings


class LineSearchSettings(Settings):
    """When a pose is good enough, and no other is."""

    pairs: int = Field(3, ge=1, description="of a scan's walls, the longest, that are tried")
    across_deg: float = Field(30.0, gt=0, lt=90, description="least angle between two walls")
    agree_deg: float = Field(6.0, gt=0, description="between the turns that two walls give")
    near_m: float = Field(0.12, gt=0, description="a point this far from the map fits by 0.6")
    points: int = Field(72, ge=10, description="of a scan that are looked at")
    least: float = Field(0.7, gt=0, le=1, description="fit of a pose that is taken")
    ahead: float = Field(0.08, ge=0, le=1, description="of every other pose's fit")
    apart_m: float = Field(0.5, gt=0, description="farther away is another pose")
    apart_deg: float = Field(20.0, gt=0, description="or turned by more")


class LineSearch:
    """A map with the distance to what is occupied."""

    def __init__(self, floor: FloorMap, settings: LineSearchSettings) -> None:
        self.settings = settings
        self._grid = floor.grid
        self._walls = Walls.of(floor.walls)
        empty = (~floor.grid.occupied).astype(np.uint8)
        self._away = cv2.distanceTransform(empty, cv2.DIST_L2, 5) * floor.grid.cell

    def pose(self, lines: list[Line], points: Array) -> Pose2 | None:
        """`map_from_base` where a scan with these `lines` and `points` (N, 2) was taken."""
        s = self.settings
        seen = points[np.isfinite(points[:, 0])]
        poses = np.vstack([np.empty((0, 3)), *(self._poses(*two) for two in self._pairs(lines))])
        poses = poses[self._is_free(poses[:, :2])]
        if len(seen) < s.points // 2 or not len(poses):
            return None
        fit = self._fit(poses, seen[:: max(1, len(seen) // s.points)])
        best = int(fit.argmax())
        off = poses - poses[best]
        turned = np.abs((off[:, 2] + pi) % (2.0 * pi) - pi)
        others = (np.hypot(off[:, 0], off[:, 1]) > s.apart_m) | (turned > radians(s.apart_deg))
        rival = float(fit[others].max(initial=0.0))
        if fit[best] < s.least or fit[best] < rival + s.ahead:
            return None
        x, y, theta = poses[best].tolist()
        return Pose2(x, y, theta)

    def _pairs(self, lines: list[Line]) -> list[tuple[Line, Line]]:
        """The pairs of walls that are not parallel, the longest first."""
        least = sin(radians(self.settings.across_deg))
        two = [(a, b) for a, b in combinations(lines, 2) if abs(sin(a.alpha - b.alpha)) > least]
        two.sort(key=lambda pair: -min(pair[0].length, pair[1].length))
        return two[: self.settings.pairs]

    def _poses(self, one: Line, other: Line) -> Array:
        """All poses (P, 3) at which two walls of the map look like `one` and `other`."""
        s, w = self.settings, self._walls
        # a wall is seen from the side of its normal's foot, or from behind
        normal = np.concatenate([w.alpha, w.alpha])
        side = np.repeat([1.0, -1.0], len(w.alpha))
        rho = np.concatenate([w.rho, w.rho])
        long = np.concatenate([w.end - w.start] * 2)
        turn = np.where(side > 0.0, normal, normal + pi)
        first, second = turn - one.alpha, turn - other.alpha
        gap = np.abs((first[:, None] - second + pi) % (2.0 * pi) - pi)
        margin = 1.3
        good = gap < radians(s.agree_deg)
        good &= (one.length < margin * long)[:, None] & (other.length < margin * long)
        i, j = np.nonzero(good)
        ax, ay, bx, by = np.cos(normal[i]), np.sin(normal[i]), np.cos(normal[j]), np.sin(normal[j])
        across = ax * by - ay * bx
        u, v = rho[i] - side[i] * one.rho, rho[j] - side[j] * other.rho
        usable = np.abs(across) > 0.3
        across = np.where(usable, across, 1.0)
        poses: Array = np.column_stack(
            [(u * by - v * ay) / across, (ax * v - bx * u) / across, first[i]]
        )[usable]
        return poses

    def _is_free(self, at: Array) -> np.ndarray:
        row, column, inside = self._cells(at)
        free: np.ndarray = inside & self._grid.free[row, column]
        return free

    def _fit(self, poses: Array, points: Array) -> Array:
        """How well (P,) points (N, 2) seen from poses (P, 3) lie on the map, 0 to 1."""
        c, n = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        x = poses[:, :1] + c * points[:, 0] - n * points[:, 1]
        y = poses[:, 1:2] + n * points[:, 0] + c * points[:, 1]
        row, column, inside = self._cells(np.stack([x, y], axis=-1))
        away = np.where(inside, self._away[row, column], np.inf)
        fit: Array = np.exp(-0.5 * np.square(away / self.settings.near_m)).mean(axis=1)
        return fit

    def _cells(self, at: Array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Row, column and whether it lies on the map, of points (..., 2)."""
        grid = self._grid
        column, row = np.moveaxis(np.floor((at - grid.origin) / grid.cell), -1, 0).astype(np.intp)
        rows, columns = grid.occupied.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return row.clip(0, rows - 1), column.clip(0, columns - 1), inside
