"""The work of a tracker of scans: short, so in the loop, each scan at once."""

from collections import deque
from collections.abc import Callable

from followerd import clock
from followerd.events import Tracked
from followerd.messages import Box, Image, RobotPose, Scan, TrackState
from followerd.record.journal import Enrolled
from followerd.trackers.sweeping import Sweeping

KEPT = 100_000  # durations; a daemon runs for weeks


class Scanning:
    """Feeds scans to a tracker; its results are delivered at once."""

    def __init__(
        self,
        sweeping: Sweeping,
        deliver: Callable[[Tracked], object],
        consumed: Callable[[Enrolled], None],
    ) -> None:
        self._sweeping = sweeping
        self._deliver = deliver
        self._consumed = consumed
        self.courses = sweeping.courses
        self.step_times: deque[float] = deque(maxlen=KEPT)  # s

    def take(self, scan: Scan, pose: RobotPose | None) -> None:
        """Track one more scan; `pose` is the robot's at it."""
        began = clock.now()
        track = self._sweeping.take(scan, pose)
        if not clock.is_virtual():
            self.step_times.append(clock.now() - began)
        if track is not None:
            self._deliver(Tracked(scan.stamp, scan.received, None, track))

    def enrol(self, region: Box | tuple[float, float], image: Image | None) -> TrackState:
        """Enrol who stands at a point (m, `base`), or in a `region` (px) of an `image`.

        Raises UsageError when nobody does.
        """
        self._consumed(Enrolled(clock.now(), None if image is None else image.id, region))
        scan, state = self._sweeping.enrol(region, image)
        self._deliver(Tracked(scan.stamp, scan.received, None, state))
        return state
