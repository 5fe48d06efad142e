"""The channels of a recording.

What viewers know is written in Foxglove's well-known schemas; the rest as JSON with schemas of our
own. `/journal` and `/decision` are what a replay lives on; all else is for eyes.
"""

import json
from dataclasses import dataclass, fields
from functools import partial
from math import cos, sin
from typing import Any

from foxglove import Channel, Context, Schema
from foxglove.channels import (
    CompressedImageChannel,
    FrameTransformsChannel,
    LaserScanChannel,
    LogChannel,
    PoseInFrameChannel,
    RawImageChannel,
)
from foxglove.messages import Pose, Quaternion, Vector3

from followerd.geometry import Pose2
from followerd.record.journal import Dropped, Enrolled, Looked, Taken

ABOUT = "followerd"  # name of the metadata record
JOURNAL, DECISION, FRAME = "/journal", "/decision", "/camera/frame"
IMAGE, DEPTH = "/camera/image", "/camera/depth"
BYTES = "/bytes/"  # and the device's name


@dataclass(frozen=True, slots=True)
class Channels:
    """One of each, in a context of their own."""

    journal: Channel
    decision: Channel
    frame: Channel
    jpeg: CompressedImageChannel
    raw: RawImageChannel
    depth: RawImageChannel
    scan: LaserScanChannel
    frames: FrameTransformsChannel
    person: PoseInFrameChannel
    log: LogChannel


def channels(context: Context) -> Channels:
    """All channels; what a camera sends decides whether images are raw or compressed."""
    said = partial(_json_channel, context)
    return Channels(
        said(JOURNAL, "followerd.Journal", _journal_schema()),
        said(DECISION, "followerd.Decision", _object("sequence", "stamp", "mode", "reasons")),
        said(FRAME, "followerd.Frame", _object("id", "stamp", "received", "camera")),
        CompressedImageChannel(IMAGE, context=context),
        RawImageChannel(IMAGE, context=context),
        RawImageChannel(DEPTH, context=context),
        LaserScanChannel("/laser/scan", context=context),
        FrameTransformsChannel("/tf", context=context),
        PoseInFrameChannel("/person", context=context),
        LogChannel("/log", context=context),
    )


def bytes_channel(context: Context, device: str) -> Channel:
    """What a device said, as it came."""
    octets = "application/octet-stream"
    schema = Schema(name="followerd.Bytes", encoding="", data=b"")
    return Channel(BYTES + device, schema=schema, message_encoding=octets, context=context)


def pose(planar: Pose2) -> Pose:
    """A planar pose in space."""
    return Pose(position=position(planar.x, planar.y), orientation=turned(planar.theta))


def position(x: float, y: float) -> Vector3:
    """On the ground."""
    return Vector3(x=x, y=y, z=0.0)


def turned(angle: float) -> Quaternion:
    """About the vertical."""
    return Quaternion(x=0.0, y=0.0, z=sin(0.5 * angle), w=cos(0.5 * angle))


def _json_channel(context: Context, topic: str, name: str, schema: dict[str, Any]) -> Channel:
    described = Schema(name=name, encoding="jsonschema", data=json.dumps(schema).encode())
    return Channel(topic, schema=described, message_encoding="json", context=context)


def _object(*names: str) -> dict[str, Any]:
    return {"type": "object", "required": list(names), "additionalProperties": True}


def _journal_schema() -> dict[str, Any]:
    kinds = (Taken, Looked, Enrolled, Dropped)
    entries = [
        {
            **_object("kind", *(field.name for field in fields(kind))),
            "properties": {"kind": {"const": kind.__name__}},
        }
        for kind in kinds
    ]
    return {"type": "object", "oneOf": entries}
