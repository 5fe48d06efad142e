"""P2OS framing: FA FB, count, payload, checksum; the same in both directions.

`count` is the payload's length + 2. The checksum covers the payload only and is sent high byte
first; all else is little endian. Nothing is escaped: FA FB may occur inside a payload, so length
and checksum, not the header, say what a packet is. (P2OS, AROS and ARCOS manuals.)
"""

from collections.abc import Callable
from dataclasses import dataclass, field

HEADER = b"\xfa\xfb"
COUNT_MIN, COUNT_MAX = 3, 255  # of what follows the count byte, on reception
PAYLOAD_MAX = 195  # bytes sent; firmware ignores what is longer than 200 in all


def checksum(payload: bytes) -> int:
    """Sum of big-endian byte pairs modulo 65536; an odd last byte is XORed into it."""
    paired = len(payload) & ~1
    total = (sum(payload[0:paired:2]) * 256 + sum(payload[1:paired:2])) & 0xFFFF
    return total ^ payload[-1] if len(payload) & 1 else total


def frame(payload: bytes) -> bytes:
    """The packet that carries `payload` (1 to PAYLOAD_MAX bytes; ValueError otherwise)."""
    if not 1 <= len(payload) <= PAYLOAD_MAX:
        raise ValueError(f"a packet carries 1 to {PAYLOAD_MAX} bytes, not {len(payload)}")
    return HEADER + bytes([len(payload) + 2]) + payload + checksum(payload).to_bytes(2, "big")


def with_checksum(packet: bytes) -> bytes:
    """A damaged packet, or several in a row, with checksums that are right again.

    What stands where a header and its count do not say so is left as it is.
    """
    mended, start = bytearray(packet), 0
    while mended.startswith(HEADER, start) and start + 2 < len(mended):
        end = start + 3 + mended[start + 2]
        if mended[start + 2] < COUNT_MIN or end > len(mended):
            break
        mended[end - 2 : end] = checksum(bytes(mended[start + 3 : end - 2])).to_bytes(2, "big")
        start = end
    return bytes(mended)


@dataclass(frozen=True, slots=True)
class Packet:
    """A payload found on the line: type or command number, then data."""

    payload: bytes
    offset: int = field(default=0, compare=False)  # of its header, counted from the stream's start
    is_intact: bool = True  # False: its checksum is wrong, it was accepted nevertheless

    @property
    def type(self) -> int:
        """First byte: packet type or command number."""
        return self.payload[0]


@dataclass(slots=True)
class LineStats:
    """What the decoder met."""

    packets: int = 0
    rejected: int = 0  # headers without a valid packet behind them
    noise_bytes: int = 0  # bytes that belong to no packet


class PacketDecoder:
    """Bytes in, packets out. No I/O, no clock; noise is counted, never raised.

    `accept_damaged` may let a payload pass although its checksum is wrong: some controllers send
    every CONFIGpac so.
    """

    def __init__(self, accept_damaged: Callable[[bytes], bool] | None = None) -> None:
        self.stats = LineStats()
        self._accept_damaged = accept_damaged
        self._buffer = bytearray()
        self._offset = 0  # of the buffer's first byte in the stream
        self._seam = 0  # bytes of a packet that was incomplete when the line paused

    @property
    def begun(self) -> tuple[int, int] | None:
        """Type, and place in the stream, of a packet whose first bytes are here."""
        if len(self._buffer) <= 3 or self._seam:
            return None
        return self._buffer[3], self._offset

    def feed(self, data: bytes) -> list[Packet]:
        """The packets completed by `data`; however the bytes are split, they are the same."""
        self._buffer += data
        packets: list[Packet] = []
        if self._seam and not self._mend_seam():
            return packets
        while self._align() and (end := self._end(0)) <= len(self._buffer):
            packet = self._packet(0, end)
            if packet is None:
                self.stats.rejected += 1
                self._skip(1)  # a false header: hunt on from the next byte
                continue
            self.stats.packets += 1
            packets.append(packet)
            self._drop(end)
        return packets

    def settle(self) -> list[Packet]:
        """The packets hidden by a false header, to be asked for after a pause on the line.

        A header whose announced bytes do not come holds back what follows it. When a whole packet
        stands there, the header was noise. A packet that is merely late stays, unless what comes
        next begins with a header: then its end is lost, and it must not eat the next one.
        """
        start = self._buffer.find(HEADER, 1)
        while 0 < start < len(self._buffer) - 2:
            end = self._end(start)
            if end <= len(self._buffer) and self._packet(start, end) is not None:
                self.stats.rejected += 1
                self._skip(start)
                self._seam = 0
                packets = self.feed(b"")
                self._seam = len(self._buffer)
                return packets
            start = self._buffer.find(HEADER, start + 1)
        self._seam = len(self._buffer)
        return []

    def _mend_seam(self) -> bool:
        """Look at what came after the pause; False as long as it is too little to tell."""
        after = bytes(self._buffer[self._seam : self._seam + len(HEADER)])
        if after in (b"", HEADER[:1]):
            return False
        if after == HEADER:
            self.stats.rejected += 1
            self._skip(self._seam)
        self._seam = 0
        return True

    def _align(self) -> bool:
        """Drop what cannot begin a packet; whether a header and its count stand in front."""
        while True:
            start = self._buffer.find(HEADER)
            if start < 0:
                start = len(self._buffer) - self._buffer.endswith(HEADER[:1])
            self._skip(start)
            if len(self._buffer) < 3:
                return False
            if self._buffer[2] >= COUNT_MIN:
                return True
            self.stats.rejected += 1
            self._skip(1)

    def _end(self, start: int) -> int:
        """Where the packet whose header stands at `start` ends."""
        return start + 3 + self._buffer[start + 2]

    def _packet(self, start: int, end: int) -> Packet | None:
        """The packet in buffer[start:end], None when it is none."""
        payload = bytes(self._buffer[start + 3 : end - 2])
        if not payload:
            return None
        if checksum(payload) == int.from_bytes(self._buffer[end - 2 : end], "big"):
            return Packet(payload, self._offset + start)
        if self._accept_damaged is not None and self._accept_damaged(payload):
            return Packet(payload, self._offset + start, is_intact=False)
        return None

    def _skip(self, count: int) -> None:
        self.stats.noise_bytes += count
        self._drop(count)

    def _drop(self, count: int) -> None:
        del self._buffer[:count]
        self._offset += count
