"""How well a scan's histograms of x and y fit those of the map (Kwolek 2004, section 5)."""

import numpy as np
import numpy.typing as npt

from followerd.estimation.claims import bridged, unclaimed
from followerd.estimation.pose_cloud import array_of
from followerd.geometry import Array, Pose2
from followerd.maps.scan_table import BEAMS, HEADING_STEP, HEADINGS, Bytes, Indices, ScanTable
from followerd.messages import Scan

SEARCHED = 2_000_000  # rows of the table at most, that a search looks at
BEST = 2000  # of them
CHUNK = 65_536  # rows scored at a time
NOWHERE = -27.6  # log of the weight of a pose in a wall: 1e-12
EVEN_BYTES = np.uint64(0x00FF_00FF_00FF_00FF)
LANES = np.uint64(0x0001_0001_0001_0001)  # of 16 bits


class HistogramSensor:
    """A Sensor: exp(beta (H - 1)) of the normalised intersection H; see Mcl."""

    def __init__(self, table: ScanTable, beta: float, bridges: bool = True) -> None:
        self.table, self.beta, self.bridges = table, beta, bridges
        # a kept table is a memory map, whose every access would make one more
        self._rows: Bytes = np.asarray(table.counts).reshape(-1, 2 * table.bins)
        self._each = np.ones(2 * table.bins, np.float32)
        self._centres = table.centres()
        self._seen: Array = np.zeros(2 * table.bins)
        self._laser = Pose2()

    def see(self, scan: Scan, person: tuple[float, float] | None) -> int:
        """See Sensor. The beams of the table's half circle, the others rescaled to fill it."""
        bearings = np.radians(np.arange(BEAMS) - BEAMS // 2)
        beams = np.round((bearings - scan.angle_min) / scan.angle_increment).astype(np.intp)
        beams = beams[(beams >= 0) & (beams < scan.ranges.size)]
        self._laser = scan.base_from_laser
        points = unclaimed(scan, person)
        if self.bridges:
            points = bridged(points, scan)
        points = points[beams]
        points = (~scan.base_from_laser).apply(points[np.isfinite(points[:, 0])])
        self._seen = self.table.histogram(points)
        return len(points) if self._seen.any() else 0

    def intersections(self, poses: Array) -> Array:
        """H (N,) of poses (3, N) of `base`, 0 where the laser cannot be."""
        x, y, theta = poses
        c, s = np.cos(theta), np.sin(theta)
        laser = self._laser
        lasers = np.stack(
            [x + c * laser.x - s * laser.y, y + s * laser.x + c * laser.y, theta + laser.theta]
        )
        rows = self.table.rows(lasers)
        least = np.minimum(self._rows[rows], self._seen.astype(np.float32))
        shared = least @ self._each  # a product with ones: sums over short rows are slow
        return np.where(rows < 0, 0.0, shared / (2.0 * BEAMS))

    def log_likelihood(self, poses: Array) -> Array:
        """See Sensor."""
        h = self.intersections(poses)
        return np.where(h > 0.0, self.beta * (h - 1.0), NOWHERE)

    def fit(self, pose: Pose2) -> float:
        """See Sensor."""
        return float(self.intersections(array_of(pose))[0])

    def search(self, count: int, rng: np.random.Generator) -> Array:
        """See Sensor: around the best rows of the whole table, each as likely as the other."""
        best = self.best_rows()
        chosen = best[rng.integers(0, best.size, count)]
        return self._poses(chosen // HEADINGS, chosen % HEADINGS, rng)

    def anywhere(self, count: int, rng: np.random.Generator) -> Array:
        """See Sensor."""
        places = rng.integers(0, len(self._centres), count)
        return self._poses(places, rng.uniform(0.0, HEADINGS, count), rng)

    def best_rows(self) -> Indices:
        """The BEST rows by intersection with the scan, of SEARCHED spread over the table."""
        stride = -(-len(self.table.counts) * HEADINGS // SEARCHED)
        sample = self.table.counts[::stride]
        rows = sample.reshape(-1, 2 * self.table.bins)
        scores = self._scores(rows)
        least = np.partition(scores[::16], -min(BEST // 16 + 1, scores[::16].size))
        least = least[-min(BEST // 16 + 1, scores[::16].size)]
        good = np.flatnonzero(scores >= least)
        good = good[scores[good].argsort()[::-1][:BEST]]
        return good // HEADINGS * stride * HEADINGS + good % HEADINGS

    def _scores(self, rows: Bytes) -> npt.NDArray[np.uint16]:
        """Intersections in beams, (N,): bytes are compared all at once and summed word by word."""
        seen = np.round(self._seen).astype(np.uint8)
        tile = np.tile(seen, (CHUNK, 1))
        least = np.empty_like(tile)
        scores = np.empty(len(rows), np.uint16)
        for start in range(0, len(rows), CHUNK):
            part = rows[start : start + CHUNK]
            low = np.minimum(part, tile[: len(part)], out=least[: len(part)])
            words = low.view(np.uint64)
            lanes = (words & EVEN_BYTES) + ((words >> np.uint64(8)) & EVEN_BYTES)
            # the product's highest lane holds the sum of all of them
            sums = (lanes * LANES) >> np.uint64(48)
            scores[start : start + len(part)] = sum(sums.T)
        return scores

    def _poses(self, places: Indices, headings: Array | Indices, rng: np.random.Generator) -> Array:
        """Poses (3, N) of `base` somewhere in the cells of the laser's."""
        n = places.size
        off = rng.uniform(-0.5, 0.5, (3, n))
        x, y = self._centres[places].T + self.table.cell * off[:2]
        theta = (headings + off[2]) * HEADING_STEP - self._laser.theta
        c, s = np.cos(theta), np.sin(theta)
        return np.stack(
            [
                x - c * self._laser.x + s * self._laser.y,
                y - s * self._laser.x - c * self._laser.y,
                theta,
            ]
        )
