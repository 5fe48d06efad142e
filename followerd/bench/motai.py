"""Suite `motai`: predictors of a turning target, on pan angles (Motai et al. 2012, tables 1, 2).

The target turns at bounded rates and accelerations between reversals; a hot spot (A), a walking
person (B) and a person beside another heat source (C) are seen with the noise of each. The paper
gives neither noise nor threshold, so its figures are shown beside ours, not compared.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import get_args

from followerd.bench import motai_loop, motai_plots
from followerd.bench.motai_runs import Job, Outcome, run_all
from followerd.bench.motai_target import SIGMA, SPEEDS
from followerd.bench.report import Report
from followerd.bench.rows import Row, mean_row
from followerd.bench.sweep import sweep
from followerd.estimation.predictors import Kind

FIRST_SEED = 1000  # seeds below serve for tuning
LEAST_SEEDS = 100
OVERSHOT = 3.0  # deg, an error beyond it is an overshoot

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
    first = motai_loop.FIRST_SEED
    loop = motai_loop.jobs(range(first, first + (2 if quick else seeds)), quick)
    swept = sweep(executor, motai_loop.run_all, loop, "motai, closed loop")
    closed = [one for batch in swept for one in batch]
    pictures = motai_plots.plots(outcomes) | motai_loop.plots(closed)
    return Report(rows(outcomes) + motai_loop.rows(closed), pictures)


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
