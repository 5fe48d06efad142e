"""Histograms of many boxes at once: integral histograms over a grid of cells (Porikli 2005)."""

from math import prod

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.messages import Pixels

Mask = npt.NDArray[np.bool_]

Counts = npt.NDArray[np.uint16]

ONE = np.uint16(1)


class Buffers:
    """Memory that is used again: fresh megabytes for every image cost more than to fill them."""

    def __init__(self) -> None:
        self._kept: dict[str, Counts] = {}

    def __call__(self, name: str, *shape: int) -> Counts:
        """An array of a shape, in the memory that had the name last time; its values are left."""
        size = prod(shape)
        if name not in self._kept or size > self._kept[name].size:
            self._kept[name] = np.empty(size + size // 4, np.uint16)
        return self._kept[name][:size].reshape(shape)


class CellHistograms:
    """Counts of bins within `mask`, for any rectangle of whole cells.

    `images` (H, W) hold bins, of which each has `bins`; their histograms lie one after another.
    `left`, `top` is where the images lie in the frame, px. Sums may run over: they are counted
    modulo 2^16, and so are their differences, which are right for patches of less than that.
    """

    def __init__(
        self,
        images: tuple[Pixels, ...],
        bins: tuple[int, ...],
        mask: Mask,
        cell: int,
        buffers: Buffers,
        left: int = 0,
        top: int = 0,
    ) -> None:
        height, width = mask.shape
        self.cell, self.left, self.top = cell, left, top
        rows, columns = -(-height // cell), -(-width // cell)
        total = sum(bins)
        # row and column 0 of the table are the empty sums
        row = (np.arange(height) // cell + 1) * (columns + 1)
        place = (row[:, None] + np.arange(width) // cell + 1)[mask] * total
        table = buffers("table", rows + 1, columns + 1, total)
        table.fill(0)
        flat = table.reshape(-1)
        first = 0
        for image, count in zip(images, bins, strict=True):
            np.add.at(flat, place + image[mask] + first, ONE)
            first += count
        # adding row to row is five times as fast as numpy's cumulative sum along an outer axis
        for i in range(2, rows + 1):
            table[i] += table[i - 1]
        for j in range(2, columns + 1):
            table[:, j] += table[:, j - 1]
        self._table, self._buffers = table, buffers

    def of(self, columns: Array, rows: Array) -> npt.NDArray[np.float32]:
        """Histograms (M, J * I, bins) of M grids of patches, row by row.

        `columns` (M, I + 1) and `rows` (M, J + 1) are the patches' edges in the frame, px; they
        are moved to the nearest edge of a cell.
        """
        height, width, total = self._table.shape
        x = np.rint((columns - self.left) / self.cell).astype(np.intp)
        y = np.rint((rows - self.top) / self.cell).astype(np.intp)
        np.clip(x, 0, width - 1, out=x)
        np.clip(y, 0, height - 1, out=y)
        at = (y * width)[:, :, None] + x[:, None, :]
        count, down, across = at.shape
        corner = self._buffers("corner", *at.shape, total)
        strip = self._buffers("strip", count, down - 1, across, total)
        patch = self._buffers("patch", count, down - 1, across - 1, total)
        np.take(self._table.reshape(-1, total), at, axis=0, out=corner, mode="clip")
        np.subtract(corner[:, 1:], corner[:, :-1], out=strip)
        np.subtract(strip[:, :, 1:], strip[:, :, :-1], out=patch)
        return patch.reshape(count, -1, total).astype(np.float32)
