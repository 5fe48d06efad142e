"""Suite `motai`: predictors of a turning target, on pan angles (Motai et al. 2012, tables 1, 2).

The target turns at bounded rates and accelerations between reversals; a hot spot (A), a walking
person (B) and a person beside another heat source (C) are seen with the noise of each. The paper
gives neither noise nor threshold, so its figures are shown beside ours, not compared.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from math import degrees, pi, radians, tan
from time import perf_counter
from typing import get_args

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from followerd.bench.report import Report
from followerd.bench.rows import Row, mean_row
from followerd.bench.sweep import sweep
from followerd.estimation.arbitration import Kind, Look, predictor
from followerd.geometry import Array

FIRST_SEED = 1000  # seeds below serve for tuning
LEAST_SEEDS = 100
FRAMES = 98
PERIOD = 1 / 15  # s
SUBSTEPS = 10  # of the target's motion, per frame
FOCAL = 686.0  # px: 640 px over 50 degrees
OVERSHOT = 3.0  # deg, an error beyond it is an overshoot
TURNING = 5.0  # deg/s², of the target
HEAD_LAG = 2  # frames that the camera's pan is behind the target

# rate, deg/s; acceleration, deg/s²; time between reversals, s
SPEEDS = {
    "slow": ((3.0, 8.0), 10.0, (2.5, 4.5)),
    "moderate": ((12.0, 25.0), 60.0, (1.2, 2.2)),
    "fast": ((30.0, 55.0), 500.0, (0.6, 1.4)),
}
SIGMA = {"A": 0.15, "B": 0.7, "C": 0.8}  # deg, what the predictors are told of the looks' noise
PAPER_ERROR = {  # deg, table 1: slow, moderate, fast
    ("A", "of"): (2.11, 2.11, 2.59),
    ("A", "kf"): (1.90, 2.63, 2.66),
    ("A", "ofkf"): (1.69, 2.06, 2.11),
    ("B", "of"): (2.04, 2.86, 3.31),
    ("B", "kf"): (1.76, 2.69, 3.64),
    ("B", "ofkf"): (1.74, 2.34, 2.68),
    ("C", "of"): (2.53, 2.86, 2.88),
    ("C", "kf"): (1.00, 1.80, 3.59),
    ("C", "ofkf"): (1.37, 1.30, 1.70),
}


@dataclass(frozen=True, slots=True)
class Job:
    """One run of one predictor."""

    target: str  # A, B or C
    speed: str
    kind: Kind
    seed: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """What is kept of it; angles in deg, (FRAMES,)."""

    job: Job
    true: Array
    foreseen: Array
    turning: npt.NDArray[np.bool_]
    step_us: float

    @property
    def errors(self) -> Array:
        """Absolute, one step ahead."""
        errors: Array = np.abs(self.foreseen - self.true)
        return errors


def suite(executor: Executor, seeds: int, quick: bool) -> Report:
    """All cells and predictors, on 100 seeds at least: a run takes milliseconds. `quick`: two."""
    numbers = range(FIRST_SEED, FIRST_SEED + (2 if quick else max(seeds, LEAST_SEEDS)))
    batches = [
        [Job(target, speed, kind, seed) for kind in get_args(Kind)]
        for target in SIGMA
        for speed in SPEEDS
        for seed in numbers
    ]
    outcomes = [one for batch in sweep(executor, run_all, batches, "motai") for one in batch]
    return Report(rows(outcomes), plots(outcomes))


def run_all(jobs: Sequence[Job]) -> list[Outcome]:
    """Several runs in one worker."""
    return [run(job) for job in jobs]


def run(job: Job) -> Outcome:
    """One run; the target and its noise depend on the seed alone, so predictors are paired."""
    rng = np.random.default_rng([job.seed, "ABC".index(job.target), list(SPEEDS).index(job.speed)])
    true, accel = target_motion(rng, job.speed)
    seen = looks(rng, true, job.target)
    head = np.concatenate([np.full(HEAD_LAG, true[0]), true[:-HEAD_LAG]])
    filter_ = predictor(job.kind, radians(SIGMA[job.target]), np.random.default_rng(job.seed))
    foreseen, times = np.empty(FRAMES), np.empty(FRAMES)
    for k in range(FRAMES):
        x = round(-FOCAL * tan(radians(seen[k] - head[k])))  # whole pixels
        look = Look(k * PERIOD, x, 0.0, radians(head[k]), 0.0, FOCAL)
        start = perf_counter()
        filter_.step(look)
        pan, _ = filter_.ahead(PERIOD)
        times[k] = perf_counter() - start
        foreseen[k] = degrees(pan)
    turning = np.abs(accel[1 : FRAMES + 1]) > TURNING
    turning[2:] |= turning[:-2] | turning[1:-1]
    return Outcome(job, true[1 : FRAMES + 1], foreseen, turning, 1e6 * float(np.median(times)))


def target_motion(rng: np.random.Generator, speed: str) -> tuple[Array, Array]:
    """Angle, deg, and acceleration, deg/s², (FRAMES + 2,) of a target that reverses at times."""
    (slowest, fastest), most, pause = SPEEDS[speed]
    dt = PERIOD / SUBSTEPS
    angle, rate, time = 0.0, 0.0, 0.0
    wanted = rng.uniform(slowest, fastest) * rng.choice([-1.0, 1.0])
    reversal = rng.uniform(*pause)
    angles, accels = [], []
    for k in range((FRAMES + 2) * SUBSTEPS):
        if time >= reversal:
            wanted = -np.sign(wanted) * rng.uniform(slowest, fastest)
            reversal = time + rng.uniform(*pause)
        accel = min(max((wanted - rate) / dt, -most), most)
        rate, angle, time = rate + accel * dt, angle + rate * dt, time + dt
        if k % SUBSTEPS == 0:
            angles.append(angle)
            accels.append(accel)
    return np.array(angles), np.array(accels)


def looks(rng: np.random.Generator, true: Array, target: str) -> Array:
    """The measured angles, deg: jitter, sway of the gait, and looks at something else."""
    n, seen = true.size, true.astype(float)
    sway = 0.5 * np.sin(2 * pi * 1.8 * PERIOD * np.arange(n) + rng.uniform(0.0, 2 * pi))
    if target == "A":
        seen += 0.1 * rng.standard_normal(n)
        return seen
    if target == "B":
        seen += 0.45 * rng.standard_normal(n) + sway
        wild = rng.random(n) < 0.01
        seen[wild] += rng.uniform(-40.0, 40.0, wild.sum())
        return seen
    seen += 0.6 * rng.standard_normal(n) + sway
    source = rng.uniform(-20.0, 20.0)
    k = 0
    while k < n:
        if rng.random() < 0.03:
            burst = slice(k, k + int(rng.integers(1, 4)))
            seen[burst] = source + 0.6 * rng.standard_normal(seen[burst].size)
            k = burst.stop
        k += 1
    return seen


def rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """Means over seeds, for each cell and predictor."""
    cells: dict[tuple[str, str, Kind], list[Outcome]] = {}
    for one in outcomes:
        cells.setdefault((one.job.target, one.job.speed, one.job.kind), []).append(one)
    result = []
    for (target, speed, kind), runs in cells.items():
        paper = PAPER_ERROR.get((target, kind))
        in_turns = [one.errors[one.turning] for one in runs if one.turning.any()]
        figures = {
            "error_mean_deg": ([float(one.errors.mean()) for one in runs], "deg"),
            "error_std_deg": ([float(one.errors.std()) for one in runs], "deg"),
            "overshoot_percent": (
                [100.0 * float((one.errors > OVERSHOT).mean()) for one in runs],
                "%",
            ),
            "turn_mean_deg": ([float(errors.mean()) for errors in in_turns], "deg"),
            "turn_max_deg": ([float(errors.max()) for errors in in_turns], "deg"),
            "step_us": ([one.step_us for one in runs], "us"),
        }
        for metric, (values, unit) in figures.items():
            printed = (
                paper[list(SPEEDS).index(speed)] if paper and metric == "error_mean_deg" else None
            )
            scenario = f"{target}-{speed}"
            result.append(mean_row("motai", scenario, kind, metric, unit, values, printed))
    return result


def plots(outcomes: Sequence[Outcome]) -> dict[str, Figure]:
    """Foreseen and true angles of each target's first seed, as in figures 8 to 14."""
    first = outcomes[0].job.seed
    result = {}
    for target in SIGMA:
        figure = Figure((9.0, 7.0), layout="constrained")
        for ax, speed in zip(figure.subplots(len(SPEEDS), 1, sharex=True), SPEEDS, strict=True):
            cell = target, speed, first
            mine = [o for o in outcomes if (o.job.target, o.job.speed, o.job.seed) == cell]
            time = PERIOD * np.arange(1, FRAMES + 1)
            for one in mine:
                ax.plot(time, one.foreseen, linewidth=0.8, label=one.job.kind)
            ax.plot(time, mine[0].true, color="black", linewidth=1.3, label="true")
            margin = 0.2 * float(np.ptp(mine[0].true)) + 2.0
            ax.set(ylabel="pan, deg", title=f"{target}-{speed}")
            ax.set_ylim(float(mine[0].true.min()) - margin, float(mine[0].true.max()) + margin)
        ax.set_xlabel("s")
        ax.legend(ncols=6, fontsize="small")
        result[f"{target}: foreseen and true pan, seed {first}"] = figure
    return result
