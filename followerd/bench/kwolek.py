"""Suite `kwolek`: a head tracked on drawn images (E1), without one cue at a time (E2), and followed
in closed loop (E3, see kwolek_follow).

The paper gives no error figures; its robot followed at 0.25 m/s, at 10 images a second.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from time import process_time
from typing import Any

import cv2
import numpy as np

from followerd.bench import kwolek_follow, kwolek_mcl, kwolek_plots
from followerd.bench.kwolek_images import Frame, Walk
from followerd.bench.report import Report
from followerd.bench.rows import Row, mean_row
from followerd.bench.sweep import sweep
from followerd.bench.trackers import build
from followerd.geometry import Array
from followerd.messages import Pixels, TrackState

FIRST_SEED = 5480  # seeds below serve for tuning
FRAMES, QUICK_FRAMES = 400, 40
UNITS = {
    "lost_percent": "%", "center_error_px": "px", "scale_error_px": "px", "jump_percent": "%",
    "frame_ms": "ms",
}  # fmt: skip
JUMP = 2.0  # px of size from one frame to the next
PAPER_MS = {"frame_ms": 100.0}

Case = tuple[str, str, dict[str, Any]]  # scenario, tracker, changes of its settings
CASES: tuple[Case, ...] = (
    ("E1", "head/paper", {}),
    ("E1", "head/default", {}),
    ("E2-no-depth", "head/paper", {"depth": False}),
    ("E2-no-depth", "head/default", {"depth": False}),
    ("E2-no-template", "head/default", {"template": False}),
    ("E2-colour", "head/paper", {"cues": "colour"}),
    ("E2-colour", "head/default", {"cues": "colour"}),
    ("E2-gradient", "head/paper", {"cues": "gradient"}),
    ("E2-gradient", "head/default", {"cues": "gradient"}),
    ("E2-adaptation-0", "head/default", {"adaptation": 0.0}),
    ("E2-adaptation-0.05", "head/default", {"adaptation": 0.05}),
    ("E2-particles-50", "head/default", {"particles": 50}),
    ("E2-particles-200", "head/paper", {"particles": 200}),
    ("E2-particles-800", "head/default", {"particles": 800}),
)
CROSSED: tuple[Case, ...] = (
    ("E1-crossed", "head/paper", {}),
    ("E1-crossed", "head/default", {}),
)


@dataclass(frozen=True, slots=True)
class Job:
    """One walk, which every case sees."""

    seed: int
    frames: int
    crossed: bool


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What is kept of one tracker's view of a walk; arrays (frames,), nan while lost."""

    scenario: str
    tracker: str
    seed: int
    figures: dict[str, float | None]
    center_error: Array  # px
    size: Array  # px, half the width
    true_size: Array  # px
    pictures: tuple[Pixels, ...] = ()  # first and last frame with the ellipse, of the first seed


def suite(executor: Executor, seeds: int, quick: bool) -> Report:
    """All cases, the closed loop, the robot on its map; `quick`: two seeds and short walks."""
    numbers = range(FIRST_SEED, FIRST_SEED + (2 if quick else seeds))
    frames = QUICK_FRAMES if quick else FRAMES
    jobs = [Job(seed, frames, crossed) for seed in numbers for crossed in (False, True)]
    outcomes = [one for batch in sweep(executor, run, jobs, "kwolek") for one in batch]
    follow = kwolek_follow.suite(executor, seeds, quick)
    found = kwolek_mcl.suite(executor, seeds, quick)
    pictures = kwolek_plots.plots(outcomes) | follow.plots | found.plots
    return Report(rows(outcomes) + follow.rows + found.rows, pictures)


def run(job: Job) -> list[Outcome]:
    """Every case on one walk."""
    cv2.setNumThreads(1)
    walk = list(Walk(job.frames, np.random.default_rng(job.seed), job.crossed))
    return [view(case, walk, job.seed) for case in (CROSSED if job.crossed else CASES)]


def view(case: Case, walk: Sequence[Frame], seed: int) -> Outcome:
    """One tracker on a walk; the same every time but for its time."""
    scenario, name, changes = case
    tracker = build(name, np.random.default_rng([seed, 1]), **changes)
    first, *rest = walk
    tracker.enrol(first.image, first.head.box, None)
    states: list[TrackState | None] = []
    times = []
    for frame in rest:
        began = process_time()
        states.append(tracker.step(frame.image, None))
        times.append(process_time() - began)
    found = np.array([_found(state) for state in states])
    true = np.array([(frame.head.x, frame.head.y, frame.head.a) for frame in rest])
    hidden = np.array([frame.hidden for frame in rest])
    error = np.hypot(*(found[:, :2] - true[:, :2]).T)
    size_error = np.abs(found[:, 2] - true[:, 2])
    astray = ~(error <= true[:, 2])  # a lost head is astray
    figures: dict[str, float | None] = {
        "lost_percent": 100.0 * float(astray[~hidden].mean()),
        "center_error_px": _mean(error),
        "scale_error_px": _mean(size_error),
        "jump_percent": 100.0 * float((np.abs(np.diff(found[:, 2])) > JUMP).mean()),
        "frame_ms": 1e3 * float(np.median(times)),
    }
    pictures: tuple[Pixels, ...] = ()
    if seed == FIRST_SEED and scenario.startswith("E1"):
        pictures = tuple(_drawn(rest[k], found[k]) for k in (0, -1))
    return Outcome(
        scenario, name, seed, figures, error, found[:, 2], true[:, 2], pictures
    )  # fmt: skip


def rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """Means over seeds, for each scenario and tracker."""
    result = []
    for scenario, tracker in dict.fromkeys((o.scenario, o.tracker) for o in outcomes):
        mine = [o.figures for o in outcomes if (o.scenario, o.tracker) == (scenario, tracker)]
        for metric, unit in UNITS.items():
            values, paper = [figures[metric] for figures in mine], PAPER_MS.get(metric)
            result.append(mean_row("kwolek", scenario, tracker, metric, unit, values, paper))
    return result


def _found(state: TrackState | None) -> tuple[float, float, float]:
    """Centre and half width, px."""
    if state is None or state.box is None:
        return (float("nan"),) * 3
    return (*state.box.centre, 0.5 * state.box.w)


def _mean(values: Array) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else None


def _drawn(frame: Frame, found: Array) -> Pixels:
    """The image with the ellipse on it."""
    pixels = frame.image.pixels.copy()
    if np.isfinite(found).all():
        x, y, a = found.tolist()
        axes = round(a), round(a * frame.head.aspect)
        cv2.ellipse(pixels, (round(x), round(y)), axes, 0.0, 0.0, 360.0, (0, 255, 0), 2)
    return pixels
