"""Who the robot is: its answer to SYNC2, and its flash parameters (CONFIGpac).

The order of the CONFIGpac is confirmed by a capture from a P3DX-SH.
"""

import struct
from dataclasses import dataclass, field, fields
from typing import Any, Self

SYNC2_REPLY = 0x02
CONFIG = 0x20


def _split_strings(data: bytes, count: int) -> tuple[list[str], bytes] | None:
    """`count` NUL-terminated strings and the rest; None when there are fewer."""
    parts = data.split(b"\0", count)
    if len(parts) <= count:
        return None
    return [part.decode("latin-1") for part in parts[:count]], parts[count]


@dataclass(frozen=True, slots=True)
class Identity:
    """The answer to SYNC2: who the robot is."""

    name: str
    robot_class: str
    subclass: str

    def __str__(self) -> str:
        return f"{self.name} / {self.robot_class} / {self.subclass}"

    def to_payload(self) -> bytes:
        """The packet's payload."""
        names = (self.name, self.robot_class, self.subclass)
        return bytes([SYNC2_REPLY]) + b"".join(name.encode("latin-1") + b"\0" for name in names)

    @classmethod
    def parse(cls, payload: bytes) -> Self | None:
        """From a SYNC2 reply."""
        strings = _split_strings(payload[1:], 3)
        return None if strings is None else cls(*strings[0])


def _wire(code: str) -> Any:
    """A CONFIGpac field: `s` string, else the struct code of a little-endian integer."""
    return field(default="" if code == "s" else 0, metadata={"code": code})


@dataclass(frozen=True, slots=True)
class Config:
    """CONFIGpac: the robot's flash parameters, in the order sent; a firmware may stop anywhere."""

    robot_class: str = _wire("s")
    subclass: str = _wire("s")
    serial: str = _wire("s")
    four_motors: int = _wire("B")
    rot_vel_top: int = _wire("H")  # deg/s
    trans_vel_top: int = _wire("H")  # mm/s
    rot_acc_top: int = _wire("H")  # deg/s²
    trans_acc_top: int = _wire("H")  # mm/s²
    pwm_max: int = _wire("H")
    name: str = _wire("s")
    sip_cycle: int = _wire("B")  # ms
    host_baud: int = _wire("B")  # HOSTBAUD code
    aux1_baud: int = _wire("B")
    has_gripper: int = _wire("H")
    front_sonar: int = _wire("H")
    rear_sonar: int = _wire("B")
    low_battery: int = _wire("H")  # dV
    rev_count: int = _wire("H")
    watchdog: int = _wire("H")  # ms
    p2_mpacs: int = _wire("B")
    stall_val: int = _wire("H")  # PWM
    stall_count: int = _wire("H")  # ms
    joy_vel: int = _wire("H")  # mm/s
    joy_rot_vel: int = _wire("H")  # deg/s
    rot_vel_max: int = _wire("H")  # deg/s
    trans_vel_max: int = _wire("H")  # mm/s
    rot_acc: int = _wire("H")  # deg/s²
    rot_decel: int = _wire("H")  # deg/s²
    rot_kp: int = _wire("H")
    rot_kv: int = _wire("H")
    rot_ki: int = _wire("H")
    trans_acc: int = _wire("H")  # mm/s²
    trans_decel: int = _wire("H")  # mm/s²
    trans_kp: int = _wire("H")
    trans_kv: int = _wire("H")
    trans_ki: int = _wire("H")
    front_bumps: int = _wire("B")
    rear_bumps: int = _wire("B")
    charger: int = _wire("B")
    sonar_cycle: int = _wire("B")  # ms
    auto_baud: int = _wire("B")  # 1 can change, 2 autobaud
    has_gyro: int = _wire("B")  # 1 raw to the client, 2 handled by the controller
    drift_factor: int = _wire("h")  # 8192ths
    aux2_baud: int = _wire("B")
    aux3_baud: int = _wire("B")
    ticks_mm: int = _wire("H")
    shutdown_volts: int = _wire("H")  # dV
    firmware: str = _wire("s")
    gyro_cw: int = _wire("H")
    gyro_ccw: int = _wire("H")
    kinematics_delay: int = _wire("B")
    lat_vel_top: int = _wire("H")  # mm/s
    lat_acc_top: int = _wire("H")
    lat_vel_max: int = _wire("H")
    lat_acc: int = _wire("H")
    lat_decel: int = _wire("H")
    charge_threshold: int = _wire("H")
    pdb_port: int = _wire("B")
    gyro_rate_limit: int = _wire("H")
    high_temperature: int = _wire("B")
    power_bits: int = _wire("H")
    battery_type: int = _wire("B")
    soc_low: int = _wire("H")
    soc_shutdown: int = _wire("H")
    bootloader: str = _wire("s")
    flags: int = _wire("I")
    gyro_firmware: int = _wire("h")

    def to_payload(self) -> bytes:
        """The packet's payload, all fields."""
        parts = [bytes([CONFIG])]
        for entry in fields(self):
            value, code = getattr(self, entry.name), entry.metadata["code"]
            parts.append(
                value.encode("latin-1") + b"\0" if code == "s" else struct.pack("<" + code, value)
            )
        return b"".join(parts)

    @classmethod
    def parse(cls, payload: bytes) -> Self:
        """What the payload holds; missing fields are 0 or empty."""
        values: dict[str, Any] = {}
        rest = payload[1:]
        for entry in fields(cls):
            code = entry.metadata["code"]
            if code == "s":
                strings = _split_strings(rest, 1)
                if strings is None:
                    break
                (values[entry.name],), rest = strings
            else:
                size = struct.calcsize("<" + code)
                if len(rest) < size:
                    break
                (values[entry.name],) = struct.unpack_from("<" + code, rest)
                rest = rest[size:]
        return cls(**values)

    @property
    def is_believable(self) -> bool:
        """Whether names are text and the figures everything depends on are possible."""
        names = (self.robot_class, self.subclass, self.name)
        return (
            all(text.isascii() and text.isprintable() for text in (*names, self.serial))
            and all(len(text) <= 20 for text in names)
            and bool(self.robot_class and self.subclass)
            and 10 <= self.rot_vel_top <= 10_000
            and 50 <= self.trans_vel_top <= 10_000
            and 20 <= self.sip_cycle <= 200
            and 100 <= self.watchdog <= 20_000
        )


def is_config_with_wrong_checksum(payload: bytes) -> bool:
    """Whether a payload that fails its checksum is nevertheless a CONFIGpac.

    On real P3DX-SH and Seekur Jr its checksum is always wrong.
    """
    return payload[0] == CONFIG and Config.parse(payload).is_believable
