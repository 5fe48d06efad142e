"""Where the robot was when something was measured, and where it is now."""

from bisect import bisect_right
from collections import deque
from math import cos, radians, sin

from pydantic import Field

from followerd.geometry import Pose2, wrap_angle
from followerd.messages import Command, Odometry, Twist
from followerd.settings import Settings

STEP = 0.01  # s, of the integration beyond the newest packet
STILL, STILL_TURN = 0.02, 0.05  # m/s, rad/s: slower counts as standing
REST = Twist()
MOST_COMMANDS = 512  # more than are given between two packets


class EgoMotionSettings(Settings):
    """How the base ramps toward a command between its packets."""

    accel_mps2: float = Field(0.5, gt=0, description="ramp of the forward speed")
    turn_accel_degps2: float = Field(100.0, gt=0, description="ramp of the turn rate")
    latency_s: float = Field(0.03, ge=0, le=0.3, description="from a decision to the wheels")
    max_gap_s: float = Field(0.5, gt=0, le=1.0, description="longest time without a packet")
    history_s: float = Field(3.0, gt=0, description="how far back poses are known")


class EgoMotion:
    """`odom_from_base` at any time near now: interpolated, or extrapolated with the command."""

    def __init__(self, settings: EgoMotionSettings | None = None) -> None:
        self.settings = settings or EgoMotionSettings()
        self._packets: deque[Odometry] = deque()
        self._stamps: deque[float] = deque()
        self._commands: deque[Command] = deque(maxlen=MOST_COMMANDS)

    def observe(self, odometry: Odometry) -> None:
        """Take a packet; one that is not newer than the newest is dropped."""
        if self._stamps and odometry.stamp <= self._stamps[-1]:
            return
        self._packets.append(odometry)
        self._stamps.append(odometry.stamp)
        while self._stamps[0] < odometry.stamp - self.settings.history_s:
            self._packets.popleft()
            self._stamps.popleft()
        acting = odometry.stamp - self.settings.latency_s
        while len(self._commands) > 1 and self._commands[1].stamp <= acting:
            self._commands.popleft()

    def commanded(self, command: Command) -> None:
        """Remember what the base was told."""
        self._commands.append(command)

    def pose_at(self, stamp: float) -> Pose2 | None:
        """`odom_from_base` at `stamp`; None where no packet lies within `max_gap_s`."""
        if not self._stamps or stamp < self._stamps[0]:
            return None
        after = bisect_right(self._stamps, stamp)
        if after == len(self._stamps):
            ahead = self._extrapolated(stamp)
            return None if ahead is None else ahead[0]
        a, b = self._packets[after - 1], self._packets[after]
        if b.stamp - a.stamp > self.settings.max_gap_s:
            return None
        share = (stamp - a.stamp) / (b.stamp - a.stamp)
        return Pose2(
            a.pose.x + share * (b.pose.x - a.pose.x),
            a.pose.y + share * (b.pose.y - a.pose.y),
            wrap_angle(a.pose.theta + share * wrap_angle(b.pose.theta - a.pose.theta)),
        )

    def twist_at(self, stamp: float) -> Twist | None:
        """The robot's velocity at `stamp`, as `pose_at`."""
        if not self._stamps or stamp < self._stamps[0]:
            return None
        after = bisect_right(self._stamps, stamp)
        if after == len(self._stamps):
            ahead = self._extrapolated(stamp)
            return None if ahead is None else ahead[1]
        a, b = self._packets[after - 1], self._packets[after]
        if b.stamp - a.stamp > self.settings.max_gap_s:
            return None
        share = (stamp - a.stamp) / (b.stamp - a.stamp)
        return Twist(
            a.twist.v + share * (b.twist.v - a.twist.v),
            a.twist.omega + share * (b.twist.omega - a.twist.omega),
        )

    def rolls(self, stamp: float) -> bool:
        """Whether the wheels are known to turn at `stamp`."""
        twist = self.twist_at(stamp)
        return twist is not None and (abs(twist.v) > STILL or abs(twist.omega) > STILL_TURN)

    def _extrapolated(self, stamp: float) -> tuple[Pose2, Twist] | None:
        """The newest packet moved on: measured speeds, ramping toward what was commanded."""
        newest = self._packets[-1]
        if stamp - newest.stamp > self.settings.max_gap_s:
            return None
        x, y, theta = newest.pose.x, newest.pose.y, newest.pose.theta
        v, omega, time = newest.twist.v, newest.twist.omega, newest.stamp
        accel = self.settings.accel_mps2
        turn_accel = radians(self.settings.turn_accel_degps2)
        commands = iter(self._commands)
        acting, following = None, next(commands, None)
        while time < stamp:
            dt = min(STEP, stamp - time)
            while following is not None and following.stamp <= time - self.settings.latency_s:
                acting, following = following, next(commands, None)
            v0, omega0 = v, omega
            if acting is not None:
                wanted = _wanted(acting, time)
                if wanted is not None:
                    v = _toward(v, wanted.v, accel * dt)
                    omega = _toward(omega, wanted.omega, turn_accel * dt)
            way, turn = 0.5 * (v0 + v) * dt, 0.5 * (omega0 + omega) * dt
            x += way * cos(theta + 0.5 * turn)
            y += way * sin(theta + 0.5 * turn)
            theta += turn
            time += dt
        return Pose2(x, y, wrap_angle(theta)), Twist(v, omega)


def _wanted(acting: Command, time: float) -> Twist | None:
    """What the base is ramping toward at `time`; None where that is its own speed."""
    if acting.motion is None or time > acting.expires:
        return REST
    return acting.motion if isinstance(acting.motion, Twist) else None


def _toward(value: float, goal: float, step: float) -> float:
    return value + min(max(goal - value, -step), step)
