"""Maps on disk as ROS's map_server has them: NAME.yaml and its image; walls in NAME.walls.yaml."""

from math import isfinite
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from followerd import yaml
from followerd.errors import ConfigError, UsageError
from followerd.geometry import Array
from followerd.maps.floor import FloorMap, OccupancyGrid
from followerd.maps.walls import walls_of

OCCUPIED, UNKNOWN, FREE = 0, 205, 254  # grey values that map_server writes
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196
MODES = ("trinary", "scale", "raw")
IMAGES = (".pgm", ".png")


def load(path: Path) -> FloorMap:
    """The map NAME, NAME.yaml or NAME.pgm; raises ConfigError naming file and line.

    Its walls stand in NAME.walls.yaml, or are found in the grid where there is no such file.
    """
    file = yaml_of(path)
    document = yaml.read(file)
    if not isinstance(document.value, dict):
        raise ConfigError(f"{document.at(())}: expected the keys of a map: image, resolution, ...")
    grid = _grid(document, _values(file, document))
    walls_file = walls_file_of(path)
    return FloorMap(grid, read_walls(walls_file) if walls_file.is_file() else walls_of(grid))


def save(path: Path, floor: FloorMap) -> None:
    """Write NAME.pgm, NAME.yaml and NAME.walls.yaml; raises UsageError."""
    grid, file = floor.grid, yaml_of(path)
    image_file = file.with_suffix(".pgm")
    grey = np.full(grid.occupied.shape, UNKNOWN, np.uint8)
    grey[grid.free], grey[grid.occupied] = FREE, OCCUPIED
    x, y = grid.origin
    text = (
        f"image: {image_file.name}\n"
        f"resolution: {grid.cell:.6g}\n"
        f"origin: [{x:.6f}, {y:.6f}, 0.0]\n"
        "negate: 0\n"
        f"occupied_thresh: {OCCUPIED_THRESH}\n"
        f"free_thresh: {FREE_THRESH}\n"
    )
    ends = "".join(
        f"  - [{', '.join(f'{value:.4f}' for value in wall)}]\n"
        for wall in floor.walls.reshape(-1, 4).tolist()
    )
    title = "# Faces of walls: x0, y0, x1, y1 in m.\n"
    try:
        image_file.write_bytes(cv2.imencode(".pgm", grey[::-1])[1].tobytes())
        file.write_text(text, encoding="utf-8")
        walls_file_of(path).write_text(
            title + (f"walls_m:\n{ends}" if ends else "walls_m: []\n"), encoding="utf-8"
        )
    except OSError as error:
        raise UsageError(f"{file}: cannot be written: {error.strerror}") from error


def yaml_of(path: Path) -> Path:
    """NAME.yaml of NAME, NAME.yaml, NAME.yml, NAME.pgm or NAME.png."""
    if path.suffix in (".yaml", ".yml"):
        return path
    return path.with_suffix(".yaml") if path.suffix in IMAGES else Path(f"{path}.yaml")


def walls_file_of(path: Path) -> Path:
    """NAME.walls.yaml beside the map."""
    return yaml_of(path).with_suffix(".walls.yaml")


def read_walls(path: Path) -> Array:
    """Walls (K, 2, 2) of a file with `walls_m`, m; raises ConfigError."""
    return segments_in(yaml.read(path), "walls_m", 4).reshape(-1, 2, 2)


def segments_in(document: yaml.Document, key: str, count: int) -> Array:
    """The rows (K, count) of a list of lists of numbers; raises ConfigError naming the row."""
    rows = document.value.get(key) if isinstance(document.value, dict) else None
    if not isinstance(rows, list):
        raise ConfigError(f"{document.at((key,))}: {key} must be a list of [{count} numbers]")
    problems = [
        f"{document.at((key, i))}: {key}: {row!r} must be {count} numbers"
        for i, row in enumerate(rows)
        if not (isinstance(row, list) and len(row) == count and all(map(_is_number, row)))
    ]
    if problems:
        raise ConfigError(*problems)
    return np.array(rows, float).reshape(-1, count)


def number_in(document: yaml.Document, key: str, default: float | None = None) -> float:
    """The number of a key; raises ConfigError naming its place."""
    value = document.value.get(key, default)
    if not _is_number(value):
        raise ConfigError(f"{document.at((key,))}: {key}: must be a number (got {value!r})")
    return float(value)


def _grid(document: yaml.Document, values: Array) -> OccupancyGrid:
    """The grid whose occupancy `values` (H, W), 0 to 1 and nan, the YAML explains."""
    cell = number_in(document, "resolution")
    occupied = number_in(document, "occupied_thresh", OCCUPIED_THRESH)
    free = number_in(document, "free_thresh", FREE_THRESH)
    if cell <= 0.0:
        raise ConfigError(f"{document.at(('resolution',))}: resolution: must be above 0 (m)")
    if not 0.0 <= free < occupied <= 1.0:
        raise ConfigError(
            f"{document.at(('free_thresh',))}: free_thresh: must be below occupied_thresh, both"
            " between 0 and 1"
        )
    origin = document.value.get("origin")
    if not (isinstance(origin, list) and len(origin) in (2, 3) and all(map(_is_number, origin))):
        raise ConfigError(f"{document.at(('origin',))}: origin: must be [x, y, yaw]")
    if any(abs(yaw) > 1e-9 for yaw in origin[2:]):
        raise ConfigError(f"{document.at(('origin',))}: origin: a turned map cannot be used: yaw 0")
    with np.errstate(invalid="ignore"):
        return OccupancyGrid(
            values >= occupied, values <= free, cell, (float(origin[0]), float(origin[1]))
        )


def _values(file: Path, document: yaml.Document) -> Array:
    """Occupancy (H, W) of the image, rows upward, 0 to 1; nan where it says unknown."""
    name, mode = document.value.get("image"), document.value.get("mode", "trinary")
    if not isinstance(name, str):
        raise ConfigError(f"{document.at(('image',))}: image: is required, the map's picture")
    if mode not in MODES:
        raise ConfigError(f"{document.at(('mode',))}: mode: must be one of {', '.join(MODES)}")
    pixels = _image(file.parent / name, document)
    alpha = pixels[..., 3] if pixels.ndim == 3 and pixels.shape[2] == 4 else None
    grey = pixels.astype(float)
    if grey.ndim == 3:
        grey = grey[..., :3].mean(axis=2)
    if mode == "raw":  # per cent; above 100 unknown
        values = np.where(grey <= 100.0, grey / 100.0, np.nan)
    else:
        negate = document.value.get("negate", 0) in (1, True)
        values = grey / 255.0 if negate else 1.0 - grey / 255.0
        if mode == "scale" and alpha is not None:
            values = np.where(alpha == 255, values, np.nan)
    return values[::-1]


def _image(file: Path, document: yaml.Document) -> npt.NDArray[np.uint8]:
    place = document.at(("image",))
    try:
        content = np.frombuffer(file.read_bytes(), np.uint8)
    except OSError as error:
        raise ConfigError(f"{place}: image: {file}: {error.strerror}") from None
    pixels = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if content.size else None
    if pixels is None or pixels.dtype != np.uint8:
        raise ConfigError(f"{place}: image: {file}: not a picture of 8 bits")
    return np.asarray(pixels, np.uint8)


def _is_number(value: Any) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and isfinite(value)
