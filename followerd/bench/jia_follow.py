"""The follow law of suite `jia`: the whole virtual daemon, its twins and its guard, on a path."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import degrees
from timeit import repeat
from typing import Any

import cv2
import numpy as np

from followerd import app
from followerd.bench.closed_loop import simulate
from followerd.bench.rows import Row, mean_row
from followerd.config import load
from followerd.control.fuzzy_gears import FuzzyGears, FuzzyGearsSettings
from followerd.geometry import Array
from followerd.runtime import logs
from followerd.sim import scenarios
from followerd.sim.rig import Rig
from followerd.sim.scenarios import Scenario

PATH = "jia-paths"
SPEEDS = (0.8, 1.0)  # m/s, of the person
LAWS: dict[str, dict[str, Any]] = {
    "fuzzy/paper": {"controller.profile": "paper"},
    "fuzzy/default": {},
    "constant_gain": {"controller.rules": "constant"},
}
UNDER_WAY = 5.0  # s after which enrolling and arming are over
FARTHEST = 3.5  # m; beyond it a Kinect sees nobody
CALLS = 2000

Figures = dict[str, tuple[float | None, str]]  # metric -> value, unit


@dataclass(frozen=True, slots=True)
class Job:
    """One run."""

    law: str
    speed: float  # m/s
    seed: int
    duration: float = 60.0  # s


@dataclass(frozen=True, slots=True)
class Outcome:
    """What is kept of it."""

    job: Job
    figures: Figures
    time: Array  # (N,) s
    robot: Array  # (N, 2) m, in the world
    person: Array  # (N, 2)
    range: Array  # (N,) m


def run(job: Job) -> Outcome:
    """One run, the same for one job every time but for the time of a call."""
    cv2.setNumThreads(1)
    logs.configure("error")
    config = load("patches-sim", {"seed": job.seed, **LAWS[job.law]})
    rig = Rig(walking(scenarios.load(PATH), job.speed), app.equipment(config), job.seed)
    summary = simulate(config, job.duration, world=rig)
    truths = [truth for truth in rig.truths if truth.stamp > UNDER_WAY]
    away = np.array([truth.target.distance for truth in truths])
    aside = np.abs([truth.target.bearing for truth in truths])
    camera = app.equipment(config).camera
    out = (np.tan(np.minimum(aside, 1.5)) > 0.5 * camera.width / camera.fx) | (away > FARTHEST)
    law = FuzzyGears(
        FuzzyGearsSettings.model_validate(config.controller.model_dump(exclude={"kind"}))
    )
    figures: Figures = {
        "range_mean_m": (float(away.mean()), "m"),
        "range_std_m": (float(away.std()), "m"),
        "bearing_mean_deg": (degrees(float(aside.mean())), "deg"),
        "out_of_view_percent": (100.0 * float(out.mean()), "%"),
        "min_range_m": (float(away.min()), "m"),
        "lost_count": (summary["follow"]["lost_count"], ""),
        "call_us": (call_us(law), "us"),
    }
    return Outcome(
        job,
        figures,
        np.array([truth.stamp for truth in truths]),
        np.array([(truth.pose.x, truth.pose.y) for truth in truths]),
        np.array([(truth.target.x, truth.target.y) for truth in truths]),
        away,
    )


def walking(scenario: Scenario, speed: float) -> Scenario:
    """The scenario with its one person at another speed."""
    (person,) = scenario.people
    path = tuple(stop.model_copy(update={"speed_mps": speed}) for stop in person.path)
    return scenario.model_copy(update={"people": (person.model_copy(update={"path": path}),)})


def call_us(law: FuzzyGears) -> float:
    """Time of one look at both surfaces, us."""

    def look() -> None:
        law.speed.at(1.37, 0.62)
        law.gear.at(-0.21, 0.13)

    return 1e6 * min(repeat(look, number=CALLS, repeat=5)) / CALLS


def rows(outcomes: Sequence[Outcome]) -> Iterator[Row]:
    """Means over seeds, for each speed and law."""
    for speed, law in dict.fromkeys((o.job.speed, o.job.law) for o in outcomes):
        mine = [o.figures for o in outcomes if (o.job.speed, o.job.law) == (speed, law)]
        for metric, (_, unit) in mine[0].items():
            values = [figures[metric][0] for figures in mine]
            yield mean_row("jia", f"follow-{speed:.1f}", law, metric, unit, values)
