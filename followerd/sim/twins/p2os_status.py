"""What the simulated robot reports each cycle: its SIP and the extended packets around it."""

from math import degrees, pi

import numpy as np

from followerd.hw.p2os.commands import BAUDS, Cmd
from followerd.hw.p2os.config import Config, Identity
from followerd.hw.p2os.models import Model
from followerd.hw.p2os.packets import GYRO_MEAN, Encoders, Gyro, Io, Joystick
from followerd.hw.p2os.protocol import frame
from followerd.hw.p2os.sip import MOVING, STOPPED, WRAP, Flags, Sip, Tail
from followerd.sim.interfaces import Body
from followerd.sim.twins.p2os_chassis import Chassis

ARRAY = 8  # sonar discs that take turns
SONAR_NOISE = 0.01  # relative
NO_ECHO = 5.0  # m
TICKS = 128_000  # encoder ticks per m
GYRO_COUNTS = 1023 * 2.5 / (5 * 300 * 1.626)  # per deg/s
GYRO_SAMPLES = 4  # per cycle
IDLE_INPUTS = 0xFF


class Status:
    """Builds the packets of one cycle."""

    def __init__(self, body: Body, rng: np.random.Generator, model: Model, tail: Tail) -> None:
        self.battery = 12.4  # V
        self.stop_button = False
        self._body = body
        self._rng = rng
        self._model = model
        self._tail = tail
        self.reset()

    def reset(self) -> None:
        """As after power-up: nothing asked for, sonar on."""
        self.sonar_on = True
        self.sonar_cycle = 0.04  # s
        self.streams: dict[int, int] = {}  # request number -> 1 once, 2 stream
        self._fired = 0  # sonar firings so far
        self._sonar_time = 0.0  # s, of the last firing

    def open(self, now: float) -> None:
        """The sonar servers start."""
        self._sonar_time = now

    def packets(self, chassis: Chassis, now: float, capacity: float) -> bytes:
        """The bytes of one cycle; extended packets only as `capacity` (bytes) allows."""
        sip = frame(self._sip(chassis, now).to_payload())
        left = capacity - len(sip)
        before, after = b"", b""
        for number, build in (
            (Cmd.GYRO, self._gyro),
            (Cmd.JOYREQUEST, self._joystick),
            (Cmd.IOREQUEST, self._io),
            (Cmd.ENCODER, self._encoders),
        ):
            if not self.streams.get(number):
                continue
            packet = frame(build(chassis))
            if len(packet) > left:
                continue
            left -= len(packet)
            if number in (Cmd.GYRO, Cmd.JOYREQUEST):
                before += packet
            else:
                after += packet
            if self.streams[number] == 1 and number != Cmd.GYRO:
                del self.streams[number]
        return before + sip + after

    def _sip(self, chassis: Chassis, now: float) -> Sip:
        left, right = (round(1000 * v / self._model.velocity) for v in chassis.wheel_speeds())
        unit = 1000 / self._model.distance
        goal = chassis.motion.heading_goal
        stall_left, stall_right = chassis.wheel_stall
        front, rear = self._body.bumpers
        flags = Flags(0)
        if chassis.motors:
            flags |= Flags.MOTORS
        if self.sonar_on:
            flags |= Flags.SONAR_1 | Flags.SONAR_2
        if self.stop_button:
            flags |= Flags.STOP_BUTTON
        return Sip(
            type=MOVING if left or right else STOPPED,
            x_raw=round(chassis.x * unit) % WRAP,
            y_raw=round(chassis.y * unit) % WRAP,
            heading_raw=self._angle(chassis.heading),
            left=left,
            right=right,
            battery=min(round(10 * self.battery), 255),
            stall_left=stall_left or self.stop_button,
            stall_right=stall_right or self.stop_button,
            bumpers_front=front & 0x7F,
            bumpers_rear=rear & 0x7F,
            control_raw=0 if goal is None else self._angle(goal),
            flags=flags,
            sonar=self._sonar(now),
            digital_in=IDLE_INPUTS,
            tail=self._tail,
            battery_x10=round(10 * self.battery),
            charge_state=0,
            rotation_x10=round(10 * degrees(chassis.motion.omega)),
        )

    def _angle(self, angle: float) -> int:
        return round(angle * self._model.angle_units / (2 * pi))

    def _sonar(self, now: float) -> tuple[tuple[int, int], ...]:
        """The discs fired since the last SIP, one of each array per sonar cycle."""
        firings = int((now - self._sonar_time) / self.sonar_cycle + 1e-6)
        self._sonar_time += firings * self.sonar_cycle
        first, self._fired = self._fired, self._fired + firings
        if not self.sonar_on:
            return ()
        fired = [
            (disc, pose)
            for firing in range(max(first, self._fired - ARRAY), self._fired)
            for disc in range(firing % ARRAY, self._model.discs, ARRAY)
            if (pose := self._model.base_from_disc(disc)) is not None
        ]
        ranges = self._body.sonar([pose for _, pose in fired])
        return tuple(
            (disc, self._range(true)) for (disc, _), true in zip(fired, ranges, strict=True)
        )

    def _range(self, true: float) -> int:
        measured = min(true * (1 + SONAR_NOISE * self._rng.standard_normal()), NO_ECHO)
        return round(1000 * (NO_ECHO if true >= NO_ECHO else measured) / self._model.range)

    def _gyro(self, chassis: Chassis) -> bytes:
        noise = self._rng.standard_normal(GYRO_SAMPLES)
        rate = GYRO_MEAN - degrees(chassis.motion.omega) * GYRO_COUNTS
        counts = (min(max(round(rate + n), 0), 1023) for n in noise)
        return Gyro(tuple((count, 25) for count in counts)).to_payload()

    def _joystick(self, chassis: Chassis) -> bytes:
        del chassis  # the stick is untouched
        return Joystick(0, 0, 512, 512, 0).to_payload()

    def _io(self, chassis: Chassis) -> bytes:
        del chassis  # nothing is wired to the user ports
        level = round(self.battery / 20 * 1023)
        return Io(bytes([IDLE_INPUTS] * 4), bytes(2), (*(0,) * 8, level)).to_payload()

    def _encoders(self, chassis: Chassis) -> bytes:
        left, right = (_signed_32(round(TICKS * path)) for path in chassis.ticks)
        return Encoders(left, right).to_payload()


def _signed_32(value: int) -> int:
    return (value + 2**31) % 2**32 - 2**31


def flash_parameters(
    identity: Identity, sip_cycle: float, watchdog: float, baud: int, auto_baud: int
) -> Config:
    """CONFIGpac of a robot as it was sold (figures of a P3DX-SH)."""
    return Config(
        robot_class=identity.robot_class,
        subclass=identity.subclass,
        serial="TWIN_0001",
        rot_vel_top=360,
        trans_vel_top=1000,
        rot_acc_top=300,
        trans_acc_top=2000,
        pwm_max=500,
        name=identity.name,
        sip_cycle=round(sip_cycle * 1000),
        host_baud=BAUDS.index(baud),
        front_sonar=1,
        rear_sonar=1,
        low_battery=115,
        rev_count=16570,
        watchdog=round(watchdog * 1000),
        stall_val=200,
        stall_count=200,
        rot_vel_max=100,
        trans_vel_max=750,
        rot_acc=100,
        rot_decel=100,
        trans_acc=300,
        trans_decel=300,
        front_bumps=5,
        rear_bumps=5,
        sonar_cycle=40,
        auto_baud=auto_baud,
        ticks_mm=128,
        shutdown_volts=110,
        firmware="3.0",
    )
