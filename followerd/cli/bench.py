"""`followerd bench`: scenarios x trackers x seeds, with tables and plots."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from matplotlib.figure import Figure
from rich.console import Console

from followerd.bench import (
    faults,
    follow,
    jia,
    kwolek,
    motai,
    obstacles,
    page,
    speed,
    tseng,
    zhuang,
)
from followerd.bench.report import write_html
from followerd.bench.rows import Row, table, write_json
from followerd.bench.sweep import executor
from followerd.errors import UsageError

Suite = Literal[
    "zhuang", "tseng", "motai", "kwolek", "jia", "follow", "faults", "obstacles", "speed", "page"
]
SUITES = {
    "zhuang": zhuang.suite,
    "tseng": tseng.suite,
    "motai": motai.suite,
    "kwolek": kwolek.suite,
    "jia": jia.suite,
    "follow": follow.suite,
    "faults": faults.suite,
    "obstacles": obstacles.suite,
    "speed": speed.suite,
    "page": page.suite,
}


def bench(
    suites: list[Suite],
    *,
    seeds: int = 20,
    jobs: int | None = None,
    scheduler: str | None = None,
    quick: Annotated[bool, Parameter(negative="")] = False,
    json: Path | None = None,
    html: Path | None = None,
) -> None:
    """Run benchmark suites: zhuang (the tracker on rendered images), tseng (a person hidden by
    boards, in scans), motai (predictors of a turning target), kwolek (a head on drawn images and in
    closed loop; a robot that finds itself on a map), jia (patches in images with depth, their
    filter and follow law), follow (the whole daemon in closed loop), faults (devices that fail
    meanwhile), obstacles (things that are suddenly in the way), speed (time per frame), page (what
    the operator's page and recording cost).

    Parameters
    ----------
    suites
        Which ones, in this order.
    seeds
        Runs of each scenario; the seeds are never those used for tuning.
    jobs
        Processes beside each other; default: one per core.
    scheduler
        Address of a Dask scheduler that takes the runs instead (needs the extra `dask`).
    quick
        Two seeds, fewer frames: to see that it works, not for figures.
    json
        File for the rows: a list of objects.
    html
        File for the page with tables and plots; it needs no other file.
    """
    if seeds < 1 or (jobs is not None and jobs < 1):
        raise UsageError("--seeds and --jobs must be at least 1")
    console = Console()
    rows: list[Row] = []
    plots: dict[str, Figure] = {}
    with executor(jobs, scheduler) as pool:
        for name in dict.fromkeys(suites):
            report = SUITES[name](pool, seeds, quick)
            console.print(table(report.rows))
            rows += report.rows
            plots |= {f"{name}: {title}": plot for title, plot in report.plots.items()}
    if json:
        write_json(json, rows)
    if html:
        write_html(html, rows, plots)
