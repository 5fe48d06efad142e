"""Grey levels: from 16-bit counts to 8 bits, and whether a camera changed its gain by itself."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from followerd.messages import Pixels

BLOCKS = (32, 24)  # columns and rows that an image is reduced to
CHANGED = 4.0  # grey levels by which half of the blocks move when the gain jumps
EVERY = 4  # of the rows and columns are looked at for the levels
CLIPPED = (0.01, 0.99)  # quantiles of the first frame that the mapping must hold
ROOM = 0.5  # of their distance, left free on both sides

Blocks = npt.NDArray[np.float64]
Grey = npt.NDArray[np.unsignedinteger[Any]]


class Tone:
    """Linear from `levels` (counts at 0 and at 255) to 8 bits, clipped; 8-bit images as they are.

    Without levels the first 16-bit frame sets them: its 1 % and 99 % quantiles and half their
    distance on both sides. They then stay, for an object must keep its grey.
    """

    def __init__(self, levels: tuple[float, float] | None = None) -> None:
        self.levels = levels
        self._table: Pixels | None = None

    def __call__(self, raw: Grey) -> Pixels:
        """Counts (H, W) uint8 or uint16 as uint8."""
        if raw.dtype == np.uint8:
            return raw.astype(np.uint8, copy=False)
        if self._table is None:
            self._table = self._mapping(raw)
        return np.take(self._table, raw)

    def _mapping(self, first: Grey) -> Pixels:
        if self.levels is None:
            low, high = np.quantile(first[::EVERY, ::EVERY], CLIPPED)
            room = max(ROOM * (high - low), 1.0)
            self.levels = float(low - room), float(high + room)
        low, high = self.levels
        grey = (np.arange(1 << 16) - low) * (255.0 / (high - low))
        return np.clip(np.round(grey), 0, 255).astype(np.uint8)


class GainWatch:
    """Looks for automatic-gain jumps: from one frame to the next, the whole image changes.

    Block means are compared twice: each with the one at its place, and all in order of their
    greys. A person who walks in changes less than half of the places; a turn of the camera changes
    places, but hardly which greys there are; a change of gain or offset changes both.
    """

    def __init__(self) -> None:
        self._before: Blocks | None = None

    def jumped(self, pixels: Pixels) -> float:
        """By how many grey levels the gain changed with this frame (H, W); 0.0 = it did not."""
        now: Blocks = np.asarray(cv2.resize(pixels, BLOCKS, None, 0, 0, cv2.INTER_AREA), np.float64)
        before, self._before = self._before, now
        if before is None:
            return 0.0
        places = np.median(np.abs(now - before))
        greys = np.median(np.abs(np.sort(now, None) - np.sort(before, None)))
        moved = float(min(places, greys))
        return moved if moved > CHANGED else 0.0
