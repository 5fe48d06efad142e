"""One table: every stream with its type, nominal rate, and what happens when it goes stale."""

from dataclasses import dataclass
from enum import Enum

from followerd.messages import Image, Odometry, Scan, StopReason


class OnStale(Enum):
    """Consequence of stale data."""

    STOP = "stop"  # stop, go on by itself when the data is fresh again
    DISARM = "disarm"  # stop, and the operator must arm again


@dataclass(frozen=True, slots=True)
class Stream:
    """What a stream promises."""

    type: type
    stale_after: float  # s since it was measured, at most; the app lowers it to the device's rate
    on_stale: OnStale
    reason: StopReason
    under_way: float = 0.0  # s that it may be older while the next one is seen to come


STREAMS = {
    "scan": Stream(Scan, 0.40, OnStale.STOP, StopReason.SCAN_STALE),
    "image": Stream(Image, 0.30, OnStale.STOP, StopReason.IMAGE_STALE),
    "odometry": Stream(Odometry, 0.32, OnStale.DISARM, StopReason.ODOMETRY_STALE, 0.09),
}
