"""What one scan telegram holds, by operating mode: which values, measured when, sent how often."""

from dataclasses import dataclass
from math import ceil

from followerd.geometry import Array
from followerd.hw.lms200.protocol import OVERHEAD
from followerd.hw.lms200.telegrams import Reply
from followerd.hw.lms200.variant import ROTATION, Variant, line_time

OTHER_BYTES = {Reply.SCAN: 4, Reply.MEAN: 5, Reply.SUBRANGE: 8, Reply.MEAN_SUBRANGE: 9}


@dataclass(frozen=True, slots=True)
class Sweep:
    """The content of one scan telegram."""

    variant: Variant
    reply: Reply = Reply.SCAN
    turn: int | None = None  # of a partial scan; None = all turns
    samples: int = 1  # scans it is the mean of
    first: int = 1  # number of the first value, from 1
    last: int | None = None  # of the last; None = to the end

    @property
    def period(self) -> float:
        """Seconds from one such sweep to the next."""
        return self.samples * self.variant.scan_time

    @property
    def age(self) -> float:
        """Seconds from the sweep's start to the first byte of its telegram."""
        if self.turn is not None:
            return (self.turn + 0.5) * ROTATION
        return (self.samples - 1) * self.variant.scan_time + self.variant.age

    @property
    def chosen(self) -> slice:
        """Its values among those of a whole scan."""
        if self.turn is not None:
            return slice(self.turn, None, self.variant.rotations)
        return slice(self.first - 1, self.last)

    @property
    def raster(self) -> int:
        """Where its values begin, in quarter degrees after those of a whole scan."""
        return (self.turn or 0) * self.variant.resolution // 25

    @property
    def bearings(self) -> Array:
        """Bearings (N,) of its values from right to left, rad, 0 ahead."""
        return self.variant.bearings[self.chosen]

    @property
    def beam_times(self) -> Array:
        """When each value (N,) is measured, s after the sweep's start; of means, the middle."""
        return self.variant.beam_times[self.chosen] + 0.5 * (self.samples - 1) * (
            self.variant.scan_time
        )

    @property
    def telegram_bytes(self) -> int:
        """Length of its telegram without indices."""
        return 2 * self.bearings.size + OTHER_BYTES[self.reply] + OVERHEAD

    def delivered_period(self, baud: int) -> float:
        """Seconds between streamed telegrams: one occupies whole periods of the mirror.

        Partial scans take turns: the next turn's comes a whole number of scans and one turn later.
        """
        busy = line_time(self.telegram_bytes, baud)
        if self.turn is None:
            return ceil(busy / self.period - 1e-9) * self.period
        scans = ceil((busy - ROTATION) / self.period - 1e-9)
        return max(0, scans) * self.period + ROTATION
