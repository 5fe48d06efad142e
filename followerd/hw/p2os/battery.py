"""From a voltage that sags with every start of the motors to what the battery allows."""

from collections import deque
from math import exp, isfinite
from statistics import median

from followerd.hw.p2os.parameters import VOLTS
from followerd.messages import BatteryLevel

MEDIAN = 5  # readings: a damaged packet or two say nothing
SMOOTHING = 5.0  # s; a start of the motors says nothing
SPREAD = 0.5  # V between the low and the shutdown voltage, where only one is known
NEAR = 0.2  # V above the shutdown voltage where the robot stops
REBOUND = 0.5  # V that a battery recovers at rest without holding more


class BatteryGauge:
    """Levels of a voltage; `low` and `shutdown` in V, nan where they are not known.

    A level once reached is left only when the voltage has risen well above it.
    """

    def __init__(self, low: float, shutdown: float) -> None:
        self.level = BatteryLevel.UNKNOWN
        shutdown = shutdown if isfinite(shutdown) else low - SPREAD
        low = low if low > shutdown + NEAR else shutdown + SPREAD
        empty = shutdown + NEAR
        self._thresholds = (
            (BatteryLevel.EMPTY, empty),
            (BatteryLevel.WEAK, (empty + low) / 2),
            (BatteryLevel.LOW, low),
        )
        self._newest: deque[float] = deque(maxlen=MEDIAN)
        self._smooth = 0.0  # V
        self._stamp = 0.0

    def update(self, volts: float, stamp: float) -> BatteryLevel:
        """The level at `stamp`, with a new reading."""
        if not VOLTS[0] <= volts <= VOLTS[1] or not isfinite(self._thresholds[0][1]):
            return self.level
        self._newest.append(volts)
        if len(self._newest) < MEDIAN:
            return self.level
        known = self.level is not BatteryLevel.UNKNOWN
        share = 1.0 - exp((self._stamp - stamp) / SMOOTHING) if known else 1.0
        self._smooth += share * (median(self._newest) - self._smooth)
        self._stamp = stamp
        self.level = self._level()
        return self.level

    def _level(self) -> BatteryLevel:
        was_reached = False
        for level, threshold in self._thresholds:
            was_reached = was_reached or self.level is level
            if self._smooth <= threshold + (REBOUND if was_reached else 0.0):
                return level
        return BatteryLevel.GOOD
