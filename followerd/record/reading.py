"""Reads recordings, whole or cut off: what is complete is given in the order of writing."""

import json
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from followerd.errors import UsageError
from followerd.geometry import Camera
from followerd.hw.camera.calibration import Calibration, Lens
from followerd.hw.camera.pixels import decode
from followerd.hw.camera.tone import Tone
from followerd.messages import Image, Pixels
from followerd.record import schemas
from followerd.record.codec import restored
from followerd.record.journal import Dropped, Enrolled, Entry, Looked, Taken
from followerd.record.tape import part

# what a file that ends in the middle, or was damaged, makes the reader raise
BROKEN = (
    McapError,
    zlib.error,
    RuntimeError,
    struct.error,
    EOFError,
    UnicodeDecodeError,
    OverflowError,
)


LENS = "lens"  # calibration by which the images were made straight, if they were


class Numbered(NamedTuple):
    """An entry of the journal."""

    number: int
    entry: Entry


class Decided(NamedTuple):
    """A decision as plain values, arrays as checksums."""

    stamp: float  # s
    plain: dict[str, Any]


class Heard(NamedTuple):
    """Bytes of a device."""

    device: str
    data: bytes
    stamp: float  # s, of the wall clock


Record = Numbered | Decided | Image | Heard


@dataclass
class Recording:
    """A recording, all its parts; iterate over it once or more.

    Raises UsageError when there is no such file or it is no recording of followerd.
    """

    path: Path
    truncated: str = ""  # where the last pass met an unfinished end

    def __post_init__(self) -> None:
        if not self.path.is_file():
            raise UsageError(f"{self.path}: no such recording")
        self.about = _about(self.path)
        self._lens: Lens | None = None
        if LENS in self.about:
            self._lens = Lens(Calibration.model_validate_json(self.about[LENS]))

    @property
    def parts(self) -> list[Path]:
        """Its files, in order."""
        found = [self.path]
        while (following := part(self.path, len(found))).is_file():
            found.append(following)
        return found

    def __iter__(self) -> Iterator[Record]:
        self.truncated = ""
        for path in self.parts:
            yield from self._records(path)

    def _records(self, path: Path) -> Iterator[Record]:
        reading = _Reading(self._lens)
        for record in self._raw(path):
            if isinstance(record, Schema):
                reading.schemas[record.id] = record
            elif isinstance(record, Channel):
                reading.channels[record.id] = record
            elif isinstance(record, Message):
                item = reading.item(record)
                if item is not None:
                    yield item

    def _raw(self, path: Path) -> Iterator[McapRecord]:
        with path.open("rb") as stream:
            try:
                yield from StreamReader(stream, record_size_limit=None).records
            except BROKEN as error:
                self.truncated = f"{path}: {type(error).__name__} {error}".strip()


class _Reading:
    """What one pass over a file remembers."""

    def __init__(self, lens: Lens | None) -> None:
        self._lens = lens
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._decoders = DecoderFactory()
        self._pixels: Pixels | None = None
        self._jpeg: bytes | None = None
        self._depth: Any = None

    def item(self, message: Message) -> Record | None:
        topic = self.channels[message.channel_id].topic
        if topic == schemas.JOURNAL:
            entry = json.loads(message.data)
            return Numbered(
                entry.pop("number"), restored(Taken | Looked | Enrolled | Dropped, entry)
            )
        if topic == schemas.DECISION:
            decision = json.loads(message.data)
            return Decided(decision["stamp"], decision)
        if topic in (schemas.IMAGE, schemas.DEPTH):
            self._see(topic, self._decoded(message))
        elif topic == schemas.FRAME:
            return self._image(json.loads(message.data))
        elif topic.startswith(schemas.BYTES):
            return Heard(topic.removeprefix(schemas.BYTES), message.data, message.log_time * 1e-9)
        return None

    def _decoded(self, message: Message) -> Any:
        channel = self.channels[message.channel_id]
        decode = self._decoders.decoder_for(
            channel.message_encoding, self.schemas[channel.schema_id]
        )
        if decode is None:
            raise McapError(f"{channel.topic} is encoded as {channel.message_encoding}")
        return decode(message.data)

    def _see(self, topic: str, picture: Any) -> None:
        data = np.frombuffer(picture.data, np.uint8)
        if topic == schemas.DEPTH:
            self._depth = data.view(np.float32).reshape(picture.height, picture.width)
        elif hasattr(picture, "encoding"):
            depth = (3,) if picture.encoding == "bgr8" else ()
            self._pixels = data.reshape(picture.height, picture.width, *depth)
        else:
            self._jpeg = picture.data

    def _image(self, frame: dict[str, Any]) -> Image | None:
        camera = restored(Camera, frame["camera"])
        pixels, self._pixels = self._pixels, None
        depth, self._depth = self._depth, None
        jpeg, self._jpeg = self._jpeg, None
        own = bool(frame.get("mjpg"))
        if jpeg is not None:
            pixels = self._as_it_was(jpeg, camera) if own else _decoded(jpeg)
        if pixels is None:
            return None
        seen = frame["id"], frame["stamp"], frame["received"], pixels, camera, depth
        return Image(*seen, jpeg if own else None)

    def _as_it_was(self, jpeg: bytes, camera: Camera) -> Pixels | None:
        """The camera's own picture, as the driver made it."""
        size = camera.width, camera.height
        pixels = decode("MJPG", memoryview(jpeg), size, 0, Tone())
        return pixels if pixels is None or self._lens is None else self._lens.straight(pixels)


def _decoded(jpeg: bytes) -> Pixels | None:
    found = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_UNCHANGED)
    return None if found is None else np.asarray(found, np.uint8)


def _about(path: Path) -> dict[str, str]:
    with path.open("rb") as stream:
        try:
            for record in StreamReader(stream, record_size_limit=None).records:
                if isinstance(record, Metadata) and record.name == schemas.ABOUT:
                    return record.metadata
        except BROKEN as error:
            raise UsageError(f"{path} is no recording: {type(error).__name__} {error}") from None
    raise UsageError(f"{path} is no recording of followerd")
