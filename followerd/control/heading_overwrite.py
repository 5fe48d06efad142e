"""Motai's follow law: every image replaces the turn that is still pending (2012, eq. 20).

The turn goes to where the person will be when it takes effect. It is an absolute heading of the
base, an absolute pan of the camera's head, or a turn rate; so nothing adds up, however often it is
replaced. The paper's own relative turns do add up on a Pioneer: `profile: paper` shows it.
"""

from math import copysign, cos, radians
from typing import Literal

from pydantic import Field

from followerd.control.interfaces import Scene, Target
from followerd.geometry import wrap_angle
from followerd.messages import LookAt, TurnBy, Twist, Wish
from followerd.settings import Settings

RATE_OVER = 0.1  # s, over which the person's turn rate is foreseen
DOUBTED = radians(3.0)  # of a sight from where the person is held to be
LEAN = 0.6  # share of the way to it


class HeadingOverwriteSettings(Settings):
    """`paper` adds each image's remaining turn to the base's own goal (DHEAD)."""

    profile: Literal["paper", "default"] = "default"
    turn: Literal["heading", "rate"] = Field(
        "heading", description="heading: the base's own controller turns it; rate: this one"
    )
    head: bool = Field(
        False,
        description="a pan-tilt head takes the fast part, the base turns so that it comes back to"
        " its middle",
    )
    tilt_deg: float = Field(0.0, ge=-30, le=90, description="of the head")
    doubt_deg: float = Field(
        8.0, ge=0, le=20, description="the head leans so far at most to a sight that is doubted"
    )
    dead_band_deg: float = Field(0.5, ge=0, le=20, description="smaller turns are left out")
    latency_s: float = Field(0.12, ge=0, le=0.5, description="until the base begins to turn")
    head_latency_s: float = Field(0.1, ge=0, le=0.5, description="until the head gets there")
    brake_degps2: float = Field(100.0, gt=0, description="with which the base ends its turns")
    turn_gain_per_s: float = Field(3.0, gt=0, description="turn rate per radian, of `rate`")
    max_turn_degps: float = Field(57.0, gt=0, description="fastest turn of `rate`")
    base_gain_per_s: float = Field(1.2, gt=0, description="of a base below a head that turns")
    base_band_deg: float = Field(4.0, ge=0, description="of the head, within which the base rests")
    distance_m: float = Field(1.5, gt=0, description="kept to the person")
    distance_band_m: float = Field(0.1, ge=0, description="half band around it without driving")
    distance_gain_per_s: float = Field(0.9, gt=0, description="speed per metre")
    lead: float = Field(0.9, ge=0, le=1.2, description="share of the person's speed fed forward")
    max_forward_mps: float = Field(0.8, gt=0)
    turn_only: bool = Field(False, description="never forward")


class HeadingOverwrite:
    """Turns base and head to where the person will be. See control.interfaces.HeadController."""

    Settings = HeadingOverwriteSettings

    def __init__(self, settings: HeadingOverwriteSettings | None = None) -> None:
        self.settings = settings or HeadingOverwriteSettings()
        self._looked: LookAt | None = None
        self._added: tuple[float, float] | None = None  # stamp of an image, rad: `paper`

    def wish(self, target: Target, scene: Scene) -> Wish:
        """The motion that follows `target`."""
        s, v = self.settings, self._speed(target)
        if s.profile == "paper":
            return TurnBy(self._remaining(scene), v, added=True)
        if s.head:
            return Twist(v, self._beneath(target, scene))
        if s.turn == "rate":
            return Twist(v, self._rate(target, scene))
        return TurnBy(self._to_heading(target, scene), v)

    def look(self, scene: Scene) -> LookAt | None:
        """The pan at which the head will see the person when it gets there; None = as before.

        It keeps pace with the base's turn but not with the person's: so it comes a little late on a
        steady turn, and is nearer when they turn back.
        """
        s = self.settings
        later, band = s.head_latency_s, radians(s.dead_band_deg)
        direction = scene.foresee(scene.now + later)
        if not s.head or direction is None:
            return None
        turning = scene.twist.omega
        pan = wrap_angle(direction + self._lean(scene) - scene.base.theta - turning * later)
        if self._looked is not None and abs(wrap_angle(pan - self._looked.pan)) <= band:
            return self._looked
        self._looked = LookAt(pan, radians(s.tilt_deg), -turning)
        return self._looked

    def _lean(self, scene: Scene) -> float:
        """Towards a newest sight that is not believed: between both, neither is out of view."""
        seen = scene.sight
        believed = None if seen is None else scene.foresee(seen.stamp)
        if seen is None or believed is None:
            return 0.0
        aside = wrap_angle(seen.pan - believed)
        if abs(aside) <= DOUBTED:
            return 0.0
        return _within(LEAN * aside, radians(self.settings.doubt_deg))

    def _to_heading(self, target: Target, scene: Scene) -> float:
        """The turn from the newest report's heading.

        The base brakes into its goal; on one that moves it would come late by its braking angle.
        """
        s = self.settings
        ahead, rate = self._ahead(target, scene, s.latency_s)
        ahead += 0.5 * rate * abs(rate) / radians(s.brake_degps2)
        if abs(ahead) <= radians(s.dead_band_deg):
            ahead = 0.0
        reported = scene.base.theta if scene.odometry is None else scene.odometry.pose.theta
        return ahead + wrap_angle(scene.base.theta - reported)

    def _rate(self, target: Target, scene: Scene) -> float:
        s = self.settings
        ahead, rate = self._ahead(target, scene, s.latency_s)
        turned = ahead - scene.twist.omega * s.latency_s  # what is under way needs no turn
        return _within(
            s.turn_gain_per_s * self._beyond(turned, s.dead_band_deg) + rate,
            radians(s.max_turn_degps),
        )

    def _beneath(self, target: Target, scene: Scene) -> float:
        """Slowly, for the head has the fast part."""
        s = self.settings
        ahead, _ = self._ahead(target, scene, 0.0)
        omega = s.base_gain_per_s * self._beyond(ahead, s.base_band_deg)
        return _within(omega, radians(s.max_turn_degps))

    def _remaining(self, scene: Scene) -> float:
        """beta = theta - alpha (eq. 20), once an image: alpha by the newest report."""
        seen = scene.sight
        reported = scene.base.theta if scene.odometry is None else scene.odometry.pose.theta
        if seen is None:
            return 0.0
        if self._added is None or self._added[0] != seen.stamp:
            direction = scene.foresee(scene.now + self.settings.latency_s)
            beta = 0.0 if direction is None else wrap_angle(direction - reported)
            self._added = seen.stamp, beta
        return self._added[1]

    def _ahead(self, target: Target, scene: Scene, later: float) -> tuple[float, float]:
        """Turn from the heading now to where the person will be, and their turn rate, rad."""
        direction = scene.foresee(scene.now + later)
        before = scene.foresee(scene.now + later - RATE_OVER)
        if direction is None or before is None:
            return target.bearing, 0.0
        return wrap_angle(direction - scene.base.theta), (direction - before) / RATE_OVER

    def _beyond(self, angle: float, band_deg: float) -> float:
        return copysign(max(0.0, abs(angle) - radians(band_deg)), angle)

    def _speed(self, target: Target) -> float:
        """Forward only, and only towards a person at a known distance."""
        s = self.settings
        if s.turn_only or target.range is None:
            return 0.0
        off = target.range - s.distance_m
        off = copysign(max(0.0, abs(off) - s.distance_band_m), off)
        along = cos(target.bearing) * target.velocity[0]
        v = s.distance_gain_per_s * off + s.lead * max(0.0, along)
        return min(max(0.0, v), s.max_forward_mps) * max(0.0, cos(target.bearing))


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
