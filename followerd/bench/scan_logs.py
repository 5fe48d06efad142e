"""Recordings of scans, whichever form they have."""

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from followerd.bench.carmen import CarmenLog
from followerd.bench.laser import LaserRecording, LaserStep
from followerd.bench.recorded_source import RecordedScans, is_recording
from followerd.errors import UsageError
from followerd.geometry import Array, Pose2


class ScanLog(Protocol):
    """Scans in file order."""

    count: int
    stamps: Array  # (count,) s

    @property
    def frame(self) -> str:
        """The frame of odometry: odom, or laser where there is none."""

    def __iter__(self) -> Iterator[LaserStep]: ...


def open_log(path: Path, base_from_laser: Pose2 | None = None) -> ScanLog:
    """A CARMEN log, an .npz of scans or a folder with one, a recording or a ROS bag.

    Raises UsageError.

    `base_from_laser` is for those that do not tell where the laser sits.
    """
    if is_recording(path) and base_from_laser is None:
        return RecordedScans(path)
    if path.is_dir() or path.suffix == ".npz":
        return LaserRecording(path, base_from_laser)
    if base_from_laser is not None:
        raise UsageError(f"{path} says itself where the laser sits")
    return CarmenLog(path)
