"""Where a scan lies on what was seen before: correlative matching (Olson 2009), then refinement.

The places seen before are a field that falls off around each surface. A coarse search finds the
pose at which most returns lie on surfaces, Gauss-Newton refines it and tells how sure it is.
"""

from dataclasses import dataclass
from math import ceil, hypot, radians
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from followerd.geometry import Array, Pose2, wrap_angle
from followerd.maps.tracing import surfaces

CELL = 0.05  # m
SIGMA = 0.1  # m, over which the field falls off around a surface
REACH = 12.0  # m, of returns that are matched
MARGIN = 1.0  # m of field around the surfaces
COARSE_FROM = 1.0  # m, size of a window that is searched in coarse steps first
KEPT = 24  # places of the first search that are looked at closely
RESIDUAL = 0.03  # m, deviation of a return from its surface
TOLERANCE = 0.08  # m, beyond which a return hardly counts
NEAR = 0.3  # m, beyond which it is none of the surface's
CORRELATED = 10.0  # returns on one surface tell this much less than as many on others
PENALTY = 0.01  # share of the returns that a deviation of one sigma must better
TAIL = 20.0  # squared deviations from where on a greater one costs little more
ELSEWHERE = 0.7  # m from the best place
FEWEST = 20  # returns of a scan that can be matched
ITERATIONS, STILL = 15, 1e-4  # m and rad of the last step
FARTHEST = 0.1  # m and rad of one step


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """What one scan saw, in `base`."""

    points: Array  # (N, 2) m, returns within REACH
    chords: Array  # (M, 2, 2) m, pieces of the surfaces

    @classmethod
    def of(cls, ends: Array, origin: tuple[float, float]) -> "Shape":
        """From the end points (N, 2) of a laser's beams at `origin`, nan without a return."""
        ends = ends.copy()
        away = np.hypot(*(ends - origin).T)
        ends[~(away <= REACH)] = np.nan
        return cls(ends[np.isfinite(ends[:, 0])], surfaces(ends, origin))


@dataclass(frozen=True, slots=True)
class Window:
    """How far a match may lie from what was expected, and how likely that is."""

    reach: float  # m
    turn: float  # rad
    sigma: float  # m, of the expected place
    turn_sigma: float  # rad

    @property
    def information(self) -> Array:
        """Of the expected pose (3, 3)."""
        return np.diag([self.sigma**-2, self.sigma**-2, self.turn_sigma**-2])

    def penalty(self, dx: Array, dy: Array, turn: Array) -> Array:
        """By which a pose that far off is disliked, as a share of the returns."""
        squared = (dx * dx + dy * dy) / self.sigma**2 + (turn / self.turn_sigma) ** 2
        # heavy tails: an odometry that slipped has slipped by any amount
        off: Array = PENALTY * squared / (1.0 + squared / TAIL)
        return off


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """The best place of a scan."""

    pose: Pose2
    score: float  # 0..1, how well its returns lie on surfaces
    information: Array  # (3, 3) of x, y in the field's frame, and theta
    lead: float  # by which its score, less the penalty, exceeds that of all places elsewhere


class Lattice(NamedTuple):
    """Poses to be tried around one."""

    cells: int  # between neighbours
    reach: float  # m
    turn: float  # rad
    turn_step: float  # rad


class Field:
    """Surfaces seen before, in any frame: 1 on them, falling off around."""

    def __init__(self, chords: Array) -> None:
        flat = chords.reshape(-1, 2) if chords.size else np.zeros((1, 2))
        self.origin = flat.min(axis=0) - MARGIN
        width, height = np.ceil((flat.max(axis=0) + MARGIN - self.origin) / CELL).astype(int)
        blank = np.full((height, width), 255, np.uint8)
        lines = np.rint(((chords - self.origin) / CELL - 0.5) * 16).astype(np.int32)
        cv2.polylines(blank, list(lines), False, 0, shift=4)
        away = CELL * cv2.distanceTransform(blank, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        away = np.minimum(away, np.float32(MARGIN))
        self.values = np.exp(-0.5 * np.square(away / np.float32(SIGMA)))
        self._pooled: dict[int, npt.NDArray[np.float32]] = {1: self.values}
        along = chords[:, 1] - chords[:, 0]
        lengths = np.hypot(*along.T)
        long = lengths > 1e-3
        self._halves = 0.5 * lengths[long]
        self._middles = chords[long].mean(axis=1)
        self._along = along[long] / lengths[long][:, None]
        self._nearest = KDTree(self._middles) if long.any() else None

    def match(self, points: Array, expected: Pose2, window: Window) -> Match | None:
        """The best pose of points (N, 2) near `expected`; None where too few are given.

        A large window is searched in coarse steps first, and the best places of that closely.
        """
        if len(points) < FEWEST:
            return None
        some = points[:: -(-len(points) // 250)]
        starts = np.array([[expected.x, expected.y, expected.theta]])
        lattice = Lattice(2, window.reach, window.turn, radians(1.0))
        if window.reach > COARSE_FROM:
            coarse = Lattice(8, window.reach, window.turn, radians(2.5))
            starts, _ = self._best(some, starts, coarse, expected, window)
            lattice = Lattice(2, 4 * CELL, radians(1.25), radians(1.25))
        starts, lead = self._best(some, starts, lattice, expected, window)
        fine = Lattice(1, CELL, 0.5 * lattice.turn_step, 0.34 * lattice.turn_step)
        starts, _ = self._best(some, starts[:1], fine, expected, window)
        pose, information = self._refined(points, Pose2(*starts[0].tolist()), expected, window)
        return Match(pose, self.score(points, pose), information, lead)

    def score(self, points: Array, pose: Pose2) -> float:
        """How well points lie on surfaces, 0..1."""
        height, width = self.values.shape
        i, j = np.floor((pose.apply(points) - self.origin) / CELL).astype(np.int64).T
        inside = (i >= 0) & (j >= 0) & (i < width) & (j < height)
        return float(self.values[j[inside], i[inside]].sum()) / len(points)

    def _best(
        self, points: Array, starts: Array, lattice: Lattice, expected: Pose2, window: Window
    ) -> tuple[Array, float]:
        """The best poses (KEPT, 3), and by how much the first leads all that are elsewhere."""
        poses, values = self._search(points, starts, lattice)
        scores = values - window.penalty(*(poses - (expected.x, expected.y, expected.theta)).T)
        best = poses[np.argsort(-scores)[:KEPT]]
        elsewhere = np.hypot(*(poses - best[0])[:, :2].T) > ELSEWHERE
        lead = float(scores.max() - scores[elsewhere].max()) if elsewhere.any() else 1.0
        return best, lead

    def _search(self, points: Array, starts: Array, lattice: Lattice) -> tuple[Array, Array]:
        """All poses (K, 3) of a lattice around each of `starts`, and their mean field values."""
        level, turn_step = lattice.cells, lattice.turn_step
        count = ceil(lattice.reach / (level * CELL))
        turns = ceil(lattice.turn / turn_step)
        field, pad = self._pool(level), (count + 1) * level
        height, width = field.shape
        padded = cv2.copyMakeBorder(field, pad, pad, pad, pad, cv2.BORDER_CONSTANT, value=0.0)
        flat = padded.ravel()
        shift = level * np.arange(-count, count + 1)
        offsets = (shift[:, None] * padded.shape[1] + shift).ravel()
        aside = CELL * np.column_stack([np.tile(shift, shift.size), np.repeat(shift, shift.size)])
        found, poses = [], []
        for x, y, theta in starts.tolist():
            for k in range(-turns, turns + 1):
                angle = theta + k * turn_step
                moved = Pose2(x, y, angle).apply(points)
                at = np.floor((moved - self.origin) / CELL).astype(np.int64)
                i = np.clip(at[:, 0], -1, width) + pad
                j = np.clip(at[:, 1], -1, height) + pad
                index = (j * padded.shape[1] + i)[:, None] + offsets
                found.append(flat.take(index).mean(axis=0))
                poses.append(np.column_stack([aside + (x, y), np.full(len(aside), angle)]))
        return np.concatenate(poses), np.concatenate(found)

    def _pool(self, level: int) -> npt.NDArray[np.float32]:
        """The greatest value within half a step of the lattice."""
        if level not in self._pooled:
            kernel = np.ones((level + 1, level + 1), np.uint8)
            self._pooled[level] = np.asarray(cv2.dilate(self.values, kernel), np.float32)
        return self._pooled[level]

    def _refined(
        self, points: Array, pose: Pose2, expected: Pose2, window: Window
    ) -> tuple[Pose2, Array]:
        """Gauss-Newton on the distances to the surfaces, with the expectation as a prior."""
        x = np.array([pose.x, pose.y, pose.theta])
        slip = x - (expected.x, expected.y, expected.theta)
        slip[2] = wrap_angle(float(slip[2]))
        squared = float(slip @ window.information @ slip)
        prior, information = window.information / (1.0 + squared / TAIL) ** 2, np.zeros((3, 3))
        for _ in range(ITERATIONS):
            off, normals, arms = self._residuals(points, Pose2(*x.tolist()))
            J = np.column_stack([normals, (normals * arms).sum(axis=1)])
            weight = 1.0 / np.square(1.0 + np.square(off / TOLERANCE))
            scaled = J.T * (weight / (CORRELATED * RESIDUAL**2))
            information = scaled @ J
            drift = x - (expected.x, expected.y, expected.theta)
            drift[2] = wrap_angle(float(drift[2]))
            step = -np.linalg.solve(information + prior, scaled @ off + prior @ drift)
            step *= min(1.0, FARTHEST / max(hypot(*step[:2]), abs(step[2]), 1e-9))
            x = x + step
            if np.abs(step).max() < STILL:
                break
        return Pose2(float(x[0]), float(x[1]), wrap_angle(float(x[2]))), information

    def _residuals(self, points: Array, pose: Pose2) -> tuple[Array, Array, Array]:
        """Of the M points beside a surface: distance (M,), its normal, and the way a turn moves it.

        The last two are (M, 2), the last per rad.
        """
        at = pose.apply(points)
        if self._nearest is None:
            return np.empty(0), np.empty((0, 2)), np.empty((0, 2))
        _, k = self._nearest.query(at)
        apart, along = at - self._middles[k], self._along[k]
        normals = np.column_stack([-along[:, 1], along[:, 0]])
        off, beside = (apart * normals).sum(axis=1), np.abs((apart * along).sum(axis=1))
        own = (np.abs(off) < NEAR) & (beside < self._halves[k] + CELL)
        arms = at - (pose.x, pose.y)
        return off[own], normals[own], np.column_stack([-arms[:, 1], arms[:, 0]])[own]
