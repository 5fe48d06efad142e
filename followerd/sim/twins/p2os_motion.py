"""The motion controller inside a P2OS robot: setpoints, limits, trapezoidal profiles.

Two channels, translation and rotation; within a channel the newest command wins at once. Wheel
commands (VEL2) are decomposed into both channels, as ARCOS does. (AROS and ARCOS manuals.)
"""

from dataclasses import dataclass
from math import copysign, inf, radians, sqrt

from followerd.geometry import wrap_angle
from followerd.hw.p2os.commands import Cmd

BRAKE = 5.0  # m/s², E_STOP; the manuals say "very high"
TURN_BRAKE = 15.0  # rad/s²
DRAG = 2.0  # m/s², motors off: gears and idling motors
TURN_DRAG = 6.0  # rad/s²
AT_HEADING = radians(0.2)  # rad, closer than this a turn is done
AT_PLACE = 0.001  # m


@dataclass(slots=True)
class MotionLimits:
    """What SETV, SETA, SETRV and SETRA set, and the flash TOP values that bound them."""

    speed: float = 0.75  # m/s
    acceleration: float = 0.3  # m/s²
    deceleration: float = 0.3  # m/s²
    turn: float = radians(100)  # rad/s
    turn_acceleration: float = radians(100)  # rad/s²
    turn_deceleration: float = radians(100)  # rad/s²
    speed_top: float = 1.0  # m/s
    acceleration_top: float = 2.0  # m/s²
    turn_top: float = radians(360)  # rad/s
    turn_acceleration_top: float = radians(300)  # rad/s²

    def set(self, number: int, value: int) -> None:
        """SETV, SETA, SETRV or SETRA."""
        match number:
            case Cmd.SETV:
                self.speed = min(abs(value) / 1000, self.speed_top)
            case Cmd.SETRV:
                self.turn = min(radians(abs(value)), self.turn_top)
            case Cmd.SETA if value > 0:
                self.acceleration = min(value / 1000, self.acceleration_top)
            case Cmd.SETA if value < 0:
                self.deceleration = min(-value / 1000, self.acceleration_top)
            case Cmd.SETRA if value > 0:
                self.turn_acceleration = min(radians(value), self.turn_acceleration_top)
            case Cmd.SETRA if value < 0:
                self.turn_deceleration = min(radians(-value), self.turn_acceleration_top)


class MotionController:
    """Setpoints and the profile that leads to them; moved by `advance`."""

    def __init__(self, limits: MotionLimits, half_track: float) -> None:
        self.limits = limits
        self.v = 0.0  # m/s, of the profile now
        self.omega = 0.0  # rad/s
        self.heading_goal: float | None = None  # rad, of HEAD and its kin
        self._half_track = half_track
        self._v_goal = 0.0
        self._omega_goal = 0.0
        self._path_goal: float | None = None  # m of path, of MOVE
        self._by_wheels = False
        self._braking = False

    def set_speed(self, v: float) -> None:
        """VEL."""
        self._leave_wheels()
        self._v_goal, self._path_goal = _clipped(v, self.limits.speed), None

    def move_to(self, path: float) -> None:
        """MOVE, as the path length at which to stand."""
        self._leave_wheels()
        self._v_goal, self._path_goal = self.limits.speed, path

    def set_turn(self, omega: float) -> None:
        """RVEL."""
        self._leave_wheels()
        self._omega_goal, self.heading_goal = _clipped(omega, self.limits.turn), None

    def turn_to(self, heading: float) -> None:
        """HEAD, DHEAD, DCHEAD, as an absolute heading; the shorter way round."""
        self._leave_wheels()
        self._omega_goal, self.heading_goal = self.limits.turn, wrap_angle(heading)

    def set_wheels(self, left: float, right: float) -> None:
        """VEL2."""
        self.clear()
        self._by_wheels = True
        self._v_goal = _clipped((left + right) / 2, self.limits.speed)
        self._omega_goal = _clipped((right - left) / 2 / self._half_track, self.limits.turn)

    def clear(self) -> None:
        """STOP: all setpoints zero."""
        self._v_goal = self._omega_goal = 0.0
        self._path_goal = self.heading_goal = None
        self._by_wheels = self._braking = False

    def brake(self) -> None:
        """E_STOP: until the next motion command."""
        self.clear()
        self._braking = True

    def relax(self) -> None:
        """The wheels were stopped from outside; the setpoints stand."""
        self.v = self.omega = 0.0

    def is_steady(self, held: bool) -> bool:
        """Whether the speeds stay as they are until the next command."""
        if held:
            return self.v == 0.0 and self.omega == 0.0
        if self._path_goal is not None or self.heading_goal is not None:
            return False
        return self.v == self._v_goal and self.omega == self._omega_goal

    def advance(self, dt: float, path: float, heading: float, held: bool, powered: bool) -> None:
        """Go on along the profile for `dt`; `held`: towards standstill, setpoints kept."""
        limits = self.limits
        v_goal = 0.0 if held else self._v_wanted(path)
        omega_goal = 0.0 if held else self._omega_wanted(heading, dt)
        if not powered:
            rates = (DRAG, DRAG, TURN_DRAG, TURN_DRAG)
        elif self._braking:
            rates = (BRAKE, BRAKE, TURN_BRAKE, TURN_BRAKE)
        else:
            rates = (
                *(limits.acceleration, limits.deceleration),
                *(limits.turn_acceleration, limits.turn_deceleration),
            )
        self.v = _towards(self.v, v_goal, rates[0] * dt, rates[1] * dt)
        self.omega = _towards(self.omega, omega_goal, rates[2] * dt, rates[3] * dt)

    def wheels(self) -> tuple[float, float]:
        """Wheel surface speeds (left, right) of the profile now, m/s."""
        side = self.omega * self._half_track
        return self.v - side, self.v + side

    def _v_wanted(self, path: float) -> float:
        if self._path_goal is None:
            return self._v_goal
        rest = self._path_goal - path
        if abs(rest) < AT_PLACE:
            return 0.0
        return copysign(min(self._v_goal, sqrt(2 * self.limits.deceleration * abs(rest))), rest)

    def _omega_wanted(self, heading: float, dt: float) -> float:
        if self.heading_goal is None:
            return self._omega_goal
        rest = wrap_angle(self.heading_goal - heading)
        if abs(rest) < AT_HEADING:
            return 0.0
        arrive = sqrt(2 * self.limits.turn_deceleration * abs(rest))
        return copysign(min(self._omega_goal, arrive, abs(rest) / dt if dt else inf), rest)

    def _leave_wheels(self) -> None:
        if self._by_wheels or self._braking:
            self.clear()


def _clipped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _towards(value: float, goal: float, speed_up: float, slow_down: float) -> float:
    grows = abs(goal) > abs(value) and goal * value >= 0
    step = speed_up if grows else slow_down
    return goal if abs(goal - value) <= step else value + copysign(step, goal - value)
