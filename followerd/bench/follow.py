"""Suite `follow`: closed-loop scenarios through the whole virtual daemon and its twins."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import product
from typing import Any

import cv2
from matplotlib.figure import Figure

from followerd.bench.closed_loop import simulate, staged
from followerd.bench.report import Report
from followerd.bench.rows import Row, mean_row
from followerd.bench.sweep import sweep
from followerd.config import load
from followerd.runtime import logs

SCENARIOS = ("corridor", "laboratory-fixate", "static-ball", "office", "turns")
TRACKERS = ("hpf/paper", "hpf/default")
HIDING = ("pillars", "boards")  # where the person is out of sight for long
HIDDEN_TRACKERS = ("stream_field/default",)
FIRST_SEED = 4560  # seeds below serve for tuning
DURATION = 60.0  # s
QUICK_DURATION = 15.0  # s
UNITS = {"_mps": "m/s", "_m": "m", "_deg": "deg", "_s": "s"}  # by the metric's ending


@dataclass(frozen=True, slots=True)
class Job:
    """One run."""

    tracker: str
    scenario: str
    seed: int
    duration: float  # s


def suite(executor: Executor, seeds: int, quick: bool) -> Report:
    """Every scenario with every tracker; `quick`: two seeds and shorter runs."""
    duration = QUICK_DURATION if quick else DURATION
    numbers = range(FIRST_SEED, FIRST_SEED + (2 if quick else seeds))
    jobs = [
        Job(tracker, scenario, seed, duration)
        for scenario, tracker in (*product(SCENARIOS, TRACKERS), *product(HIDING, HIDDEN_TRACKERS))
        for seed in numbers
    ]
    runs = list(zip(jobs, sweep(executor, run, jobs, "follow"), strict=True))
    return Report(rows(runs), {"every run": plot(runs)})


def run(job: Job) -> dict[str, float | None]:
    """The `follow` figures of one run, flat."""
    cv2.setNumThreads(1)
    logs.configure("error")
    kind, _, profile = job.tracker.partition("/")
    changes = {"sim.scenario": job.scenario, "seed": job.seed, "tracker.profile": profile}
    return flat(simulate(staged(load(f"{kind}-sim", changes)), job.duration)["follow"])


def flat(figures: Mapping[str, Any]) -> dict[str, float | None]:
    """Figures with those inside a figure as `name_p50`."""
    result: dict[str, float | None] = {}
    for name, value in figures.items():
        if isinstance(value, Mapping):
            result |= {f"{name}_{part}": number for part, number in value.items()}
        else:
            result[name] = value
    return result


def rows(runs: Sequence[tuple[Job, Mapping[str, float | None]]]) -> list[Row]:
    """Means over seeds, for each scenario and tracker."""
    result = []
    for scenario, tracker in dict.fromkeys((job.scenario, job.tracker) for job, _ in runs):
        mine = [f for job, f in runs if (job.scenario, job.tracker) == (scenario, tracker)]
        for metric in mine[0]:
            values = [figures[metric] for figures in mine]
            result.append(mean_row("follow", scenario, tracker, metric, unit(metric), values))
    return result


def unit(metric: str) -> str:
    """The unit that a metric's name ends with."""
    name = metric.removesuffix("_p50").removesuffix("_p95")
    name = name.removesuffix("_mean").removesuffix("_std")
    return next((text for ending, text in UNITS.items() if name.endswith(ending)), "")


def plot(runs: Sequence[tuple[Job, Mapping[str, float | None]]]) -> Figure:
    """Every run as a dot: how much was tracked, and how near the robot came to people."""
    figure = Figure((9.0, 6.0), layout="constrained")
    groups = list(dict.fromkeys((job.scenario, job.tracker) for job, _ in runs))
    panels = figure.subplots(2, 1, sharex=True)
    for ax, metric in zip(panels, ("tracking_rate", "min_person_distance_m"), strict=True):
        for place, group in enumerate(groups):
            dots = [f[metric] for job, f in runs if (job.scenario, job.tracker) == group]
            known = [value for value in dots if value is not None]
            ax.plot([place] * len(known), known, "o", color="tab:blue", alpha=0.4)
        ax.set_ylabel(metric)
        ax.grid(axis="y", color="0.9")
    labels = [f"{scenario}\n{tracker}" for scenario, tracker in groups]
    panels[1].set_xticks(range(len(groups)), labels, rotation=60, fontsize="small")
    return figure
