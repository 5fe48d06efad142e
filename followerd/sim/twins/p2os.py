"""A Pioneer's controller, simulated down to its bytes: sans-I/O, moved by bytes and by time.

States: waiting for SYNC0, SYNC1, SYNC2 in turn; connected (no SIPs yet); open (a SIP each cycle).
It keeps the firmware's dangerous habit: after 2 s without a valid command it stops but keeps its
setpoints, and any valid command, even a PULSE, sends it on its way again. (P2OS, AROS and ARCOS
manuals; where they differ or are silent, as two independent clients and a server behave.)
"""

from dataclasses import replace
from math import inf, radians

import numpy as np

from followerd.hw.p2os.commands import BAUDS, FORBIDDEN, Cmd, Request, split_bytes
from followerd.hw.p2os.config import Identity
from followerd.hw.p2os.models import MODELS
from followerd.hw.p2os.packets import ResetNote, SerAux
from followerd.hw.p2os.protocol import PacketDecoder, checksum, frame
from followerd.hw.p2os.sip import Tail
from followerd.sim.interfaces import Body, Twin
from followerd.sim.twins.p2os_aux import AuxPort
from followerd.sim.twins.p2os_chassis import TICK, Chassis
from followerd.sim.twins.p2os_status import Status, flash_parameters

EPSILON = 1e-9  # s
HOSTBAUD_TRIAL = 0.5  # s for a valid command at a new rate, else back to the flash rate
BOOT = 1.5  # s from power to the first answer
COUNT_MAX = 204  # of what follows the count byte; longer commands are ignored
TTY: dict[int, int] = {Cmd.TTY2: 1, Cmd.TTY3: 2, Cmd.TTY4: 3}  # AUX ports
GETAUX: dict[int, int] = {Cmd.GETAUX: 1, Cmd.GETAUX2: 2, Cmd.GETAUX3: 3}
AUXBAUD: dict[int, int] = {Cmd.AUX1BAUD: 1, Cmd.AUX2BAUD: 2, Cmd.AUX3BAUD: 3}
MOTIONS = (
    *(Cmd.VEL, Cmd.MOVE, Cmd.RVEL, Cmd.ROTATE, Cmd.HEAD, Cmd.DHEAD, Cmd.DCHEAD, Cmd.VEL2),
    *(Cmd.STOP, Cmd.E_STOP, Cmd.QSTOP),
)


class P2osTwin:
    """The robot's controller; `body` is what it moves."""

    def __init__(
        self,
        body: Body,
        rng: np.random.Generator,
        *,
        model: str = "p3dx-sh",
        name: str = "followerd_twin",
        tail: Tail = Tail.STATE_OF_CHARGE,
        watchdog: float = 2.0,  # s
        sip_cycle: float = 0.1,  # s
        host_baud: int = 9600,  # in flash
        auto_baud: int = 2,
        has_gyro: int = 0,
        answers_config: bool = True,
        config_checksum_is_wrong: bool = False,
        aux_baud: int = 9600,  # in flash
        queues_getaux: bool = False,  # whether a new GETAUX leaves a pending one standing
    ) -> None:
        self.faults: list[str] = []  # commands that must never be sent to a robot
        self.status = Status(body, rng, MODELS[model], tail)
        self.chassis = Chassis(body, MODELS[model])
        self._model = MODELS[model]
        self._identity = Identity(name, "Pioneer", model)
        self._watchdog = watchdog
        self._sip_cycle = sip_cycle
        self._flash_baud = host_baud
        self._auto_baud = auto_baud
        self._has_gyro = has_gyro
        self._answers_config = answers_config
        self._config_checksum_is_wrong = config_checksum_is_wrong
        self._aux = {port: AuxPort(aux_baud, rng, queues_getaux) for port in (1, 2, 3)}
        self._decoder = PacketDecoder()
        self._out = bytearray()
        self._stop_button = False
        self._next_sip = inf
        self._line_free = 0.0  # s, when everything said so far has left
        self._awake_from = 0.0  # s, end of booting
        self._baud_trial_ends = inf
        self.is_held = False  # by the watchdog
        self.is_connected = False
        self._disconnect()

    # What the line calls

    def receive(self, data: bytes, now: float) -> None:
        """Bytes from the host."""
        self._advance(now)
        if now < self._awake_from:
            return
        for packet in self._decoder.feed(data):
            if len(packet.payload) + 2 <= COUNT_MAX:
                self._obey(Request.parse(packet.payload))

    def step(self, now: float) -> bytes:
        """Move on to `now`; the bytes that start to leave."""
        self._advance(now)
        if self._baud_trial_ends <= now + EPSILON:
            self.baud, self._baud_trial_ends = self._flash_baud, inf
        for port in self._aux.values():
            port.advance(now)
        if self._next_sip <= now + EPSILON:
            if self._line_free > now + EPSILON:
                self._next_sip = self._line_free
            else:
                self._next_sip = max(self._next_sip + self._sip_cycle, now + 2 * EPSILON)
                self._report(now)
        data = bytes(self._out)
        self._out.clear()
        self._line_free = max(self._line_free, now) + 10 * len(data) / self.baud
        return data

    def wake_at(self) -> float:
        """When `step` is due next."""
        now = self.chassis.time
        if self._out:
            return now
        due = min(self._next_sip, self._baud_trial_ends)
        for port in self._aux.values():
            if port.device is not None:
                due = min(due, port.wake_at())
        if self.is_connected and not self.is_held:
            due = min(due, self._last_command + self._watchdog)
        return due if self.chassis.is_steady(self.is_held) else min(due, now + TICK)

    # What happens to the robot

    def attach_aux(self, twin: Twin, port: int = 1) -> None:
        """Plug a simulated device into an AUX port."""
        self._aux[port].device = twin

    def reboot(self, now: float, note: int | None = None) -> None:
        """Power cycle or reset: all is forgotten, and for BOOT seconds it is silent and deaf.

        `note` is the packet type with which a running session is told.
        """
        self._advance(now)
        self.drop_session()
        self.chassis.reset_odometry()
        self._decoder = PacketDecoder()
        self._awake_from = now + BOOT
        if note is not None:
            self._send(ResetNote(note).to_payload())

    def drop_session(self) -> None:
        """Forget the client without a word."""
        self._disconnect()
        self._out.clear()

    def press_stop_button(self, pressed: bool) -> None:
        """The STOP button: cuts the motors while E_STALL is on."""
        self._stop_button = self.status.stop_button = pressed
        if pressed and self._e_stall:
            self.chassis.set_motors(False)

    def press_motors_button(self) -> None:
        """The MOTORS button toggles the motors' power."""
        self.chassis.set_motors(not self.chassis.motors)

    # The session

    @property
    def is_open(self) -> bool:
        """Whether SIPs flow."""
        return self._next_sip < inf

    def _disconnect(self) -> None:
        self.baud, self._baud_trial_ends = self._flash_baud, inf
        self.chassis.reset_motion()
        self.status.reset()
        self.is_connected = self.is_held = False
        self._expected_sync = 0
        self._last_command = 0.0
        self._next_sip = inf
        self._e_stall = True
        for port in self._aux.values():
            port.reset()

    def _obey(self, request: Request) -> None:
        if not self.is_connected:
            self._synchronise(request.number)
            return
        self._last_command = self.chassis.time
        self.is_held = False
        self._baud_trial_ends = inf
        if request.number in FORBIDDEN:
            self.faults.append(f"command {request.number}")
        elif request.number in MOTIONS:
            self._set_motion(request)
        else:
            self._serve(request)

    def _synchronise(self, number: int) -> None:
        if number not in (0, self._expected_sync):
            if self._expected_sync:
                self._expected_sync = 0
                self._send(ResetNote(0xFF).to_payload())
        elif number < Cmd.CLOSE:
            self._expected_sync = number + 1
            self._send(bytes([number]))
        else:
            self.is_connected, self._last_command = True, self.chassis.time
            self._send(self._identity.to_payload())

    def _serve(self, request: Request) -> None:
        value = request.integer
        match request.number:
            case Cmd.OPEN if not self.is_open:
                self._next_sip = self.chassis.time + self._sip_cycle
                self.status.open(self.chassis.time)
            case Cmd.CLOSE:
                self._disconnect()
            case Cmd.ENABLE:
                self.chassis.set_motors(bool(value) and not (self._stop_button and self._e_stall))
            case Cmd.SETO:
                self.chassis.reset_odometry()
            case Cmd.SETV | Cmd.SETA | Cmd.SETRV | Cmd.SETRA:
                self.chassis.motion.limits.set(request.number, value)
            case Cmd.SONAR:
                self.status.sonar_on = bool(value & 1)
            case Cmd.POLLING:
                self.status.sonar_on = bool(request.string)
            case Cmd.SONARCYCLE:
                self.status.sonar_cycle = min(max(value, 2), 120) / 1000
            case Cmd.BUMPSTALL:
                self.chassis.bump_stall = value
            case Cmd.E_STALL:
                self._e_stall = bool(value)
            case Cmd.CONFIG if self._answers_config:
                self._send_config()
            case Cmd.HOSTBAUD if 0 <= value < len(BAUDS):
                self.baud = BAUDS[value]
                self._baud_trial_ends = self.chassis.time + HOSTBAUD_TRIAL
            case Cmd.ENCODER | Cmd.IOREQUEST | Cmd.GYRO | Cmd.JOYREQUEST:
                self.status.streams[request.number] = value
            case number if number in TTY:
                self._aux[TTY[number]].write(request.string, self.chassis.time)
            case number if number in GETAUX:
                self._aux[GETAUX[number]].fetch(value)
            case number if number in AUXBAUD and 0 <= value < len(BAUDS):
                self._aux[AUXBAUD[number]].baud = BAUDS[value]

    # Motion

    def _advance(self, now: float) -> None:
        while now > self.chassis.time:
            if self.chassis.is_steady(self.is_held):
                self.chassis.roll(now)
            else:
                self.chassis.advance(min(now, self.chassis.time + TICK), self.is_held)
            expires = self._last_command + self._watchdog - EPSILON
            if self.is_connected and self.chassis.time >= expires:
                self.is_held = True

    def _set_motion(self, request: Request) -> None:
        if not self.chassis.motors:
            return
        motion, value = self.chassis.motion, request.integer
        match request.number:
            case Cmd.VEL:
                motion.set_speed(value / 1000)
            case Cmd.MOVE:
                motion.move_to(self.chassis.path + value / 1000)
            case Cmd.RVEL | Cmd.ROTATE:
                motion.set_turn(radians(value))
            case Cmd.HEAD:
                motion.turn_to(radians(value))
            case Cmd.DHEAD | Cmd.DCHEAD:  # to the control point, as SIPs report it
                goal = motion.heading_goal
                motion.turn_to(radians(value) + (self.chassis.heading if goal is None else goal))
            case Cmd.VEL2:
                left, right = split_bytes(value)
                unit = self._model.vel2_step / 1000
                motion.set_wheels(left * unit, right * unit)
            case Cmd.STOP:
                motion.clear()
            case _:
                motion.brake()

    # What it says

    def _send(self, payload: bytes) -> None:
        self._out += frame(payload)

    def _report(self, now: float) -> None:
        """One cycle's packets; what AUX devices said goes last, as far as the line carries it."""
        capacity = self.baud * self._sip_cycle / 10
        said = self.status.packets(self.chassis, now, capacity)
        for number, port in self._aux.items():
            if data := port.answer():
                packet = frame(SerAux(number, data).to_payload())
                if len(said) + len(packet) <= capacity:
                    said += packet
                    port.taken()
        self._out += said

    def _send_config(self) -> None:
        flash = flash_parameters(
            self._identity, self._sip_cycle, self._watchdog, self._flash_baud, self._auto_baud
        )
        payload = replace(flash, has_gyro=self._has_gyro).to_payload()
        packet = frame(payload)
        if self._config_checksum_is_wrong:
            wrong = checksum(payload) ^ 0x0101
            packet = packet[:-2] + wrong.to_bytes(2, "big")
        self._out += packet
