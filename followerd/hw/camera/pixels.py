"""Video frames as the kernel hands them over, as images."""

import cv2
import numpy as np

from followerd.hw.camera.tone import Tone
from followerd.messages import Pixels

COLOUR_FIRST = ("MJPG", "YUYV", "UYVY", "GREY", "Y16")  # what `auto` takes, best first
GREY_FIRST = ("Y16", "GREY", "YUYV", "UYVY", "MJPG")  # of a thermal camera
PACKED = {"YUYV": cv2.COLOR_YUV2BGR_YUY2, "UYVY": cv2.COLOR_YUV2BGR_UYVY}
BYTES = {"YUYV": 2, "UYVY": 2, "GREY": 1, "Y16": 2}  # a pixel


def decode(
    kind: str, data: memoryview, size: tuple[int, int], stride: int, tone: Tone
) -> Pixels | None:
    """The image of one buffer, BGR or grey; None when it is damaged or cut off.

    `size` is (width, height) px, `stride` bytes from row to row; `tone` makes 16-bit greys 8-bit.
    """
    width, height = size
    if kind == "MJPG":
        if not data:
            return None
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        fits = image is not None and image.shape[:2] == (height, width)
        return np.asarray(image, np.uint8) if fits else None
    stride = max(stride, width * BYTES[kind])
    if len(data) < stride * height:
        return None
    rows = np.frombuffer(data, np.uint8, stride * height).reshape(height, stride)
    rows = np.ascontiguousarray(rows[:, : width * BYTES[kind]])
    if kind == "GREY":
        return rows.copy()
    if kind == "Y16":
        return tone(rows.view("<u2"))
    return np.asarray(cv2.cvtColor(rows.reshape(height, width, 2), PACKED[kind]), np.uint8)


def top_field(pixels: Pixels) -> Pixels:
    """An interlaced image (H, W[, 3]) made of its upper field alone, the lines between averaged.

    The other field is 1/50 or 1/60 s older or younger: on a moving robot the two do not fit, and
    blending them doubles every edge.
    """
    whole = pixels.copy()
    upper, between = pixels[0::2], whole[1::2]
    below = np.concatenate((upper[1:], upper[-1:]))[: len(between)]
    cv2.addWeighted(upper[: len(between)], 0.5, below, 0.5, 0.0, dst=between)
    return whole
