"""What a map of one floor is: a grid of what is occupied, and its walls as segments."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyGrid:
    """Cells of the frame `map`, rows upward: `occupied[j, i]` holds x = x0 + (i + 1/2) cell."""

    occupied: npt.NDArray[np.bool_]  # (H, W)
    free: npt.NDArray[np.bool_]  # (H, W); neither occupied nor free is unknown
    cell: float  # m
    origin: tuple[float, float]  # m, lower left corner of cell [0, 0] in `map`


@dataclass(frozen=True, slots=True, eq=False)
class FloorMap:
    """Both forms of one map; each can be made from the other."""

    grid: OccupancyGrid
    walls: Array  # (K, 2, 2) m, ends of straight walls in `map`
