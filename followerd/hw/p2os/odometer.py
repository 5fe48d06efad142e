"""From the counters of status packets to a pose that never jumps."""

from math import hypot, pi

from followerd.geometry import Pose2, wrap_angle
from followerd.hw.p2os.models import Model
from followerd.hw.p2os.sip import WRAP, Sip
from followerd.messages import Twist

# A step beyond what the reported wheel speeds explain is a counter that was set, not motion.
SLACK = 0.1  # m
TURN_SLACK = 0.2  # rad
MARGIN = 2.0  # × wheel speed; speeds are momentary, steps are not


class Odometer:
    """Unwraps XPOS, YPOS (15 bits) and THPOS into `odom_from_base`, starting at `start`.

    After `rebase` the next packet is taken as the pose reached so far: at the start of a session,
    and after SETO.
    """

    def __init__(self, model: Model, start: Pose2 | None = None) -> None:
        self.pose = start or Pose2()  # odom_from_base
        self.jumps = 0  # counters found set by someone else
        self._model = model
        self._last: Sip | None = None
        self._last_stamp = 0.0
        self._x = self._y = 0  # unwrapped counters
        self._odom_from_robot = Pose2()

    def rebase(self) -> None:
        """The counters are about to jump."""
        self._last = None

    def heading(self, sip: Sip) -> float:
        """Heading in the robot's own odometry frame, rad."""
        return wrap_angle(sip.heading_raw * 2 * pi / self._model.angle_units)

    def twist(self, sip: Sip) -> Twist:
        """Velocity from the wheel speeds."""
        unit = self._model.velocity
        return Twist(
            v=0.0005 * (sip.left + sip.right) * unit,
            omega=0.5 * (sip.right - sip.left) * unit * self._model.difference,
        )

    def update(self, sip: Sip, stamp: float) -> Pose2:
        """The pose at `stamp`, when `sip` was measured."""
        last = self._last
        if last is not None:
            dx, dy = _step(last.x_raw, sip.x_raw), _step(last.y_raw, sip.y_raw)
            turn = wrap_angle(self.heading(sip) - self.heading(last))
            if self._is_possible(dx, dy, turn, last, sip, stamp - self._last_stamp):
                self._x += dx
                self._y += dy
            else:
                self.jumps += 1
                last = None
        if last is None:
            self._x, self._y = sip.x_raw, sip.y_raw
            self._odom_from_robot = self.pose @ ~self._robot_pose(sip)
        self._last, self._last_stamp = sip, stamp
        self.pose = self._odom_from_robot @ self._robot_pose(sip)
        return self.pose

    def _robot_pose(self, sip: Sip) -> Pose2:
        unit = self._model.distance / 1000
        return Pose2(self._x * unit, self._y * unit, self.heading(sip))

    def _is_possible(self, dx: int, dy: int, turn: float, last: Sip, sip: Sip, dt: float) -> bool:
        fastest = max(abs(speed) for s in (last, sip) for speed in (s.left, s.right))
        reach = MARGIN * 0.001 * self._model.velocity * fastest * max(dt, 0.0)
        step = hypot(dx, dy) * self._model.distance / 1000
        return step <= reach + SLACK and abs(turn) <= reach / self._model.half_track + TURN_SLACK


def _step(old: int, new: int) -> int:
    """The shorter way from `old` to `new` on a counter of 15 bits."""
    return (new - old + WRAP // 2) % WRAP - WRAP // 2
