"""Whether a measurement is a new one, or what a stuck device has said before (FAILSAFES F3).

Real sensors are noisy: a scan that is the same to the last bit was not measured anew. What repeats
itself is not used, so its stream goes stale and everything follows from that. Pictures are looked
at where the tracker is (`trackers.looking`).
"""

from math import inf

import numpy as np

from followerd.messages import Measurement, Odometry, Scan, Wish

MOVING = 0.05  # m/s or rad/s: a base that reports this reports other poses too
SENT_FORWARD = 0.1  # m/s
OBEYS_WITHIN = 0.5  # s, from such a command to the first report that it moves


class Novelty:
    """Remembers the newest measurement of each kind."""

    def __init__(self) -> None:
        self.repeated: dict[str, int] = {}  # by kind, in a row
        self._scan: bytes = b""
        self._odometry: Odometry | None = None
        self._sent_since = inf  # s, since when the base has been told to drive

    def is_new(self, measurement: Measurement, wish: Wish | None, now: float) -> bool:
        """Whether it tells anything new; `wish` is what was sent to the wheels last."""
        new = True
        if isinstance(measurement, Scan):
            new = self._is_new_scan(measurement)
        elif isinstance(measurement, Odometry):
            new = self._is_new_report(measurement, wish, now)
        kind = type(measurement).__name__.lower()
        self.repeated[kind] = 0 if new else self.repeated.get(kind, 0) + 1
        return new

    def _is_new_scan(self, scan: Scan) -> bool:
        before, self._scan = self._scan, scan.ranges.tobytes()
        # where nothing at all gives an echo, scans are the same
        return self._scan != before or not np.isfinite(scan.ranges).any()

    def _is_new_report(self, report: Odometry, wish: Wish | None, now: float) -> bool:
        """A standing base says the same for ever; one that drives, or was told to, does not."""
        before, self._odometry = self._odometry, report
        if wish is None or abs(wish.v) < SENT_FORWARD:
            self._sent_since = inf
        else:
            self._sent_since = min(self._sent_since, now)
        if before is None or before.pose != report.pose or any(report.wheel_stall):
            return True
        moves = max(abs(report.twist.v), abs(report.twist.omega)) > MOVING
        return not moves and now - self._sent_since < OBEYS_WITHIN
