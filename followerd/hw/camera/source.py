"""Where a camera's frames come from: what the driver needs of a ring, a twin or a real camera."""

from typing import Protocol

from followerd.hw.camera.protocol import Frame


class FrameStream(Protocol):
    """An open source; the newest frame wins, older ones that nobody took are lost."""

    async def read(self) -> Frame:
        """The newest frame not read before; raises LinkLost when the source is gone."""

    def close(self) -> None:
        """Close; idempotent."""


class FrameSource(Protocol):
    """Where a camera is plugged in."""

    name: str  # as in the config, for messages

    async def open(self, device: str) -> FrameStream:
        """Open it for `device`; raises OpenError with the remedy."""
