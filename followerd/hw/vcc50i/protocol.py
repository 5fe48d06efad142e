"""Canon's RS-232 frames: header, device number, content, end mark; no checksum, no escapes.

`FF` begins a command of the host, `FE` an answer, `FA` the note that a command has ended, `FB` the
note of an event. Neither a header nor the end mark `EF` occurs inside a frame, so a damaged frame
never hides the next one; but damage that leaves digits behind cannot be seen here.
(Canon, VC-C50i/VC-C50iR Programmer's Manual, sections 4 to 8.)
"""

import re
from dataclasses import dataclass, field
from enum import IntFlag

COMMAND, ANSWER, NOTE, EVENT = 0xFF, 0xFE, 0xFA, 0xFB
END = 0xEF
DEVICE = b"00"  # the only camera on the line, or all of a cascade
BODY_MIN, BODY_MAX = 4, 32  # bytes between header and end mark; the longest we know has 15
FROM_CAMERA = bytes((ANSWER, NOTE, EVENT))
FROM_HOST = bytes((COMMAND,))
BAUD = 9600  # as delivered


class Errors(IntFlag):
    """Why a command was refused; BUSY stands beside each of the others."""

    MODE = 0x80  # off, not under the host's control, or not initialised
    PARAMETER = 0x40
    COMMAND = 0x20
    BUSY = 0x10
    SYSTEM = 0x01


NO_ERROR = Errors(0)
KNOWN_ERRORS = sum(Errors)


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame found on the line."""

    header: int
    body: bytes
    offset: int = field(default=0, compare=False)  # of its header, counted from the stream's start

    def to_bytes(self) -> bytes:
        """As sent."""
        return bytes((self.header,)) + self.body + bytes((END,))


@dataclass(frozen=True, slots=True)
class Request:
    """A command of the host; the parameters are ASCII, numbers upper-case hexadecimal."""

    command: int
    parameters: bytes = b""

    def to_bytes(self) -> bytes:
        """As sent."""
        number = self.command.to_bytes(2, "big")
        return Frame(COMMAND, DEVICE + number + self.parameters).to_bytes()

    @classmethod
    def parse(cls, frame: Frame) -> "Request | None":
        """The command in a frame to this camera; None when it is none, or for another."""
        body = frame.body
        if frame.header != COMMAND or body[:2] != DEVICE or not body[4:].isascii():
            return None
        return cls(int.from_bytes(body[2:4], "big"), body[4:])


@dataclass(frozen=True, slots=True)
class Answer:
    """What the camera says to a command; it does not say to which."""

    errors: Errors = NO_ERROR
    data: bytes = b""

    def to_bytes(self) -> bytes:
        """As sent."""
        return Frame(ANSWER, DEVICE + digits(self.errors, 2) + self.data).to_bytes()

    @classmethod
    def parse(cls, frame: Frame) -> "Answer | None":
        """The answer in a frame of this camera; None when it is none or damaged."""
        body = frame.body
        errors = number(body[2:4])
        if frame.header != ANSWER or body[:2] != DEVICE or errors is None:
            return None
        data = body[4:]
        is_refusal = errors & Errors.BUSY and not (errors & ~KNOWN_ERRORS or data)
        if not data.isascii() or (errors and not is_refusal):
            return None
        return cls(Errors(errors), data)


def digits(value: int, count: int) -> bytes:
    """`value` in `count` upper-case hexadecimal digits (ValueError when it does not fit)."""
    text = b"%0*X" % (count, value)
    if value < 0 or len(text) != count:
        raise ValueError(f"{value} does not fit into {count} hexadecimal digits")
    return text


def number(text: bytes) -> int | None:
    """The value of upper-case hexadecimal digits; None when there is anything else."""
    return int(text, 16) if re.fullmatch(rb"[0-9A-F]+", text) else None


def well_formed(answer: bytes) -> bytes:
    """A damaged answer as one that says something else: without a checksum its digits must do."""
    if len(answer) < 2 + BODY_MIN:
        return answer
    data = bytes(b"0123456789ABCDEF"[byte & 0xF] for byte in answer[5:-1])
    return Answer(data=data).to_bytes()


@dataclass(slots=True)
class LineStats:
    """What the decoder met."""

    frames: int = 0
    noise_bytes: int = 0  # bytes that belong to no frame


class FrameDecoder:
    """Bytes in, frames out. No I/O, no clock; noise is counted, never raised."""

    def __init__(self, headers: bytes = FROM_CAMERA) -> None:
        self.stats = LineStats()
        first, inner = rb"[%s]" % re.escape(headers), rb"[^\xef\xfa\xfb\xfe\xff]"
        self._whole = re.compile(rb"(%s)(%s{%d,%d})\xef" % (first, inner, BODY_MIN, BODY_MAX))
        self._begun = re.compile(rb"%s%s{0,%d}\Z" % (first, inner, BODY_MAX))
        self._buffer = b""
        self._offset = 0  # of the buffer's first byte in the stream

    def feed(self, data: bytes) -> list[Frame]:
        """The frames completed by `data`; however the bytes are split, they are the same."""
        buffer = self._buffer + data
        frames = [
            Frame(match[1][0], match[2], self._offset + match.start())
            for match in self._whole.finditer(buffer)
        ]
        rest = self._begun.search(buffer, max(0, len(buffer) - BODY_MAX - 1))
        kept = rest.start() if rest else len(buffer)
        self.stats.frames += len(frames)
        self.stats.noise_bytes += kept - sum(len(frame.body) + 2 for frame in frames)
        self._buffer = buffer[kept:]
        self._offset += kept
        return frames
