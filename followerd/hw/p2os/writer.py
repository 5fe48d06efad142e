"""The one writer: every byte to the base of an open session passes here.

The firmware stops a robot that hears nothing for 2 s, keeps its setpoints, and resumes at the next
valid command of any kind. So keep-alive is earned: the gate opens for a command that the guard has
just approved, until that command expires. While it is closed only what stops the robot is written,
until status packets show that it stands; then, and only then, the rest (CONFIG, SETV, ENABLE 1, …).
What is passed on to a device on an AUX port moves nothing: it may also pass while the gate is open.

Pure state: time is an argument, nothing is written by itself.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from math import degrees, inf, isfinite

from followerd.geometry import wrap_angle
from followerd.hw.p2os.commands import Cmd, command, join_bytes
from followerd.messages import Command, TurnBy, Twist, WheelSpeeds, Wish

HALT = command(Cmd.STOP) + command(Cmd.VEL, 0) + command(Cmd.RVEL, 0)
BRAKE = command(Cmd.E_STOP)
MOTORS_OFF = command(Cmd.ENABLE, 0)
# setpoints sent while the motors were off may wait inside the firmware: zero them
MOTORS_ON = command(Cmd.ENABLE, 1) + command(Cmd.VEL, 0) + command(Cmd.RVEL, 0)

setpoint = lru_cache(maxsize=1024)(command)  # the same few for every decision

REPEAT = 0.2  # s, after which an unchanged setpoint, or an unanswered stop, is sent again
STOPS_TO_SETTLE = 2  # a lost stop must not be taken for an obeyed one
REACTION = 0.1  # s after a stop, from which on a status packet shows its effect
BURST = 60  # bytes that may be sent at once
RESERVE = 18  # bytes of them kept for setpoints when something is passed on
FASTEST_LINE = 38400  # baud; beyond, the firmware (a command each 3 to 5 ms) is the limit
EPSILON = 1e-9  # s
COMMAND = 3  # place of a packet's command number


class Channel(Enum):
    """Where a setpoint lives; VEL2 stands alone, the other two combine freely."""

    TRANSLATE = "VEL"
    ROTATE = "RVEL or HEAD"
    WHEELS = "VEL2"


@dataclass(frozen=True, slots=True)
class Caps:
    """What is never exceeded, whatever the command says."""

    speed: float  # m/s
    turn: float  # rad/s
    vel2_step: float  # m/s per unit of VEL2


NOTHING = Caps(0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Status:
    """What the newest status packet says, as far as writing depends on it."""

    stamp: float  # s, first byte
    heading: float  # rad, in the robot's own odometry frame
    standing: bool
    motors: bool


class Writer:
    """Decides what is written when: `due(now)`, at the latest at `wake_at(now)`."""

    def __init__(self, baud: int, caps: Caps = NOTHING) -> None:
        self.caps = caps
        self.set_baud(baud)
        self.served: Command | None = None  # the newest command, when the last `due` completed it
        self._command: Command | None = None  # waits to be served
        self._open_until = -inf  # s; -inf = gate closed
        self._stopped_itself = False  # a command expired, or the motors are off; none came since
        self._wanted: dict[Channel, bytes] = {}
        self._sent: dict[Channel, tuple[bytes, float]] = {}
        self._stop = HALT
        self._braked = False  # an emergency stop is not softened until the gate opens again
        self._stop_due = -inf  # s; inf = the robot is seen standing
        self._stops = 0
        self._last_stop = -inf  # s
        self._shows_from = inf  # s, from when status packets tell whether the stops were heard
        self._urgent = b""
        self._waiting: deque[bytes] = deque()
        self._relayed: deque[bytes] = deque()
        self._status: Status | None = None
        self._tokens = float(BURST)
        self._tokens_at = -inf

    @property
    def is_open(self) -> bool:
        """Whether motion is allowed now."""
        return self._open_until > -inf

    @property
    def is_settled(self) -> bool:
        """Whether the gate is closed and the robot is known to stand with zero setpoints."""
        return self._stop_due == inf

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits for the robot to stand."""
        return not self._waiting

    @property
    def relayed_backlog(self) -> int:
        """Bytes for AUX ports that still wait."""
        return sum(map(len, self._relayed))

    def set_baud(self, baud: int) -> None:
        """Stay under half of this line rate."""
        self._rate = 0.5 * min(baud, FASTEST_LINE) / 10  # bytes/s

    def drive(self, command: Command, now: float) -> None:
        """Take over `command`; the newest overwrites."""
        was_late = self._close_if_expired(now)
        wanted = None if command.motion is None else self._setpoints(command.motion)
        if wanted is None:
            self._close(BRAKE if command.emergency else HALT)
            # what stopped by itself is stopped already: said with the stop's decision
            self._command = command if self._stop_due <= now or self._stopped_itself else None
        elif command.expires > now and self._status is not None and self._status.motors:
            if was_late:
                # the firmware may have stopped meanwhile and would go on with old setpoints
                self._urgent += HALT
            self._open_until, self._stopped_itself = command.expires, False
            self._wanted = wanted
            self._forget_other_mode()
            self._command = command if any(self._changed(wanted)) else None

    def ask(self, number: int, argument: int | bytes | None = None) -> None:
        """Queue any other command until the robot stands with zero setpoints."""
        self._waiting.append(command(number, argument))

    def relay(self, packet: bytes) -> None:
        """Queue commands for an AUX port until the robot may move, or is known to stand."""
        self._relayed.append(packet)

    def motors_on(self) -> None:
        """Queue ENABLE 1, with zero setpoints behind it."""
        self._waiting.append(MOTORS_ON)

    def motors_off(self) -> None:
        """ENABLE 0, at once."""
        self._urgent += MOTORS_OFF

    def note(self, status: Status) -> None:
        """A status packet came."""
        self._status = status
        if self.is_open:
            if not status.motors:
                self._close(HALT)
                self._command, self._stopped_itself = None, True
        elif not status.standing:
            self._stop_due = min(self._stop_due, self._last_stop + REPEAT)
        elif self._stops >= STOPS_TO_SETTLE and status.stamp >= self._shows_from:
            if self._stop is BRAKE:
                # it stands: now the setpoints behind the brake
                self._stop, self._stops, self._stop_due = HALT, 0, -inf
            else:
                self._stop_due = inf

    def due(self, now: float) -> bytes:
        """What is to be written now, possibly nothing. Sets `served`."""
        self._close_if_expired(now)
        self._refill(now)
        data = self._urgent
        self._urgent = b""
        if self.is_open:
            data += self._setpoints_due(now)
            data += self._relayed_due(len(data))
        elif self._stop_due <= now + EPSILON:
            data += self._stop
            self._stops += 1
            if self._stops <= STOPS_TO_SETTLE:
                self._shows_from = now + REACTION
            self._last_stop, self._stop_due = now, now + REPEAT
        elif self.is_settled:
            data += self._waiting_due() or self._relayed_due(0)
        self._tokens -= len(data)
        stopped = self._stopped_itself and self._command is not None
        done = stopped or (bool(data) and not (self.is_open and any(self._changed(self._wanted))))
        self.served = self._command if done else None
        if done:
            self._command = None
            self._stopped_itself = self._stopped_itself and not stopped
        return data

    def wake_at(self, now: float) -> float:
        """When `due` has something to write next, as far as can be said now."""
        if self._urgent:
            return now
        if not self.is_open:
            if self.is_settled and self._waiting:
                return self._affordable_at(len(self._waiting[0]), now)
            if self.is_settled and self._relayed:
                return self._affordable_at(len(self._relayed[0]) + RESERVE, now)
            return max(self._stop_due, now)
        due = self._open_until
        if self._relayed:
            due = min(due, self._affordable_at(len(self._relayed[0]) + RESERVE, now))
        for channel, data in self._wanted.items():
            wanted_at = self._wanted_at(channel, data)
            due = min(due, max(wanted_at, self._affordable_at(len(data), now)))
        return due

    def _close_if_expired(self, now: float) -> bool:
        expired = self.is_open and now >= self._open_until - EPSILON
        if expired:
            self._close(HALT)
            self._command, self._stopped_itself = None, True
        return expired

    def _close(self, stop: bytes) -> None:
        """Shut the gate; an already stopping robot is only stopped harder, never softer."""
        harder = stop is BRAKE and not self._braked and not self.is_settled
        if self.is_open or harder:
            self._stop, self._stops, self._stop_due = stop, 0, -inf
            self._braked = stop is BRAKE
        self._open_until = -inf
        self._wanted.clear()
        self._sent.clear()

    def _setpoints(self, motion: Wish) -> dict[Channel, bytes] | None:
        """The commands of a motion, None when it is no finite one."""
        speed, turn = self.caps.speed, self.caps.turn
        match motion:
            case Twist(v, omega) if isfinite(v) and isfinite(omega):
                return {
                    Channel.TRANSLATE: setpoint(Cmd.VEL, round(1000 * _clipped(v, speed))),
                    Channel.ROTATE: setpoint(Cmd.RVEL, round(degrees(_clipped(omega, turn)))),
                }
            case TurnBy(angle, v, added=True) if isfinite(v) and isfinite(angle):
                return {
                    Channel.TRANSLATE: setpoint(Cmd.VEL, round(1000 * _clipped(v, speed))),
                    Channel.ROTATE: command(Cmd.DHEAD, round(degrees(wrap_angle(angle)))),
                }
            case TurnBy(angle, v) if isfinite(v) and isfinite(angle) and self._status is not None:
                heading = round(degrees(wrap_angle(self._status.heading + angle)))
                return {
                    Channel.TRANSLATE: command(Cmd.VEL, round(1000 * _clipped(v, speed))),
                    Channel.ROTATE: command(Cmd.HEAD, heading),
                }
            case WheelSpeeds(left, right) if isfinite(left) and isfinite(right):
                units = [round(_clipped(w, speed) / self.caps.vel2_step) for w in (left, right)]
                left_byte, right_byte = (int(_clipped(unit, 127)) for unit in units)
                return {Channel.WHEELS: command(Cmd.VEL2, join_bytes(left_byte, right_byte))}
            case _:
                return None

    def _forget_other_mode(self) -> None:
        """The firmware drops the setpoints of one motion mode when it hears the other."""
        if self._sent.keys() - self._wanted.keys():
            self._sent.clear()

    def _wanted_at(self, channel: Channel, data: bytes) -> float:
        """Since when a setpoint should be on the wire (again)."""
        sent = self._sent.get(channel)
        if sent is None or sent[0] != data:
            return -inf
        # said again, a turn that is added would be added again
        return inf if data[COMMAND] == Cmd.DHEAD else sent[1] + REPEAT

    def _changed(self, wanted: dict[Channel, bytes]) -> Iterable[bool]:
        return (self._wanted_at(channel, data) == -inf for channel, data in wanted.items())

    def _setpoints_due(self, now: float) -> bytes:
        """The channels to send, the longest unsent first, as far as the governor allows."""
        out = b""
        oldest_first = sorted(
            self._wanted.items(), key=lambda item: self._sent.get(item[0], (b"", -inf))[1]
        )
        for channel, data in oldest_first:
            if self._wanted_at(channel, data) > now + EPSILON:
                continue
            if not self._affords(len(out) + len(data)):
                break
            self._sent[channel] = (data, now)
            out += data
        return out

    def _waiting_due(self) -> bytes:
        out = b""
        while self._waiting and self._affords(len(out) + min(len(self._waiting[0]), BURST)):
            out += self._waiting.popleft()
        return out

    def _relayed_due(self, before: int) -> bytes:
        """What may be passed on behind `before` bytes of setpoints."""
        out = b""
        while self._relayed and self._affords(
            before + len(out) + min(len(self._relayed[0]) + RESERVE, BURST)
        ):
            out += self._relayed.popleft()
        return out

    def _refill(self, now: float) -> None:
        self._tokens = min(self._tokens + (now - self._tokens_at) * self._rate, BURST)
        self._tokens_at = now

    def _affords(self, count: int) -> bool:
        return self._tokens >= count - EPSILON

    def _affordable_at(self, count: int, now: float) -> float:
        missing = min(count, BURST) - self._tokens
        return max(now, self._tokens_at + missing / self._rate)


def _clipped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
