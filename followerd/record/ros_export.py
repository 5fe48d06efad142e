"""A recording as a ROS 2 bag.

Message types as their ROS definitions have them (REP-103 axes, as ours; REP-105 frames).
"""

from collections.abc import Iterator
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from followerd.errors import UsageError
from followerd.geometry import Pose2
from followerd.messages import Image, Odometry, Scan, Twist
from followerd.record.journal import Taken
from followerd.record.reading import Decided, Numbered, Record, Recording

STORE = get_typestore(Stores.ROS2_HUMBLE)
TOPICS = {
    "/scan": "sensor_msgs/msg/LaserScan",
    "/odom": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/camera/image_raw": "sensor_msgs/msg/Image",
    "/person": "geometry_msgs/msg/PoseStamped",
    "/cmd_vel": "geometry_msgs/msg/TwistStamped",
}


def export(recording: Recording, folder: Path) -> dict[str, int]:
    """Write a rosbag2 (MCAP) into the new `folder`: messages by topic. Raises UsageError."""
    if folder.exists():
        raise UsageError(f"{folder} exists; give a new folder")
    counts = dict.fromkeys(TOPICS, 0)
    try:
        with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            connections = {
                topic: writer.add_connection(topic, kind, typestore=STORE)
                for topic, kind in TOPICS.items()
            }
            for record in recording:
                for topic, stamp, message in _messages(record):
                    data = STORE.serialize_cdr(message, TOPICS[topic])
                    writer.write(connections[topic], round(stamp * 1e9), data)
                    counts[topic] += 1
    except OSError as error:
        raise UsageError(f"{folder} cannot be written: {error.strerror}") from None
    return counts


def _messages(record: Record) -> Iterator[tuple[str, float, Any]]:
    if isinstance(record, Image):
        yield "/camera/image_raw", record.stamp, _image(record)
    elif isinstance(record, Numbered) and isinstance(record.entry, Taken):
        event = record.entry.event
        if isinstance(event, Scan):
            yield "/scan", event.stamp, _scan(event)
        elif isinstance(event, Odometry):
            yield "/odom", event.stamp, _odometry(event)
            yield "/tf", event.stamp, _transforms(event)
    elif isinstance(record, Decided):
        yield from _outcome(record)


def _outcome(decided: Decided) -> Iterator[tuple[str, float, Any]]:
    track, motion = decided.plain["track"], decided.plain["command"]["motion"] or {}
    header = _header(decided.stamp, "base_link")
    speeds = _twist(Twist(motion.get("v", 0.0), motion.get("omega", 0.0)))
    yield "/cmd_vel", decided.stamp, _new("TwistStamped", "geometry", header=header, twist=speeds)
    if track is not None and track["position"] is not None:
        header, pose = _header(track["stamp"], "odom"), _pose(Pose2(*track["position"]))
        yield "/person", decided.stamp, _new("PoseStamped", "geometry", header=header, pose=pose)


def _new(name: str, package: str, **values: Any) -> Any:
    return STORE.types[f"{package}_msgs/msg/{name}"](**values)


def _header(stamp: float, frame: str) -> Any:
    seconds, rest = divmod(max(0, round(stamp * 1e9)), 10**9)
    time = STORE.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
    return _new("Header", "std", stamp=time, frame_id=frame)


def _vector(x: float = 0.0, y: float = 0.0, z: float = 0.0, name: str = "Vector3") -> Any:
    return _new(name, "geometry", x=float(x), y=float(y), z=float(z))


def _turned(angle: float) -> Any:
    return _new("Quaternion", "geometry", x=0.0, y=0.0, z=sin(0.5 * angle), w=cos(0.5 * angle))


def _pose(pose: Pose2) -> Any:
    where = _vector(pose.x, pose.y, name="Point")
    return _new("Pose", "geometry", position=where, orientation=_turned(pose.theta))


def _twist(twist: Twist) -> Any:
    return _new("Twist", "geometry", linear=_vector(twist.v), angular=_vector(z=twist.omega))


def _scan(scan: Scan) -> Any:
    spacing = np.diff(scan.beam_times)
    return _new(
        "LaserScan",
        "sensor",
        header=_header(scan.stamp, "laser"),
        angle_min=scan.angle_min,
        angle_max=scan.angle_min + scan.angle_increment * max(0, scan.ranges.size - 1),
        angle_increment=scan.angle_increment,
        time_increment=float(spacing.mean()) if spacing.size else 0.0,
        scan_time=0.0,
        range_min=0.0,
        range_max=scan.range_max,
        ranges=scan.ranges.astype(np.float32),
        intensities=np.zeros(0, np.float32),
    )


def _odometry(odometry: Odometry) -> Any:
    nothing = np.zeros(36)
    return _new(
        "Odometry",
        "nav",
        header=_header(odometry.stamp, "odom"),
        child_frame_id="base_link",
        pose=_new("PoseWithCovariance", "geometry", pose=_pose(odometry.pose), covariance=nothing),
        twist=_new(
            "TwistWithCovariance", "geometry", twist=_twist(odometry.twist), covariance=nothing
        ),
    )


def _transforms(odometry: Odometry) -> Any:
    moved = _new(
        "Transform",
        "geometry",
        translation=_vector(odometry.pose.x, odometry.pose.y),
        rotation=_turned(odometry.pose.theta),
    )
    stamped = _new(
        "TransformStamped",
        "geometry",
        header=_header(odometry.stamp, "odom"),
        child_frame_id="base_link",
        transform=moved,
    )
    return STORE.types["tf2_msgs/msg/TFMessage"](transforms=[stamped])


def _image(image: Image) -> Any:
    height, width = image.pixels.shape[:2]
    return _new(
        "Image",
        "sensor",
        header=_header(image.stamp, "camera"),
        height=height,
        width=width,
        encoding="bgr8" if image.pixels.ndim == 3 else "mono8",
        is_bigendian=0,
        step=image.pixels[0].nbytes,
        data=np.ascontiguousarray(image.pixels).reshape(-1),
    )
