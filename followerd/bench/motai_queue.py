"""What Motai's law is compared with: turns that wait for each other instead of replacing them."""

from collections import deque
from math import radians

from followerd.control.heading_overwrite import HeadingOverwrite, HeadingOverwriteSettings
from followerd.control.interfaces import Scene, Target
from followerd.geometry import wrap_angle
from followerd.messages import LookAt, Measurement, PtzState, TurnBy, Wish

DONE = radians(1.0)
STARTS = 0.3  # s that a head is given to set out


class Queueing(HeadingOverwrite):
    """The same turns, one for each image, each carried out before the next is told."""

    _head_goals: deque[LookAt]
    _headings: deque[float]

    def __init__(self, settings: HeadingOverwriteSettings | None = None) -> None:
        super().__init__(settings)
        self._head_goals, self._headings = deque(), deque()
        self._queued = -1.0  # s, stamp of the newest image whose turn waits
        self._at: PtzState | None = None
        self._told: tuple[LookAt, float] | None = None  # and when, s

    def note(self, measurement: Measurement) -> None:
        """Where the head is."""
        if isinstance(measurement, PtzState):
            self._at = measurement

    def wish(self, target: Target, scene: Scene) -> Wish:
        """See Controller."""
        newest = super().wish(target, scene)
        if not isinstance(newest, TurnBy):
            return newest
        odometry = scene.odometry
        reported = scene.base.theta if odometry is None else odometry.pose.theta
        if self._is_new(scene):
            self._headings.append(reported + newest.angle)
        while len(self._headings) > 1 and abs(wrap_angle(self._headings[0] - reported)) < DONE:
            self._headings.popleft()
        rest = wrap_angle(self._headings[0] - reported) if self._headings else 0.0
        return TurnBy(rest, newest.v)

    def look(self, scene: Scene) -> LookAt | None:
        """See HeadController."""
        newest = super().look(scene)
        if newest is not None and self._is_new(scene):
            self._head_goals.append(newest)
        if self._head_goals and self._is_done(scene.now):
            self._told = self._head_goals.popleft(), scene.now
        return None if self._told is None else self._told[0]

    def _is_new(self, scene: Scene) -> bool:
        if scene.sight is None or scene.sight.stamp <= self._queued:
            return False
        self._queued = scene.sight.stamp
        return True

    def _is_done(self, now: float) -> bool:
        if self._told is None or self._at is None:
            return True
        goal, since = self._told
        there = abs(wrap_angle(self._at.pan - goal.pan)) < DONE and not self._at.moving
        return (there or now - since > STARTS) and not self._at.moving
