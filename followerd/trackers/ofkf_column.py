"""The paper's finder: the most salient column of a thermal image. It knows warm, not who."""

from math import sqrt

import numpy as np

from followerd.geometry import Array
from followerd.messages import Box, Pixels
from followerd.perception.hotspot import Column, salient_column
from followerd.trackers.ofkf_finder import Found

REACH = 4.0  # deviations that the column is looked for beside the foreseen one
ROOM = 2.0  # of the height, that the column is looked at
LEAST_SHARE = 0.02  # of a column, that counts as warm


class ColumnFinder:
    """Takes the warmest column near the foreseen one, and any when that is cold.

    Images are evened (perception.hotspot.Levels). The size stays as enrolled unless told.
    """

    def __init__(self, even: Pixels, box: Array) -> None:
        """Learn the person in `box` (4,) x y w h, centre and size."""
        self._shape = np.sqrt([box[2] / box[3], box[3] / box[2]])
        self.size = sqrt(box[2] * box[3])
        self._below, self._share = 0.0, LEAST_SHARE
        column = self._look(even, box[:2], 0.25 * box[2:])
        if column is not None:
            self._below = float(box[1] - column.y) / self.size  # of the centre, under what is warm
            self._share = max(column.share, LEAST_SHARE)

    @property
    def extent(self) -> Array:
        """Width and height (2,), px."""
        extent: Array = self.size * self._shape
        return extent

    def find(self, even: Pixels, foreseen: Array, deviation: Array) -> Found:
        """The warmest column near `foreseen` (2,), which may be wrong by `deviation` (2,), px."""
        column = self._look(even, foreseen, deviation)
        return self._judged(column) if column else Found(foreseen, 0.0, 0.0)

    def search(self, even: Pixels) -> Found | None:
        """The warmest column of the whole image."""
        column = salient_column(even, self.extent[0])
        return self._judged(column) if column else None

    def learn(self, dt: float) -> None:
        """Nothing is learnt."""

    def resize(self, size: float) -> None:
        """The person is now `size` px large."""
        self.size = size

    def _look(self, even: Pixels, centre: Array, deviation: Array) -> Column | None:
        x, y = centre.tolist()
        w, h = self.extent.tolist()
        # a window no taller than the body would slide to the feet, a little with every image
        around = Box.around(x, y, w + 2.0 * REACH * float(deviation[0]), ROOM * h)
        return salient_column(even, w, around)

    def _judged(self, column: Column) -> Found:
        centre = np.array([column.x, column.y + self._below * self.size])
        return Found(centre, min(column.share / self._share, 1.2), 1.0)
