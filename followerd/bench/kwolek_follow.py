"""The closed loop of suite `kwolek`: how fast a person may walk before the robot loses their face.

The whole daemon in virtual time; in `E3` a person walks backward before the robot, which has a
Kinect (`E3-stereo`: a stereo pair), in `E3-leading` behind a robot that looks back. In `office` the
robot has a stereo pair and finds itself on the map while it follows round the furniture.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from math import pi
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure

from followerd import app
from followerd.bench.closed_loop import simulate
from followerd.bench.looks import looks
from followerd.bench.pose_scores import localization_figures
from followerd.bench.report import Report
from followerd.bench.rows import Row, mean_row
from followerd.bench.sweep import sweep
from followerd.config import load
from followerd.geometry import Array, wrap_angle
from followerd.messages import Decision, Mode
from followerd.runtime import logs
from followerd.sim import scenarios
from followerd.sim.rig import Rig
from followerd.sim.scenarios import Scenario

WORLDS = {
    "E3": ("head-sim", "hall-face-to-face"),
    "E3-stereo": ("head-stereo-sim", "hall-face-to-face"),
    "E3-leading": ("head-leading-sim", "hall-leading"),
    "office": ("head-stereo-sim", "face-to-face"),
}
SPEEDS = {  # m/s, of the person
    "E3": (0.25, 0.4, 0.5, 0.6, 0.7, 0.8),
    "E3-stereo": (0.6,),
    "E3-leading": (0.25, 0.4, 0.6),
    "office": (0.25,),
}
SURE_SPEED = 0.6  # m/s, at which most runs are made
FIRST_SEED = 5460  # seeds below serve for tuning
MOST_SEEDS, FEW_SEEDS = 10, 2  # at that speed, and at every other
DURATION, QUICK_DURATION = 35.0, 12.0  # s
REFERENCE = 1.6  # m
SETTLED = 3.0  # s after the robot has begun to follow
LOST = 1.0  # percent of the time, that may be lost
UNITS = {"lost_percent": "%", "range_rms_m": "m", "bearing_rms_deg": "deg"}
ON_A_MAP = {"office": {"pose_error_cm": "cm"}}  # the others have no localizer
PAPER_SPEED = 0.25  # m/s


@dataclass(frozen=True, slots=True)
class Job:
    """One run."""

    scenario: str
    tracker: str
    speed: float  # m/s
    seed: int
    duration: float  # s


Figures = dict[str, float | None]
NEVER_FOLLOWED: Figures = {
    "lost_percent": 100.0, "range_rms_m": None, "bearing_rms_deg": None, "pose_error_cm": None,
}  # fmt: skip


def suite(executor: Executor, seeds: int, quick: bool) -> Report:
    """Every speed; `quick`: one speed, one short run each."""
    duration = QUICK_DURATION if quick else DURATION
    jobs = [
        Job(scenario, tracker, speed, seed, duration)
        for scenario in WORLDS
        for tracker in (("head/default",) if scenario != "E3" else ("head/paper", "head/default"))
        for speed in (SPEEDS[scenario][:1] if quick else SPEEDS[scenario])
        for seed in seeds_at(speed, 1 if quick else seeds)
    ]
    runs = list(zip(jobs, sweep(executor, run, jobs, "kwolek E3"), strict=True))
    return Report(rows(runs), {"E3: loss and distance over the person's speed": plot(runs)})


def seeds_at(speed: float, seeds: int) -> range:
    """Those of the runs at one speed."""
    most = MOST_SEEDS if speed == SURE_SPEED else FEW_SEEDS
    return range(FIRST_SEED, FIRST_SEED + min(seeds, most))


def run(job: Job) -> Figures:
    """The figures of one run."""
    cv2.setNumThreads(1)
    logs.configure("error")
    config_name, world = WORLDS[job.scenario]
    profile = job.tracker.partition("/")[2]
    changes: dict[str, Any] = {"sim.scenario": world, "seed": job.seed, "tracker.profile": profile}
    if job.scenario not in ON_A_MAP:
        changes["localizer"] = None
    config = load(config_name, changes)
    rig = Rig(at_speed(scenarios.load(world), job.speed), app.equipment(config), job.seed)
    decisions: list[Decision] = []
    simulate(
        config,
        job.duration,
        lambda daemon: daemon.decision_watchers.append(decisions.append),
        world=rig,
    )
    seen = looks(rig.truths, decisions)
    start = next((k for k, look in enumerate(seen) if look.mode is Mode.FOLLOWING), len(seen))
    back = pi if job.scenario == "E3-leading" else 0.0
    tracked = seen[start:]
    if not tracked:
        return NEVER_FOLLOWED
    begun = tracked[0].truth.stamp + SETTLED
    actors = [look.truth.target for look in tracked if look.truth.stamp > begun]
    off = np.array([actor.distance - REFERENCE for actor in actors])
    aside = np.degrees([wrap_angle(actor.bearing - back) for actor in actors])
    away = localization_figures(rig.truths, decisions)["position_error_mean_m"]
    return {
        "lost_percent": 100.0 * float(np.mean([not look.on_target for look in tracked])),
        "range_rms_m": _rms(off),
        "bearing_rms_deg": _rms(aside),
        "pose_error_cm": None if away is None else 100.0 * away,
    }


def at_speed(scenario: Scenario, speed: float) -> Scenario:
    """The scenario with its person walking at `speed`, m/s."""
    person, *others = scenario.people
    path = tuple(stop.model_copy(update={"speed_mps": speed}) for stop in person.path)
    walker = person.model_copy(update={"path": path})
    return scenario.model_copy(update={"people": (walker, *others)})


def rows(runs: Sequence[tuple[Job, Figures]]) -> list[Row]:
    """Means over seeds at each speed, and the fastest speed of each tracker."""
    result = []
    for scenario, tracker in dict.fromkeys((job.scenario, job.tracker) for job, _ in runs):
        mine = [(j, f) for j, f in runs if (j.scenario, j.tracker) == (scenario, tracker)]
        speeds = list(dict.fromkeys(job.speed for job, _ in mine))
        for speed in speeds:
            for metric, unit in (UNITS | ON_A_MAP.get(scenario, {})).items():
                values = [f[metric] for job, f in mine if job.speed == speed]
                name = f"{scenario}-{speed:g}"
                result.append(mean_row("kwolek", name, tracker, metric, unit, values))
        numbers = dict.fromkeys(job.seed for job, _ in mine if job.speed == speeds[0])
        fastest: list[float | None] = [
            max_speed([(j.speed, f) for j, f in mine if j.seed == seed]) for seed in numbers
        ]
        metric = "max_speed_mps"
        row = mean_row("kwolek", scenario, tracker, metric, "m/s", fastest, PAPER_SPEED)
        result.append(row)
    return result


def max_speed(runs: Sequence[tuple[float, Figures]]) -> float:
    """The fastest speed, m/s, up to which every run kept the person; 0 where none did."""
    fastest = 0.0
    for speed, figures in sorted(runs, key=lambda run: run[0]):
        lost = figures["lost_percent"]
        if lost is None or lost >= LOST:
            break
        fastest = speed
    return fastest


def plot(runs: Sequence[tuple[Job, Figures]]) -> Figure:
    """Every run as a dot over the person's speed."""
    figure = Figure((9.0, 6.0), layout="constrained")
    panels = figure.subplots(len(UNITS), 1, sharex=True)
    for ax, (metric, unit) in zip(panels, UNITS.items(), strict=True):
        for group in dict.fromkeys((job.scenario, job.tracker) for job, _ in runs):
            dots = [(j.speed, f[metric]) for j, f in runs if (j.scenario, j.tracker) == group]
            known = [(speed, value) for speed, value in dots if value is not None]
            ax.plot(*np.array(known).reshape(-1, 2).T, "o", alpha=0.5, label=" ".join(group))
        ax.set_ylabel(f"{metric.rsplit('_', 1)[0]}, {unit}")
        ax.grid(axis="y", color="0.9")
    panels[0].legend(fontsize="small")
    panels[-1].set_xlabel("speed of the person, m/s")
    return figure


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else None
