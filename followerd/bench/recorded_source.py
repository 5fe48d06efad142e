"""Recordings of followerd and ROS bags, as sources of frames and scans."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from followerd.bench.laser import LaserStep
from followerd.errors import UsageError
from followerd.estimation.ego_motion import EgoMotion
from followerd.geometry import Pose2
from followerd.hw.camera.protocol import Frame
from followerd.messages import Image, Odometry, Scan
from followerd.record import ros_import
from followerd.record.journal import Taken
from followerd.record.reading import Numbered, Recording

NOMINAL_RATE = 25.0  # frames a second of a single frame


def is_recording(path: Path) -> bool:
    """Whether `path` is a recording or a ROS bag: *.mcap, *.bag, or a rosbag2 folder."""
    return path.suffix in (".mcap", ".bag") or (path / "metadata.yaml").is_file()


def measurements(path: Path) -> Iterator[Image | Scan | Odometry]:
    """What the devices measured, in order. Raises UsageError."""
    try:
        recording = Recording(path) if path.suffix == ".mcap" else None
    except UsageError:  # an MCAP file of ROS
        recording = None
    if recording is None:
        yield from ros_import.read(path, {})
        return
    for record in recording:
        if isinstance(record, Image):
            yield record
        elif isinstance(record, Numbered) and isinstance(record.entry, Taken):
            event = record.entry.event
            if isinstance(event, Scan | Odometry):
                yield event


class RecordedFrames:
    """The images; see hw.camera.files.Recording. Raises UsageError when there are none."""

    def __init__(self, path: Path) -> None:
        self._path = path
        images = [(m.stamp, m.camera) for m in measurements(path) if isinstance(m, Image)]
        if not images:
            raise UsageError(f"{path} holds no images")
        self.count = len(images)
        self.camera = images[0][1]
        self.width, self.height = self.camera.width, self.camera.height
        spanned = images[-1][0] - images[0][0]
        self.rate = (self.count - 1) / spanned if spanned > 0.0 else NOMINAL_RATE

    def __iter__(self) -> Iterator[Frame]:
        images = (m for m in measurements(self._path) if isinstance(m, Image))
        for index, image in enumerate(images):
            yield Frame(index, image.stamp, image.pixels, image.depth)


class RecordedScans:
    """The scans with the odometry of their moment; see bench.laser. Raises UsageError."""

    def __init__(self, path: Path) -> None:
        self._steps: list[LaserStep] = []
        ego = EgoMotion()
        moved = False
        for measurement in measurements(path):
            if isinstance(measurement, Odometry):
                ego.observe(measurement)
                moved = True
            elif isinstance(measurement, Scan):
                pose = ego.pose_at(measurement.stamp)
                self._steps.append(LaserStep(len(self._steps), measurement, pose))
        if not self._steps:
            raise UsageError(f"{path} holds no scans")
        self.frame = "odom" if moved else "laser"
        self.count = len(self._steps)
        self.stamps = np.array([step.scan.stamp for step in self._steps])
        self.base_from_laser: Pose2 = self._steps[0].scan.base_from_laser

    def __iter__(self) -> Iterator[LaserStep]:
        return iter(self._steps)
