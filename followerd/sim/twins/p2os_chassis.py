"""Wheels, encoders and motor stages of the simulated robot, between its controller and the body."""

from math import cos, inf, sin

from followerd.geometry import wrap_angle
from followerd.hw.p2os.models import Model
from followerd.sim.interfaces import Body
from followerd.sim.twins.p2os_motion import MotionController, MotionLimits

TICK = 0.01  # s, of the motion profile
STALL_AFTER = 0.1  # s that a driven wheel is held before the motors relax
STALL_COUNT = 0.2  # s that they relax
FRONT, REAR = 1, 2  # BUMPSTALL bits


class Chassis:
    """Moves the body along the profile, counts odometry, stalls. Time moves it, in ticks."""

    def __init__(self, body: Body, model: Model) -> None:
        self.time = 0.0  # s, moved on to
        self.motion = MotionController(MotionLimits(), model.half_track)
        self.motors = False
        self.bump_stall = FRONT | REAR
        self.wheel_stall = (False, False)  # left, right
        self.x = self.y = self.heading = 0.0  # m, rad: the controller's odometry
        self.path = 0.0  # m, mean of both wheels
        self.ticks = [0.0, 0.0]  # m, of each wheel
        self._body = body
        self._half_track = model.half_track
        self._travel = body.wheel_travel
        self._stalled_until = 0.0
        self._blocked_since = inf

    def reset_motion(self) -> None:
        """Motors off, limits and setpoints as in flash; the wheels roll out."""
        speeds = self.motion.v, self.motion.omega
        self.motion = MotionController(MotionLimits(), self._half_track)
        self.motion.v, self.motion.omega = speeds
        self.motors = False

    def reset_odometry(self) -> None:
        """SETO."""
        self.x = self.y = self.heading = 0.0

    def set_motors(self, on: bool) -> None:
        """Power the motors or not; a change leaves zero setpoints."""
        if on != self.motors:
            self.motion.clear()
        self.motors = on

    def is_steady(self, held: bool) -> bool:
        """Whether nothing changes by itself until the next command."""
        stalls = self._blocked_since < inf or self.wheel_stall != (False, False)
        return not stalls and self.motion.is_steady(held or not self.motors)

    def advance(self, now: float, held: bool) -> None:
        """Move on to `now`, at most one TICK; `held` by the watchdog: stop, keep the setpoints."""
        dt, self.time = now - self.time, now
        self._body.advance(now)
        self._integrate()
        self.motion.advance(dt, self.path, self.heading, held or not self.motors, self.motors)
        self._check_stall()
        self._check_bumpers()
        self._body.drive(*self.motion.wheels())

    def roll(self, now: float) -> None:
        """Move on to `now` with the speeds as they are."""
        self.time = now
        self._body.advance(now)
        self._integrate()
        if self.motion.v or self.motion.omega:
            self._check_stall()
            self._check_bumpers()
            self._body.drive(*self.motion.wheels())

    def wheel_speeds(self) -> tuple[float, float]:
        """What the encoders say (left, right), m/s."""
        left, right = self.motion.wheels()
        held_left, held_right = self._body.blocked
        return 0.0 if held_left else left, 0.0 if held_right else right

    def _integrate(self) -> None:
        left, right = self._body.wheel_travel
        d_left, d_right = left - self._travel[0], right - self._travel[1]
        if d_left == 0.0 and d_right == 0.0:
            return
        self._travel = (left, right)
        path, turn = (d_left + d_right) / 2, (d_right - d_left) / 2 / self._half_track
        middle = self.heading + turn / 2
        self.x += path * cos(middle)
        self.y += path * sin(middle)
        self.heading = wrap_angle(self.heading + turn)
        self.path += path
        self.ticks[0] += d_left
        self.ticks[1] += d_right

    def _check_stall(self) -> None:
        if self.time < self._stalled_until:
            self.motion.relax()
            return
        left, right = self.motion.wheels()
        held_left, held_right = self._body.blocked
        pushes = (held_left and left != 0.0, held_right and right != 0.0)
        self.wheel_stall = (False, False)
        if pushes == (False, False):
            self._blocked_since = inf
        elif self._blocked_since == inf:
            self._blocked_since = self.time
        elif self.time - self._blocked_since >= STALL_AFTER:
            self._blocked_since = inf
            self._stalled_until = self.time + STALL_COUNT
            self.wheel_stall = pushes
            self.motion.relax()

    def _check_bumpers(self) -> None:
        front, rear = self._body.bumpers
        wanted = self.motion.v
        if (front and wanted > 0 and self.bump_stall & FRONT) or (
            rear and wanted < 0 and self.bump_stall & REAR
        ):
            self.motion.v = 0.0
