"""What stands still: cells of `odom` that keep being hit, on a grid that wraps round.

Without a map it tells a chair's legs from a person's, given time and odometry.
"""

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.geometry import Array
from followerd.settings import Settings

Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]

CELLS = 512  # along each side, after which the grid begins anew


class BackgroundSettings(Settings):
    """How long something must have stood."""

    cell_m: float = Field(0.1, gt=0)
    stands_s: float = Field(4.0, gt=0, description="hit for so long is background")
    memory_s: float = Field(20.0, gt=0, description="in which a cell that is not hit is forgotten")


class Background:
    """The learned cells."""

    def __init__(self, settings: BackgroundSettings) -> None:
        self.settings = settings
        self._hit = np.zeros((CELLS, CELLS))  # s, fading
        self._stamp = np.full((CELLS, CELLS), -np.inf)  # s, of the last hit

    def learn(self, points: Array, but: Array, radius: float, stamp: float, dt: float) -> None:
        """Take the end points (N, 2) of a scan `dt` seconds after the one before.

        What lies within `radius` of `but` (2,) is somebody, however still they stand.
        """
        off = points - but
        far = np.einsum("ij,ij->i", off, off) > radius * radius
        x, y = self._cells(points[far])
        fade = np.exp((self._stamp[x, y] - stamp) / self.settings.memory_s)
        # a cell that several beams hit is one hit: the last assignment stands
        self._hit[x, y] = self._hit[x, y] * fade + dt
        self._stamp[x, y] = stamp

    def stands(self, points: Array, stamp: float) -> Mask:
        """Which points (N, 2) lie in a cell of the background, or beside one."""
        x, y = self._cells(points)
        still = np.zeros(len(points), np.bool_)
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                at = (x + dx) % CELLS, (y + dy) % CELLS
                fade = np.exp((self._stamp[at] - stamp) / self.settings.memory_s)
                still |= self._hit[at] * fade > self.settings.stands_s
        return still

    def _cells(self, points: Array) -> tuple[Indices, Indices]:
        cells = np.floor(points / self.settings.cell_m).astype(np.intp) % CELLS
        return cells[:, 0], cells[:, 1]
