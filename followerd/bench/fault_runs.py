"""One run with faults: when the robot stopped, how far it went, whom it came near."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import cos, hypot, inf
from typing import Any

import cv2
import numpy as np

from followerd import app
from followerd.bench.bystander import armed_by_session, rearm
from followerd.bench.closed_loop import Summary, simulate
from followerd.bench.false_stops import Account, InView, account, broken
from followerd.bench.metrics import is_visible
from followerd.bench.mishaps import MISHAPS, TURNING
from followerd.bench.told import Told
from followerd.config import Config, load
from followerd.errors import DeviceError
from followerd.messages import Decision, Mode, StopReason
from followerd.runtime import logs
from followerd.runtime.daemon import Daemon
from followerd.runtime.stats import Stop
from followerd.sim.faults import Fault, FaultKind
from followerd.sim.truth import Actor, Truth

GONE = "operator:off"  # not a device: the session that armed is heard of no more (F14)
CONFIG = {"record.raw_bytes": True}
SLOWEST = {"laser.baud": 38400, "laser.resolution_deg": 1}  # that F2 allows; trackers of images
FOLLOWING = "hpf-sim"  # the preset of every run that names none
HEAD = "ofkf-sim"  # the one with a pan-tilt head
MOMENTS = {  # s, when a fault begins
    "start-up": (0.8, 2.5),
    "setting off": (5.0, 7.5),
    "under way": (8.0, 14.0),
    "later": (15.0, 22.0),
}
LENGTH = 4.0  # s, of a fault
AFTER = 4.0  # s that a run goes on behind it
NEAR, FAST = 0.45, 0.1  # m, m/s: nearer and faster is an approach
MOVES = 0.05  # m/s or rad/s
STANDS = 0.01  # the same
SLACK = 0.06  # s from a decision to its stop's last byte, what was under way included
LATCHED = (Mode.DISARMED, Mode.FAULT, Mode.ESTOP)
MINE, OTHERS = 0.9, 1.1  # m: no speed toward the followed person, little toward anybody else
NOTICED = 0.5  # s that they have been so near
SILENT = frozenset({FaultKind.OFF, FaultKind.DISCONNECT, FaultKind.REBOOT})  # surely nothing new
FRESH = 2.0  # s after those, before anything may move


@dataclass(frozen=True, slots=True)
class Job:
    """One run: `fault` as `device:name`, or `none`, or `mixed`: one after the other."""

    fault: str
    scenario: str
    seed: int
    duration: float | None = None  # s; None = as long as the fault asks
    moment: str = "under way"
    preset: str = FOLLOWING


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a run; None = it did not stop, or did not move when the fault began."""

    moved: bool  # when the fault began
    time_to_stop: float | None  # s, from the fault to zero velocity's last byte
    standstill: float | None  # s, from the fault
    stop_distance: float | None  # m, from the fault to standstill
    collisions: int
    approaches: int
    wrong_follow: float  # m
    false_stops: int  # without a fault, see `account`
    unnamed_stops: int  # without reason, device or time (F19)
    stops: int
    too_early: float  # m driven before the devices had been well for long enough (F18)
    resumed: float  # m driven after a stop that only the operator may end
    fastest: float  # m/s that the base was told
    toward_person: float  # m/s told, toward the followed person who is near (F11)
    toward_others: float  # m/s told, toward anybody else who is near (F12)
    sound: float  # s without a fault in which it followed, or falsely did not
    following: float  # s
    stood: float  # s of the sound time, falsely


def run(job: Job) -> Outcome:
    """The run of a job; the same job gives the same outcome."""
    cv2.setNumThreads(1)
    logs.configure("error")
    rng = np.random.default_rng([job.seed, 11])
    start = float(rng.uniform(*MOMENTS[job.moment]))
    duration = start + LENGTH + AFTER if job.duration is None else job.duration
    faults = _faults(job.fault, start, duration, rng)
    laser = SLOWEST if job.preset == FOLLOWING else {}
    place = {"sim.scenario": job.scenario, "seed": job.seed}
    config = load(job.preset, {**place, **CONFIG, **laser})
    rig = app.rig(config, faults)
    witness = Witness(config.base.model_dump().get("baud") or 9600)
    _, mishap = MISHAPS.get(job.fault, ("", None))

    def attach(daemon: Daemon) -> None:
        witness.attach(daemon)
        if mishap is not None:
            asyncio.get_running_loop().call_at(start, mishap, daemon, start + LENGTH)
        if job.fault == GONE:
            witness.beside = asyncio.ensure_future(armed_by_session(daemon, start))
        if job.fault == "mixed":
            heads = config.tracker.kind == "head"
            witness.beside = asyncio.ensure_future(rearm(daemon, rig, heads=heads))

    follow: Summary = {}
    try:
        follow = simulate(config, duration, attach, world=rig)["follow"] or {}
    except DeviceError:  # who never came up ends the start
        if job.moment != "start-up":
            raise
    hurt = [(f.start, f.end + AFTER) for f in faults] or [(duration, duration)]
    if mishap is not None or job.fault == GONE:
        hurt = [(start, duration)]
    single = job.fault not in ("none", "mixed")
    turns = job.fault in TURNING
    stopped = witness.stopped(start, start + LENGTH + AFTER, turns=turns) if single else None
    falsely = account(rig.truths, witness.decisions, hurt, witness.sight(config))
    outcome = _outcome(rig.truths, witness, follow, falsely, start, stopped)
    silent = [f for f in faults if f.kind in SILENT and f.device != "ptz"]
    if job.moment != "start-up" or not silent:
        return outcome
    return replace(outcome, too_early=_driven(rig.truths, silent[0].start, silent[0].end + FRESH))


def _faults(name: str, start: float, duration: float, rng: np.random.Generator) -> list[Fault]:
    if name in ("none", GONE, *MISHAPS):
        return []
    if name != "mixed":
        return [Fault.parse(f"{name}@{start:.3f}+{LENGTH}")]
    faults, at = [], start
    kinds = list(FaultKind)
    while at < duration:
        device = ("robot", "laser", "camera")[int(rng.integers(3))]
        kind = kinds[int(rng.integers(len(kinds)))]
        faults.append(Fault(device, kind, at, float(rng.uniform(0.2, 3.0))))
        at += float(rng.uniform(8.0, 30.0))
    return faults


class Witness:
    """Hears what goes to the base, and keeps the decisions."""

    def __init__(self, baud: int) -> None:
        self.decisions: list[Decision] = []
        self.stops: list[Stop] = []
        self.told = Told(baud)
        self.beside: asyncio.Future[None] | None = None  # what goes on beside the run
        self._by_camera = False  # and a fixed one

    def attach(self, daemon: Daemon) -> None:
        """Look at a daemon."""
        daemon.decision_watchers.append(self.decisions.append)
        daemon.line_watchers.append(self.told.hear)
        self.stops = daemon.stats.stops
        self._by_camera = "image" in daemon.pipeline.freshness.newest and daemon.head is None

    def sight(self, config: Config) -> InView:
        """Whether the tracker's own sensor can show somebody; a head is turned to them."""
        camera = app.equipment(config).camera
        if self._by_camera:
            return lambda actor: is_visible(actor, camera)
        return lambda actor: actor.in_sight and cos(actor.bearing) > 0.0

    def stopped(self, start: float, end: float, *, turns: bool = False) -> float | None:
        """When (s) the base was told to stop because something broke after `start`.

        Where it may go on `turns` it need only stop driving.
        """
        for decision in self.decisions:
            ends = decision.command.speed == 0.0 if turns else decision.command.stops
            if start <= decision.stamp <= end and ends and broken(decision):
                return self._halted(start, decision.stamp + SLACK, turns=turns)
        if not self.decisions:
            return None
        # a decision that hangs names nothing
        last = self.decisions[-1]
        hangs = last.command.expires < last.stamp - 1.0 and not last.command.stops
        return self._halted(start, start + LENGTH, turns=False) if hangs else None

    def _halted(self, start: float, end: float, *, turns: bool) -> float | None:
        """The first stop behind which nothing moved the robot any more; it is said repeatedly."""
        told = [(t, asked) for t, asked in self.told.history if start <= t <= end]
        zero = [asked.v == 0.0 and (turns or asked.omega == 0.0) for _, asked in told]
        last = max([k for k, stands in enumerate(zero) if not stands], default=-1)
        return told[last + 1][0] if last + 1 < len(told) else None


def _outcome(
    truths: Sequence[Truth],
    witness: Witness,
    follow: dict[str, Any],
    falsely: Account,
    start: float,
    stopped: float | None,
) -> Outcome:
    at = next((truth for truth in truths if truth.stamp >= start), truths[-1])
    moved = max(abs(at.twist.v), abs(at.twist.omega)) > MOVES
    stopped = stopped if moved else None
    standstill, distance = (None, None) if stopped is None else _to_standstill(
        truths, start, stopped
    )  # fmt: skip
    latched = [d.stamp for d in witness.decisions if d.stamp > start and d.mode in LATCHED]
    resumed = 0.0
    if standstill is not None and latched:
        resumed = _driven(truths, start + standstill, truths[-1].stamp)
    armed = [d for d in witness.decisions if d.mode is Mode.FOLLOWING]
    times = np.array([d.stamp for d in armed])
    steps = np.minimum(np.diff(times), 0.1) if len(times) > 1 else np.zeros(0)
    return Outcome(
        moved=moved,
        time_to_stop=None if stopped is None else stopped - start,
        standstill=standstill,
        stop_distance=distance,
        collisions=truths[-1].collisions,
        approaches=approaches(truths),
        wrong_follow=follow.get("wrong_follow_m") or 0.0,
        false_stops=len(falsely.stops),
        unnamed_stops=sum(not _is_told(stop) for stop in witness.stops),
        stops=len(witness.stops),
        too_early=0.0,
        resumed=resumed,
        fastest=max((abs(asked.v) for _, asked in witness.told.history), default=0.0),
        toward_person=toward(truths, witness.told, MINE, lambda truth: (truth.target,)),
        toward_others=toward(truths, witness.told, OTHERS, lambda truth: truth.others),
        sound=falsely.sound,
        following=float(steps.sum()),
        stood=falsely.stood,
    )


def _is_told(stop: Stop) -> bool:
    """Whether a stop says why, by which device, and when; over a lost link nothing is said."""
    timed = stop.time_to_stop is not None or stop.reason == StopReason.LINK_LOST.name.lower()
    return bool(stop.reason and stop.device) and timed


def toward(
    truths: Sequence[Truth], told: Told, near: float, who: Callable[[Truth], Sequence[Actor]]
) -> float:
    """The fastest speed told to drive at somebody seen nearer than `near` m for a while, m/s."""
    fastest, since = 0.0, inf
    for truth in truths:
        ahead = [a for a in who(truth) if a.in_sight and a.distance < near and abs(a.bearing) < 0.7]
        since = min(since, truth.stamp) if ahead else inf
        if truth.stamp - since > NOTICED:
            fastest = max(fastest, told.at(truth.stamp).v)
    return fastest


def _to_standstill(
    truths: Sequence[Truth], start: float, stopped: float
) -> tuple[float | None, float | None]:
    """Time and way from `start` until the robot stands."""
    way, before = 0.0, None
    for truth in truths:
        if truth.stamp < start:
            continue
        if before is not None:
            way += hypot(truth.pose.x - before.x, truth.pose.y - before.y)
        before = truth.pose
        still = max(abs(truth.twist.v), abs(truth.twist.omega)) < STANDS
        if still and truth.stamp >= stopped:
            return truth.stamp - start, way
    return None, None


def _driven(truths: Sequence[Truth], start: float, end: float) -> float:
    """Way between two times, m."""
    some = [truth.pose for truth in truths if start <= truth.stamp <= end]
    return sum(hypot(b.x - a.x, b.y - a.y) for a, b in pairwise(some))


def approaches(truths: Sequence[Truth]) -> int:
    """How often the robot itself drove toward a person nearer than NEAR, faster than FAST."""
    count, was = 0, False
    for truth in truths:
        velocity = truth.twist.v
        near = any(
            actor.distance < NEAR and velocity * cos(actor.bearing) > FAST
            for actor in (truth.target, *truth.others)
        )
        count += near and not was
        was = near
    return count
