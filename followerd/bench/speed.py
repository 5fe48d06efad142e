"""Suite `speed`: the time a tracker needs for one frame, in one thread.

Everything from the frame in memory to the track; rendering and decoding are left out. All
trackers get the same frames of one walk down the corridor, several times over. The same seed makes
each pass the same work, so the least time of a frame is the tracker's, the rest the machine's.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from cProfile import Profile
from math import radians
from time import perf_counter
from types import CodeType

import cv2
import numpy as np
from matplotlib.figure import Figure
from rich.progress import track as progress_bar

from followerd.bench.report import Report
from followerd.bench.ride import Agility, Ride
from followerd.bench.rows import Row
from followerd.bench.scripts import Chaperon
from followerd.bench.trackers import build
from followerd.geometry import Array, Camera, Pose2
from followerd.messages import Box, Image, Odometry, Place, Scan, TrackPhase, TrackState
from followerd.sim.scenarios import load
from followerd.sim.world import World

SIZES = ((192, 144), (320, 240), (640, 480))  # px
TRACKERS = ("hpf/paper", "hpf/default")
PARTICLES = (100, 150, 1000, 10_000, 100_000)
NORMAL = 150  # particles, of the paper
FRAMES = 241  # the first is the enrolment
QUICK_FRAMES = 61
PASSES = 6  # over the frames
LONG = 8.0  # s, after which two passes are enough
SEED = 1000


class Tape:
    """A tracker that only keeps what it is given."""

    needs = frozenset({"image"})
    sees = frozenset({"colour", "depth"})

    def __init__(self) -> None:
        self.seen: list[tuple[Image, Pose2 | None]] = []
        self.region: Box | tuple[float, float] = (0.0, 0.0)

    def enrol(
        self, seen: Image | Scan, region: Box | tuple[float, float], ego: Pose2 | None
    ) -> TrackState:
        """Keep the frame and who is in it."""
        self.region = region
        self.seen = [(seen, ego)] if isinstance(seen, Image) else []
        return TrackState(seen.stamp, TrackPhase.TENTATIVE, 1.0)

    def step(
        self,
        measurement: Image | Scan | Odometry,
        ego: Pose2 | None,
        place: Place | None = None,
    ) -> None:
        """Keep the frame."""
        del place
        if isinstance(measurement, Image):
            self.seen.append((measurement, ego))

    def forget(self) -> None:
        """Keep nothing."""
        self.seen = []


def suite(executor: Executor, seeds: int, quick: bool) -> Report:
    """All sizes, profiles and particle counts, one after another in this process.

    Neither workers nor seeds: runs beside each other would measure each other.
    """
    del executor, seeds
    cv2.setNumThreads(1)
    counts = (NORMAL, 1000) if quick else PARTICLES
    rows: list[Row] = []
    for size in progress_bar(SIZES, "speed", transient=True):
        tape = record(size, QUICK_FRAMES if quick else FRAMES)
        place = f"{size[0]}x{size[1]}"
        for name in TRACKERS:
            for count in counts:
                rows += percentiles(f"{place}/{count}", name, play(tape, name, count))
            alone = play(tape, name, NORMAL, odometry=False)
            rows += percentiles(f"{place}/{NORMAL} without odometry", name, alone)
            rows += stages(tape, place, name)
    return Report(rows, {"median time per frame over particles": plot(rows)})


def record(size: tuple[int, int], count: int) -> Tape:
    """`count` frames of a walk down the corridor, the robot calmly behind."""
    camera = Camera.from_hfov(*size, radians(48.0), z=0.6, elevation=radians(-5.0))
    world = World(load("corridor"), np.random.default_rng(SEED))
    tape = Tape()
    for _ in Ride(world, camera, Chaperon(), Agility()).frames(tape, count):
        pass
    return tape


def play(tape: Tape, name: str, particles: int, odometry: bool = True) -> Array:
    """Run a tracker over the tape; the least time of every step after the enrolment, ms."""
    began = perf_counter()
    passes: list[Array] = []
    while len(passes) < 2 or (len(passes) < PASSES and perf_counter() - began < LONG):
        passes.append(once(tape, name, particles, odometry))
    least: Array = 1e3 * np.min(passes, axis=0)
    return least


def once(
    tape: Tape,
    name: str,
    particles: int,
    odometry: bool = True,
    profile: Profile | None = None,
) -> Array:
    """One pass over the tape; the time of every step after the enrolment, s."""
    tracker = build(name, np.random.default_rng(SEED), particles=particles)
    image, ego = tape.seen[0]
    tracker.enrol(image, tape.region, ego if odometry else None)
    step = tracker.step if profile is None else lambda i, e: profile.runcall(tracker.step, i, e)
    times = []
    for image, ego in tape.seen[1:]:
        began = perf_counter()
        step(image, ego if odometry else None)
        times.append(perf_counter() - began)
    return np.array(times)


def percentiles(scenario: str, tracker: str, times: Array) -> list[Row]:
    """Median and 99th percentile of times in ms."""
    return [
        Row("speed", scenario, tracker, f"frame_ms_p{p}", float(np.percentile(times, p)), "ms")
        for p in (50, 99)
    ]


def stages(tape: Tape, place: str, name: str) -> list[Row]:
    """Mean time of what the tracker's step calls directly; the profiler adds a little to each."""
    profile = Profile()
    once(tape, name, NORMAL, profile=profile)
    spent: dict[str, float] = {}
    for entry in profile.getstats():
        if isinstance(entry.code, CodeType) and entry.code.co_name == "step":
            for call in entry.calls or []:
                name_of = call.code.co_name if isinstance(call.code, CodeType) else call.code
                spent[name_of] = spent.get(name_of, 0.0) + call.totaltime
    frames = len(tape.seen) - 1
    scenario = f"{place}/{NORMAL} stages"
    return [
        Row("speed", scenario, name, f"{called}_ms", 1e3 * seconds / frames, "ms")
        for called, seconds in sorted(spent.items(), key=lambda item: -item[1])
        if not called.startswith("<")
    ]


def plot(rows: Sequence[Row]) -> Figure:
    """Median time over the number of particles, a line per size and profile."""
    figure = Figure((7.0, 4.0), layout="constrained")
    ax = figure.subplots()
    lines: dict[tuple[str, str], list[tuple[int, float]]] = {}
    for row in rows:
        size, _, count = row.scenario.partition("/")
        if row.metric == "frame_ms_p50" and count.isdigit() and row.value is not None:
            lines.setdefault((size, row.tracker), []).append((int(count), row.value))
    for (size, tracker), points in lines.items():
        style = "--" if tracker.endswith("paper") else "-"
        ax.plot(*zip(*points, strict=True), style, marker="o", label=f"{size} {tracker}")
    ax.set(xscale="log", yscale="log", xlabel="particles", ylabel="median time per frame, ms")
    ax.grid(which="both", color="0.9")
    ax.legend(fontsize="small")
    return figure
