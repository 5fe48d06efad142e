"""Where the robot was when something was measured, and where it is now."""

from bisect import bisect_right
from collections import deque
from math import cos, radians, sin
from typing import NamedTuple

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


class _Step(NamedTuple):
    """Where the robot is taken to be, and how fast, a while after a packet."""

    stamp: float  # s
    x: float  # m
    y: float  # m
    theta: float  # rad
    v: float  # m/s
    omega: float  # rad/s

    @property
    def pose(self) -> Pose2:
        """`odom_from_base`."""
        return Pose2(self.x, self.y, wrap_angle(self.theta))

    @property
    def twist(self) -> Twist:
        """The robot's velocity."""
        return Twist(self.v, self.omega)


class EgoMotion:
    """`odom_from_base` at any time near now: interpolated, or extrapolated with the command."""

    def __init__(self, settings: EgoMotionSettings | None = None) -> None:
        self.settings = settings or EgoMotionSettings()
        self._packets: deque[Odometry] = deque()
        self._stamps: deque[float] = deque()
        self._commands: deque[Command] = deque(maxlen=MOST_COMMANDS)
        self._path: list[_Step] = []  # from the newest packet on, each step worked out once
        self._asked: tuple[float, _Step] | None = None  # a decision asks for one time and again

    def observe(self, odometry: Odometry) -> None:
        """Take a packet; one that is not newer than the newest is dropped."""
        if self._stamps and odometry.stamp <= self._stamps[-1]:
            return
        self._packets.append(odometry)
        self._stamps.append(odometry.stamp)
        self._path.clear()
        self._asked = None
        while self._stamps[0] < odometry.stamp - self.settings.history_s:
            self._packets.popleft()
            self._stamps.popleft()
        acting = odometry.stamp - self.settings.latency_s
        while len(self._commands) > 1 and self._commands[1].stamp <= acting:
            self._commands.popleft()

    def commanded(self, command: Command) -> None:
        """Remember what the base was told."""
        self._commands.append(command)
        self._asked = None
        # steps already taken in which it acts
        latency = self.settings.latency_s
        while len(self._path) > 1 and command.stamp <= self._path[-2].stamp - latency:
            self._path.pop()

    def pose_at(self, stamp: float) -> Pose2 | None:
        """`odom_from_base` at `stamp`; None where no packet lies within `max_gap_s`."""
        if not self._stamps or stamp < self._stamps[0]:
            return None
        after = bisect_right(self._stamps, stamp)
        if after == len(self._stamps):
            ahead = self._extrapolated(stamp)
            return None if ahead is None else ahead.pose
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
            return None if ahead is None else ahead.twist
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

    def _extrapolated(self, stamp: float) -> _Step | None:
        """The newest packet moved on: measured speeds, ramping toward what was commanded."""
        if self._asked is not None and self._asked[0] == stamp:
            return self._asked[1]
        newest = self._packets[-1]
        if stamp - newest.stamp > self.settings.max_gap_s:
            return None
        path = self._path
        if not path:
            pose, twist = newest.pose, newest.twist
            path.append(_Step(newest.stamp, pose.x, pose.y, pose.theta, twist.v, twist.omega))
        while stamp - path[-1].stamp >= STEP:
            path.append(self._moved(path[-1], STEP))
        last = len(path) - 1
        while last and stamp - path[last - 1].stamp < STEP:
            last -= 1
        step = path[last]
        if step.stamp < stamp:
            step = self._moved(step, stamp - step.stamp)
        self._asked = stamp, step
        return step

    def _moved(self, step: _Step, dt: float) -> _Step:
        """`dt` seconds later."""
        time, x, y, theta, v0, omega0 = step
        v, omega = v0, omega0
        wanted = self._wanted(time)
        if wanted is not None:
            v = _toward(v0, wanted.v, self.settings.accel_mps2 * dt)
            omega = _toward(omega0, wanted.omega, radians(self.settings.turn_accel_degps2) * dt)
        way, turn = 0.5 * (v0 + v) * dt, 0.5 * (omega0 + omega) * dt
        x += way * cos(theta + 0.5 * turn)
        y += way * sin(theta + 0.5 * turn)
        return _Step(time + dt, x, y, theta + turn, v, omega)

    def _wanted(self, time: float) -> Twist | None:
        """What the base is ramping toward at `time`; None where that is its own speed."""
        acting = time - self.settings.latency_s
        for command in reversed(self._commands):
            if command.stamp <= acting:
                if command.motion is None or time > command.expires:
                    return REST
                return command.motion if isinstance(command.motion, Twist) else None
        return None


def _toward(value: float, goal: float, step: float) -> float:
    return value + min(max(goal - value, -step), step)
