"""Requests to an LMS2xx and its answers, but for the scans: codes and contents of the payloads."""

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import NamedTuple

from followerd.hw.lms200.protocol import FROM_DEVICE, Telegram
from followerd.hw.lms200.variant import Variant

PASSWORD = b"SICK_LMS"  # opens installation mode
POWER_ON_BAUD = 9600


class BadTelegram(ValueError):
    """A telegram whose checksum holds and whose content cannot be."""


class Command(IntEnum):
    """First byte of a host's payload."""

    RESET = 0x10
    MODE = 0x20  # mode [parameters]
    SCAN = 0x30  # 01: one whole scan
    STATUS = 0x31
    ERRORS = 0x32
    TYPE = 0x3A
    VARIANT = 0x3B  # field u16, resolution u16
    READ_CONFIG = 0x74
    WRITE_CONFIG = 0x77  # leading bytes of the configuration


class Reply(IntEnum):
    """First byte of a device's payload: the command's with bit 7, but for a few."""

    POWER_ON = 0x90  # type string, unprompted at the end of booting
    RESET = 0x91
    NOT_ALLOWED = 0x92
    MODE = 0xA0
    SCAN = 0xB0
    STATUS = 0xB1
    ERRORS = 0xB2
    MEAN = 0xB6
    SUBRANGE = 0xB7
    MEAN_SUBRANGE = 0xBF
    TYPE = 0xBA
    VARIANT = 0xBB
    READ_CONFIG = 0xF4
    WRITE_CONFIG = 0xF7


def reply_to(command: int) -> int:
    """Code of the answer to `command`."""
    return Reply.RESET if command == Command.RESET else command | 0x80


class Mode(IntEnum):
    """Parameter of Command.MODE, the line rates apart."""

    INSTALLATION = 0x00  # PASSWORD
    STREAM = 0x24
    ON_REQUEST = 0x25
    STREAM_MEAN = 0x26  # number of scans
    STREAM_SUBRANGE = 0x27  # first u16, last u16, from 1
    STREAM_MEAN_SUBRANGE = 0x28  # number of scans, first u16, last u16
    STREAM_PARTIAL = 0x2A


class ModeResult(IntEnum):
    """Content of Reply.MODE."""

    OK = 0
    REFUSED = 1
    FAULT = 2


BAUD_CODES = {38400: 0x40, 19200: 0x41, 9600: 0x42, 500000: 0x48}  # parameter of Command.MODE
BAUD_WORDS = {9600: 0x8067, 19200: 0x8033, 38400: 0x8019, 500000: 0x8001}  # in the status report

HEALTHY = 0x10  # status byte of an LMS200 without complaint
SEVERITY = 0x07
WARNING, ERROR, FATAL = 2, 3, 4  # severities
SOURCE = 0x18  # constant in a device: 0x10 an LMS of this kind, 0x18 a special one
IMPLAUSIBLE = 0x40
POLLUTED = 0x80


def is_usable(status: int) -> bool:
    """Whether scans may be used that come with this status byte."""
    return status & SEVERITY < ERROR and not status & IMPLAUSIBLE


def is_degraded(status: int) -> bool:
    """Whether the device warns: dirty window, or a warning."""
    return bool(status & POLLUTED) or status & SEVERITY == WARNING


def request(command: int, data: bytes = b"", address: int = 0) -> Telegram:
    """A host's telegram; address 0 is any device."""
    return Telegram(address, bytes((command,)) + data)


def answer(reply: int, data: bytes = b"", status: int = HEALTHY, address: int = 0) -> Telegram:
    """The telegram of the device with this address."""
    return Telegram(FROM_DEVICE | address, bytes((reply,)) + data + bytes((status,)))


_VARIANT = Struct("<HH")
_VARIANT_ANSWER = Struct("<BHH")


def variant_data(variant: Variant) -> bytes:
    """Content of Command.VARIANT."""
    return _VARIANT.pack(variant.field, variant.resolution)


def variant_of(data: bytes) -> Variant:
    """The variant that Command.VARIANT asks for."""
    if len(data) != _VARIANT.size:
        raise BadTelegram(f"a variant has 4 bytes, not {len(data)}")
    return Variant(*_VARIANT.unpack(data))


class VariantAnswer(NamedTuple):
    """Content of Reply.VARIANT."""

    done: bool
    in_force: Variant

    def to_data(self) -> bytes:
        """The content."""
        return _VARIANT_ANSWER.pack(self.done, self.in_force.field, self.in_force.resolution)

    @classmethod
    def from_data(cls, data: bytes) -> "VariantAnswer":
        """Raises BadTelegram."""
        if len(data) != _VARIANT_ANSWER.size:
            raise BadTelegram(f"a variant answer has 5 bytes, not {len(data)}")
        done, field, resolution = _VARIANT_ANSWER.unpack(data)
        return cls(done == 1, Variant(field, resolution))


class ErrorEntry(NamedTuple):
    """One entry of Reply.ERRORS."""

    severity: int  # as in the status byte
    number: int


def errors_of(data: bytes) -> tuple[ErrorEntry, ...]:
    """The entries of Reply.ERRORS."""
    return tuple(ErrorEntry(*pair) for pair in zip(data[::2], data[1::2], strict=False))


def errors_data(entries: tuple[ErrorEntry, ...]) -> bytes:
    """Content of Reply.ERRORS."""
    return bytes(value for entry in entries for value in entry)


CONFIG_BYTES = 34
INDICES_BIT = 2  # of the availability


@dataclass(frozen=True, slots=True)
class Config:
    """The 34 configuration bytes kept in EEPROM; those without a name here are left as they are."""

    raw: bytes

    def __post_init__(self) -> None:
        if len(self.raw) != CONFIG_BYTES:
            raise BadTelegram(f"a configuration has {CONFIG_BYTES} bytes, not {len(self.raw)}")

    @property
    def has_indices(self) -> bool:
        """Whether scans end with two real-time indices."""
        return bool(self.raw[4] & INDICES_BIT)

    @property
    def measuring_mode(self) -> int:
        """Which bits of a value are range and which are flags (see scans.RANGE_BITS)."""
        return self.raw[5]

    @property
    def unit(self) -> int:
        """0 cm, 1 mm."""
        return self.raw[6]

    def with_values(self, measuring_mode: int, unit: int) -> "Config":
        """This configuration with another measuring mode and unit."""
        return Config(self.raw[:5] + bytes((measuring_mode, unit)) + self.raw[7:])

    def with_indices(self, wanted: bool) -> "Config":
        """This configuration with or without real-time indices."""
        availability = self.raw[4] & ~INDICES_BIT | wanted * INDICES_BIT
        return Config(self.raw[:4] + bytes((availability,)) + self.raw[5:])

    def overwritten(self, leading: bytes) -> "Config":
        """This configuration with its leading bytes replaced; devices take a short one so."""
        return Config(leading[:CONFIG_BYTES] + self.raw[len(leading) :])


FACTORY_CONFIG = Config(bytes.fromhex("0000460000000100000202").ljust(CONFIG_BYTES, b"\0"))


def written_config(data: bytes) -> tuple[bool, Config]:
    """Content of Reply.WRITE_CONFIG: whether it was done, and the configuration in force."""
    return data[:1] == b"\1", Config(data[1:])


_STATUS = Struct("<7s B B 8x B 8H 8x 8H 8x H 33x B 4x H H B 4x H x B B x B B 7s 22x")
_STATUS_SHORTEST = 146  # a printed variant of the table lacks the last counters


@dataclass(frozen=True, slots=True)
class Status:
    """Content of Reply.STATUS, as far as it is used."""

    firmware: bytes  # ASCII
    mode: int
    defective: bool
    is_special: bool
    pollution: tuple[int, ...]  # 8 channels
    pollution_calibration: tuple[int, ...]  # the same, clean
    revolutions: int  # of the motor
    measuring_mode: int
    variant: Variant
    restart: int
    baud_word: int
    is_baud_permanent: bool  # boots at this rate instead of at 9600
    address: int
    unit: int
    is_laser_off: bool
    boot_prom: bytes  # ASCII

    def to_data(self) -> bytes:
        """The content; reserved and unnamed bytes are zero."""
        return _STATUS.pack(
            self.firmware,
            self.mode,
            self.defective,
            self.is_special,
            *self.pollution,
            *self.pollution_calibration,
            self.revolutions,
            self.measuring_mode,
            self.variant.field,
            self.variant.resolution,
            self.restart,
            self.baud_word,
            self.is_baud_permanent,
            self.address,
            self.unit,
            self.is_laser_off,
            self.boot_prom,
        )

    @classmethod
    def from_data(cls, data: bytes) -> "Status":
        """Raises BadTelegram when it is too short."""
        if len(data) < _STATUS_SHORTEST:
            raise BadTelegram(f"a status report has {_STATUS.size} bytes, not {len(data)}")
        values = _STATUS.unpack(data[: _STATUS.size].ljust(_STATUS.size, b"\0"))
        firmware, mode, defective, special = values[:4]
        revolutions, measuring_mode, field, resolution, restart = values[20:25]
        baud_word, permanent, address, unit, laser_off, boot_prom = values[25:]
        return cls(
            firmware=firmware,
            mode=mode,
            defective=bool(defective),
            is_special=bool(special),
            pollution=values[4:12],
            pollution_calibration=values[12:20],
            revolutions=revolutions,
            measuring_mode=measuring_mode,
            variant=Variant(field, resolution),
            restart=restart,
            baud_word=baud_word,
            is_baud_permanent=bool(permanent),
            address=address,
            unit=unit,
            is_laser_off=bool(laser_off),
            boot_prom=boot_prom,
        )
