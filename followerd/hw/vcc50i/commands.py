"""What can be said to the camera: commands, status bits, and its units.

Angles are steps of 0.1125° from the home position, pan positive to the *right*, tilt positive
upward; outside this package angles are rad, pan positive to the left, tilt positive upward (as
`geometry.Camera.elevation`). Zoom positions run from wide (0) to tele.
"""

from enum import IntEnum, IntFlag
from math import exp, log, radians

from followerd.hw.vcc50i.protocol import Request, digits, number

STEP = radians(0.1125)  # rad
ORIGIN = 0x8000  # how a step count of 0 is sent
ZOOM_TELE = 0x7A8  # zoom position
ZOOM_RATIO = 26.0  # focal length at tele over wide


class Cmd(IntEnum):
    """Command numbers that the driver or the twin knows; the parameters are in the comments."""

    PAN_SPEED = 0x50  # 3 digits, steps/s
    TILT_SPEED = 0x51
    SPEED = 0x52  # 0 pan, 1 tilt: as set
    RUN = 0x53  # 0 stop, 1 right, 2 left, 3 up, 4 down
    HOME = 0x57
    INITIALISE = 0x58  # 0: then home, 1: then back
    SPEED_LIMITS = 0x59  # 0, 1 pan slowest, fastest; 2, 3 tilt
    ANGLE_LIMITS = 0x5C  # 0, 1 pan smallest, largest; 2, 3 tilt
    MOVE = 0x62  # pan, tilt: 4 digits each
    POSITION = 0x63
    RANGE = 0x64  # 0 pan, 1 tilt; smallest, largest: 4 digits each
    STATUS = 0x86  # nothing: 3 digits; 0: 5 digits
    NAME = 0x87
    CONTROL = 0x90  # 0 by the host, 1 by the remote control
    POWER = 0xA0  # 0 off, 1 on
    FOCUS = 0xA1  # 0 automatic, 1 by hand
    ZOOM_RUN = 0xA2  # 0 stop
    ZOOM_RATIO = 0xAB
    ZOOM = 0xB3  # 4 digits
    ZOOM_POSITION = 0xB4  # 0 now, 3 tele end


class Status(IntFlag):
    """Bits of the operation status."""

    MENU = 1 << 19
    LOCAL = 1 << 18  # under the remote control's control
    TILTING = 1 << 11
    TILT_LIMIT = 1 << 10
    PANNING = 1 << 9
    PAN_LIMIT = 1 << 8
    ZOOMING = 1 << 7
    REMOTE_OFF = 1 << 6
    CAMERA_OFF = 1 << 5
    NOT_INITIALISED = 1 << 4
    SHUTTER_1 = 1 << 3
    SHUTTER_2 = 1 << 2
    MANUAL_FOCUS = 1 << 1
    FOCUSING = 1 << 0


TURNING = Status.PANNING | Status.TILTING
STATUS_DIGITS, POSITION_DIGITS, ZOOM_DIGITS = 3, 8, 4  # of the answers
KNOWN_STATUS = (1 << 12) - 1  # the bits of the short answer

STATUS = Request(Cmd.STATUS)
POSITION = Request(Cmd.POSITION)
ZOOM_POSITION = Request(Cmd.ZOOM_POSITION, b"0")
STOP = Request(Cmd.RUN, b"0")
RIGHTWARD = Request(Cmd.RUN, b"1")
LEFTWARD = Request(Cmd.RUN, b"2")
STOP_ZOOM = Request(Cmd.ZOOM_RUN, b"0")
HOST_CONTROL = Request(Cmd.CONTROL, b"0")
REMOTE_CONTROL = Request(Cmd.CONTROL, b"1")
POWER_ON = Request(Cmd.POWER, b"1")
POWER_OFF = Request(Cmd.POWER, b"0")
INITIALISE = Request(Cmd.INITIALISE, b"0")


def move(pan: int, tilt: int) -> Request:
    """Turn to step counts, at the speeds set."""
    return Request(Cmd.MOVE, digits(ORIGIN + pan, 4) + digits(ORIGIN + tilt, 4))


def zoom(position: int) -> Request:
    """Zoom to a position."""
    return Request(Cmd.ZOOM, digits(position, 4))


def pan_speed(steps: int) -> Request:
    """Pan at so many steps/s from now on."""
    return Request(Cmd.PAN_SPEED, digits(steps, 3))


def tilt_speed(steps: int) -> Request:
    """Tilt at so many steps/s from now on."""
    return Request(Cmd.TILT_SPEED, digits(steps, 3))


def tilt_range(lowest: int, highest: int) -> Request:
    """Let it tilt so far, in steps; after power-on it is ±30°."""
    return Request(Cmd.RANGE, b"1" + digits(ORIGIN + lowest, 4) + digits(ORIGIN + highest, 4))


def position_data(pan: int, tilt: int) -> bytes:
    """The answer to POSITION."""
    return digits(ORIGIN + pan, 4) + digits(ORIGIN + tilt, 4)


def position_of(data: bytes) -> tuple[int, int] | None:
    """Pan and tilt steps in the answer to POSITION; None when it is none."""
    value = number(data)
    if value is None or len(data) != POSITION_DIGITS:
        return None
    return (value >> 16) - ORIGIN, (value & 0xFFFF) - ORIGIN


def pan_steps(angle: float) -> int:
    """Steps of a pan angle (rad, left positive)."""
    return round(-angle / STEP)


def tilt_steps(angle: float) -> int:
    """Steps of a tilt angle (rad, up positive)."""
    return round(angle / STEP)


def pan_angle(steps: float) -> float:
    """Pan angle (rad, left positive) of steps."""
    return -steps * STEP


def tilt_angle(steps: float) -> float:
    """Tilt angle (rad, up positive) of steps."""
    return steps * STEP


def zoom_position(factor: float, tele: int = ZOOM_TELE, ratio: float = ZOOM_RATIO) -> int:
    """Position of a focal length `factor` times that at wide, 1 to `ratio` (else its end).

    No source says how the focal length grows with the position; equal ratios at equal steps fit
    the ends and no data in between.
    """
    return round(tele * log(min(max(factor, 1.0), ratio)) / log(ratio))


def zoom_factor(position: float, tele: int = ZOOM_TELE, ratio: float = ZOOM_RATIO) -> float:
    """Focal length at a zoom position over that at wide (inverse of `zoom_position`)."""
    return exp(log(ratio) * position / tele)
