"""What a client tells the robot: a command number and, with most, one argument.

An integer travels as its magnitude, the type byte carries the sign. Two-byte arguments (VEL2,
DIGOUT, PTUPOS, GRIPPERVAL) are one signed 16-bit integer, high byte first; a receiver applies the
sign before it splits. (ARCOS manual, table of client commands.)
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Self

from followerd.hw.p2os.protocol import frame

POSITIVE, NEGATIVE, STRING = 0x3B, 0x1B, 0x2B  # type byte of the argument


class Cmd(IntEnum):
    """Command numbers under the manuals' names; units are of the argument."""

    PULSE = 0  # SYNC0 while not connected
    OPEN = 1  # SYNC1
    CLOSE = 2  # SYNC2
    POLLING = 3  # string of disc numbers from 1
    ENABLE = 4
    SETA = 5  # mm/s², + acceleration, - deceleration
    SETV = 6  # mm/s
    SETO = 7
    MOVE = 8  # mm
    ROTATE = 9
    SETRV = 10  # deg/s
    VEL = 11  # mm/s
    HEAD = 12  # deg in the robot's own odometry frame
    DHEAD = 13  # deg
    SETRVDIR_ARCOS = 14  # deg/s, + left, - right
    SAY = 15  # string of (20 ms, tone) pairs
    JOYREQUEST = 17
    CONFIG = 18
    ENCODER = 19
    SETRVDIR = 20  # deg/s
    RVEL = 21  # deg/s, + left
    DCHEAD = 22  # deg
    SETRA = 23  # deg/s², + acceleration, - deceleration
    SHUTDOWN = 25
    IMUREQUEST = 26
    SONAR = 28
    STOP = 29
    DIGOUT = 30  # two bytes: mask, states
    VEL2 = 32  # two bytes: left, right, × 20 mm/s
    GRIPPER = 33
    ADSEL = 35
    GRIPPERVAL = 36
    GRIPREQUEST = 37
    GYROCALCW = 38
    GYROCALCCW = 39
    IOREQUEST = 40
    PTUPOS = 41  # two bytes: port, pulse width
    TTY2 = 42  # string for AUX1
    GETAUX = 43  # bytes wanted from AUX1, 0 = flush
    BUMPSTALL = 44  # 0 off, 1 front, 2 rear, 3 both
    TCM2 = 45
    JOYDRIVE = 47
    SONARCYCLE = 48  # ms
    HOSTBAUD = 50  # index into BAUDS
    AUX1BAUD = 51
    AUX2BAUD = 52
    AUX3BAUD = 53
    E_STOP = 55
    E_STALL = 56
    QSTOP = 57
    GYRO = 58
    LCD = 59  # string
    TTY4 = 60  # string for AUX3
    GETAUX3 = 61
    BATTERYINFO = 62
    CALCOMP = 65
    TTY3 = 66  # string for AUX2
    GETAUX2 = 67
    CHARGE = 68
    ROTKP = 82
    ROTKV = 83
    ROTKI = 84
    TRANSKP = 85
    TRANSKV = 86
    TRANSKI = 87
    REVCOUNT = 88
    DRIFTFACTOR = 89
    SOUND = 90
    PLAYLIST = 91
    SOUNDTOG = 92
    TICKSMM = 93
    POWER_PC = 95
    POWER_LRF = 96
    POWER_5V = 97
    POWER_12V = 98
    LATVEL = 110
    LATACCEL = 113
    BATTEST = 250
    RESET = 253
    MAINTENANCE = 255


BAUDS = (9600, 19200, 38400, 57600, 115200)  # by HOSTBAUD code

SYNC0, SYNC1, SYNC2 = Cmd.PULSE, Cmd.OPEN, Cmd.CLOSE

SIMULATOR_ONLY = range(224, 240)
FORBIDDEN = frozenset({Cmd.RESET, Cmd.MAINTENANCE, *SIMULATOR_ONLY})  # never sent to a robot


@dataclass(frozen=True, slots=True)
class Request:
    """A command with its argument."""

    number: int
    argument: int | bytes | None = None

    def to_bytes(self) -> bytes:
        """The whole packet. ValueError when the argument does not fit."""
        return frame(bytes([self.number]) + _encoded(self.argument))

    @classmethod
    def parse(cls, payload: bytes) -> Self:
        """What `payload` asks for. Lenient as the firmware is: a missing or cut argument is None,
        bytes after a counted string are ignored."""
        return cls(payload[0], _decoded(payload[1:]))

    @property
    def integer(self) -> int:
        """The argument as an integer; 0 where there is none."""
        return self.argument if isinstance(self.argument, int) else 0

    @property
    def string(self) -> bytes:
        """The argument as a string; empty where there is none."""
        return self.argument if isinstance(self.argument, bytes) else b""


def command(number: int, argument: int | bytes | None = None) -> bytes:
    """The whole packet of one command."""
    return Request(number, argument).to_bytes()


def join_bytes(high: int, low: int) -> int:
    """A two-byte argument from its bytes (each -128..255), as the signed integer to send."""
    return int.from_bytes([high & 0xFF, low & 0xFF], "big", signed=True)


def split_bytes(value: int) -> tuple[int, int]:
    """The bytes (high, low) of a two-byte argument, each signed."""
    high, low = (value & 0xFFFF).to_bytes(2, "big")
    return high - 256 * (high > 127), low - 256 * (low > 127)


def _encoded(argument: int | bytes | None) -> bytes:
    match argument:
        case None:
            return b""
        case int():
            if abs(argument) > 0xFFFF:
                raise ValueError(f"{argument} does not fit into 16 bits and a sign")
            kind = NEGATIVE if argument < 0 else POSITIVE
            return bytes([kind]) + abs(argument).to_bytes(2, "little")
        case _:
            return bytes([STRING, len(argument)]) + argument


def _decoded(data: bytes) -> int | bytes | None:
    if len(data) < 2:
        return None
    match data[0]:
        case 0x3B:
            return int.from_bytes(data[1:3], "little")
        case 0x1B:
            return -int.from_bytes(data[1:3], "little")
        case 0x2B:
            return data[2 : 2 + data[1]]
        case _:
            return None
