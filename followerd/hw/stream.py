"""Byte streams to devices: what a driver reads from and writes to, and how a link is opened."""

from collections import deque
from typing import NamedTuple, Protocol


class Received(NamedTuple):
    """Bytes and the loop time at which they came."""

    data: bytes
    stamp: float  # s


class ByteStream(Protocol):
    """An open link. `read` raises LinkLost on hang-up; writes never block the loop."""

    async def read(self, at_least: int = 1) -> Received:
        """The next bytes that came (at least one), in order; never waits longer than needed.

        A reader that has no use for less may ask for more bytes: as long as nothing waits for it,
        it may be left asleep until so many came. They are still handed over chunk by chunk.
        """

    def write(self, data: bytes) -> None:
        """Send what the port takes, queue the rest (bounded: LinkLost when it overflows)."""

    async def drain(self) -> None:
        """Wait until everything written was handed to the port."""

    def set_baud(self, baud: int) -> None:
        """Change the line rate now; call `drain` first. No effect on sockets."""

    def discard_input(self) -> None:
        """Forget what was received but not yet read."""

    def close(self) -> None:
        """Close; idempotent."""


class Link(Protocol):
    """Where a device is plugged in; opens streams. Foreign exceptions are mapped here only."""

    name: str  # as in the config, for messages

    async def open(self, device: str, baud: int) -> ByteStream:
        """Open the link for `device`; raises OpenError with the remedy."""


class ArrivalTimes:
    """When the byte at a given offset of a stream arrived, at the line rate's resolution.

    `add` is told of each chunk; `at` gives the arrival of one byte: the chunk's stamp less the
    line time of the bytes that followed it in that chunk.
    """

    def __init__(self, keep: int = 64) -> None:
        self._chunks: deque[tuple[int, int, float]] = deque(maxlen=keep)  # first, count, stamp
        self._count = 0

    def add(self, received: Received) -> None:
        """Note a chunk."""
        self._chunks.append((self._count, len(received.data), received.stamp))
        self._count += len(received.data)

    def at(self, offset: int, baud: int | None) -> float:
        """Arrival time of byte `offset` (counted from the stream's start), s."""
        for first, count, stamp in reversed(self._chunks):
            if first <= offset:
                late = (first + count - 1 - offset) * (10.0 / baud if baud else 0.0)
                return stamp - late
        return self._chunks[0][2]
