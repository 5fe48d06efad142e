"""What a recording keeps of an image."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Camera
from followerd.messages import Image, Pixels
from followerd.record.settings import RecordSettings


@dataclass(frozen=True, slots=True, eq=False)
class Still:
    """A picture as it goes into the file: JPEG or raw or neither, and what belongs to it."""

    id: int
    stamp: float  # s
    received: float  # s
    camera: Camera
    jpeg: bytes | None
    is_own: bool  # the JPEG is the camera's
    raw: Pixels | None
    depth: npt.NDArray[np.float32] | None


def kept(image: Image, settings: RecordSettings) -> Still:
    """Compressed where the settings want it so, which takes a millisecond; nothing is copied."""
    jpeg, raw, depth = None, None, None
    if settings.images == "exact":
        jpeg, raw = image.jpeg, (image.pixels if image.jpeg is None else None)
    elif settings.images == "jpeg":
        quality = [cv2.IMWRITE_JPEG_QUALITY, settings.jpeg_quality]
        jpeg = bytes(cv2.imencode(".jpg", image.pixels, quality)[1])
    if settings.images != "none":
        depth = image.depth
    is_own = jpeg is not None and settings.images == "exact"
    return Still(image.id, image.stamp, image.received, image.camera, jpeg, is_own, raw, depth)
