"""What an LMS200's turning mirror measures, when, and how it errs.

Error figures: its data sheet, as in protocols/lms200.md section 7.
"""

from math import ceil, exp

import numpy as np

from followerd.geometry import Array, Pose2
from followerd.hw.lms200.scans import ScanTelegram, Unit, words_of
from followerd.hw.lms200.sweep import Sweep
from followerd.hw.lms200.telegrams import Config
from followerd.sim.interfaces import Scene

SIGMA = 0.005  # m, one scan to the next
BEAM_BIAS = 0.004  # m, standard deviation over the beams, constant
WARM_UP_BIAS = 0.010  # m, at most, common to all beams
WARM_UP_TIME = 1800.0  # s
NO_RETURN = 0.001  # share of beams
LONGEST = 20.0  # m, on surfaces of some 40 % remission
SPOT, DIVERGENCE = 0.010, 0.0044  # m at the window, m per m
EDGE = 0.10  # m between neighbouring beams that makes an edge
QUARTER_DEGREE = np.radians(0.25)


class Scanner:
    """The mirror turns evenly from `turning_since`; scans are computed when asked for."""

    def __init__(
        self,
        scene: Scene,
        rng: np.random.Generator,
        base_from_laser: Pose2,
        *,
        upside_down: bool = False,
    ) -> None:
        self.turning_since = 0.0  # s
        self.dazzled: tuple[float, float] | None = None  # rad, between which bearings
        self._scene = scene
        self._noise = RangeNoise(rng)
        self._base_from_laser = base_from_laser
        self._side = -1.0 if upside_down else 1.0

    def next_complete(self, after: float, sweep: Sweep) -> float:
        """When the first such sweep is complete at or after `after`."""
        first = self.turning_since + sweep.age
        return first + ceil((after - first) / sweep.period - 1e-6) * sweep.period

    def measure(
        self, sweep: Sweep, complete: float, now: float, config: Config, status: int, number: int
    ) -> ScanTelegram:
        """The sweep that was complete at `complete`, as telegram `number` of its stream."""
        bearings = self._side * sweep.bearings
        started = complete - sweep.age
        ages = now - started - sweep.beam_times
        self._scene.advance(now)
        true = self._scene.ranges(self._base_from_laser, bearings, ages)
        uptime = now - self.turning_since
        ranges = self._noise.added(true, bearings, uptime, sweep.samples)
        if self.dazzled is not None:
            ranges[(self.dazzled[0] <= bearings) & (bearings <= self.dazzled[1])] = np.nan
        unit = Unit(config.unit)
        scans = round((started - self.turning_since) / sweep.variant.scan_time) + sweep.samples - 1
        return ScanTelegram(
            words_of(ranges, config.measuring_mode, unit),
            unit,
            sweep.reply,
            partial=sweep.turn is not None,
            raster=sweep.raster,
            samples=sweep.samples,
            first=sweep.first,
            indices=(scans & 0xFF, number & 0xFF) if config.has_indices else None,
            status=status,
        )


class RangeNoise:
    """The errors of one device, drawn from `rng`."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._beam_bias = rng.normal(0.0, BEAM_BIAS, 721)  # by quarter degree
        self._warm_up_bias = rng.uniform(-WARM_UP_BIAS, WARM_UP_BIAS)

    def added(self, ranges: Array, bearings: Array, uptime: float, samples: int = 1) -> Array:
        """Measured ranges (N,) in m for the true ones; inf = no echo. `samples` are averaged."""
        n = ranges.size
        true = np.minimum(ranges, 2 * LONGEST)
        measured = self._mixed(true, bearings)
        measured[measured > LONGEST] = np.inf
        quarters = np.rint((bearings + np.pi / 2) / QUARTER_DEGREE).astype(np.intp)
        measured += self._beam_bias[quarters]
        measured += self._warm_up_bias * exp(-uptime / WARM_UP_TIME)
        measured += self._rng.standard_normal(n) * (SIGMA / samples**0.5)
        measured[self._rng.random(n) < NO_RETURN] = np.inf
        return np.maximum(measured, 0.0)

    def _mixed(self, true: Array, bearings: Array) -> Array:
        """Where the spot covers both sides of a depth edge, the range lies between."""
        n = true.size
        chance, side, share = self._rng.random((3, n))
        before, after = np.empty(n), np.empty(n)
        before[0], before[1:] = true[0], true[:-1]
        after[:-1], after[-1] = true[1:], true[-1]
        other = np.where(side < 0.5, before, after)
        spacing = abs(bearings[-1] - bearings[0]) / max(1, n - 1) * true
        mixed = chance * np.maximum(spacing, 1e-3) < SPOT + DIVERGENCE * true
        mixed &= (np.abs(other - true) > EDGE) & (other < LONGEST)
        ranges: Array = np.where(mixed, true + share * (other - true), true)
        return ranges
