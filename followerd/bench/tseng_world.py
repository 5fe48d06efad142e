"""The world of suite `tseng`: a walker who goes round boards, and a robot that trails along.

The paper gives neither walking speeds nor where the boards stood. Here the robot loses sight of the
person for about 30 % of the time, as there.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2, ceil, cos, inf, pi, sin

import numpy as np

from followerd.bench.tseng_room import ROOM, Board, Room, Streets, distance, gap
from followerd.geometry import Pose2, wrap_angle
from followerd.messages import Scan
from followerd.sim.raycast import cast

PERIOD = 0.25  # s, between scans
SUBSTEPS = 10  # of the walk, between two scans
BEAMS = 361
REACH = 8.0  # m
RANGE_SIGMA = 0.01  # m
LEG = 0.06  # m, radius
APART = 0.10  # m, of a leg from the middle, sideways
SWING = 0.22  # m, and forward and back
STRIDE = 1.2  # m
BEFORE = 0.8  # m from a board stands who looks at it
NO_CIRCLES = np.empty((0, 3))


@dataclass(frozen=True, slots=True)
class Plan:
    """One run: the boards, how the person walks, and how well the robot knows where it is."""

    boards: int = 4
    lengths: tuple[float, float] = (1.6, 1.8)  # m, least and most
    speeds: tuple[float, ...] = (0.55, 0.75)  # m/s, one of them per run
    duration: float = 60.0  # s
    position_sigma: float = 0.04  # m per axis, of the robot's pose
    heading_sigma: float = 0.015  # rad
    trails: bool = True  # the robot follows; else it stands
    ellipse: tuple[float, float] | None = None  # m, semi-axes of the walk, once round


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What is true at one scan, and the scan."""

    scan: Scan
    person: complex  # the middle between the legs
    lagged: complex  # its mean over the quarter second before, as the paper took its truth
    robot: Pose2
    believed: Pose2  # the same as the robot knows it
    hits: int  # returns from the legs


def furnished(plan: Plan, rng: np.random.Generator) -> Room:
    """A room with boards between which a person can pass everywhere."""
    width, depth = ROOM
    while True:
        boards: list[Board] = []
        for _ in range(200):
            if len(boards) == plan.boards:
                return Room(boards)
            middle = complex(rng.uniform(1.0, width - 1.0), rng.uniform(1.0, depth - 1.0))
            half = 0.5 * rng.uniform(*plan.lengths) * np.exp(1j * rng.uniform(0.0, pi))
            board = complex(middle - half), complex(middle + half)
            inside = all(1.0 < z.real < width - 1.0 and 1.0 < z.imag < depth - 1.0 for z in board)
            if inside and all(gap(board, other) > 0.95 for other in boards):
                boards.append(board)


class Walker:
    """A person bound for one place after another, turning no faster than people do."""

    TURN = 2.5  # rad/s
    PAUSE = 0.15  # of the arrivals
    VARIES = 0.2  # share of the speed

    def __init__(self, room: Room, plan: Plan, rng: np.random.Generator) -> None:
        self.rng = rng
        self.streets = Streets(room.boards)
        self.speed = float(rng.choice(plan.speeds))
        self.z = self._somewhere()
        self.ring = [self.z]
        while len(self.ring) < 6:
            self.ring.append(self._beyond(self.ring[-1]))
        self._next: int | None = 1 if rng.random() < 0.5 else None  # round and round, or anywhere
        self.path: list[complex] = []
        self.heading = float(rng.uniform(-pi, pi))
        self.gone = 0.0  # m
        self._pause = 0.0  # s
        self._pace = 1.0

    def step(self, dt: float) -> None:
        """Walk on for `dt` seconds."""
        if self._pause > 0.0:
            self._pause -= dt
            return
        if not self.path:
            self.path = self.streets.way(self.z, self._goal())
        target = self.path[0]
        off = wrap_angle(atan2((target - self.z).imag, (target - self.z).real) - self.heading)
        self.heading += min(max(off, -self.TURN * dt), self.TURN * dt)
        self._pace += dt * (1.0 - self._pace) + self.VARIES * (2.0 * dt) ** 0.5 * float(
            self.rng.standard_normal()
        )
        pace = self.speed * min(max(self._pace, 1.0 - self.VARIES), 1.0 + self.VARIES)
        move = dt * pace * max(cos(off), 0.1)
        self.z += move * complex(cos(self.heading), sin(self.heading))
        self.gone += move
        if abs(target - self.z) < 0.15:
            self.path.pop(0)
            if not self.path and self.rng.random() < self.PAUSE:
                self._pause = float(self.rng.uniform(0.5, 2.0))

    def legs(self) -> list[complex]:
        """The middles of both legs."""
        forward = complex(cos(self.heading), sin(self.heading))
        stride = APART * 1j + SWING * sin(2.0 * pi * self.gone / STRIDE)
        return [self.z + stride * forward, self.z - stride * forward]

    def _goal(self) -> complex:
        if self._next is None:
            return self._beyond(self.z)
        self._next = (self._next + 1) % len(self.ring)
        return self.ring[self._next - 1]

    def _beyond(self, z: complex) -> complex:
        """A place before a board and out of sight of `z`: boards are there to be looked at."""
        for _ in range(200):
            place, boards = self._somewhere(), self.streets.boards
            near = any(distance(board, place) < BEFORE for board in boards)
            if near and not self.streets.sees(z, place):
                return place
        return self._somewhere()

    def _somewhere(self) -> complex:
        width, depth = ROOM
        while True:
            z = complex(self.rng.uniform(0.5, width - 0.5), self.rng.uniform(0.5, depth - 0.5))
            if self.streets.is_open(z):
                return z


class Promenade(Walker):
    """Once round an ellipse in the middle of the room."""

    SPEED = 0.65  # m/s

    def __init__(self, room: Room, plan: Plan, rng: np.random.Generator) -> None:
        super().__init__(room, plan, rng)
        self.axes = plan.ellipse or (1.0, 1.0)
        self.t = 0.0
        self.step(0.0)

    def step(self, dt: float) -> None:
        """Along the curve at an even speed."""
        a, b = self.axes
        slope = complex(-a * sin(self.t), b * cos(self.t))
        self.t += dt * self.SPEED / abs(slope)
        self.gone += dt * self.SPEED
        self.heading = atan2(slope.imag, slope.real)
        self.z = complex(0.5 * ROOM[0] + a * cos(self.t), 0.5 * ROOM[1] + b * sin(self.t))


def moments(room: Room, plan: Plan, rng: np.random.Generator) -> Iterator[Moment]:
    """The run, scan by scan."""
    walker = (Promenade if plan.ellipse else Walker)(room, plan, rng)
    trail, lengths = [walker.z], [0.0]
    while plan.trails and lengths[-1] < 3.1:  # the robot begins behind the person
        walker.step(PERIOD / SUBSTEPS)
        _append(trail, lengths, walker.z)
    error, pull = rng.standard_normal(3), PERIOD / 3.0  # an error that fades over 3 s
    sigmas = (plan.position_sigma, plan.position_sigma, plan.heading_sigma)
    phase = float(rng.uniform(0.0, 2.0 * pi))
    for k in range(ceil(plan.duration / PERIOD)):
        recent = []
        for _ in range(SUBSTEPS):
            walker.step(PERIOD / SUBSTEPS)
            _append(trail, lengths, walker.z)
            recent.append(walker.z)
        place = complex(0.5 * ROOM[0], 0.4)
        if plan.trails:
            behind = 3.1 + 0.5 * sin(phase + 0.2 * PERIOD * k)
            place = complex(np.interp(lengths[-1] - behind, lengths, np.array(trail)))
        facing = walker.z - place if plan.trails else complex(0.5 * ROOM[0], 3.0) - place
        robot = Pose2(place.real, place.imag, atan2(facing.imag, facing.real))
        error = (1.0 - pull) * error + (1.0 - (1.0 - pull) ** 2) ** 0.5 * rng.standard_normal(3)
        dx, dy, turn = (error * sigmas).tolist()
        believed = Pose2(robot.x + dx, robot.y + dy, wrap_angle(robot.theta + turn))
        scan, hits = scanned(room, robot, walker.legs(), PERIOD * k, rng)
        yield Moment(scan, walker.z, complex(np.mean(recent)), robot, believed, hits)


def _append(trail: list[complex], lengths: list[float], z: complex) -> None:
    if abs(z - trail[-1]) > 1e-6:
        lengths.append(lengths[-1] + abs(z - trail[-1]))
        trail.append(z)


def scanned(
    room: Room, robot: Pose2, legs: list[complex], stamp: float, rng: np.random.Generator
) -> tuple[Scan, int]:
    """A scan of 361 beams over 180 degrees, and how many of them met a leg."""
    angles = robot.theta + np.radians(np.linspace(-90.0, 90.0, BEAMS))
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    origin = np.array([robot.x, robot.y])
    walls = cast(origin, ways, room.segments, NO_CIRCLES)
    bodies = cast(
        origin,
        ways,
        np.empty((0, 4)),
        np.array([(z.real, z.imag, LEG) for z in legs]).reshape(-1, 3),
    )
    ranges = np.minimum(walls, bodies)
    hits = int(np.count_nonzero((bodies < walls) & (bodies < REACH)))
    ranges = ranges + RANGE_SIGMA * rng.standard_normal(BEAMS)
    ranges[ranges > REACH] = inf
    increment = pi / (BEAMS - 1)
    return (
        Scan(stamp, stamp, -0.5 * pi, increment, ranges, REACH, np.zeros(BEAMS), Pose2()),
        hits,
    )
