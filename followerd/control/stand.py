"""The guard of a robot on a stand: what `followerd drive-check` may let its wheels do.

The guard proper lets nothing roll forward but towards a person at a known distance, through free
space that the laser sees, with a camera that sees too. A robot whose wheels hang above a bench has
none of that, and to feed the guard a made-up person and an empty hall would be a lie that a bug
could tell on the road. So its rules stay whole and have no switch, and this is another guard, which
the daemon cannot reach. It knows of no obstacle; in return it allows so little, in speed and in
distance from where it began, that wheels which touch the floor after all do no harm.
"""

from math import hypot, inf, radians

from pydantic import Field

from followerd.control.plausible import is_finite_wish, is_plausible_odometry
from followerd.geometry import Pose2, wrap_angle
from followerd.messages import Command, Odometry, Reason, StopReason, Twist
from followerd.settings import Settings
from followerd.streams import STREAMS


class StandSettings(Settings):
    """How little a robot on a stand may do."""

    max_speed_mps: float = Field(0.1, gt=0, le=0.15)
    max_turn_degps: float = Field(20.0, gt=0, le=30)
    reach_m: float = Field(0.4, gt=0, le=0.5, description="from where it began, in a line")
    reach_deg: float = Field(120.0, gt=0, le=180, description="turned from where it began")
    valid_s: float = Field(0.25, gt=0, le=0.25, description="of a command without a newer one")


class StandGuard:
    """Makes the commands of `drive-check`; what stops it once stops it for good."""

    def __init__(self, settings: StandSettings | None = None) -> None:
        self.settings = settings or StandSettings()
        self._newest: Odometry | None = None
        self._began: Pose2 | None = None
        self._latched: Reason | None = None

    def begin(self) -> None:
        """A person has said that the wheels are up: from here it may go as far as it may."""
        self._began = None if self._newest is None else self._newest.pose

    def sense(self, odometry: Odometry) -> None:
        """Take a base report."""
        self._newest = odometry
        self._latched = self._latched or self._forbidding(odometry)

    def check(self, wish: Twist, now: float) -> Command:
        """The command for `wish`: capped, good for a moment, or a stop with its reason."""
        s, newest = self.settings, self._newest
        age = inf if newest is None else now - newest.stamp
        reason = self._latched
        if self._began is None:
            reason = Reason(StopReason.DISARMED, "", "nobody has said that the wheels are up")
        elif not 0.0 <= age <= STREAMS["odometry"].stale_after:
            reason = Reason(StopReason.ODOMETRY_STALE, "base")
        elif not is_finite_wish(wish):
            reason = Reason(StopReason.ABSURD_DATA, "wish")
        if reason is not None:
            return Command(now, reasons=(reason,))
        turn = radians(s.max_turn_degps)
        motion = Twist(_within(wish.v, s.max_speed_mps), _within(wish.omega, turn))
        return Command(now, motion, now + s.valid_s)

    def _forbidding(self, odometry: Odometry) -> Reason | None:
        s = self.settings
        if not is_plausible_odometry(odometry):
            return Reason(StopReason.ABSURD_DATA, "base")
        if any(odometry.wheel_stall):
            return Reason(StopReason.WHEEL_STALL, "base")
        if odometry.bumpers_front or odometry.bumpers_rear:
            return Reason(StopReason.BUMPER, "base")
        if odometry.stop_button:
            return Reason(StopReason.STOP_BUTTON, "base")
        moved = Pose2() if self._began is None else ~self._began @ odometry.pose
        turned = abs(wrap_angle(moved.theta))
        if hypot(moved.x, moved.y) > s.reach_m or turned > radians(s.reach_deg):
            return Reason(StopReason.LIMIT, "base", "farther from where it began than it may")
        return None


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
