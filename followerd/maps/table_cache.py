"""Scan tables on disk, by the map and the shape they were made of; read by memory map."""

import hashlib
import json
import os
from pathlib import Path

import numpy as np

from followerd.errors import UsageError
from followerd.maps.floor import OccupancyGrid
from followerd.maps.scan_table import (
    HEADINGS,
    Progress,
    ScanTable,
    TableShape,
    build,
    place_rows,
    stride_of,
)

FORMAT = 1  # to be raised when `build` counts otherwise


def cache_dir() -> Path:
    """Where tables are kept: followerd/scan_tables under XDG_CACHE_HOME or ~/.cache."""
    home = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(home) if home else Path.home() / ".cache") / "followerd" / "scan_tables"


def table_for(
    grid: OccupancyGrid,
    shape: TableShape,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> ScanTable:
    """The table of a map: the kept one, or a new one that is kept for the next time.

    Raises ConfigError when it would not fit the memory, UsageError when it cannot be written.
    """
    stride = stride_of(grid, shape)
    name = (folder or cache_dir()) / key_of(grid, shape)
    kept = _read(name, grid, shape, stride)
    if kept is None:
        keep(build(grid, shape, progress), grid, shape, folder)
        kept = _read(name, grid, shape, stride)
        if kept is None:
            raise UsageError(f"{name}.npy: what was written cannot be read again; delete it")
    return kept


def keep(
    table: ScanTable, grid: OccupancyGrid, shape: TableShape, folder: Path | None = None
) -> None:
    """Store a table for the next time; raises UsageError."""
    _write((folder or cache_dir()) / key_of(grid, shape), table)


def key_of(grid: OccupancyGrid, shape: TableShape) -> str:
    """The same for the same map and shape only."""
    digest = hashlib.sha256(repr((FORMAT, shape, grid.cell, grid.origin)).encode())
    for mask in (grid.occupied, grid.free):
        digest.update(repr(mask.shape).encode())
        digest.update(np.packbits(mask).tobytes())
    return digest.hexdigest()[:24]


def _read(name: Path, grid: OccupancyGrid, shape: TableShape, stride: int) -> ScanTable | None:
    """A kept table; None where there is none, or a broken one."""
    try:
        reach = float(json.loads(name.with_suffix(".json").read_text(encoding="utf-8"))["reach"])
        counts = np.load(name.with_suffix(".npy"), mmap_mode="r")
    except (OSError, ValueError, KeyError, EOFError):
        return None
    places = place_rows(grid, stride)
    if counts.shape != (int(places.max()) + 1, HEADINGS, 2 * shape.bins):
        return None
    return ScanTable(counts, places, stride * grid.cell, grid.origin, reach, shape.max_range)


def _write(name: Path, table: ScanTable) -> None:
    """The counts first: a table without its second file does not exist."""
    part = name.with_suffix(f".{os.getpid()}.part")
    try:
        name.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as file:
            np.save(file, table.counts)
        part.replace(name.with_suffix(".npy"))
        part.write_text(json.dumps({"reach": table.reach}), encoding="utf-8")
        part.replace(name.with_suffix(".json"))
    except OSError as error:
        raise UsageError(f"{name.parent}: cannot be written: {error.strerror}") from error
