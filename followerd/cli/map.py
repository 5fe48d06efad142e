"""`followerd map`: the map of a floor from a log, a plan or a simulated world."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from cyclopts import Parameter, validators
from rich.progress import Progress

from followerd.bench.floor_plan import floor_of
from followerd.bench.mapping import Which, build_map, chosen, draw_map, logged_poses, matched_poses
from followerd.bench.scan_logs import open_log
from followerd.cli.bars import Bars
from followerd.errors import UsageError
from followerd.geometry import Pose2
from followerd.maps.files import save, yaml_of
from followerd.maps.floor import FloorMap


def map_(
    source: Path,
    *,
    out: Path,
    scans: Which = "all",
    poses: Literal["log", "match"] | None = None,
    cell: Annotated[float, Parameter(validator=validators.Number(gte=0.01, lte=0.5))] = 0.05,
) -> None:
    """Make the map of a floor, as ROS's map_server reads it, with its walls and a picture.

    Parameters
    ----------
    source
        A CARMEN log, an .npz of scans or a folder with scans.npz; or a floor plan measured by
        hand (YAML with walls_m, boards_m); or a simulated world, by name or file.
    out
        Name of the map: writes OUT.yaml, OUT.pgm, OUT.walls.yaml, and OUT.png to check it by.
    scans
        Of a log: those with an even index, an odd one, or all.
    poses
        Of a log: its corrected poses, or found by matching its scans. Default: the corrected
        ones where there are any.
    cell
        Of a log: size of the grid's cells, m.
    """
    way: Sequence[Pose2] = ()
    floor = floor_of(source)
    if floor is None:
        floor, way = _from_log(source, scans, poses, cell)
    save(out, floor)
    picture = yaml_of(out).with_suffix(".png")
    picture.write_bytes(cv2.imencode(".png", draw_map(floor, way))[1].tobytes())
    height, width = floor.grid.occupied.shape
    print(f"{yaml_of(out)}: {width} x {height} cells of {floor.grid.cell:g} m")
    print(f"free: {floor.grid.free.sum() * floor.grid.cell**2:.1f} m2")
    lengths = np.hypot(*(floor.walls[:, 1] - floor.walls[:, 0]).T)
    print(f"walls: {len(floor.walls)}, {lengths.sum():.1f} m")
    print(f"look at {picture}")


def _from_log(
    source: Path, scans: Which, poses: str | None, cell: float
) -> tuple[FloorMap, Sequence[Pose2]]:
    steps = chosen(open_log(source), scans)
    if not steps:
        raise UsageError(f"{source}: there are no {scans} scans")
    with Progress(transient=True) as progress:
        bars = Bars(progress)
        if poses == "match" or (poses is None and steps[0].corrected is None):
            way = matched_poses(steps, bars)
        else:
            way = logged_poses(steps, source)
        return build_map(steps, way, cell, bars), way
