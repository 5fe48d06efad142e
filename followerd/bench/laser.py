"""Recorded scans as a laser on a robot delivers them, with the odometry of that moment."""

import csv
import gzip
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from followerd.errors import UsageError
from followerd.geometry import Array, Pose2
from followerd.messages import Scan

ODOMETRY = ("odom.csv.gz", "odom.csv")  # beside the scans, whichever there is
STAMPS = ("t_header", "t", "stamp", "t_bag")  # columns of its time, the best first
KEYS = ("t", "ranges", "angle_min", "angle_inc")


@dataclass(frozen=True, slots=True)
class LaserStep:
    """One scan of a recording, and where the robot was then."""

    index: int
    scan: Scan
    ego: Pose2 | None  # odom_from_base
    corrected: Pose2 | None = None  # map_from_base, as a mapper found it afterwards


class LaserRecording:
    """Scans of an .npz file (t, ranges, angle_min, angle_inc), or of a folder with `scans.npz`.

    Odometry is taken from `odom.csv.gz` beside them where there is one. Ranges of 0 and nan are
    beams that were not measured, inf had no echo. Raises UsageError.
    """

    def __init__(self, path: Path, base_from_laser: Pose2 | None = None) -> None:
        file = path / "scans.npz" if path.is_dir() else path
        self.base_from_laser = base_from_laser or Pose2()
        content = _read(file)
        self.stamps: Array = np.asarray(content["t"], float)
        ranges = np.asarray(content["ranges"], float)
        if self.stamps.ndim != 1 or ranges.ndim != 2 or len(ranges) != len(self.stamps):
            raise UsageError(f"{file}: ranges must hold one row of beams for each of t")
        self._ranges = np.where(ranges > 0.0, ranges, np.nan)
        self._first, self._step = float(content["angle_min"]), float(content["angle_inc"])
        if not self._step > 0.0:
            raise UsageError(f"{file}: angle_inc must be above 0, counter-clockwise")
        finite = ranges[np.isfinite(ranges)]
        farthest = finite.max() if finite.size else 0.0
        self._range_max = float(content["range_max"]) if "range_max" in content else farthest
        self.count = len(self.stamps)
        self._odometry = _odometry(file.parent)

    @property
    def frame(self) -> str:
        """The frame that tracks are given in: odom, or the laser of each scan."""
        return "laser" if self._odometry is None else "odom"

    def __iter__(self) -> Iterator[LaserStep]:
        for index, stamp in enumerate(self.stamps.tolist()):
            ranges = self._ranges[index]
            scan = Scan(
                stamp,
                stamp,
                self._first,
                self._step,
                ranges,
                self._range_max,
                np.zeros(ranges.size),
                self.base_from_laser,
            )
            yield LaserStep(index, scan, self._pose_at(stamp))

    def _pose_at(self, stamp: float) -> Pose2 | None:
        """By the report before `stamp`, moved on: a live robot does not know the next one."""
        if self._odometry is None:
            return None
        times = self._odometry[:, 0]
        row = max(int(np.searchsorted(times, stamp, side="right")) - 1, 0)
        time, x, y, theta, v, omega = self._odometry[row].tolist()
        return Pose2(x, y, theta).moved(v, omega, min(max(stamp - time, 0.0), 0.5))


def _read(file: Path) -> dict[str, Array]:
    try:
        with np.load(file) as archive:
            content = {key: archive[key] for key in (*KEYS, "range_max") if key in archive}
    except (OSError, ValueError, BadZipFile, TypeError, AttributeError) as error:
        raise UsageError(f"{file}: not readable as scans in .npz: {error}") from error
    missing = [key for key in KEYS if key not in content]
    if missing:
        raise UsageError(f"{file}: lacks {', '.join(missing)}; scans have {', '.join(KEYS)}")
    return content


def _odometry(folder: Path) -> Array | None:
    """Rows t, x, y, theta, v, omega in order of time; None without a file."""
    found = [folder / name for name in ODOMETRY if (folder / name).is_file()]
    if not found:
        return None
    file = found[0]
    try:
        content = file.read_bytes()
        text = (gzip.decompress(content) if file.suffix == ".gz" else content).decode()
        rows = list(csv.DictReader(text.splitlines()))
        stamp = next(name for name in STAMPS if name in rows[0])
        columns = (stamp, "x", "y", "theta", "v", "w")
        table = np.array([[float(row[name]) for name in columns] for row in rows])
    except (OSError, EOFError, ValueError, KeyError, TypeError, IndexError, StopIteration) as error:
        wanted = "a time, x, y, theta, v and w"
        raise UsageError(f"{file}: not readable as rows of {wanted}: {error!r}") from error
    return table[np.argsort(table[:, 0], kind="stable")]
