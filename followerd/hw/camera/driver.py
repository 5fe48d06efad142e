"""The camera as a sensor: frames of any source become images with a camera model."""

import cv2
import numpy as np

from followerd import clock
from followerd.errors import SetupError
from followerd.hw.camera.protocol import Frame
from followerd.hw.camera.settings import CameraSettings
from followerd.hw.camera.source import FrameSource, FrameStream
from followerd.hw.interfaces import ExposureLock, Sink
from followerd.messages import Image, Pixels


class CameraDriver:
    """Streams images; `dropped` counts frames that came too fast to be read."""

    role = "camera"
    Settings: type[CameraSettings] = CameraSettings

    def __init__(self, settings: CameraSettings, source: FrameSource, name: str = "camera") -> None:
        self.name = name
        self.dropped = 0
        self._source = source
        self._camera = settings.camera
        self._last: int | None = None
        self._stream: FrameStream | None = None
        self.exposure_locked = False

    @property
    def errors(self) -> int:
        """See CountsErrors: frames that the camera took and that never came, or were broken."""
        return self.dropped

    async def run(self, sink: Sink) -> None:
        """Stream into `sink` until cancelled; raises OpenError, SetupError, LinkLost."""
        self._stream = stream = await self._source.open(self.name)
        self.lock_exposure(self.exposure_locked)
        self._last = None
        try:
            while True:
                sink(self._image(await stream.read(), clock.now()))
        finally:
            self._stream = None
            stream.close()

    def lock_exposure(self, locked: bool = True) -> None:
        """See ExposureLock; what the camera offers of it, and again after it was unplugged."""
        self.exposure_locked = locked
        stream: object = self._stream
        if isinstance(stream, ExposureLock):
            stream.lock_exposure(locked)

    def _image(self, frame: Frame, now: float) -> Image:
        height, width = frame.pixels.shape[:2]
        expected = (self._camera.width, self._camera.height)
        if (width, height) != expected:
            problem = f"{self._source.name} sends {width}x{height} frames, the config says"
            raise SetupError(
                self.name, f"{problem} {expected[0]}x{expected[1]}", "set width and height to match"
            )
        if self._last is not None:
            self.dropped += frame.id - self._last - 1
        self._last = frame.id
        pixels = self._toned(frame.pixels)
        return Image(frame.id, frame.stamp, now, pixels, self._camera, frame.depth, frame.jpeg)

    def _toned(self, pixels: Pixels) -> Pixels:
        """Colour is what trackers expect of a camera; a thermal one gives grey."""
        if pixels.ndim == 3:
            return pixels
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR), np.uint8)
