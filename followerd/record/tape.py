"""Writes recordings: every call goes to the file at once. Not for the loop; see recorder."""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path

import foxglove
import numpy as np
import numpy.typing as npt
from foxglove import Channel, Context, MCAPWriter
from foxglove.mcap import MCAPCompression, MCAPWriteOptions
from foxglove.messages import (
    CompressedImage,
    FrameTransform,
    FrameTransforms,
    LaserScan,
    Log,
    LogLevel,
    PoseInFrame,
    RawImage,
    Timestamp,
)

from followerd.errors import UsageError
from followerd.geometry import Pose2
from followerd.messages import Decision, Image, Odometry, Pixels, Scan
from followerd.record import schemas
from followerd.record.codec import Plain, plain
from followerd.record.journal import Entry, Taken
from followerd.record.settings import RecordSettings
from followerd.record.still import Still, kept

CHUNK = 512 * 1024  # bytes; a chunk is what a killed recording loses at most, between two flushes
MB = 1e6


class DiskFull(Exception):
    """There is less room than recording may use."""


class Tape:
    """A recording NAME.mcap, continued in NAME-1.mcap ...; `about` stands in each of them.

    Stamps are shifted by `epoch`, the wall clock's reading at loop time 0. Raises UsageError when
    the file exists or cannot be written.
    """

    def __init__(
        self, path: Path | None, settings: RecordSettings, about: Mapping[str, str], epoch: float
    ) -> None:
        self.settings = settings
        self.path = path
        self.about = {key: str(value) for key, value in about.items()}
        self._epoch = epoch
        self._context = Context()
        self._channels = schemas.channels(self._context)
        self._bytes: dict[str, Channel] = {}
        self._files = 0
        self._writer: MCAPWriter | None = None
        self._flushed = -float("inf")  # s, loop time
        self._said: tuple[str, ...] = ()
        if path is not None:
            self._writer = self._open(path)
        self._server = None
        if settings.foxglove_port is not None:
            self._server = foxglove.start_server(
                name="followerd",
                port=settings.foxglove_port,
                capabilities=[],
                context=self._context,
            )

    def image(self, image: Image) -> None:
        """An image, as the settings want it."""
        self.still(kept(image, self.settings))

    def still(self, still: Still) -> None:
        """What is kept of an image."""
        at, log_time = self._time(still.stamp), self._ns(still.received)
        if still.raw is not None:
            self._channels.raw.log(_raw(still.raw, at), log_time=log_time)
        elif still.jpeg is not None:
            shown = CompressedImage(timestamp=at, frame_id="camera", data=still.jpeg, format="jpeg")
            self._channels.jpeg.log(shown, log_time=log_time)
        if still.depth is not None:
            self._channels.depth.log(_depth(still.depth, at), log_time=log_time)
        frame = {
            "id": still.id,
            "stamp": still.stamp,
            "received": still.received,
            "camera": plain(still.camera),
            "depth": still.depth is not None,
            "mjpg": still.is_own,
        }
        self._log(self._channels.frame, frame, still.received)

    def entry(self, entry: Entry, number: int) -> None:
        """What the daemon consumed; numbered without a gap."""
        self._log(self._channels.journal, {"number": number, **_object(entry)}, entry.now)
        if isinstance(entry, Taken):
            if isinstance(entry.event, Scan):
                self._scan(entry.event)
            elif isinstance(entry.event, Odometry):
                self._base(entry.event)
        if entry.now - self._flushed >= self.settings.flush_s:
            self._flush(entry.now)

    def decision(self, decision: Decision) -> None:
        """What came of it."""
        self._log(self._channels.decision, plain(decision, digests=True), decision.stamp)
        track, at = decision.track, self._ns(decision.stamp)
        if track is not None and track.position is not None:
            here = PoseInFrame(
                timestamp=self._time(track.stamp),
                frame_id="odom",
                pose=schemas.pose(Pose2(*track.position)),
            )
            self._channels.person.log(here, log_time=at)
        said = (decision.mode.value, *map(str, decision.reasons))
        if said != self._said:
            self._said = said
            level = LogLevel.Warning if decision.reasons else LogLevel.Info
            text = Log(
                timestamp=self._time(decision.stamp), level=level, message=": ".join(said),
                name="followerd",
            )  # fmt: skip
            self._channels.log.log(text, log_time=at)

    def heard(self, device: str, data: bytes, now: float) -> None:
        """Bytes that a device sent."""
        if device not in self._bytes:
            self._bytes[device] = schemas.bytes_channel(self._context, device)
        self._bytes[device].log(data, log_time=self._ns(now))

    def hand_over(self) -> None:
        """Nothing waits: every call has gone to the file."""

    def close(self) -> None:
        """Finish the file."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        if self._server is not None:
            self._server.stop()
            self._server = None

    def _scan(self, scan: Scan) -> None:
        turn = scan.angle_increment * max(0, scan.ranges.size - 1)
        shown = LaserScan(
            timestamp=self._time(scan.stamp),
            frame_id="base",
            pose=schemas.pose(scan.base_from_laser),
            start_angle=scan.angle_min,
            end_angle=scan.angle_min + turn,
            ranges=scan.ranges.tolist(),
        )
        self._channels.scan.log(shown, log_time=self._ns(scan.received))

    def _base(self, odometry: Odometry) -> None:
        moved = FrameTransform(
            timestamp=self._time(odometry.stamp),
            parent_frame_id="odom",
            child_frame_id="base",
            translation=schemas.position(odometry.pose.x, odometry.pose.y),
            rotation=schemas.turned(odometry.pose.theta),
        )
        frames = FrameTransforms(transforms=[moved])
        self._channels.frames.log(frames, log_time=self._ns(odometry.received))

    def _log(self, channel: Channel, value: object, now: float) -> None:
        text = json.dumps(value, separators=(",", ":"), allow_nan=False)
        channel.log(text.encode(), log_time=self._ns(now))

    def _flush(self, now: float) -> None:
        """Make sure that what was written survives the process, and that there is room for more.

        Raises DiskFull.
        """
        self._flushed = now
        if self._writer is None or self.path is None:
            return
        self._writer.flush()
        free = shutil.disk_usage(self.path.parent).free / MB
        if free < self.settings.min_free_mb:
            raise DiskFull(f"{free:.0f} MB left in {self.path.parent}")
        if part(self.path, self._files).stat().st_size / MB >= self.settings.max_file_mb:
            self._writer.close()
            self._files += 1
            self._writer = self._open(part(self.path, self._files))

    def _open(self, path: Path) -> MCAPWriter:
        if path.exists():
            raise UsageError(f"{path} exists; recordings are never overwritten")
        options = MCAPWriteOptions(
            compression=MCAPCompression.Lz4, chunk_size=CHUNK, compression_threads=0
        )
        try:
            writer = foxglove.open_mcap(path, context=self._context, writer_options=options)
        except (OSError, RuntimeError) as error:
            raise UsageError(f"{path} cannot be written: {error}") from None
        writer.write_metadata(schemas.ABOUT, {**self.about, "part": str(self._files)})
        return writer

    def _ns(self, stamp: float) -> int:
        return max(0, round((stamp + self._epoch) * 1e9))

    def _time(self, stamp: float) -> Timestamp:
        seconds, rest = divmod(self._ns(stamp), 10**9)
        return Timestamp(seconds, rest)


def _object(entry: Entry) -> dict[str, Plain]:
    described = plain(entry)
    assert isinstance(described, dict)
    return described


def part(path: Path, number: int) -> Path:
    """The file that continues a recording for the `number`th time; 0 is the first itself."""
    return path if number == 0 else path.with_name(f"{path.stem}-{number}{path.suffix}")


def _raw(pixels: Pixels, at: Timestamp) -> RawImage:
    height, width = pixels.shape[:2]
    return RawImage(
        timestamp=at,
        frame_id="camera",
        width=width,
        height=height,
        encoding="bgr8" if pixels.ndim == 3 else "mono8",
        step=pixels[0].nbytes,
        data=np.ascontiguousarray(pixels).tobytes(),
    )


def _depth(depth: npt.NDArray[np.float32], at: Timestamp) -> RawImage:
    depth = np.ascontiguousarray(depth, np.float32)
    height, width = depth.shape
    return RawImage(
        timestamp=at,
        frame_id="camera",
        width=width,
        height=height,
        encoding="32FC1",
        step=4 * width,
        data=depth.tobytes(),
    )
