"""One run with faults: when the robot stopped, how far it went, whom it came near."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import cos, hypot
from typing import Any

import cv2
import numpy as np

from followerd import app
from followerd.bench.bystander import armed_by_session, rearm
from followerd.bench.closed_loop import simulate
from followerd.bench.false_stops import Account, InView, account, broken
from followerd.bench.metrics import is_visible
from followerd.config import Config, load
from followerd.hw.p2os.commands import Cmd
from followerd.hw.p2os.protocol import PacketDecoder
from followerd.hw.p2os.writer import BRAKE, HALT
from followerd.messages import Decision, Mode, StopReason
from followerd.runtime import logs
from followerd.runtime.daemon import Daemon
from followerd.runtime.stats import Stop
from followerd.sim.faults import Fault, FaultKind
from followerd.sim.truth import Truth

HUNG = "decisions:stuck"  # not a device: the pipeline decides nothing new (F1)
GONE = "operator:off"  # nor is this: the session that armed is heard of no more (F14)
CONFIG = {"record.raw_bytes": True}
SETPOINTS = (Cmd.VEL, Cmd.RVEL, Cmd.HEAD, Cmd.DHEAD, Cmd.VEL2)
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
    sound: float  # s without a fault in which it followed, or falsely did not
    following: float  # s
    stood: float = 0.0  # s of the sound time, falsely


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

    def attach(daemon: Daemon) -> None:
        witness.attach(daemon)
        if job.fault == HUNG:
            asyncio.get_running_loop().call_at(start, hang, daemon)
        if job.fault == GONE:
            witness.beside = asyncio.ensure_future(armed_by_session(daemon, start))
        if job.fault == "mixed":
            witness.beside = asyncio.ensure_future(rearm(daemon, rig))

    follow = simulate(config, duration, attach, world=rig)["follow"] or {}
    hurt = [(f.start, f.end + AFTER) for f in faults] or [(duration, duration)]
    if job.fault in (HUNG, GONE):
        hurt = [(start, duration)]
    single = job.fault not in ("none", "mixed")
    stopped = witness.stopped(start, start + LENGTH + AFTER) if single else None
    falsely = account(rig.truths, witness.decisions, hurt, witness.sight(config))
    outcome = _outcome(rig.truths, witness, follow, falsely, start, stopped)
    silent = [f for f in faults if f.kind in SILENT and f.device != "ptz"]
    if job.moment != "start-up" or not silent:
        return outcome
    return replace(outcome, too_early=_driven(rig.truths, silent[0].start, silent[0].end + FRESH))


def hang(daemon: Daemon) -> None:
    """From now on nothing new is decided: every event gets the last command again."""
    last = daemon.decision
    assert last is not None
    vars(daemon.pipeline)["step"] = lambda _event, now: replace(last, stamp=now)


def _faults(name: str, start: float, duration: float, rng: np.random.Generator) -> list[Fault]:
    if name in ("none", HUNG, GONE):
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
        self.halts: list[float] = []  # s, last byte
        self.moves: list[float] = []  # s, of setpoints that are not zero
        self.stops: list[Stop] = []
        self.beside: asyncio.Future[None] | None = None  # what goes on beside the run
        self._baud = baud
        self._by_camera = False  # and a fixed one

    def attach(self, daemon: Daemon) -> None:
        """Look at a daemon."""
        daemon.decision_watchers.append(self.decisions.append)
        daemon.line_watchers.append(self._hear)
        self.stops = daemon.stats.stops
        self._by_camera = "image" in daemon.pipeline.freshness.newest and daemon.head is None

    def sight(self, config: Config) -> InView:
        """Whether the tracker's own sensor can show somebody; a head is turned to them."""
        camera = app.equipment(config).camera
        if self._by_camera:
            return lambda actor: is_visible(actor, camera)
        return lambda actor: actor.in_sight and cos(actor.bearing) > 0.0

    def stopped(self, start: float, end: float) -> float | None:
        """When (s) the base was told to stop because something broke after `start`."""
        for decision in self.decisions:
            if start <= decision.stamp <= end and decision.command.stops and broken(decision):
                return self._halted(start, decision.stamp + SLACK)
        # a decision that hangs names nothing
        hangs = self.decisions[-1].command.expires < self.decisions[-1].stamp - 1.0
        halts = [t for t in self.halts if start <= t <= end]
        return halts[0] if halts and hangs and not self.decisions[-1].command.stops else None

    def _halted(self, start: float, end: float) -> float | None:
        """The first stop behind which nothing moved the robot any more; it is said repeatedly."""
        moved = max([t for t in self.moves if t <= end], default=start)
        return next((t for t in self.halts if max(start, moved) <= t <= end), None)

    def _hear(self, device: str, data: bytes, now: float) -> None:
        if device == "base-sent" and (HALT in data or BRAKE in data):
            self.halts.append(now + 10 * len(data) / self._baud)
        elif device == "base-sent" and _moves(data):
            self.moves.append(now)


def _moves(data: bytes) -> bool:
    packets = PacketDecoder().feed(data)
    return any(p.type in SETPOINTS and any(p.payload[2:]) for p in packets)


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
        sound=falsely.sound,
        following=float(steps.sum()),
        stood=falsely.stood,
    )


def _is_told(stop: Stop) -> bool:
    """Whether a stop says why, by which device, and when; over a lost link nothing is said."""
    timed = stop.time_to_stop is not None or stop.reason == StopReason.LINK_LOST.name.lower()
    return bool(stop.reason and stop.device) and timed


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
