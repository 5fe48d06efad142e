"""How near a scan's end points lie to the map's walls, whatever stands between.

The search at large sums, heading by heading, shifted pictures of the field: a beam costs every
place of the map one addition.
"""

from math import cos, pi, radians, sin

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.estimation.claims import unclaimed
from followerd.estimation.pose_cloud import array_of
from followerd.geometry import Array, Pose2
from followerd.maps.distance_field import DistanceField
from followerd.messages import Scan
from followerd.settings import Settings

NOWHERE = -27.6  # log of the weight of a pose where the robot cannot be
UNSEEN = -1.0  # same, where no scan of the map saw the floor: maps have holes where robots drive
FARTHEST = 2.0  # m from a wall, beyond which all is alike
SEARCH_CELL = 0.2  # m
SEARCH_SIGMA = 0.25  # m
SEARCH_STEP = radians(3.0)
SEARCH_BEAMS = 30
SEARCH_RANGE = 12.0  # m; farther ends are moved too much by half a step
BEST = 1000  # places that a search keeps
CROWD = 100_000  # cells of place and heading among which they are found
APART = (4, 4, 5)  # cells of x, y and heading, of which one is kept
TRIES = 4  # poses around each one kept
SHRINKING = (1.0, 0.5, 0.25, 0.12)  # cells around it, try by try

Picture = npt.NDArray[np.float32]


class FieldSettings(Settings):
    """Of the likelihood field."""

    beams: int = Field(100, ge=10, description="of a scan, evenly chosen of those with an echo")
    sigma_m: float = Field(0.07, gt=0, description="deviation of an echo from the map's wall")
    stray_share: float = Field(0.2, gt=0, lt=1, description="echoes from what is not on the map")
    trust: float = Field(0.42, gt=0, le=1, description="exponent: neighbouring beams err alike")
    max_range_m: float = Field(30.0, gt=0, description="farther echoes are not used")
    near_m: float = Field(0.15, gt=0, description="from a wall, of an echo that the map explains")


class FieldSensor:
    """A Sensor: mixture of a Gaussian of the distance and of strays; see Mcl."""

    def __init__(self, field: DistanceField, settings: FieldSettings) -> None:
        self.field, self.settings = field, settings
        s = settings
        far = np.minimum(field.far, FARTHEST)
        gauss = np.exp(-0.5 * (far / s.sigma_m) ** 2)
        log = s.trust * np.log((1.0 - s.stray_share) * gauss + s.stray_share)
        self._log = _bordered(log.astype(np.float32), float(log.min()))
        self._far = _bordered(far.astype(np.float32), FARTHEST)
        place = np.where(field.free, 0.0, np.where(field.walls, NOWHERE, UNSEEN))
        self._place = _bordered(place.astype(np.float32), NOWHERE)
        self._points: Array = np.empty((0, 2))
        self._coarse = Coarse(field)

    def see(self, scan: Scan, person: tuple[float, float] | None) -> int:
        """See Sensor."""
        points = unclaimed(scan, person)
        with np.errstate(invalid="ignore"):
            near = np.flatnonzero(scan.ranges <= self.settings.max_range_m)
        near = near[np.isfinite(points[near, 0])]
        if near.size > self.settings.beams:
            near = near[np.linspace(0, near.size - 1, self.settings.beams).astype(np.intp)]
        self._points = points[near]
        return int(near.size)

    def log_likelihood(self, poses: Array) -> Array:
        """See Sensor."""
        sums: Array = self._at(self._log, poses).sum(axis=0, dtype=np.float64)
        sums += self._place.ravel()[self._flat(*poses[:2])]
        return sums

    def fit(self, pose: Pose2) -> float:
        """See Sensor: the share of echoes near a wall."""
        far = self._at(self._far, array_of(pose))
        return float((far < self.settings.near_m).mean())

    def search(self, count: int, rng: np.random.Generator) -> Array:
        """See Sensor: one pose for each of the best places, brought nearer to the walls."""
        poses = self._coarse.best(self._points)
        log = self.log_likelihood(poses)
        reach = np.array([[self._coarse.cell], [self._coarse.cell], [SEARCH_STEP]])
        for share in SHRINKING:
            off = share * reach[:, :, None] * rng.uniform(-1.0, 1.0, (*poses.shape, TRIES))
            tries = poses[:, :, None] + off
            logs = self.log_likelihood(tries.reshape(3, -1)).reshape(-1, TRIES)
            k, each = logs.argmax(axis=1), np.arange(len(log))
            better = logs[each, k] > log
            poses = np.where(better, tries[:, each, k], poses)
            log = np.where(better, logs[each, k], log)
        order = log.argsort()[::-1][:count]
        return poses[:, order[np.arange(count) % order.size]]

    def anywhere(self, count: int, rng: np.random.Generator) -> Array:
        """See Sensor."""
        return self._coarse.anywhere(count, rng)

    def _flat(self, x: Array, y: Array) -> npt.NDArray[np.intp]:
        """Index in a bordered array's memory of places, m."""
        f = self.field
        height, width = self._log.shape
        i = ((x - f.origin[0]) / f.cell + 1.0).astype(np.int32)
        j = ((y - f.origin[1]) / f.cell + 1.0).astype(np.int32)
        np.clip(i, 0, width - 1, out=i)
        np.clip(j, 0, height - 1, out=j)
        flat: npt.NDArray[np.intp] = j.astype(np.intp) * width + i
        return flat

    def _at(self, picture: Array, poses: Array) -> Array:
        """What a picture holds (B, N) at every end point, seen from every pose."""
        x, y, theta = poses
        c, s = np.cos(theta), np.sin(theta)
        px, py = self._points.T[..., None]
        values: Array = picture.ravel().take(
            self._flat(x + c * px - s * py, y + s * px + c * py), mode="clip"
        )
        return values


class Coarse:
    """The field in cells of SEARCH_CELL, for the search of the whole map."""

    def __init__(self, field: DistanceField) -> None:
        self.stride = max(round(SEARCH_CELL / field.cell), 1)
        self.cell = self.stride * field.cell
        self.origin = field.origin
        self.headings = np.arange(round(2 * pi / SEARCH_STEP)) * SEARCH_STEP
        middle = slice(self.stride // 2, None, self.stride)
        far = field.far[middle, middle]
        self._score = np.round(255.0 * np.exp(-0.5 * (far / SEARCH_SIGMA) ** 2)).astype(np.uint16)
        self._j, self._i = np.nonzero(field.free[middle, middle])

    def best(self, points: Array) -> Array:
        """Up to BEST poses (3, K) for end points (N, 2), each the best of its surroundings."""
        points = points[np.hypot(points[:, 0], points[:, 1]) < SEARCH_RANGE]
        if len(points) > SEARCH_BEAMS:
            points = points[np.linspace(0, len(points) - 1, SEARCH_BEAMS).astype(np.intp)]
        scores = np.stack([self._scores(points, theta) for theta in self.headings.tolist()])
        crowd = min(CROWD, scores.size)
        chosen = scores.ravel().argpartition(-crowd)[-crowd:]
        chosen = chosen[scores.ravel()[chosen].argsort(kind="stable")[::-1]]
        heading, place = np.unravel_index(chosen, scores.shape)
        cells = np.stack([self._i[place], self._j[place], heading])
        blocks = cells // np.array([APART]).T
        sizes = *blocks[:2].max(axis=1) + 1, self.headings.size
        _, first = np.unique(np.ravel_multi_index(tuple(blocks), sizes), return_index=True)
        return self._middles(cells[:, np.sort(first)[:BEST]])

    def _scores(self, points: Array, theta: float) -> Array:
        """Sums (K,) over the points for all free cells at one heading."""
        c, s = cos(theta), sin(theta)
        steps = np.rint(points @ np.array([[c, s], [-s, c]]) / self.cell).astype(np.intp)
        total = np.zeros(self._score.shape, np.uint16)
        height, width = total.shape
        for i, j in steps.tolist():
            x0, x1 = max(-i, 0), min(width - i, width)
            y0, y1 = max(-j, 0), min(height - j, height)
            if x0 < x1 and y0 < y1:
                here = total[y0:y1, x0:x1]
                np.add(here, self._score[y0 + j : y1 + j, x0 + i : x1 + i], out=here)
        return total[self._j, self._i]

    def anywhere(self, count: int, rng: np.random.Generator) -> Array:
        """Poses (3, count) on the free floor."""
        place = rng.integers(0, self._i.size, count)
        heading = rng.integers(0, self.headings.size, count)
        middles = self._middles(np.stack([self._i[place], self._j[place], heading]))
        off = rng.uniform(-0.5, 0.5, middles.shape)
        return middles + np.array([[self.cell], [self.cell], [SEARCH_STEP]]) * off

    def _middles(self, cells: npt.NDArray[np.intp]) -> Array:
        """Poses (3, N) of cells (3, N)."""
        x, y = (cells[:2] + 0.5) * self.cell + np.array([self.origin]).T
        return np.stack([x, y, cells[2] * SEARCH_STEP])


def _bordered(picture: Picture, value: float) -> Picture:
    """One cell more on every side."""
    return np.pad(picture, 1, constant_values=value)
