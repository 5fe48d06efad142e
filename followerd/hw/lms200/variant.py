"""What the scanner sweeps: field of view and resolution, and the timing that follows.

The mirror turns at 75 Hz and measures at whole degrees; finer scans interlace several turns,
each started a raster step later.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from followerd.geometry import Array

ROTATION = 1 / 75  # s
BITS_PER_BYTE = 10  # on the line: start, 8 data, stop


def line_time(count: int, baud: int) -> float:
    """Seconds that `count` bytes take."""
    return count * BITS_PER_BYTE / baud


@dataclass(frozen=True)
class Variant:
    """Field and resolution as the device names them."""

    field: int  # deg, centred on straight ahead
    resolution: int  # 1/100 deg

    @property
    def count(self) -> int:
        """Values in a whole scan."""
        return self.field * 100 // self.resolution + 1

    @property
    def rotations(self) -> int:
        """Turns of the mirror that make a whole scan."""
        return 100 // self.resolution

    @property
    def scan_time(self) -> float:
        """Seconds from one whole scan to the next."""
        return self.rotations * ROTATION

    @property
    def age(self) -> float:
        """Seconds from a scan's start to the first byte of its telegram.

        Interlaced scans take their whole time, a single turn only the half that sees.
        """
        return self.scan_time if self.rotations > 1 else 0.5 * ROTATION

    @cached_property
    def bearings(self) -> Array:
        """Bearings (N,) in the order of the values, from right to left, rad, 0 ahead."""
        bearings: Array = np.radians(
            np.arange(self.count) * (self.resolution / 100) - self.field / 2
        )
        return bearings

    @cached_property
    def turns(self) -> Array:
        """The turn (N,), 0 first, in which each value is measured."""
        return np.arange(self.count, dtype=np.float64) % self.rotations

    @cached_property
    def beam_times(self) -> Array:
        """When each value (N,) is measured, s after the scan's start (mirror at -90 deg)."""
        sweep = (self.bearings + np.pi / 2) / (2 * np.pi)
        times: Array = (self.turns + sweep) * ROTATION
        return times


VARIANTS = tuple(
    Variant(field, resolution)
    for field, resolution in ((180, 50), (180, 100), (100, 100), (100, 50), (100, 25))
)
