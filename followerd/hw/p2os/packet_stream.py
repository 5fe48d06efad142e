"""Packets with their times, from an open byte stream."""

from math import inf
from typing import NamedTuple

from followerd.hw.p2os.config import is_config_with_wrong_checksum
from followerd.hw.p2os.protocol import LineStats, Packet, PacketDecoder
from followerd.hw.stream import ArrivalTimes, ByteStream

PAUSE = 0.025  # s of quiet line; longer than a USB adapter's latency, shorter than between SIPs


class Arrived(NamedTuple):
    """A packet and when it came."""

    packet: Packet
    stamp: float  # s, first byte
    received: float  # s, last chunk


class PacketStream:
    """A byte stream read packet by packet. Raises LinkLost as the stream does."""

    def __init__(self, stream: ByteStream, baud: int) -> None:
        self.baud = baud
        self._stream = stream
        self._last = inf  # s, end of the newest chunk
        self._restart()

    @property
    def stats(self) -> LineStats:
        """Counters since the line rate was set."""
        return self._decoder.stats

    async def read(self) -> list[Arrived]:
        """The packets completed by the next bytes; may be empty."""
        received = await self._stream.read()
        began = received.stamp - 10.0 * len(received.data) / self.baud
        packets = self._decoder.settle() if began - self._last > PAUSE else []
        self._last = received.stamp
        self._times.add(received)
        packets += self._decoder.feed(received.data)
        return [
            Arrived(packet, self._times.at(packet.offset, self.baud), received.stamp)
            for packet in packets
        ]

    @property
    def begun(self) -> tuple[int, int] | None:
        """See PacketDecoder."""
        return self._decoder.begun

    def write(self, data: bytes) -> None:
        """Send now."""
        self._stream.write(data)

    async def drain(self) -> None:
        """Wait until the port has taken everything."""
        await self._stream.drain()

    def set_baud(self, baud: int) -> None:
        """Change the line rate; what came at the old one is forgotten."""
        self._stream.set_baud(baud)
        self.baud = baud
        self.discard()

    def discard(self) -> None:
        """Forget what was received so far."""
        self._stream.discard_input()
        self._restart()

    def close(self) -> None:
        """Close the stream."""
        self._stream.close()

    def _restart(self) -> None:
        self._decoder = PacketDecoder(is_config_with_wrong_checksum)
        self._times = ArrivalTimes()
        self._last = inf
