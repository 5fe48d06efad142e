"""LMS2xx telegrams on the wire: framing, checksum, decoder (SICK telegram listing 8007954).

    STX | address | LEN lo, hi | payload: command, data, [status] | CRC lo, hi

LEN counts the payload. A device sets bit 7 of the address, ends its payload with a status byte,
and acknowledges a request by a bare ACK or NAK byte before it answers.
"""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import numpy.typing as npt

STX = 0x02
FROM_DEVICE = 0x80  # bit of the address
LONGEST_PAYLOAD = 812  # bytes: 401 values as a sub-range with real-time indices
OVERHEAD = 6  # bytes around the payload


class Acknowledgement(IntEnum):
    """A bare byte: the request came through, or did not; neither means that it was obeyed."""

    ACK = 0x06
    NAK = 0x15


Registers = npt.NDArray[np.uint16]


def _shifted(crc: Registers) -> Registers:
    out: Registers = (crc << np.uint16(1)) ^ np.where(crc >> 15, 0x8005, 0).astype(np.uint16)
    return out


def _contributions(length: int) -> Registers:
    """What a byte adds to the checksum, by its distance from the end: (length, 256).

    The device shifts its register by one bit a byte and adds the byte with its predecessor
    before it; both steps are linear over GF(2), so the checksum is the sum of these.
    """
    byte = np.arange(256, dtype=np.uint16)
    rows: list[Registers] = [byte, _shifted(byte) ^ (byte << np.uint16(8))]
    while len(rows) < length:
        rows.append(_shifted(rows[-1]))
    return np.array(rows)


_TABLE = _contributions(LONGEST_PAYLOAD + 4).ravel()
_ROWS = np.arange(LONGEST_PAYLOAD + 3, -1, -1) * 256


def checksum(data: bytes) -> int:
    """CRC of STX to the payload's last byte (at most 816 bytes).

    One shift a byte makes it weak: two flips a byte and a bit apart cancel, and 1 in 512 random
    replacements of two neighbouring bytes passes. What comes through must still be plausible.
    """
    index = _ROWS[_ROWS.size - len(data) :] + np.frombuffer(data, np.uint8)
    return int(np.bitwise_xor.reduce(_TABLE.take(index)))


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
        self._shortest = 2 if from_device else 1
        self._buffer = bytearray()
        self._start = 0  # offset of the buffer's first byte in the stream
        self._needed = 1  # bytes in the buffer before there is anything to decide

    @property
    def is_midway(self) -> bool:
        """Whether a frame seems begun and not finished."""
        return bool(self._buffer)

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
            self.noise_bytes += 1
            at += 1
        del buffer[:at]
        self._start += at
        return events

    def _end_of_frame(self, at: int) -> int:
        """Where the frame that begins at `at` ends, as far as is known; `at` if none begins."""
        header = self._buffer[at : at + 4]
        if len(header) > 1 and header[1] & FROM_DEVICE != self._direction:
            return at
        if len(header) < 4:
            return at + 4
        length = header[2] | header[3] << 8
        if not self._shortest <= length <= LONGEST_PAYLOAD:
            return at
        return at + length + OVERHEAD
