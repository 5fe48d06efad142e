"""Floor plans measured by hand: segments in, a map out."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from followerd import yaml
from followerd.errors import ConfigError
from followerd.geometry import Array
from followerd.maps.files import number_in, segments_in
from followerd.maps.floor import FloorMap, OccupancyGrid

CELL = 0.05  # m
MARGIN = 0.5  # m of unknown around the plan
KEYS = ("walls_m", "boards_m", "free_m", "cell_m")


def read_plan(path: Path) -> FloorMap:
    """The map of a YAML file of segments; raises ConfigError naming file and line.

    `walls_m` lists [x0, y0, x1, y1], `boards_m` [x0, y0, x1, y1, thickness] along the middle of
    boards, which have four faces; `free_m` lists [x, y] of points on the floor (default: the
    largest space that the walls enclose), `cell_m` is the grid's cell.
    """
    document = yaml.read(path)
    given = document.value if isinstance(document.value, dict) else {}
    unknown = [f"{document.at((key,))}: unknown key {key}" for key in given if key not in KEYS]
    if unknown:
        raise ConfigError(*unknown, f"{path}: a floor plan has {', '.join(KEYS)}")
    walls = segments_in(document, "walls_m", 4) if "walls_m" in given else np.empty((0, 4))
    boards = segments_in(document, "boards_m", 5) if "boards_m" in given else np.empty((0, 5))
    free = segments_in(document, "free_m", 2) if "free_m" in given else np.empty((0, 2))
    cell = number_in(document, "cell_m", CELL)
    if not 0.005 <= cell <= 0.5:
        raise ConfigError(f"{document.at(('cell_m',))}: cell_m: must be from 0.005 to 0.5")
    if len(walls) + len(boards) == 0:
        raise ConfigError(f"{path}: a floor plan needs walls_m or boards_m")
    if (boards[:, 4:] <= 0.0).any():
        raise ConfigError(f"{document.at(('boards_m',))}: boards_m: a thickness must be above 0")
    faces = [walls.reshape(-1, 2, 2), *(_faces(board) for board in boards)]
    return from_segments(np.concatenate(faces), cell, free)


def from_segments(segments: Array, cell: float = CELL, free: Array | None = None) -> FloorMap:
    """The map with walls (K, 2, 2), m; the floor is what can be reached from points `free` (F, 2).

    Without such points it is the largest space that the walls enclose, or all where none is.
    """
    lower = np.floor((segments.min(axis=(0, 1)) - MARGIN) / cell) * cell
    width, height = np.ceil((segments.max(axis=(0, 1)) + MARGIN - lower) / cell).astype(int)
    image = np.zeros((height, width), np.uint8)
    ends = np.floor((segments - lower) / cell).astype(np.int32)
    for a, b in ends.tolist():
        cv2.line(image, a, b, 1, 1, cv2.LINE_4)
    occupied = image == 1
    spaces = _spaces(occupied)
    if free is not None and len(free):
        at = np.floor((free - lower) / cell).astype(int)
        at = at[(at >= 0).all(axis=1) & (at < (width, height)).all(axis=1)]
        inside = np.unique(spaces[at[:, 1], at[:, 0]])
    else:
        sizes = np.bincount(spaces.ravel())
        sizes[[0, spaces[0, 0]]] = 0  # the walls, and what lies around them
        inside = np.array([sizes.argmax() if sizes.any() else spaces[0, 0]])
    is_free = np.isin(spaces, inside) & ~occupied
    origin = (float(lower[0]), float(lower[1]))
    return FloorMap(OccupancyGrid(occupied, is_free, cell, origin), segments)


def _spaces(occupied: npt.NDArray[np.bool_]) -> npt.NDArray[np.int32]:
    """The number (H, W) of the connected space that each cell belongs to; 0 in walls."""
    _, spaces = cv2.connectedComponents((~occupied).astype(np.uint8), connectivity=4)
    return np.asarray(spaces, np.int32)


def _faces(board: Array) -> Array:
    """The four faces (4, 2, 2) of a board."""
    a, b, thickness = board[:2], board[2:4], board[4]
    along = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
    aside = 0.5 * thickness * np.array([-along[1], along[0]])
    corners = np.array([a - aside, b - aside, b + aside, a + aside])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
