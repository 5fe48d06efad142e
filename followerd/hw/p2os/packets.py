"""What the robot sends once servers are open: any packet as its value.

`parse` turns any payload into its value; types that are not known here, and payloads shorter than
they must be, come back as they are. (ARCOS manual.)
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from followerd.hw.p2os.config import CONFIG, Config
from followerd.hw.p2os.sip import TYPES as SIP_TYPES
from followerd.hw.p2os.sip import Sip

ENCODERS, GYRO, IO, JOYSTICK, GRIPPER, BATTERY = 0x90, 0x98, 0xF0, 0xF8, 0xE0, 0xFA
SERAUX = {0xB0: 1, 0xB8: 2, 0xC8: 3}  # packet type -> AUX port
RESET_NOTES = (0xFF, 0xFE)  # the controller lost count or was reset

NOTE_MAX = 4  # bytes of a reset note's payload
GYRO_MEAN = 512  # ADC counts at rest, nominal


@dataclass(frozen=True, slots=True)
class Encoders:
    """ENCODERpac: accumulated ticks."""

    left: int
    right: int

    def to_payload(self) -> bytes:
        """The packet's payload."""
        return struct.pack("<Bii", ENCODERS, self.left, self.right)

    @classmethod
    def parse(cls, payload: bytes) -> Self | None:
        """From an ENCODERpac."""
        return cls(*struct.unpack_from("<ii", payload, 1)) if len(payload) >= 9 else None


@dataclass(frozen=True, slots=True)
class Gyro:
    """GYROpac: samples every 25 ms, sent just before the SIP."""

    samples: tuple[tuple[int, int], ...]  # (rate 0-1023, temperature)

    def rates(self, mean: float = GYRO_MEAN, scale: float = 1.626) -> tuple[float, ...]:
        """Turn rates in deg/s, left positive, about the resting value `mean`."""
        return tuple(-(rate - mean) * 5 / 1023 * 300 / 2.5 * scale for rate, _ in self.samples)

    def to_payload(self) -> bytes:
        """The packet's payload."""
        samples = b"".join(struct.pack("<HB", *sample) for sample in self.samples)
        return bytes([GYRO, len(self.samples)]) + samples

    @classmethod
    def parse(cls, payload: bytes) -> Self | None:
        """From a GYROpac."""
        if len(payload) < 2 or len(payload) < 2 + 3 * payload[1]:
            return None
        return cls(tuple(struct.iter_unpack("<HB", payload[2 : 2 + 3 * payload[1]])))


@dataclass(frozen=True, slots=True)
class Io:
    """IOpac: digital inputs and outputs as bytes, analog inputs 0-1023 = 0-5 V."""

    digital_in: bytes
    digital_out: bytes
    analog: tuple[int, ...]

    def to_payload(self) -> bytes:
        """The packet's payload."""
        return (
            bytes([IO, len(self.digital_in)])
            + self.digital_in
            + bytes([len(self.digital_out)])
            + self.digital_out
            + struct.pack(f"<B{len(self.analog)}H", len(self.analog), *self.analog)
        )

    @classmethod
    def parse(cls, payload: bytes) -> Self | None:
        """From an IOpac."""
        groups: list[bytes] = []
        rest = payload[1:]
        for size in (1, 1, 2):
            if not rest or len(rest) < 1 + size * rest[0]:
                return None
            end = 1 + size * rest[0]
            groups.append(rest[1:end])
            rest = rest[end:]
        analog = struct.unpack(f"<{len(groups[2]) // 2}H", groups[2])
        return cls(groups[0], groups[1], analog)


@dataclass(frozen=True, slots=True)
class Joystick:
    """JOYSTICKpac: axes 0-1023, 0 = full left and full back."""

    button_1: int
    button_2: int
    x: int
    y: int
    throttle: int

    def to_payload(self) -> bytes:
        """The packet's payload."""
        values = (self.button_1, self.button_2, self.x, self.y, self.throttle)
        return struct.pack("<BBBHHH", JOYSTICK, *values)

    @classmethod
    def parse(cls, payload: bytes) -> Self | None:
        """From a JOYSTICKpac."""
        return cls(*struct.unpack_from("<BBHHH", payload, 1)) if len(payload) >= 9 else None


@dataclass(frozen=True, slots=True)
class GripperState:
    """GRIPPERpac."""

    kind: int  # 0 none, 1 user IO, 2 general IO
    state: int
    grasp_time: int

    def to_payload(self) -> bytes:
        """The packet's payload."""
        return bytes([GRIPPER, self.kind, self.state, self.grasp_time])

    @classmethod
    def parse(cls, payload: bytes) -> Self | None:
        """From a GRIPPERpac."""
        return cls(*payload[1:4]) if len(payload) >= 4 else None


@dataclass(frozen=True, slots=True)
class Battery:
    """BATTERYpac: one record of raw bytes per battery."""

    records: tuple[bytes, ...]

    def to_payload(self) -> bytes:
        """The packet's payload; records are of one size."""
        size = len(self.records[0]) if self.records else 0
        return bytes([BATTERY, len(self.records), size]) + b"".join(self.records)

    @classmethod
    def parse(cls, payload: bytes) -> Self | None:
        """From a BATTERYpac."""
        if len(payload) < 3 or len(payload) < 3 + payload[1] * payload[2]:
            return None
        count, size = payload[1], payload[2]
        return cls(tuple(payload[3 + i * size : 3 + (i + 1) * size] for i in range(count)))


@dataclass(frozen=True, slots=True)
class SerAux:
    """SERAUXpac: bytes that a device on an AUX port sent."""

    port: int  # 1, 2 or 3
    data: bytes

    def to_payload(self) -> bytes:
        """The packet's payload."""
        kind = next(kind for kind, port in SERAUX.items() if port == self.port)
        return bytes([kind]) + self.data

    @classmethod
    def parse(cls, payload: bytes) -> Self:
        """From a SERAUXpac, 2 or 3."""
        return cls(SERAUX[payload[0]], payload[1:])


@dataclass(frozen=True, slots=True)
class ResetNote:
    """The controller was reset, or lost the sync count."""

    type: int

    def to_payload(self) -> bytes:
        """The packet's payload."""
        return bytes([self.type])

    @classmethod
    def parse(cls, payload: bytes) -> Self | None:
        """From a short packet of type FF or FE; a long one is a damaged one of another type."""
        return cls(payload[0]) if len(payload) <= NOTE_MAX else None


Value = Sip | Config | Encoders | Gyro | Io | Joystick | GripperState | Battery | SerAux | ResetNote

_PARSERS: dict[int, Callable[[bytes], Value | None]] = {
    **dict.fromkeys(SIP_TYPES, Sip.parse),
    CONFIG: Config.parse,
    ENCODERS: Encoders.parse,
    GYRO: Gyro.parse,
    IO: Io.parse,
    JOYSTICK: Joystick.parse,
    GRIPPER: GripperState.parse,
    BATTERY: Battery.parse,
    **dict.fromkeys(SERAUX, SerAux.parse),
    **dict.fromkeys(RESET_NOTES, ResetNote.parse),
}


def parse(payload: bytes) -> Value | bytes:
    """The value of a robot's payload; the payload itself when its type or length is not known."""
    parser = _PARSERS.get(payload[0])
    value = None if parser is None else parser(payload)
    return payload if value is None else value
