"""From the counters of status packets to a pose that never jumps."""

from math import hypot, pi

from followerd.geometry import Pose2, wrap_angle
from followerd.hw.p2os.models import Model
from followerd.hw.p2os.sip import WRAP, Sip
from followerd.messages import Twist

# A step beyond what the reported wheel speeds explain is a counter that was set, not motion.
SLACK = 0.1  # m
TURN_SLACK = 0.2  # rad
GROWTH = 4.0  # m/s²; a wheel's speed may vanish at once, but not come up faster
SPEED_SLACK = 0.15  # m/s
TURN_GROWTH = 5.3  # rad/s², 300 degrees/s²: robots turn up slower
MARGIN = 2.0  # × wheel speed; speeds are momentary, steps are not


class Odometer:
    """Unwraps XPOS, YPOS (15 bits) and THPOS into `odom_from_base`, starting at `start`.

    After `rebase` the next packet is taken as the pose reached so far: at the start of a session,
    and after SETO. A jump of the counters is a lie, unless the next packet goes on from there.
    """

    def __init__(self, model: Model, start: Pose2 | None = None) -> None:
        self.pose = start or Pose2()  # odom_from_base
        self.jumps = 0  # counters found set by someone else
        self._model = model
        self._last: Sip | None = None
        self._last_stamp = 0.0
        self._odd: Sip | None = None  # the newest packet, if it jumped
        self._odd_stamp = 0.0
        self._x = self._y = 0  # unwrapped counters
        self._odom_from_robot = Pose2()

    def rebase(self) -> None:
        """The counters are about to jump."""
        self._last = self._odd = None

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

    def follows(self, sip: Sip, stamp: float) -> bool:
        """Whether `sip` may be believed: it goes on from the last one, or from a jump."""
        last, odd = self._last, self._odd
        self._odd, self._odd_stamp, odd_stamp = sip, stamp, self._odd_stamp
        if last is None or self._goes_on(last, sip, stamp - self._last_stamp):
            self._odd = None
            return True
        if odd is None or not self._goes_on(odd, sip, stamp - odd_stamp):
            return False
        # the counters were set: it will have gone on as before meanwhile
        twist = self.twist(last)
        self.pose = self.pose.moved(twist.v, twist.omega, stamp - self._last_stamp)
        self.jumps += 1
        self.rebase()
        return True

    def update(self, sip: Sip, stamp: float) -> Pose2:
        """The pose at `stamp`, when `sip` was measured."""
        last = self._last
        if last is not None:
            self._x += _step(last.x_raw, sip.x_raw)
            self._y += _step(last.y_raw, sip.y_raw)
        else:
            self._x, self._y = sip.x_raw, sip.y_raw
            self._odom_from_robot = self.pose @ ~self._robot_pose(sip)
        self._last, self._last_stamp = sip, stamp
        self.pose = self._odom_from_robot @ self._robot_pose(sip)
        return self.pose

    def _robot_pose(self, sip: Sip) -> Pose2:
        unit = self._model.distance / 1000
        return Pose2(self._x * unit, self._y * unit, self.heading(sip))

    def _goes_on(self, last: Sip, sip: Sip, dt: float) -> bool:
        """Whether the wheels can have taken it from `last` to `sip` within `dt`."""
        dx, dy = _step(last.x_raw, sip.x_raw), _step(last.y_raw, sip.y_raw)
        turn = wrap_angle(self.heading(sip) - self.heading(last))
        unit, dt = 0.001 * self._model.velocity, max(dt, 0.0)
        before, now = (unit * max(abs(s.left), abs(s.right)) for s in (last, sip))
        if now > before + GROWTH * dt + SPEED_SLACK:
            return False
        reach = MARGIN * max(before, now) * dt
        step = hypot(dx, dy) * self._model.distance / 1000
        omega = max(abs(self.twist(s).omega) for s in (last, sip))
        turned = (MARGIN * omega + 0.5 * TURN_GROWTH * dt) * dt
        return step <= reach + SLACK and abs(turn) <= turned + TURN_SLACK


def _step(old: int, new: int) -> int:
    """The shorter way from `old` to `new` on a counter of 15 bits."""
    return (new - old + WRAP // 2) % WRAP - WRAP // 2
