"""A person walks about before a robot that stands still: what laser and camera saw, in pairs."""

from bisect import bisect_left
from collections.abc import Callable
from math import hypot

from followerd.estimation.mount import Pair
from followerd.hw.interfaces import Sensor
from followerd.messages import Image, Measurement, Scan
from followerd.perception.movers import Legs, StillImage, StillScan
from followerd.runtime.watching import watch

IMAGE_PERIOD, SCAN_PERIOD = 0.2, 0.05  # s, between those that are kept
STILL = 3  # of so many, one is looked at to know what stands still
TOGETHER = 0.08  # s, an image and a scan that show the same
AROUND = 0.4  # s before and after, that tell where a person walks to
WALKS = 0.08  # m in that time; who goes less stands


class MountSession:
    """Keeps what laser and camera deliver; `pairs` is what came of it."""

    def __init__(self, laser: Sensor, camera: Sensor) -> None:
        self.images: list[Image] = []
        self.scans: list[Scan] = []
        self._sensors = (laser, camera)

    async def watch(self, seconds: float, tell: Callable[[float], None]) -> None:
        """Watch for `seconds` from when both deliver; see `watching.watch`."""
        await watch(self._sensors, self._take, self._begins, seconds, tell)

    def pairs(self) -> list[Pair]:
        """One person, seen by both at the same time."""
        if not (self.images and self.scans):
            return []
        image = StillImage([image.pixels for image in self.images[::STILL]])
        scan = StillScan(self.scans[::STILL])
        legs = [scan.legs(each) for each in self.scans]
        stamps = [each.stamp + float(each.beam_times.mean()) for each in self.scans]
        pairs = []
        for seen in self.images:
            at = _nearest(stamps, seen.stamp)
            who, silhouette = legs[at], image.silhouette(seen.pixels)
            if who is None or silhouette is None or abs(stamps[at] - seen.stamp) > TOGETHER:
                continue
            before = legs[_nearest(stamps, seen.stamp - AROUND)]
            after = legs[_nearest(stamps, seen.stamp + AROUND)]
            pairs.append(
                Pair(
                    who.nearest,
                    who.middle if who.count == 2 else None,
                    silhouette.column,
                    silhouette.row,
                    silhouette.foot,
                    _approach(before, after),
                )
            )
        return pairs

    def _take(self, measurement: Measurement) -> None:
        if isinstance(measurement, Image):
            if not self.images or measurement.stamp >= self.images[-1].stamp + IMAGE_PERIOD:
                self.images.append(measurement)
        elif isinstance(measurement, Scan) and (
            not self.scans or measurement.stamp >= self.scans[-1].stamp + SCAN_PERIOD
        ):
            self.scans.append(measurement)

    def _begins(self) -> bool:
        return bool(self.images and self.scans)


def _nearest(stamps: list[float], stamp: float) -> int:
    """Index of the stamp next to `stamp`."""
    after = bisect_left(stamps, stamp)
    candidates = range(max(0, after - 1), min(len(stamps), after + 1))
    return min(candidates, key=lambda i: abs(stamps[i] - stamp))


def _approach(before: Legs | None, after: Legs | None) -> float:
    """How much the way leads to the robot: 1 straight to it, -1 away; 0 also for who stands."""
    if before is None or after is None:
        return 0.0
    (x, y), (x0, y0) = after.middle, before.middle
    went = hypot(x - x0, y - y0)
    if went < WALKS:
        return 0.0
    return -((x - x0) * x + (y - y0) * y) / went / max(hypot(x, y), 1e-6)
