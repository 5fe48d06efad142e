"""Scripts that drive the robot of a ride: by the truth, by the track, or not at all."""

from dataclasses import dataclass, field
from math import copysign, radians

import numpy as np

from followerd.control.image_centering import ImageCentering
from followerd.control.interfaces import Target
from followerd.geometry import Pose2
from followerd.messages import TrackPhase, TrackState, Twist
from followerd.sim.truth import Truth

KEEP_AWAY = 1.8  # m; no scripted robot drives nearer to the person


class Stand:
    """The robot stands."""

    def wish(self, truth: Truth, track: TrackState | None, ego: Pose2 | None) -> Twist:
        """Standstill."""
        del truth, track, ego
        return Twist()


@dataclass
class BangBang:
    """Full turns left and right in irregular turns, the person kept within a cone (S3)."""

    rng: np.random.Generator
    rate: float = radians(60.0)  # rad/s
    hold: tuple[float, float] = (0.2, 0.6)  # s between two switches
    cone: float = radians(12.0)  # with the base's latency the person stays within 15 degrees
    speed: float = 0.4  # m/s
    _omega: float = field(default=0.0, init=False)
    _switch_at: float = field(default=0.0, init=False)

    def wish(self, truth: Truth, track: TrackState | None, ego: Pose2 | None) -> Twist:
        """The present turn; switched when its time is over or the person leaves the cone."""
        del track, ego
        bearing = truth.target.bearing
        strays = abs(bearing) > self.cone and self._omega * bearing <= 0.0
        if strays or truth.stamp >= self._switch_at:
            side = bearing if abs(bearing) > self.cone else -self._omega or 1.0
            self._omega = copysign(self.rate, side)
            self._switch_at = truth.stamp + self.rng.uniform(*self.hold)
        return Twist(_forward(truth, self.speed), self._omega)


@dataclass
class Chaperon:
    """Calmly behind the person, by the truth: the same ride for every tracker (S4)."""

    speed: float = 0.4  # m/s
    gain: float = 1.5  # 1/s

    def wish(self, truth: Truth, track: TrackState | None, ego: Pose2 | None) -> Twist:
        """Toward the person."""
        del track, ego
        return Twist(_forward(truth, self.speed), self.gain * truth.target.bearing)


@dataclass
class Follow:
    """Zhuang's law on the track; `turn_only` is his fixating robot (S1), else S2."""

    turn_only: bool = False
    law: ImageCentering = field(default_factory=ImageCentering)

    def wish(self, truth: Truth, track: TrackState | None, ego: Pose2 | None) -> Twist:
        """The law's motion; none without a track."""
        del truth
        target = seen(track, ego)
        if target is None:
            return Twist()
        wish = self.law.wish(target)
        return Twist(0.0, wish.omega) if self.turn_only else wish


def seen(track: TrackState | None, ego: Pose2 | None) -> Target | None:
    """What a follow law is told of a track; an occluded one has no range."""
    if track is None or track.bearing is None or track.phase is TrackPhase.LOST:
        return None
    if track.phase is TrackPhase.OCCLUDED:
        return Target(track.bearing)
    if track.velocity is None or ego is None:
        return Target(track.bearing, track.range)
    along_base = Pose2(theta=-ego.theta).apply_point(*track.velocity)
    return Target(track.bearing, track.range, along_base)


def _forward(truth: Truth, speed: float) -> float:
    return speed if truth.target.distance > KEEP_AWAY else 0.0
