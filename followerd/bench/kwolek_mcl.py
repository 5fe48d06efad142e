"""The localisation part of suite `kwolek`: from anywhere in the paper's office, with a person
before the laser, and after being carried off (Kwolek 2004, sections 5 and 6)."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from math import hypot
from time import perf_counter, thread_time

import cv2
import numpy as np
import numpy.typing as npt
import rich.progress
from matplotlib.figure import Figure

from followerd.bench import kwolek_mcl_plots as plots
from followerd.bench.kwolek_room import Trial, floor, wander
from followerd.bench.report import Report
from followerd.bench.rows import Row, mean_row
from followerd.bench.sweep import sweep
from followerd.estimation.localizer import Localizer
from followerd.geometry import Array, wrap_angle
from followerd.localizers.likelihood_field import LikelihoodField, LikelihoodFieldSettings
from followerd.localizers.scan_histogram import ScanHistogram, ScanHistogramSettings
from followerd.maps.distance_field import DistanceField
from followerd.maps.floor import FloorMap
from followerd.maps.scan_table import Progress, build
from followerd.maps.table_cache import keep, table_for

FIRST_SEED = 4000  # seeds below serve for tuning
LEAST_SEEDS = 200
CONVERGED_BY, RECOVERED_BY = 30, 10
RIGHT = 0.3  # m
WRONG = 0.5  # m
SETTLED = 10  # last updates, over which the error is taken
PAPER = {"updates_to_converge": 8.0, "error_cm": 10.0}  # its experiments, profile paper
BLOCKED = 0.15
SCENARIOS = {
    "mcl": Trial(),
    "mcl-blocked": Trial(blocked=BLOCKED),
    "mcl-blocked-untracked": Trial(blocked=BLOCKED, is_tracked=False),
    "mcl-kidnapped": Trial(updates=85, kidnapped_at=60),
}
HISTOGRAMS = {
    "scan_histogram/paper": ScanHistogramSettings(profile="paper"),
    "scan_histogram/default": ScanHistogramSettings(),
}
Builder = Callable[[FloorMap, np.random.Generator], Localizer]
TRACKERS: dict[str, Builder] = {
    "scan_histogram/paper": lambda on, rng: ScanHistogram(
        HISTOGRAMS["scan_histogram/paper"], on, rng
    ),
    "scan_histogram/default": lambda on, rng: ScanHistogram(
        HISTOGRAMS["scan_histogram/default"], on, rng
    ),
    "likelihood_field": lambda on, rng: LikelihoodField(LikelihoodFieldSettings(), on, rng),
}


@dataclass(frozen=True, slots=True)
class Job:
    """One run of every localizer."""

    scenario: str
    seed: int


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What is kept of a localizer's run of T updates."""

    job: Job
    tracker: str
    place: Array  # (T,) m, error
    turn: Array  # (T,) deg, likewise
    lost: npt.NDArray[np.bool_]  # (T,) the localizer says so
    times: Array  # (T,) ms of the processor's time

    @property
    def start(self) -> int:
        """The first update that counts."""
        return SCENARIOS[self.job.scenario].kidnapped_at or 0

    @property
    def converged(self) -> int:
        """The update, counted from 1, from which on it is right for good."""
        wrong = np.flatnonzero(self.place[self.start :] >= RIGHT)
        return 1 + (int(wrong[-1]) + 1 if wrong.size else 0)

    @property
    def is_success(self) -> bool:
        """Whether that is soon enough."""
        by = RECOVERED_BY if self.start else CONVERGED_BY
        return self.converged <= by


def suite(executor: Executor, seeds: int, quick: bool) -> Report:
    """Every scenario on 200 seeds at least: a run takes a tenth of a second. `quick`: two."""
    numbers = range(FIRST_SEED, FIRST_SEED + (2 if quick else max(seeds, LEAST_SEEDS)))
    costs = [row for name in TRACKERS for row in cost(name)]  # leaves the tables for the runs
    jobs = [Job(scenario, seed) for seed in numbers for scenario in SCENARIOS]
    outcomes = [one for batch in sweep(executor, run, jobs, "kwolek: mcl") for one in batch]
    return Report(rows(outcomes) + costs, pictures(outcomes))


def run(job: Job) -> list[Outcome]:
    """One run; all localizers see the same."""
    cv2.setNumThreads(1)
    world_rng, *rngs = np.random.default_rng(job.seed).spawn(1 + len(TRACKERS))
    moments = list(wander(SCENARIOS[job.scenario], world_rng))
    outcomes = []
    for (name, builder), rng in zip(TRACKERS.items(), rngs, strict=True):
        localizer = builder(_room(), rng)
        localizer.start(None)
        errors = np.empty((4, len(moments)))
        for k, moment in enumerate(moments):
            began = thread_time()
            found = localizer.step(moment.scan, moment.ego, moment.person)
            took = 1e3 * (thread_time() - began)
            if found is None:
                errors[:, k] = np.inf, np.inf, 1.0, took
                continue
            off = ~moment.truth @ found.map_from_base
            turn = abs(np.degrees(wrap_angle(off.theta)))
            errors[:, k] = hypot(off.x, off.y), turn, found.lost, took
        place, turn, lost, times = errors
        outcomes.append(Outcome(job, name, place, turn, lost > 0.0, times))
    return outcomes


@cache
def _room() -> FloorMap:
    return floor()


def rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """Per scenario and localizer; errors are those of successful runs."""
    result = []
    for scenario in dict.fromkeys(one.job.scenario for one in outcomes):
        for tracker in TRACKERS:
            runs = [o for o in outcomes if (o.job.scenario, o.tracker) == (scenario, tracker)]
            good = [one for one in runs if one.is_success]
            relied_on = [o.place[o.start :][~o.lost[o.start :]] for o in runs]
            is_papers = scenario == "mcl" and tracker == "scan_histogram/paper"
            paper = PAPER if is_papers else {}
            figures = {
                "success_percent": ("%", [100.0 * one.is_success for one in runs]),
                "error_cm": ("cm", [100.0 * float(o.place[-SETTLED:].mean()) for o in good]),
                "heading_error_deg": ("deg", [float(o.turn[-SETTLED:].mean()) for o in good]),
                "relied_on_percent": ("%", [100.0 * float(np.mean(~o.lost)) for o in runs]),
                "wrong_relied_on_percent": (
                    "%",
                    [100.0 * float(np.mean(place > WRONG)) for place in relied_on if place.size],
                ),
                "update_ms": ("ms", [float(np.median(one.times)) for one in runs]),
                "search_ms": ("ms", [float(one.times.max()) for one in runs]),
            }
            updates = float(np.median([one.converged for one in runs]))
            result.append(
                Row("kwolek", scenario, tracker, "updates_to_converge", updates, "", None,
                    paper.get("updates_to_converge"), len(runs))
            )  # fmt: skip
            for metric, (unit, values) in figures.items():
                printed = paper.get(metric)
                result.append(mean_row("kwolek", scenario, tracker, metric, unit, values, printed))
    return result


def cost(tracker: str) -> list[Row]:
    """Size of a localizer's table, and seconds to build it anew and to load a kept one."""
    grid = _room().grid
    settings = HISTOGRAMS.get(tracker)
    began = perf_counter()
    if settings is None:
        field = DistanceField.of(grid)
        size, built, loaded = field.far.nbytes + field.free.nbytes, perf_counter() - began, None
    else:
        with bar(f"{tracker}: table") as progress:
            table = build(grid, settings.shape, progress)
        size, built = table.counts.nbytes, perf_counter() - began
        keep(table, grid, settings.shape)
        began = perf_counter()
        table_for(grid, settings.shape)
        loaded = perf_counter() - began
    return [
        Row("kwolek", "mcl", tracker, "table_mb", size / 1e6, "MB"),
        Row("kwolek", "mcl", tracker, "build_s", built, "s"),
        Row("kwolek", "mcl", tracker, "load_s", loaded, "s"),
    ]


@contextmanager
def bar(title: str) -> Iterator[Progress]:
    """A progress bar, moved by calling what it gives with the share done."""
    with rich.progress.Progress(transient=True) as progress:
        task = progress.add_task(title, total=1.0)
        yield lambda done: progress.update(task, completed=done)


def pictures(outcomes: Sequence[Outcome]) -> dict[str, Figure]:
    """Figures 2 and 3 of the paper, and the errors over time."""
    first = outcomes[0].job.seed
    result = {"mcl, figure 2: the motion model": plots.motion()}
    for tracker in HISTOGRAMS:
        title = f"mcl, figure 3: {tracker}, seed {first}"
        result[title] = _localization(tracker, first)
    for scenario in ("mcl", "mcl-kidnapped"):
        runs = [one for one in outcomes if one.job.scenario == scenario]
        place = {
            tracker: np.median([o.place for o in runs if o.tracker == tracker], axis=0)
            for tracker in TRACKERS
        }
        result[f"{scenario}: median error"] = plots.errors(place, runs[0].start)
    return result


def _localization(tracker: str, seed: int) -> Figure:
    """The cloud of one run; the localizer draws as in `run`."""
    world_rng, *rngs = np.random.default_rng(seed).spawn(1 + len(TRACKERS))
    localizer = ScanHistogram(HISTOGRAMS[tracker], _room(), rngs[list(TRACKERS).index(tracker)])
    localizer.start(None)
    moments = list(wander(SCENARIOS["mcl"], world_rng))
    shown = {}
    for k, moment in enumerate(moments[: plots.SHOWN[-1]], 1):
        found = localizer.step(moment.scan, moment.ego)
        if k in plots.SHOWN and found is not None and localizer.mcl.poses is not None:
            shown[k] = localizer.mcl.poses, found.map_from_base
    return plots.clouds(_room().walls, moments, shown)
