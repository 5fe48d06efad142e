"""The plausibility gate: ranges that neither their neighbours nor the last scan know.

The checksum lets one in 512 damaged pairs of bytes through, and what it lets through shows as one
to four wrong ranges side by side. A range stands when it lies between those of its neighbours, two
on either side, or close to one of them, or when the scan before had one like it nearby; else it is
not measured (nan). So a thing of one or two beams that comes into view is seen one scan later.
"""

import re
from collections.abc import Iterator
from math import ceil, isnan

import numpy as np

from followerd.geometry import Array

MARGIN = 0.10  # m, from one beam to the next, or from one scan to the next
FASTEST = 2.2  # m/s, robot and person towards each other
FASTEST_TURN = 2.0  # rad/s, of the robot
NO_ECHO = 1000.0  # m, beyond every range
UP, DOWN, UNKNOWN = 1, 2, 3  # steps from one range to the next; 0 is along
# out, at most one along, back
ISLAND = re.compile(rb"[\1\3](?=(\0?)[\2\3])|[\2\3](?=(\0?)[\1\3])")
ENDS = bytes((UNKNOWN,))
MOST = 0.1  # share of the ranges; more spikes than this are no scan


class SpikeGate:
    """Keeps the last scan; `increment` is the bearing from one range to the next, rad."""

    def __init__(self, increment: float) -> None:
        self.removed = 0  # ranges, since it was made
        self._increment = increment
        self._last: Array | None = None
        self._last_stamp = 0.0  # s

    def passed(self, ranges: Array, stamp: float) -> Array | None:
        """The ranges (N,), nan where implausible; None when too much is. No echo (inf) passes."""
        spikes = self._spikes(ranges, stamp)
        self._last, self._last_stamp = ranges, stamp
        if not spikes:
            return ranges
        self.removed += len(spikes)
        if len(spikes) > max(1.0, MOST * ranges.size):
            return None
        left = ranges.copy()
        left[spikes] = np.nan
        return left

    def _spikes(self, ranges: Array, stamp: float) -> list[int]:
        """Indices of what neither neighbours nor the last scan support.

        Damaged neighbours may vouch for each other, but not for the farthest out of them: it goes
        first, and then the others stand alone.
        """
        known: Array = np.minimum(ranges, NO_ECHO)
        spikes: list[int] = []
        while found := [
            index
            for island in _islands(known)
            for index in island
            if not self._was_there(index, float(ranges[index]), stamp)
        ]:
            spikes += found
            known[found] = np.nan
        return spikes

    def _was_there(self, index: int, range_: float, stamp: float) -> bool:
        """Whether the last scan had such a range as near as the robot can have turned since."""
        if self._last is None:
            return False
        elapsed = stamp - self._last_stamp
        reach = 1 + ceil(FASTEST_TURN * elapsed / self._increment)
        nearby = self._last[max(0, index - reach) : index + reach + 1]
        return bool((np.abs(nearby - range_) <= MARGIN + FASTEST * elapsed).any())


def _islands(ranges: Array) -> Iterator[range]:
    """Indices of one or two ranges that stand out from all around them; nan is unknown.

    Behind an edge without echo the spot may see anything farther: no echo counts as far away.
    """
    steps = ranges[1:] - ranges[:-1]
    up, down = ~(steps <= MARGIN), ~(steps >= -MARGIN)  # of nan both, which is UNKNOWN
    kinds = UP * up.view(np.uint8) + DOWN * down.view(np.uint8)
    numbers: list[float] = ranges.tolist()  # a few at a time, plain numbers are faster
    for found in ISLAND.finditer(ENDS + kinds.tobytes() + ENDS):
        first, end = found.start(), found.end() + len(found[1] or found[2] or b"")
        if numbers[first] < NO_ECHO and _stands_out(numbers, first, end):
            yield range(first, end)


def _stands_out(ranges: list[float], first: int, end: int) -> bool:
    """Whether ranges do not lie between their neighbours.

    A wall seen end-on is ragged, and the spot of the beam sees both sides of an edge.
    """
    island = ranges[first:end]
    around = ranges[max(0, first - 2) : first] + ranges[end : end + 2]
    known = [r for r in around if not isnan(r)]
    if not known:
        return True
    return min(island) < min(known) - MARGIN or max(island) > max(known) + MARGIN
