"""The camera as a sensor: frames of any source become images with a camera model."""

from pathlib import Path

from followerd import clock
from followerd.errors import SetupError
from followerd.hw.camera.protocol import Frame
from followerd.hw.camera.ring import RingSource
from followerd.hw.camera.settings import CameraSettings
from followerd.hw.camera.source import FrameSource
from followerd.hw.camera.v4l2 import V4l2Source
from followerd.hw.interfaces import Sink
from followerd.messages import Image


def open_camera(link: str, settings: CameraSettings) -> FrameSource:
    """The source `/dev/videoN` (or a symlink to it), or a frame ring: `ring:FILE` or its path."""
    if Path(link).resolve().name.startswith("video"):
        return V4l2Source(link, settings.width, settings.height, settings.rate_hz)
    return RingSource(link.removeprefix("ring:"))


class CameraDriver:
    """Streams images; `dropped` counts frames that came too fast to be read."""

    role = "camera"
    Settings = CameraSettings

    role = "camera"
    Settings = CameraSettings

    def __init__(self, settings: CameraSettings, source: FrameSource, name: str = "camera") -> None:
        self.name = name
        self.dropped = 0
        self._source = source
        self._camera = settings.camera
        self._last: int | None = None

    async def run(self, sink: Sink) -> None:
        """Stream into `sink` until cancelled; raises OpenError, SetupError, LinkLost."""
        stream = await self._source.open(self.name)
        self._last = None
        try:
            while True:
                sink(self._image(await stream.read(), clock.now()))
        finally:
            stream.close()

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
        return Image(frame.id, frame.stamp, now, frame.pixels, self._camera, frame.depth)
