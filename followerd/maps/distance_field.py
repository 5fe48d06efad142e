"""How far every place of a map is from its nearest wall."""

from dataclasses import dataclass
from math import ceil

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.maps.floor import OccupancyGrid

FINEST = 0.05  # m; a coarser map is interpolated to about that


@dataclass(frozen=True, slots=True, eq=False)
class DistanceField:
    """`far[j, i]` m, and whether the robot can be there, of cells as in OccupancyGrid."""

    far: Array  # (H, W) m, float32
    free: npt.NDArray[np.bool_]  # (H, W)
    walls: npt.NDArray[np.bool_]  # (H, W); what is neither was never seen
    cell: float  # m
    origin: tuple[float, float]  # m

    @classmethod
    def of(cls, grid: OccupancyGrid) -> "DistanceField":
        """From the middles of occupied cells."""
        finer = max(ceil(grid.cell / FINEST - 1e-6), 1)
        walls = np.where(grid.occupied, 0, 255).astype(np.uint8)
        far = cv2.distanceTransform(walls, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        if finer > 1:
            size = finer * walls.shape[1], finer * walls.shape[0]
            far = cv2.resize(far, size, interpolation=cv2.INTER_LINEAR)
        metres: Array = np.asarray(far, np.float32) * np.float32(grid.cell)
        each = np.ones((finer, finer), np.bool_)
        free, occupied = np.kron(grid.free, each), np.kron(grid.occupied, each)
        return cls(metres, free, occupied, grid.cell / finer, grid.origin)
