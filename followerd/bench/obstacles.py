"""Suite `obstacles`: something is suddenly in the robot's way; how soon is it told to stop (F10).

Whole daemon and twins, laser at 38400 baud. Times count from the moment something is in the stop
zone (nearer than the margin that the guard owes it) to the last byte of zero: of speed where the
robot drives, of the turn where it turns on the spot. From then on it is to be held: nothing that
the base is told may bring the robot nearer, neither on its way nor by turning.
"""

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise
from math import copysign, cos, degrees, radians, sin, tau

import cv2
import numpy as np

from followerd import app, clock
from followerd.bench.closed_loop import simulate
from followerd.bench.false_stops import BROKEN
from followerd.bench.report import Report
from followerd.bench.rows import Row
from followerd.bench.sweep import sweep
from followerd.bench.told import Told
from followerd.config import load
from followerd.control.clearance import Footprint, time_to_contact
from followerd.control.transitions import Action
from followerd.events import Hand, Presence
from followerd.geometry import Array, Pose2
from followerd.messages import Decision, Mode, StopReason, Twist
from followerd.runtime import logs
from followerd.runtime.daemon import Daemon
from followerd.sim.place import outline
from followerd.sim.rig import Rig
from followerd.sim.scenarios import Block, Column

CONFIG = {"laser.baud": 38400, "laser.resolution_deg": 1, "record.raw_bytes": True}
FIRST_SEED = 6000  # seeds below serve for tuning
BAUD = 38400  # of the base, once it is connected
READY = 3.0  # s until a hand may drive
STEP = 0.02  # s, of what walks
HELD = 2.0  # s for which it must stay stopped
UNDER_WAY = 0.25  # m/s of a robot that follows
ROOM = 1.4  # m to the person, so that something fits in between
LATEST = 20.0  # s
HEIGHT = 1.0  # m
BODY = Footprint(0.21, 0.30, 0.213)
MARGIN, REAR_MARGIN = 0.65, 0.25  # m, a little less than the guard keeps
TURN_MARGIN = radians(1.5)  # the same, of a turn that would touch
DRIVING = (Mode.FOLLOWING, Mode.MANUAL)
FALSE = BROKEN | {StopReason.OBSTACLE, StopReason.REAR_UNSEEN}  # before anything is in the way

Thing = Block | Column
Things = Callable[[float], list[Thing]]  # in `base` of the moment, s after it


def legs(x: float, y: float, radius: float = 0.06) -> list[Thing]:
    """Of somebody who stands there."""
    return [_pole(x, y - 0.12, radius), _pole(x, y + 0.12, radius)]


def stepping(x: float, y: float, speed: float, radius: float = 0.06) -> Things:
    """Somebody who comes from (x, y) to the middle of the way and stays."""

    def at(time: float) -> list[Thing]:
        left = max(0.0, abs(y) - speed * time)
        return legs(x, left if y > 0.0 else -left, radius)

    return at


def _pole(x: float, y: float, radius: float) -> Column:
    return Column(x_m=x, y_m=y, radius_m=radius, height_m=HEIGHT)


def _box(x: float, y: float, length: float, width: float, yaw: float = 0.0) -> Block:
    return Block(x_m=x, y_m=y, length_m=length, width_m=width, height_m=HEIGHT, yaw_deg=yaw)


@dataclass(frozen=True, slots=True)
class Scene:
    """What appears, in `base`, while the robot does what."""

    things: Things
    hand: Twist | None = None  # that drives or turns it; None = it follows somebody
    dark: float = 0.0  # share of beams on the thing that come back with nothing
    zone_after: float = 0.0  # s until it is in the stop zone

    @property
    def turns(self) -> bool:
        """Whether the robot turns on the spot."""
        return self.hand is not None and self.hand.v == 0.0


def _still(*things: Thing) -> Things:
    return lambda _time: list(things)


AHEAD, BACK = Twist(0.4, 0.0), Twist(-0.15, 0.0)
LEFT, RIGHT = Twist(0.0, 0.6), Twist(0.0, -0.6)
SIDE = 0.29  # m, half the way's width with its margin and a leg's reach
SCENES = {
    "box near": Scene(_still(_box(0.7, 0.0, 0.3, 0.4))),
    "box at the zone's end": Scene(_still(_box(0.95, 0.0, 0.3, 0.4))),
    "box, turned": Scene(_still(_box(0.8, 0.1, 0.3, 0.3, 35.0))),
    "box's corner in the way": Scene(_still(_box(0.8, 0.35, 0.3, 0.4))),
    "wall across": Scene(_still(_box(0.85, 0.0, 0.1, 1.8))),
    "pillar": Scene(_still(_pole(1.0, 0.0, 0.3))),
    "pole": Scene(_still(_pole(0.6, 0.0, 0.03))),
    "thin pole": Scene(_still(_pole(0.7, 0.05, 0.015))),
    "chair leg on the left": Scene(_still(_pole(0.7, 0.15, 0.02))),
    "chair leg on the right": Scene(_still(_pole(0.7, -0.15, 0.02))),
    "four chair legs": Scene(
        _still(*(_pole(x, y, 0.015) for x in (0.6, 1.0) for y in (-0.2, 0.2)))
    ),
    "person near": Scene(_still(*legs(0.55, 0.0))),
    "person at the zone's end": Scene(_still(*legs(0.8, 0.0))),
    "person half in the way": Scene(_still(*legs(0.7, 0.25))),
    "child": Scene(_still(*legs(0.6, 0.0, 0.035))),
    "steps in from the left": Scene(stepping(0.7, 0.9, 1.0), zone_after=(0.9 - 0.12 - SIDE) / 1.0),
    "steps in from the right": Scene(
        stepping(0.7, -0.9, 1.4), zone_after=(0.9 - 0.12 - SIDE) / 1.4
    ),
    "runs in from the left": Scene(stepping(0.7, 1.0, 2.0), zone_after=(1.0 - 0.12 - SIDE) / 2.0),
    "dark box": Scene(_still(_box(0.75, 0.0, 0.3, 0.4)), dark=0.6),
    "dark trousers": Scene(_still(*legs(0.6, 0.0)), dark=0.5),
    "by hand: person": Scene(_still(*legs(0.6, 0.0)), AHEAD),
    "by hand: pole in the arc": Scene(_still(_pole(0.62, 0.16, 0.03)), Twist(0.3, 0.4)),
    "backward: wall": Scene(_still(_box(-0.6, 0.0, 0.1, 1.2)), BACK),
    "backward: person": Scene(_still(*legs(-0.55, 0.0)), BACK),
    "backward: person aside": Scene(_still(*legs(-0.55, 0.12)), BACK),
    "turning left: corner of a box": Scene(_still(_box(0.0, 0.52, 0.3, 0.5)), LEFT),
    "turning left: pole": Scene(_still(_pole(0.16, 0.277, 0.02)), LEFT),
    "turning right: pole": Scene(_still(_pole(0.16, -0.277, 0.02)), RIGHT),
    "turning right: person": Scene(_still(*legs(0.14, -0.44)), RIGHT),
}


@dataclass(frozen=True, slots=True)
class Job:
    """One run."""

    scene: str
    seed: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """Of one run; None: it did not stop, or never got under way."""

    moved: bool
    time_to_stop: float | None  # s
    held: float  # share of the time in which something was in the stop zone, after the stop
    touched: bool
    driven: float = 0.0  # s that it was to drive before anything was in the way
    false_stop: float = 0.0  # s of them in which it was stopped


def suite(executor: Executor, seeds: int, quick: bool) -> Report:
    """Every scene, three of them where it is `quick`."""
    names = list(SCENES)[::10] if quick else list(SCENES)
    numbers = range(FIRST_SEED, FIRST_SEED + (2 if quick else seeds))
    jobs = [Job(name, seed) for name in names for seed in numbers]
    return Report(rows(list(zip(jobs, sweep(executor, run, jobs, "obstacles"), strict=True))), {})


def rows(runs: Sequence[tuple[Job, Outcome]]) -> list[Row]:
    """The figures of each scene, and of all."""
    result = []
    for name in (*dict.fromkeys(job.scene for job, _ in runs), "all"):
        mine = [outcome for job, outcome in runs if name in (job.scene, "all") and outcome.moved]
        times = [o.time_to_stop for o in mine if o.time_to_stop is not None]
        figures: dict[str, tuple[float | None, str]] = {
            "time_to_stop_p99_s": (float(np.percentile(times, 99)) if times else None, "s"),
            "time_to_stop_max_s": (max(times, default=None), "s"),
            "stopped_percent": (100.0 * len(times) / len(mine) if mine else None, "%"),
            "held_percent": (100.0 * float(np.mean([o.held for o in mine])) if mine else None, "%"),
            "held_min_percent": (100.0 * min(o.held for o in mine) if mine else None, "%"),
            "false_stop_percent": (_share(mine), "%"),
            "touched": (float(sum(o.touched for o in mine)), ""),
        }
        result += [
            Row("obstacles", name, "all", metric, value, unit, seeds=len(mine))
            for metric, (value, unit) in figures.items()
        ]
    return result


def _share(outcomes: Sequence[Outcome]) -> float | None:
    driven = sum(o.driven for o in outcomes)
    return 100.0 * sum(o.false_stop for o in outcomes) / driven if driven else None


def run(job: Job) -> Outcome:
    """The run of a job; the same job gives the same outcome."""
    cv2.setNumThreads(1)
    logs.configure("error")
    scene = SCENES[job.scene]
    operator = "auto" if scene.hand is None else "manual"
    config = load("hpf-sim", {"seed": job.seed, "operator": operator, **CONFIG})
    stage = Stage(scene, app.rig(config), np.random.default_rng([job.seed, 13]))
    simulate(config, LATEST, stage.attach, world=stage.rig)
    return stage.outcome()


class Stage:
    """Lets the robot get under way, puts the thing there, and hears what the base is told."""

    def __init__(self, scene: Scene, rig: Rig, rng: np.random.Generator) -> None:
        self.rig = rig
        self._scene = scene
        self._rng = rng
        self._told = Told(BAUD)
        self._seen: list[tuple[float, Array]] = []  # s; the thing's outline (N, 2) in `base`, m
        self._before: list[tuple[float, bool]] = []  # s of a decision to drive; whether it stopped
        self._began: float | None = None  # s, in the stop zone
        self._collisions = 0, 0  # then, and in the end
        self._tasks: list[asyncio.Future[None]] = []

    def attach(self, daemon: Daemon) -> None:
        """Begin."""
        daemon.line_watchers.append(self._told.hear)
        daemon.decision_watchers.append(self._note)
        self._tasks.append(asyncio.ensure_future(self._play(daemon)))

    def outcome(self) -> Outcome:
        """What came of it."""
        if self._began is None:
            return Outcome(False, None, 0.0, False)
        since = [(t, asked) for t, asked in self._told.history if t >= self._began]
        stops = [t for t, asked in since if (asked.omega if self._scene.turns else asked.v) == 0.0]
        steps = np.minimum(np.diff([t for t, _ in self._before]), 0.1)
        stood = np.array([stopped for _, stopped in self._before[:-1]], bool)
        return Outcome(
            moved=True,
            time_to_stop=stops[0] - self._began if stops else None,
            held=self._held(stops[0]) if stops else 0.0,
            touched=self._collisions[1] > self._collisions[0],
            driven=float(steps.sum()),
            false_stop=float(steps[stood].sum()),
        )

    def _held(self, first: float) -> float:
        """Who has turned aside may drive on: only what is in the way now is to be stood before."""
        meant = self._scene.hand or AHEAD
        toward = []
        for stamp, points in self._seen:
            if stamp <= first:
                continue
            asked = self._told.at(stamp)
            if self._scene.turns:  # what stands in the turn is in the zone until it is gone
                toward.append(asked.omega * meant.omega > 0.0)
            elif _is_in_way(points, meant) or any(_is_in_turn(points, side) for side in (1, -1)):
                toward.append(_is_in_way(points, asked) or _is_in_turn(points, asked.omega))
        return 1.0 - sum(toward) / max(len(toward), 1)

    async def _play(self, daemon: Daemon) -> None:
        await clock.sleep(READY + float(self._rng.uniform(0.0, 0.5)))
        hand = self._scene.hand
        if hand is not None:
            daemon.act(Action.MANUAL, "bench")
            self._tasks.append(asyncio.ensure_future(_drive(daemon, hand)))
        while not self._is_under_way():
            await clock.sleep(0.1)
        await clock.sleep(float(self._rng.uniform(0.3, 0.6)))
        base, begun = self.rig.world.pose, clock.now()
        self._darken()
        while (time := clock.now() - begun) <= self._scene.zone_after + HELD:
            things = [_placed(thing, base) for thing in self._scene.things(time)]
            self.rig.world.put(*things)
            outlines = np.concatenate([_edge(thing) for thing in things])
            self._seen.append((clock.now(), (~self.rig.world.pose).apply(outlines)))
            if self._began is None and time >= self._scene.zone_after - STEP:
                self._began = begun + self._scene.zone_after
                self._collisions = (self.rig.truths[-1].collisions,) * 2
            await clock.sleep(STEP)
        self._collisions = self._collisions[0], self.rig.truths[-1].collisions

    def _is_under_way(self) -> bool:
        truth, hand = self.rig.truths[-1], self._scene.hand
        if hand is None:
            return truth.twist.v > UNDER_WAY and truth.target.distance > ROOM
        return abs(truth.twist.v) + abs(truth.twist.omega) > 0.8 * (abs(hand.v) + abs(hand.omega))

    def _darken(self) -> None:
        """From now on some beams on what is new give no echo."""
        world, place, share = self.rig.world, self.rig.world.place, self._scene.dark
        if share == 0.0:
            return
        ranges = world.ranges

        def seen(base_from_laser: Pose2, bearings: Array, ages: Array) -> Array:
            new = ranges(base_from_laser, bearings, ages)
            now, world.place = world.place, place
            old = ranges(base_from_laser, bearings, ages)
            world.place = now
            lost = (new < old) & (self._rng.random(new.size) < share)
            return np.where(lost, np.inf, new)

        vars(world)["ranges"] = seen

    def _note(self, decision: Decision) -> None:
        if decision.mode in DRIVING and not self._seen:
            why = {reason.stop for reason in decision.reasons if reason.full_stop}
            self._before.append((decision.stamp, decision.command.stops and bool(why & FALSE)))


def _is_in_way(points: Array, twist: Twist) -> bool:
    """Whether the robot, keeping `twist`, would touch something within the margin."""
    if twist.v == 0.0:
        return False
    margin = MARGIN if twist.v > 0.0 else REAR_MARGIN
    return bool(abs(twist.v) * time_to_contact(points, twist, BODY).min() < margin)


def _is_in_turn(points: Array, side: float) -> bool:
    """Whether it would touch something if it turned on to a side (left positive)."""
    if side == 0.0:
        return False
    angles = time_to_contact(points, Twist(0.0, copysign(1.0, side)), BODY)
    return bool(angles.min() < TURN_MARGIN)


def _edge(thing: Thing) -> Array:
    """Points (N, 2) on its outline."""
    if isinstance(thing, Column):
        angles = np.linspace(0.0, tau, 24)
        return np.column_stack(
            [
                thing.x_m + thing.radius_m * np.cos(angles),
                thing.y_m + thing.radius_m * np.sin(angles),
            ]
        )
    corners = np.array([*outline(thing), outline(thing)[0]])
    shares = np.linspace(0.0, 1.0, 40)[:, None]
    return np.concatenate([a + shares * (b - a) for a, b in pairwise(corners)])


async def _drive(daemon: Daemon, wanted: Twist) -> None:
    while True:
        daemon.handle(Presence("bench"))
        daemon.handle(Hand("bench", wanted))
        await clock.sleep(0.05)


def _placed(thing: Thing, base: Pose2) -> Thing:
    c, s = cos(base.theta), sin(base.theta)
    x = base.x + c * thing.x_m - s * thing.y_m
    y = base.y + s * thing.x_m + c * thing.y_m
    turned = {} if isinstance(thing, Column) else {"yaw_deg": thing.yaw_deg + degrees(base.theta)}
    return thing.model_copy(update={"x_m": x, "y_m": y, **turned})
