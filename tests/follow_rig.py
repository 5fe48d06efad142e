"""A kinematic closed loop around the pipeline: perfect track, ideal base, legs and walls in a scan.

For tests of the thinking layers alone; the real daemon runs against the twins.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from heapq import heappop, heappush
from math import atan2, hypot, inf, pi, radians, sin

import numpy as np

from followerd.control.image_centering import ImageCentering, ImageCenteringSettings
from followerd.control.transitions import Action
from followerd.events import Event, Operator, Tick, Tracked
from followerd.geometry import Array, Pose2
from followerd.messages import (
    Command,
    Decision,
    Odometry,
    Scan,
    Sonar,
    TrackPhase,
    TrackState,
    Twist,
)
from followerd.pipeline import Pipeline, PipelineSettings

BASE_FROM_LASER = Pose2(0.17, 0.0, 0.0)
BEARINGS = np.radians(np.arange(-90.0, 90.5, 1.0))
REAR_DISCS = tuple((8 + k, Pose2(-0.2, 0.1 - 0.03 * k, radians(130 + 14 * k))) for k in range(8))
PathOf = Callable[[float], tuple[float, float]]


def standing(x: float, y: float = 0.0) -> PathOf:
    """Somebody who stays at (x, y)."""
    return lambda _: (x, y)


def walking(start: float, legs: list[tuple[float, float]]) -> PathOf:
    """Along x from `start`: (speed m/s, until s) one after the other."""

    def at(time: float) -> tuple[float, float]:
        x, before = start, 0.0
        for speed, until in legs:
            x += speed * (min(time, until) - min(time, before))
            before = until
        return x, 0.0

    return at


def wall(x1: float, y1: float, x2: float, y2: float) -> Array:
    """A wall as one row of segments."""
    return np.array([[x1, y1, x2, y2]])


@dataclass
class Rig:
    """Robot, person, walls, and the streams between them and a pipeline."""

    person: PathOf
    walls: Array = field(default_factory=lambda: np.empty((0, 4)))
    others: list[PathOf] = field(default_factory=list)
    settings: PipelineSettings = field(default_factory=PipelineSettings)
    law: ImageCenteringSettings = field(default_factory=ImageCenteringSettings)
    noise: float = 0.01  # m, of the laser
    feet: bool = True  # the tracker gives a range
    phase: Callable[[float], TrackPhase] = lambda _: TrackPhase.CONFIRMED
    dead: Callable[[str, float], bool] = lambda _stream, _time: False
    legs_visible: bool = True  # to the laser
    rear: float = 5.0  # m, what the rear sonar hears

    def __post_init__(self) -> None:
        self.pipeline = Pipeline(self.settings, ImageCentering(self.law))
        self.rng = np.random.default_rng(1)
        self.now = 0.0
        self.pose = Pose2()
        self.twist = Twist()
        self.command = Command(0.0)
        self.motors = False
        self.decisions: list[Decision] = []
        self.events: list[tuple[Event, float]] = []
        self.trace: list[tuple[float, Pose2, Twist]] = []
        self._queue: list[tuple[float, int, Callable[[], None]]] = []
        self._order = 0
        self._every(0.1, self._odometry)
        self._every(1 / 18.75, self._scan)
        self._every(1 / 15, self._image)
        self._every(0.1, lambda: void(self.give(Tick())))

    def give(self, event: Event) -> Decision:
        """Hand one event to the pipeline now."""
        decision = self.pipeline.step(event, self.now)
        self.events.append((event, self.now))
        self.decisions.append(decision)
        self.command = decision.command
        self.motors = decision.motors
        return decision

    def operate(self, action: Action) -> Decision:
        """What an operator does."""
        return self.give(Operator(action))

    def run(self, seconds: float) -> "Rig":
        """Let time pass."""
        until = self.now + seconds
        while self._queue[0][0] <= until:
            due, _, do = heappop(self._queue)
            self._move(due)
            do()
        self._move(until)
        return self

    def armed(self) -> "Rig":
        """Enrolled, confirmed and armed after the sensors have come up."""
        self.run(1.0)
        self.operate(Action.ENROL)
        self.operate(Action.CONFIRM)
        self.run(1.5)
        assert self.operate(Action.ARM).refused == ""
        return self

    @property
    def range(self) -> float:
        """Distance from the robot to the person, m."""
        x, y = self.person(self.now)
        return hypot(x - self.pose.x, y - self.pose.y)

    @property
    def stopped(self) -> bool:
        """Whether the wheels stand."""
        return abs(self.twist.v) < 1e-6 and abs(self.twist.omega) < 1e-6

    def _every(self, period: float, do: Callable[[], None]) -> None:
        def again(k: int) -> None:
            do()
            self._at((k + 1) * period, lambda: again(k + 1))

        self._at(period, lambda: again(1))

    def _at(self, due: float, do: Callable[[], None]) -> None:
        self._order += 1
        heappush(self._queue, (due, self._order, do))

    def _move(self, until: float) -> None:
        while self.now < until - 1e-12:
            dt = min(0.02, until - self.now)
            motion = self.command.motion
            alive = self.motors and isinstance(motion, Twist) and self.now <= self.command.expires
            goal = motion if alive and isinstance(motion, Twist) else Twist()
            v = self.twist.v + float(np.clip(goal.v - self.twist.v, -0.5 * dt, 0.5 * dt))
            turn = radians(100) * dt
            omega = self.twist.omega + float(np.clip(goal.omega - self.twist.omega, -turn, turn))
            self.twist = Twist(v, omega)
            self.pose = self.pose.moved(v, omega, dt)
            self.now += dt
            self.trace.append((self.now, self.pose, self.twist))

    def _odometry(self) -> None:
        if self.dead("odometry", self.now):
            return
        sonar = tuple(Sonar(disc, pose, self.rear) for disc, pose in REAR_DISCS)
        self.give(
            Odometry(
                self.now, self.now, self.pose, self.twist, sonar=sonar, motors_enabled=self.motors
            )
        )

    def _scan(self) -> None:
        if self.dead("scan", self.now):
            return
        stamp = self.now
        ranges = self._ranges()
        scan = Scan(
            stamp, stamp + 0.01, BEARINGS[0], radians(1.0), ranges, 8.0,
            np.zeros(BEARINGS.size), BASE_FROM_LASER,
        )  # fmt: skip
        self._at(stamp + 0.01, lambda: void(self.give(scan)))

    def _image(self) -> None:
        if self.dead("image", self.now):
            return
        stamp, frame = self.now, round(self.now * 15)
        track = self._track(stamp, frame)
        self._at(stamp + 0.04, lambda: void(self.give(Tracked(stamp, stamp + 0.02, frame, track))))

    def _track(self, stamp: float, frame: int) -> TrackState | None:
        if not self.pipeline.modes.enrolled:
            return None
        phase = self.phase(stamp)
        if phase is TrackPhase.LOST:
            return TrackState(stamp, phase, 0.0, frame)
        x, y = (~self.pose).apply_point(*self.person(stamp))
        bearing = atan2(y, x) + self.rng.normal(0, 0.01)
        distance = hypot(x, y) * (1 + self.rng.normal(0, 0.05)) if self.feet else None
        sigma = 0.25 if self.feet else None
        return TrackState(stamp, phase, 0.9, frame, None, bearing, distance, sigma)

    def _ranges(self) -> Array:
        here = self.pose @ BASE_FROM_LASER
        angles = here.theta + BEARINGS
        rays = np.column_stack([np.cos(angles), np.sin(angles)])
        best = np.full(BEARINGS.size, inf)
        for x, y in self._legs():
            rel = np.array([x - here.x, y - here.y])
            along = rays @ rel
            aside2 = rel @ rel - along**2
            hit = (aside2 < 0.06**2) & (along > 0)
            best[hit] = np.minimum(best[hit], along[hit] - np.sqrt(0.06**2 - aside2[hit]))
        for x1, y1, x2, y2 in self.walls:
            best = np.minimum(best, _to_segment(here, rays, x1, y1, x2, y2))
        best = best + self.rng.normal(0, self.noise, best.size)
        best[best > 8.0] = inf
        return best

    def _legs(self) -> Iterator[tuple[float, float]]:
        people = (self.person, *self.others) if self.legs_visible else self.others
        for path in people:
            x, y = path(self.now)
            stride = 0.15 * sin(2 * pi * self.now)
            yield x + stride, y + 0.1
            yield x - stride, y - 0.1


def void(_: object) -> None:
    """Drop a result."""


def _to_segment(here: Pose2, rays: Array, x1: float, y1: float, x2: float, y2: float) -> Array:
    edge = np.array([x2 - x1, y2 - y1])
    start = np.array([x1 - here.x, y1 - here.y])
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = rays[:, 0] * edge[1] - rays[:, 1] * edge[0]
        along = (start[0] * edge[1] - start[1] * edge[0]) / cross
        share = (start[0] * rays[:, 1] - start[1] * rays[:, 0]) / cross
    hit = (along > 0) & (share >= 0) & (share <= 1)
    return np.where(hit, along, inf)
