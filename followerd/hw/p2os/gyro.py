"""Turn rate from a rate gyro whose resting value drifts with its temperature."""

from math import nan, radians
from statistics import fmean

from followerd.hw.p2os.packets import GYRO_MEAN, Gyro

COUNTS = 1023  # of the converter; more is no sample
LEARNING = 0.02  # share of a sample taken into the resting value while the robot stands
DRIFT = 60  # counts from the nominal resting value, at most


class GyroRate:
    """Collects GYROpacs between status packets, and learns the resting value at standstill."""

    def __init__(self) -> None:
        self._mean = float(GYRO_MEAN)  # counts at rest
        self._rates: list[float] = []  # deg/s

    def add(self, gyro: Gyro, standing: bool) -> None:
        """Take the samples since the last status packet, unless they are none."""
        if any(rate > COUNTS for rate, _ in gyro.samples):
            return
        if standing:
            for rate, _ in gyro.samples:
                self._mean += LEARNING * (rate - self._mean)
            self._mean = min(max(self._mean, GYRO_MEAN - DRIFT), GYRO_MEAN + DRIFT)
        self._rates += gyro.rates(self._mean)

    def take(self) -> float:
        """Mean turn rate since the last call, rad/s, left positive; nan when nothing came."""
        rate = radians(fmean(self._rates)) if self._rates else nan
        self._rates.clear()
        return rate
