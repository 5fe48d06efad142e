"""Images, scans and odometry out of a bag of ROS 1 or 2."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from math import atan2
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from followerd.errors import UsageError
from followerd.geometry import Camera, Pose2
from followerd.messages import Image, Odometry, Scan, Twist

STORE = get_typestore(Stores.ROS2_HUMBLE)  # for bags that do not carry their types
USUAL_CAMERA_DEG = 60.0  # field of view where a bag has no camera_info


def read(path: Path, topics: Mapping[str, str]) -> Iterator[Image | Scan | Odometry]:
    """Images, scans and odometry of a bag, in its order; `topics` by kind where it has several.

    Kinds are image, scan and odometry. Raises UsageError.
    """
    try:
        with AnyReader([path], default_typestore=STORE) as reader:
            chosen = {_chosen(reader, kind, topics.get(kind)): kind for kind in READERS}
            cameras = _cameras(reader)
            wanted = [c for c in reader.connections if c.topic in chosen]
            messages = reader.messages(wanted) if wanted else ()
            counts: Counter[str] = Counter()
            for connection, stamp, data in messages:
                message = reader.deserialize(data, connection.msgtype)
                kind = chosen[connection.topic]
                yield READERS[kind](message, stamp * 1e-9, counts[kind], cameras)
                counts[kind] += 1
    except AnyReaderError as error:
        raise UsageError(f"{path} is no ROS bag that can be read: {error}") from None


TYPES = {
    "image": ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"),
    "scan": ("sensor_msgs/msg/LaserScan",),
    "odometry": ("nav_msgs/msg/Odometry",),
}


def _chosen(reader: AnyReader, kind: str, wanted: str | None) -> str:
    found = sorted({c.topic for c in reader.connections if c.msgtype in TYPES[kind]})
    if wanted is not None:
        if wanted not in found:
            raise UsageError(f"no {kind} on {wanted}; there are {', '.join(found) or 'none'}")
        return wanted
    if len(found) > 1:
        raise UsageError(f"several {kind} topics: {', '.join(found)}; choose one")
    return found[0] if found else ""


def _cameras(reader: AnyReader) -> list[Camera]:
    """The first camera_info, if there is one."""
    infos = [c for c in reader.connections if c.msgtype == "sensor_msgs/msg/CameraInfo"]
    for connection, _, data in reader.messages(infos[:1]) if infos else ():
        info: Any = reader.deserialize(data, connection.msgtype)
        k = info.k if hasattr(info, "k") else info.K  # ROS 2, ROS 1
        return [Camera(info.width, info.height, *(float(k[i]) for i in (0, 4, 2, 5)))]
    return []


def _read_image(message: Any, received: float, number: int, cameras: list[Camera]) -> Image:
    data = np.asarray(message.data, np.uint8)
    if hasattr(message, "format"):
        pixels = cv2.imdecode(data, cv2.IMREAD_COLOR)
    else:
        pixels = _decoded(data, message.encoding, message.height, message.width)
    if pixels is None:
        raise UsageError(f"image {number} of the bag cannot be decoded")
    height, width = pixels.shape[:2]
    usual = 0.5 * width / np.tan(np.radians(0.5 * USUAL_CAMERA_DEG))
    camera = (
        cameras[0] if cameras else Camera(width, height, usual, usual, 0.5 * width, 0.5 * height)
    )
    stamp = _stamp(message.header, received)
    return Image(number, stamp, received, pixels.astype(np.uint8, copy=False), camera)


def _decoded(data: np.ndarray, encoding: str, height: int, width: int) -> np.ndarray | None:
    if encoding in ("mono8", "8UC1"):
        return data.reshape(height, -1)[:, :width]
    if encoding in ("bgr8", "8UC3"):
        return data.reshape(height, -1)[:, : 3 * width].reshape(height, width, 3)
    if encoding == "rgb8":
        return data.reshape(height, -1)[:, : 3 * width].reshape(height, width, 3)[..., ::-1].copy()
    raise UsageError(f"images encoded as {encoding} are not understood; bgr8, rgb8 and mono8 are")


def _read_scan(message: Any, received: float, _number: int, _cameras: list[Camera]) -> Scan:
    ranges = np.asarray(message.ranges, np.float64)
    ranges = np.where(ranges < message.range_min, np.nan, ranges)
    ranges = np.where(ranges > message.range_max, np.inf, ranges)
    angle, step = float(message.angle_min), float(message.angle_increment)
    if step < 0.0:
        ranges, angle, step = ranges[::-1].copy(), angle + step * (ranges.size - 1), -step
    times = np.arange(ranges.size) * float(message.time_increment)
    stamp = _stamp(message.header, received)
    return Scan(stamp, received, angle, step, ranges, float(message.range_max), times, Pose2())


def _read_odometry(
    message: Any, received: float, _number: int, _cameras: list[Camera]
) -> Odometry:  # fmt: skip
    pose, twist = message.pose.pose, message.twist.twist
    q = pose.orientation
    theta = atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    return Odometry(
        _stamp(message.header, received),
        received,
        Pose2(float(pose.position.x), float(pose.position.y), theta),
        Twist(float(twist.linear.x), float(twist.angular.z)),
    )


def _stamp(header: Any, received: float) -> float:
    stamp = float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)
    return stamp or received


Reader = Callable[[Any, float, int, list[Camera]], Image | Scan | Odometry]
READERS: dict[str, Reader] = {"image": _read_image, "scan": _read_scan, "odometry": _read_odometry}
