"""A serial line that is listened to: its bytes, both ways, for the recording."""

from collections.abc import Callable

from followerd import clock
from followerd.hw.stream import ByteStream, Link, Received

Hear = Callable[[str, bytes, float], None]  # whose bytes, what, loop time


class OverheardLink:
    """Wraps a link; `hear` is told what `device` says, and under `device-sent` what it is told."""

    def __init__(self, link: Link, device: str, hear: Hear) -> None:
        self.name = link.name
        self._link = link
        self._device = device
        self._hear = hear

    async def open(self, device: str, baud: int) -> "OverheardStream":
        """See Link."""
        return OverheardStream(await self._link.open(device, baud), self._device, self._hear)


class OverheardStream:
    """An open stream of an OverheardLink; see ByteStream."""

    def __init__(self, stream: ByteStream, device: str, hear: Hear) -> None:
        self._stream = stream
        self._device = device
        self._hear = hear
        self.drain = stream.drain
        self.set_baud = stream.set_baud
        self.discard_input = stream.discard_input
        self.close = stream.close

    async def read(self, at_least: int = 1) -> Received:
        """See ByteStream."""
        received = await self._stream.read(at_least)
        self._hear(self._device, received.data, received.stamp)
        return received

    def write(self, data: bytes) -> None:
        """See ByteStream."""
        self._hear(f"{self._device}-sent", bytes(data), clock.now())
        self._stream.write(data)
