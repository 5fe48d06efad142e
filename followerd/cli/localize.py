"""`followerd localize`: a localizer alone over a log."""

from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from cyclopts import Parameter
from rich.progress import Progress

from followerd.bench.localize import COLUMNS, locate, parse_start, summarise
from followerd.bench.localizers import build
from followerd.bench.mapping import Which, chosen
from followerd.bench.scan_logs import open_log
from followerd.bench.track import write_csv
from followerd.cli.bars import Bars
from followerd.cli.summary import print_result, write_result
from followerd.errors import UsageError
from followerd.maps.files import load


def localize(
    log: Path,
    *,
    localizer: str = "likelihood_field",
    map_: Annotated[Path, Parameter(name="--map")],
    scans: Which = "all",
    start: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    out: Path,
    summary: Path | None = None,
    seed: int = 0,
) -> None:
    """Find the robot on a map, scan by scan, and write one row for each.

    Parameters
    ----------
    log
        A CARMEN log, or a folder with scans.npz and odom.csv.gz.
    localizer
        Its kind, or kind/profile.
    map_
        A map as `followerd map` or ROS writes it: its name, or its YAML file.
    scans
        Those with an even index, an odd one, or all; the odometry is that of all.
    start
        truth (the log's corrected pose), global (anywhere on the map), or X,Y,THETA in m and rad
        in the map's frame. Default: truth where the log has it, else global.
    out
        CSV file: index,stamp,x,y,theta,particles_spread in m, rad and the map's frame; index
        counts all of the log's scans from 0; nan where the pose is not known.
    summary
        JSON file for counts, times, and errors where the log has corrected poses.
    seed
        Of the localizer's random numbers.
    """
    cv2.setNumThreads(1)
    steps = chosen(open_log(log), scans)
    if not steps:
        raise UsageError(f"{log}: there are no {scans} scans")
    floor = load(map_)
    at = start or ("global" if steps[0].corrected is None else "truth")
    begin = parse_start(at, steps[0], floor)
    finder = build(localizer, floor, np.random.default_rng(seed))
    with Progress(transient=True) as progress:
        shown = Bars(progress).shown(steps, "localizing")
        rows = write_csv(out, locate(finder, shown, begin), COLUMNS)
    about = {"source": str(log), "map": str(map_), "localizer": localizer, "start": at}
    result = about | {"seed": seed} | summarise(rows)
    print_result(result)
    if summary:
        write_result(summary, result)
