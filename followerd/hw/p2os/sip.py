"""The standard server information packet (SIP), sent every cycle once servers are open.

Fields are the wire's: millimetres or encoder-dependent units, 4096 angle units a turn, decivolts.
The tail after DIGOUT grew with the firmware: each field there may be missing, from the end.
(ARCOS manual, table of the standard SIP; tails as several firmwares send them.)
"""

import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Any, Self

STOPPED, MOVING = 0x32, 0x33
TYPES = range(0x30, 0x40)  # 0x3S, S = motor state
WRAP = 1 << 15  # XPOS and YPOS count modulo this

_HEAD = struct.Struct("<BHHhhhBBBhHBB")  # type .. sonar count
_READING = struct.Struct("<BH")
_PORTS = struct.Struct("<BBBBB")
_TAIL = struct.Struct("<HbhHhbbII")  # BATTERYX10 .. FLAGS3
_TAIL_ENDS = (2, 3, 5, 7, 9, 10, 11, 15, 19)  # where each of its fields ends
_TAIL_BLANK = (0, -1, 0, 0, 0, -127, 0, 0, 0)


class Flags(IntFlag):
    """FLAGS of AROS and ARCOS; early P2OS sends a pulse width there."""

    MOTORS = 1 << 0
    SONAR_1 = 1 << 1
    SONAR_2 = 1 << 2
    SONAR_3 = 1 << 3
    SONAR_4 = 1 << 4
    STOP_BUTTON = 1 << 5
    E_STALL = 1 << 6
    FAR_LEDGE = 1 << 7
    NEAR_LEDGE = 1 << 8
    JOYSTICK_BUTTON = 1 << 9
    POWER_GOOD = 1 << 10


class Tail(IntEnum):
    """How many fields follow DIGOUT; the variants met on real robots."""

    P2OS = 0
    BATTERY_X10 = 1
    CHARGE_STATE = 2
    FAULT_FLAGS = 4
    STATE_OF_CHARGE = 7
    FLAGS_3 = 9


@dataclass(frozen=True, slots=True)
class Sip:
    """One standard SIP."""

    type: int = STOPPED
    x_raw: int = 0  # × DistConv mm; 15 significant bits
    y_raw: int = 0
    heading_raw: int = 0  # 4096ths of a turn
    left: int = 0  # mm/s × VelConv
    right: int = 0  # mm/s × VelConv
    battery: int = 0  # dV, saturates at 255
    stall_left: bool = False
    stall_right: bool = False
    bumpers_rear: int = 0  # bit mask, bit 0 = first bumper
    bumpers_front: int = 0
    control_raw: int = 0  # heading setpoint, 4096ths of a turn
    flags: int = 0  # see Flags
    compass: int = 0  # 2 deg, 0 = none
    sonar: tuple[tuple[int, int], ...] = ()  # (disc, range × RangeConv mm), new ones only
    gripper: int = 0
    analog_port: int = 0
    analog: int = 0  # 0-255 = 0-5 V
    digital_in: int = 0
    digital_out: int = 0
    tail: int = Tail.P2OS  # how many of the fields below the packet has
    battery_x10: int = 0  # dV
    charge_state: int = -1  # -1 unknown
    rotation_x10: int = 0  # deg/s × 10
    fault_flags: int = 0
    lateral: int = 0  # mm/s
    temperature: int = -127  # deg C, -127 = none
    state_of_charge: int = 0  # %, 0 = not known
    timestamp_us: int = 0
    flags_3: int = 0

    def to_payload(self) -> bytes:
        """The packet's payload."""
        head = _HEAD.pack(
            self.type,
            self.x_raw,
            self.y_raw,
            self.heading_raw,
            self.left,
            self.right,
            self.battery,
            self.stall_left | self.bumpers_rear << 1,
            self.stall_right | self.bumpers_front << 1,
            self.control_raw,
            self.flags,
            self.compass,
            len(self.sonar),
        )
        readings = b"".join(_READING.pack(disc, distance) for disc, distance in self.sonar)
        ports = _PORTS.pack(
            self.gripper, self.analog_port, self.analog, self.digital_in, self.digital_out
        )
        tail = _TAIL.pack(
            self.battery_x10,
            self.charge_state,
            self.rotation_x10,
            self.fault_flags,
            self.lateral,
            self.temperature,
            self.state_of_charge,
            self.timestamp_us,
            self.flags_3,
        )
        return head + readings + ports + tail[: (0, *_TAIL_ENDS)[self.tail]]

    @classmethod
    def parse(cls, payload: bytes) -> Self | None:
        """The SIP of a payload; None when it is too short for what it announces."""
        if len(payload) < _HEAD.size:
            return None
        head = _HEAD.unpack_from(payload)
        count = head[12]
        ports_at = _HEAD.size + _READING.size * count
        tail_at = ports_at + _PORTS.size
        if head[0] not in TYPES or len(payload) < tail_at:
            return None
        extra = payload[tail_at:]
        fields = sum(end <= len(extra) for end in _TAIL_ENDS)
        known = _TAIL.unpack((extra + bytes(_TAIL.size))[: _TAIL.size])[:fields]
        stall_low, stall_high = head[7], head[8]
        values: tuple[Any, ...] = (
            *head[:7],
            bool(stall_low & 1),
            bool(stall_high & 1),
            stall_low >> 1,
            stall_high >> 1,
            *head[9:12],
            tuple(_READING.iter_unpack(payload[_HEAD.size : ports_at])),
            *_PORTS.unpack_from(payload, ports_at),
            fields,
            *known,
            *_TAIL_BLANK[fields:],
        )
        return cls(*values)

    @property
    def volts(self) -> float:
        """Battery voltage, V; the finer field where there is one."""
        return (self.battery_x10 if self.tail >= Tail.BATTERY_X10 else self.battery) / 10.0
