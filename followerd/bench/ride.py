"""A tracker on a simulated robot without the daemon: rendered frames, packets, a driving script.

The tracker gets images, and the poses that 10 Hz status packets allow; the script drives the base
by the truth or by the track. One loop over a fixed grid of time, the same for one seed.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import pi, radians
from time import thread_time
from typing import NamedTuple, Protocol

from followerd.errors import UsageError
from followerd.estimation.ego_motion import EgoMotion, EgoMotionSettings
from followerd.geometry import Camera, Pose2
from followerd.messages import Box, Command, Image, Odometry, TrackState, Twist
from followerd.sim.truth import Truth
from followerd.sim.twins.camera import Picture
from followerd.sim.world import World
from followerd.trackers.interfaces import Tracker

FRAME_RATE = 15  # 1/s
STEPS_PER_FRAME = 4
STEPS_PER_PACKET = 6  # 10 Hz
STEP = 1.0 / (FRAME_RATE * STEPS_PER_FRAME)  # s
LATENCY_STEPS = 2  # from a command to the wheels
EXPIRES = 1.0  # s
SPEED_UNIT = LENGTH_UNIT = 1e-3  # m and m/s, of a status packet
ANGLE_UNIT = 2 * pi / 4096  # rad, of a status packet


class Script(Protocol):
    """Who drives."""

    def wish(self, truth: Truth, track: TrackState | None, ego: Pose2 | None) -> Twist:
        """The motion wanted now, the robot being at `odom_from_base` = `ego` by its packets."""


@dataclass(frozen=True, slots=True)
class Agility:
    """How fast the base takes up a command."""

    accel: float = 0.5  # m/s2
    turn_accel: float = radians(100.0)  # rad/s2


class Frame(NamedTuple):
    """One frame of a ride."""

    image: Image
    truth: Truth
    box: Box | None  # the target as it is in the image, px; None = not in view
    shown: float  # share of it that nothing hides
    track: TrackState | None
    duration: float  # s of the processor, for the tracker's work


class Ride:
    """A world, a base in it that obeys a script, and what its status packets tell."""

    def __init__(
        self,
        world: World,
        camera: Camera,
        script: Script,
        agility: Agility,
        take: Callable[[Camera], Picture] | None = None,
    ) -> None:
        """`take` is what the camera sees of the world's now; by default it is colour alone."""
        self.world = world
        self._take = take or (lambda camera: (world.render(camera), None))
        self._camera = camera
        self._script = script
        self._agility = agility
        self._ego = EgoMotion(
            EgoMotionSettings(
                accel_mps2=agility.accel,
                turn_accel_degps2=agility.turn_accel * 180.0 / pi,
                # half a step less: a command is due whatever the rounding of its stamp
                latency_s=(LATENCY_STEPS - 0.5) * STEP,
            )
        )
        self._wheel_track = world.scenario.robot.track_m
        self._commands = deque([Twist()] * LATENCY_STEPS)
        self._speed = Twist()
        self._counted = Pose2()  # odom_from_base without rounding
        self._travel = world.wheel_travel
        self._track: TrackState | None = None

    def frames(self, tracker: Tracker, count: int, with_odometry: bool = True) -> Iterator[Frame]:
        """Enrol the target in the first of `count` frames, then follow it.

        Raises UsageError when the target is not in the first frame.
        """
        for step in range((count - 1) * STEPS_PER_FRAME + 1):
            now = step * STEP
            self.world.advance(now)
            if step % STEPS_PER_PACKET == 0:
                self._ego.observe(self._packet(now))
            truth = self.world.truth()
            if step % STEPS_PER_FRAME == 0:
                ego = self._ego.pose_at(now) if with_odometry else None
                yield self._look(tracker, step // STEPS_PER_FRAME, now, truth, ego)
            ego = self._ego.pose_at(now)
            self._drive(self._script.wish(truth, self._track, ego), now)

    def _look(
        self, tracker: Tracker, number: int, now: float, truth: Truth, ego: Pose2 | None
    ) -> Frame:
        pixels, depth = self._take(self._camera)
        image = Image(number, now, now, pixels, self._camera, depth)
        seen = self.world.truth_box(self._camera)
        box, shown = seen if seen else (None, 0.0)
        if number == 0 and box is None:
            raise UsageError(f"{self.world.scenario.name}: nobody to enrol in the first frame")
        began = thread_time()  # other jobs of a sweep run beside this one
        if box is not None and number == 0:
            self._track = tracker.enrol(image, box, ego)
        else:
            self._track = tracker.step(image, ego)
        return Frame(image, truth, box, shown, self._track, thread_time() - began)

    def _drive(self, wish: Twist, now: float) -> None:
        """Hand the wish to the base, which acts on one given a moment ago."""
        self._ego.commanded(Command(now, wish, expires=now + EXPIRES))
        self._commands.append(wish)
        wanted = self._commands.popleft()
        self._speed = Twist(
            _toward(self._speed.v, wanted.v, self._agility.accel * STEP),
            _toward(self._speed.omega, wanted.omega, self._agility.turn_accel * STEP),
        )
        half = 0.5 * self._wheel_track * self._speed.omega
        self.world.drive(self._speed.v - half, self._speed.v + half)

    def _packet(self, now: float) -> Odometry:
        """A status packet: the encoders' path since the last one, everything rounded."""
        left, right = self.world.wheel_travel
        rolled_left, rolled_right = left - self._travel[0], right - self._travel[1]
        self._travel = (left, right)
        turn = (rolled_right - rolled_left) / self._wheel_track
        self._counted = self._counted.moved(0.5 * (rolled_left + rolled_right), turn, 1.0)
        pose = Pose2(
            _rounded(self._counted.x, LENGTH_UNIT),
            _rounded(self._counted.y, LENGTH_UNIT),
            _rounded(self._counted.theta, ANGLE_UNIT),
        )
        half = 0.5 * self._wheel_track * self._speed.omega
        wheels = (
            _rounded(self._speed.v - half, SPEED_UNIT),
            _rounded(self._speed.v + half, SPEED_UNIT),
        )
        twist = Twist(0.5 * (wheels[0] + wheels[1]), (wheels[1] - wheels[0]) / self._wheel_track)
        return Odometry(now, now, pose, twist)


def _toward(value: float, goal: float, step: float) -> float:
    return value + min(max(goal - value, -step), step)


def _rounded(value: float, unit: float) -> float:
    return unit * round(value / unit)
