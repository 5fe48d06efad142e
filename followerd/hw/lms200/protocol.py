"""LMS2xx telegrams on the wire: framing, checksum, decoder (SICK telegram listing 8007954).

    STX | address | LEN lo, hi | payload: command, data, [status] | CRC lo, hi

LEN counts the payload. A device sets bit 7 of the address, ends its payload with a status byte,
and acknowledges a request by a bare ACK or NAK byte before it answers.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum

STX = 0x02
FROM_DEVICE = 0x80  # bit of the address
LONGEST_PAYLOAD = 813  # bytes: 401 values as a mean sub-range with real-time indices
HEADER = 4  # bytes before the payload
OVERHEAD = 6  # bytes around the payload

# Payload lengths of a device's telegrams by their first byte (telegrams.Reply has the names);
# where real devices are known to differ, or may, the shortest and the longest.
LENGTHS = {
    0x90: (2, 66),
    0x91: (2, 2),
    0x92: (2, 2),
    0xA0: (3, 3),
    0xB0: (4, 808),
    0xB1: (148, 154),
    0xB2: (2, 514),
    0xB6: (5, 809),
    0xB7: (8, 812),
    0xBA: (2, 66),
    0xBB: (7, 7),
    0xBF: (9, 813),
    0xF4: (9, 36),
    0xF7: (10, 37),
}
COUNT_AT = {0xB0: 1, 0xB6: 2, 0xB7: 5, 0xBF: 6}  # where a scan's payload has its count word
COUNT_MASK = 0x03FF


class Acknowledgement(IntEnum):
    """A bare byte: the request came through, or did not; neither means that it was obeyed."""

    ACK = 0x06
    NAK = 0x15


MARKS = re.compile(rb"[\x02\x06\x15]")

# x**(15 * 2**k) = x**(2**k) + 1 modulo x**15 + x + 1: bits from there upwards fold down
FOLDS = [(15 << k, 1 << k) for k in range(6, -1, -1)]
FACTOR = 0x8003  # x**15 + x + 1


def checksum(data: bytes) -> int:
    """CRC of STX to the payload's last byte.

    The device shifts its register by one bit a byte and adds the byte with its predecessor before
    it. So the checksum is, over GF(2), the sum of b x**(d - 1) (x + x**8) over the bytes b at a
    distance d from the last, plus the last, modulo x**16 + x**15 + x**2 + 1; that is (x + 1) times
    FACTOR. Every eighth byte makes one long number: a telegram takes microseconds.

    One bit a byte makes it weak: two flips a byte and a bit apart cancel, and of the random bursts
    over L bytes, 2 <= L <= 9, a share of 2**-(7 + L) passes. What comes through must still be
    plausible (see spikes).
    """
    before = data[-2::-1]
    total = 0
    for shift in range(8):
        total ^= int.from_bytes(before[shift::8], "little") << shift
    crc = total << 1 ^ total << 8 ^ data[-1]
    is_odd = crc.bit_count() & 1  # the remainder modulo x + 1
    for above, step in FOLDS:
        while high := crc >> above:
            crc ^= high << above ^ high ^ high << step
    return crc if crc.bit_count() & 1 == is_odd else crc ^ FACTOR


@dataclass(frozen=True, slots=True)
class Telegram:
    """One frame; its first byte stood at `offset` of the stream it was decoded from."""

    address: int
    payload: bytes
    offset: int = field(default=0, compare=False)

    def __post_init__(self) -> None:
        if not 1 <= len(self.payload) <= LONGEST_PAYLOAD:
            raise ValueError(f"a payload has 1 to {LONGEST_PAYLOAD} bytes, not {len(self.payload)}")

    @property
    def command(self) -> int:
        """First byte of the payload; an answer has the request's with bit 7 set."""
        return self.payload[0]

    @property
    def is_from_device(self) -> bool:
        """Whether a device sent it."""
        return bool(self.address & FROM_DEVICE)

    @property
    def data(self) -> bytes:
        """The payload without command and status."""
        return self.payload[1:-1] if self.is_from_device else self.payload[1:]

    @property
    def status(self) -> int:
        """The status byte of a device's telegram."""
        return self.payload[-1]

    def to_bytes(self) -> bytes:
        """The frame."""
        header = bytes((STX, self.address)) + len(self.payload).to_bytes(2, "little")
        body = header + self.payload
        return body + checksum(body).to_bytes(2, "little")


def with_checksum(telegram: bytes) -> bytes:
    """A whole telegram, damaged on purpose, with the checksum that its bytes now have."""
    return telegram[:-2] + checksum(telegram[:-2]).to_bytes(2, "little")


Event = Telegram | Acknowledgement


class TelegramDecoder:
    """Bytes in, telegrams and acknowledgements out. Line noise is counted, never raised.

    It hears a device (`from_device`) or a host. A telegram is believed for its length and CRC
    alone: its marks occur in measured values too. Behind a broken frame it hunts on from the
    frame's second byte, so that no whole telegram is lost.
    """

    def __init__(self, *, from_device: bool = True) -> None:
        self.noise_bytes = 0
        self.rejected_frames = 0
        self._direction = FROM_DEVICE if from_device else 0
        self._buffer = bytearray()
        self._start = 0  # offset of the buffer's first byte in the stream
        self._needed = 1  # bytes in the buffer before there is anything to decide

    @property
    def is_midway(self) -> bool:
        """Whether a frame seems begun and not finished."""
        return bool(self._buffer)

    @property
    def pending(self) -> int:
        """Bytes here of the frame that seems begun."""
        return len(self._buffer)

    def beginnings(self, since: int, count: int) -> Iterator[tuple[int, bytes]]:
        """Offsets in the stream from `since` on where a frame may begin, with its first bytes.

        As far as `count` of them are here. A frame that lost bytes holds the next one's beginning
        long before it is known to be bad.
        """
        last = len(self._buffer) - count
        at = self._buffer.find(STX, max(0, since - self._start))
        while 0 <= at <= last:
            yield self._start + at, bytes(self._buffer[at : at + count])
            at = self._buffer.find(STX, at + 1)

    @property
    def missing(self) -> int:
        """Bytes, at least 1, before there can be anything new."""
        return self._needed - len(self._buffer)

    def feed(self, data: bytes) -> list[Event]:
        """What was completed by `data`, in order."""
        self._buffer += data
        return [] if len(self._buffer) < self._needed else self._decode(more_to_come=True)

    def give_up(self) -> list[Event]:
        """The line is silent: what stands behind a frame that will never be finished."""
        return self._decode(more_to_come=False)

    def _decode(self, *, more_to_come: bool) -> list[Event]:
        events: list[Event] = []
        buffer = self._buffer
        at, self._needed = 0, 1
        while at < len(buffer):
            if buffer[at] == STX:
                end = self._end_of_frame(at)
                if end > len(buffer) and more_to_come:
                    self._needed = end - at
                    break
                if at < end <= len(buffer):
                    frame = bytes(buffer[at:end])
                    if checksum(frame[:-2]) == int.from_bytes(frame[-2:], "little"):
                        events.append(Telegram(frame[1], frame[4:-2], self._start + at))
                        at = end
                        continue
                    self.rejected_frames += 1
            elif buffer[at] in (Acknowledgement.ACK, Acknowledgement.NAK):
                events.append(Acknowledgement(buffer[at]))
                at += 1
                continue
            mark = MARKS.search(buffer, at + 1)
            following = len(buffer) if mark is None else mark.start()
            self.noise_bytes += following - at
            at = following
        del buffer[:at]
        self._start += at
        return events

    def _end_of_frame(self, at: int) -> int:
        """Where the frame that begins at `at` ends, as far as is known; `at` if none begins."""
        head = self._buffer[at : at + HEADER + 1]
        if len(head) < 2:
            return at + 2
        if head[1] & FROM_DEVICE != self._direction:
            return at
        if len(head) <= HEADER:
            return at + HEADER + 1
        length, command = head[2] | head[3] << 8, head[HEADER]
        shortest, longest = (
            LENGTHS.get(command, (1, 0)) if self._direction else (1, LONGEST_PAYLOAD)
        )
        if not shortest <= length <= longest:
            return at
        if self._direction and command in COUNT_AT:
            end = at + HEADER + COUNT_AT[command] + 2
            if len(self._buffer) < end:
                return end
            count = (self._buffer[end - 2] | self._buffer[end - 1] << 8) & COUNT_MASK
            if length - shortest - 2 * count not in (0, 2):  # without, with indices
                return at
        return at + length + OVERHEAD
