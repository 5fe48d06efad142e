"""The rows of a benchmark's report, as JSON and as a table."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from followerd.errors import UsageError
from followerd.geometry import Array

MOST_COLUMNS = 2  # of trackers, that 80 characters have room for


@dataclass(frozen=True, slots=True)
class Row:
    """One figure. `value` None = the runs could not know it."""

    suite: str
    scenario: str
    tracker: str  # may carry a profile: hpf/paper
    metric: str
    value: float | None
    unit: str
    ci95: float | None = None  # half width of the 95 % interval of the mean over seeds
    paper_value: float | None = None
    seeds: int = 1  # runs behind the value


def mean_row(
    suite: str,
    scenario: str,
    tracker: str,
    metric: str,
    unit: str,
    values: Sequence[float | None],
    paper_value: float | None = None,
) -> Row:
    """The mean over seeds with its interval; runs that did not know the value are left out."""
    known = np.array([value for value in values if value is not None], dtype=float)
    mean, ci95 = interval(known)
    return Row(suite, scenario, tracker, metric, mean, unit, ci95, paper_value, known.size)


def interval(values: Array) -> tuple[float | None, float | None]:
    """Mean and half width of its 95 % interval, by a bootstrap of the seeds (fixed generator)."""
    if values.size == 0:
        return None, None
    mean = float(values.mean())
    if values.size == 1:
        return mean, None
    rng = np.random.default_rng(95)
    means = values[rng.integers(0, values.size, (2000, values.size))].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return mean, float(0.5 * (high - low))


def write_json(path: Path, rows: Sequence[Row]) -> None:
    """A list of objects, one per row; raises UsageError."""
    try:
        text = json.dumps([asdict(row) for row in rows], indent=1, allow_nan=False)
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--json {path}: cannot be written: {error.strerror}") from error


def figure_text(row: Row) -> str:
    """Value, interval and unit for people."""
    if row.value is None:
        return "-"
    spread = f" ± {row.ci95:.2g}" if row.ci95 is not None else ""
    return f"{row.value:.4g}{spread} {row.unit}".rstrip()


def pivot(rows: Sequence[Row]) -> tuple[list[str], dict[tuple[str, str], list[str]]]:
    """Trackers, and a line of texts per (scenario, metric); "" where there is no row."""
    trackers = list(dict.fromkeys(row.tracker for row in rows))
    lines: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        line = lines.setdefault((row.scenario, row.metric), [""] * len(trackers))
        line[trackers.index(row.tracker)] = figure_text(row)
    return trackers, lines


def table(rows: Sequence[Row]) -> Table:
    """One suite's rows: a column per tracker, or a line each where a terminal has no room."""
    trackers, lines = pivot(rows)
    wide = len(trackers) <= MOST_COLUMNS
    view = Table(title=rows[0].suite if rows else "no rows")
    for name in ("scenario", "metric", *(trackers if wide else ("tracker", "value"))):
        view.add_column(name, no_wrap=True)
    above = ""
    for (scenario, metric), texts in lines.items():
        if above and scenario != above:
            view.add_section()
        head = "" if scenario == above else scenario, metric
        if wide:
            view.add_row(*head, *texts)
        else:
            pairs = [pair for pair in zip(trackers, texts, strict=True) if pair[1]]
            for first, pair in enumerate(pairs):
                view.add_row(*(("", "") if first else head), *pair)
        above = scenario
    view.caption = f"mean ± half of the 95 % interval over {max_seeds(rows)} seeds"
    return view


def max_seeds(rows: Sequence[Row]) -> int:
    """How many runs the best-known figure stands on."""
    return max((row.seeds for row in rows), default=0)
