"""Where the robot is on a map of walls: an extended Kalman filter on line features.

Tseng and Tang 2009, Algorithm 1, lines 3-12, with the running mean in the sequential update where
line 9 prints the predicted one. State: x, y, theta of `map_from_base`.
"""

from dataclasses import dataclass
from math import cos, hypot, inf, pi, radians, sin, sqrt

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.geometry import Array, Pose2, wrap_angle
from followerd.messages import Line
from followerd.settings import Settings

CHI_SQUARE_99 = 9.21  # 2 degrees of freedom


class LineEkfSettings(Settings):
    """Noise of the odometry and of the map, and when a wall is taken for one of the map."""

    position_share: float = Field(0.05, gt=0, description="of the way, deviation of the odometry")
    turn_share: float = Field(0.03, gt=0, description="of the turn")
    drift_deg_per_m: float = Field(0.57, ge=0, description="heading drift of the odometry")
    map_sigma_deg: float = Field(0.3, ge=0, description="of the map's walls")
    map_sigma_m: float = Field(0.01, ge=0, description="of the map's walls")
    correlation: float = Field(2.0, ge=1, description="by which a wall's covariance is inflated")
    gate_deg: float = Field(14.0, gt=0)
    gate_m: float = Field(0.4, gt=0)
    overlap: float = Field(0.15, ge=0, description="share of its length a wall may be overshot")
    rest_period_s: float = Field(1.0, ge=0, description="between two updates of a standing robot")
    least_matched: float = Field(0.4, ge=0, le=1, description="share of the walls in view")
    lost_after_s: float = Field(2.0, gt=0, description="of fewer matches than that")
    worst_nis: float = Field(3.0, gt=1, description="mean innovation beyond which it is lost")


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """The M walls of a map as lines x cos(alpha) + y sin(alpha) = rho between two ends."""

    alpha: Array  # (M,) rad
    rho: Array  # (M,) m, >= 0
    start: Array  # (M,) m along (-sin, cos) of alpha
    end: Array  # (M,) m, > start
    cos: Array  # (M,) of alpha
    sin: Array  # (M,)

    @classmethod
    def of(cls, segments: Array) -> "Walls":
        """From end points (M, 2, 2), m."""
        a, b = segments[:, 0], segments[:, 1]
        alpha = np.arctan2(b[:, 0] - a[:, 0], a[:, 1] - b[:, 1])
        rho = a[:, 0] * np.cos(alpha) + a[:, 1] * np.sin(alpha)
        alpha = np.where(rho < 0.0, alpha + pi, alpha)
        along = np.stack([-np.sin(alpha), np.cos(alpha)])
        ends = np.sort([(a.T * along).sum(axis=0), (b.T * along).sum(axis=0)], axis=0)
        return cls(alpha, np.abs(rho), ends[0], ends[1], np.cos(alpha), np.sin(alpha))


class LineEkf:
    """The pose (x, y, theta) in the map and its covariance."""

    def __init__(self, walls: Walls, settings: LineEkfSettings | None = None) -> None:
        self.settings = settings or LineEkfSettings()
        self.walls = walls
        s = self.settings
        self._map_noise = np.diag([radians(s.map_sigma_deg) ** 2, s.map_sigma_m**2])
        self.start(Pose2(), np.diag([0.1, 0.1, 0.1]) ** 2)

    def start(self, pose: Pose2, covariance: Array) -> None:
        """Begin at `pose` with a `covariance` (3, 3)."""
        self.m: Array = np.array([pose.x, pose.y, pose.theta])
        self.P: Array = covariance.copy()
        self._moved = True  # since the last update
        self._updated_at = -inf
        self._unmatched_since: float | None = None
        self._nis = 1.0  # mean of the matches' innovations per degree of freedom

    @property
    def pose(self) -> Pose2:
        """`map_from_base`."""
        return Pose2(*self.m.tolist())

    def predict(self, step: Pose2) -> None:
        """The robot has moved by `step`, `base_before_from_base_now` (Algorithm 1, lines 3-4)."""
        s, theta = self.settings, float(self.m[2])
        c, n = cos(theta), sin(theta)
        dx, dy, way = c * step.x - n * step.y, n * step.x + c * step.y, hypot(step.x, step.y)
        self.m = self.m + (dx, dy, step.theta)
        self.m[2] = wrap_angle(float(self.m[2]))
        G = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        place = (s.position_share * way) ** 2 + 1e-6
        turn = s.turn_share * abs(step.theta) + radians(s.drift_deg_per_m) * way
        self.P = G @ self.P @ G.T + np.diag([place, place, turn * turn + 1e-7])
        self._moved = self._moved or way > 1e-3 or abs(step.theta) > 1e-3

    def update(self, lines: list[Line], stamp: float) -> int:
        """Take the lines of a scan, in `base` (lines 5-12); how many were found on the map."""
        s = self.settings
        if not self._moved and stamp - self._updated_at < s.rest_period_s:
            return 0  # the same scan again and again would feign certainty
        self._moved, self._updated_at = False, stamp
        matched = sum(self._correct(line) for line in lines)
        if matched >= s.least_matched * len(lines) and self._nis < s.worst_nis:
            self._unmatched_since = None
        elif self._unmatched_since is None:
            self._unmatched_since = stamp
        return matched

    def is_lost(self, now: float) -> bool:
        """Whether the walls in view have not been the map's for a while."""
        return self.unmatched_for(now) >= self.settings.lost_after_s

    def unmatched_for(self, now: float) -> float:
        """Seconds since when the walls in view have not been the map's."""
        return 0.0 if self._unmatched_since is None else now - self._unmatched_since

    def widen(self, sigma_m: float, sigma_rad: float) -> None:
        """Be less sure of the pose."""
        self.P = self.P + np.diag(np.square([sigma_m, sigma_m, sigma_rad]))

    def _correct(self, line: Line) -> bool:
        """One sequential update with the wall that fits best; whether there was one."""
        s, w = self.settings, self.walls
        x, y, theta = self.m.tolist()
        expected = w.rho - x * w.cos - y * w.sin
        behind = expected < 0.0
        turned = line.alpha - (w.alpha - theta) + np.where(behind, pi, 0.0)
        turned = (turned + pi) % (2.0 * pi) - pi
        off = line.rho - np.abs(expected)
        turn_gate = max(radians(s.gate_deg), 3.0 * sqrt(self.P[2, 2]))
        gate = max(s.gate_m, 3.0 * sqrt(max(self.P[0, 0], self.P[1, 1])))
        near = (np.abs(turned) < turn_gate) & (np.abs(off) < gate) & self._beside(line)
        R = s.correlation * line.covariance + self._map_noise
        best: tuple[float, float, Array, Array] | None = None
        for k in np.flatnonzero(near).tolist():
            sign = -1.0 if behind.item(k) else 1.0
            H = np.array([[0.0, 0.0, -1.0], [-sign * w.cos.item(k), -sign * w.sin.item(k), 0.0]])
            S = H @ self.P @ H.T + R
            u, v = turned.item(k), off.item(k)
            a, b, d = S.item(0), S.item(1), S.item(3)
            distance = (d * u * u - 2.0 * b * u * v + a * v * v) / (a * d - b * b)
            if distance > CHI_SQUARE_99:
                continue
            away = abs(expected.item(k))
            # of the two faces of a thin board the nearer one is seen
            if best is None or _is_better(distance, away, best[0], best[1]):
                best = distance, away, H, np.array([u, v])
        if best is None:
            return False
        self._nis += 0.1 * (0.5 * best[0] - self._nis)
        self._blend(best[2], R, best[3])
        return True

    def _beside(self, line: Line) -> npt.NDArray[np.bool_]:
        """Which walls (M,) the middle of a line lies beside."""
        w = self.walls
        mx, my = self.pose.apply_point(*line.ends.mean(axis=0).tolist())
        along = my * w.cos - mx * w.sin
        margin = self.settings.overlap * (w.end - w.start)
        return (along > w.start - margin) & (along < w.end + margin)

    def _blend(self, H: Array, R: Array, v: Array) -> None:
        """Kalman update in Joseph's form."""
        K = np.linalg.solve(H @ self.P @ H.T + R, H @ self.P).T
        self.m = self.m + K @ v
        self.m[2] = wrap_angle(float(self.m[2]))
        rest = np.eye(3) - K @ H
        self.P = rest @ self.P @ rest.T + K @ R @ K.T


def _is_better(distance: float, away: float, best: float, best_away: float) -> bool:
    if max(distance, best) < 2.0 * min(distance, best) + 1e-9:
        return away < best_away
    return distance < best
