"""Kwolek's follow law: keep 1.6 m from the person, and their head in the middle of the image.

A PD law with insensitivity zones (Kwolek 2004, section 6). The camera may look anywhere along the
robot's axis: where it looks back the robot leads, and the person walks behind it.
"""

from math import copysign, cos, radians, sin
from typing import Literal

from pydantic import Field

from followerd.control.interfaces import Scene, Target
from followerd.geometry import wrap_angle
from followerd.messages import Twist
from followerd.settings import Settings


class DistancePdSettings(Settings):
    """`paper` drives at 0.25 m/s at most, and knows nothing of the person's speed."""

    profile: Literal["paper", "default"] = "default"
    distance_m: float = Field(1.6, gt=0.5, description="kept to the person")
    mount_yaw_deg: float = Field(
        0.0, ge=-180, le=180, description="of the camera: 0 looks ahead, 180 back"
    )
    distance_zone_m: float = Field(0.08, ge=0, description="error that is let be")
    bearing_zone_deg: float = Field(2.3, ge=0, description="same, of the direction")
    restart: float = Field(1.5, ge=1, description="zones that an error must leave to count again")
    distance_gain_per_s: float = Field(1.2, gt=0, description="speed per metre")
    distance_damping: float = Field(0.25, ge=0, lt=1, description="speed per m/s of its change")
    bearing_gain_per_s: float = Field(1.8, gt=0, description="turn rate per radian")
    bearing_damping: float = Field(0.15, ge=0, lt=1, description="turn rate per rad/s")
    lead: float = Field(0.8, ge=0, le=1, description="share of the person's speed fed forward")
    stroll_mps: float = Field(0.1, ge=0, description="slower persons are taken to stand")
    max_approach_mps: float = Field(0.8, gt=0, description="towards the person")
    max_retreat_mps: float = Field(
        0.15, ge=0, description="away from the person; more only where the laser looks that way"
    )
    max_turn_degps: float = Field(57.0, gt=0, description="fastest turn")


PAPER_SPEED = 0.25  # m/s


class Zone:
    """An error that counts from the zone's edge on: no jump where it leaves the zone slowly.

    Once inside, it must leave the zone by more to count again, or the robot would chatter.
    """

    def __init__(self, half: float, restart: float) -> None:
        """`half` its half width."""
        self.half = half
        self._restart = restart
        self.acts = False  # the error counts

    def beyond(self, error: float) -> float:
        """What of the error lies outside."""
        self.acts = abs(error) > (self.half if self.acts else self._restart * self.half)
        return copysign(abs(error) - self.half, error) if self.acts else 0.0


class DistancePd:
    """Turn to the person, keep the distance."""

    Settings = DistancePdSettings

    def __init__(self, settings: DistancePdSettings | None = None) -> None:
        self.settings = s = settings or DistancePdSettings()
        self._distance = Zone(s.distance_zone_m, s.restart)
        self._bearing = Zone(radians(s.bearing_zone_deg), s.restart)

    def wish(self, target: Target, scene: Scene) -> Twist:
        """The motion that follows `target`; no speed without a range."""
        s = self.settings
        paper, mount = s.profile == "paper", radians(s.mount_yaw_deg)
        off = wrap_angle(target.bearing - mount)
        omega = s.bearing_gain_per_s * self._bearing.beyond(off)
        if target.range is None:
            return Twist(0.0, self._turn(omega))
        c, w = cos(target.bearing), sin(target.bearing)
        vx, vy = target.velocity
        along, parting = c * vx + w * vy, c * (vx - scene.twist.v) + w * vy
        passing = (c * vy - w * (vx - scene.twist.v)) / max(target.range, 0.5)
        if self._bearing.acts:
            omega += s.bearing_damping * (passing - scene.twist.omega)
        speed = s.distance_gain_per_s * self._distance.beyond(target.range - s.distance_m)
        if self._distance.acts:
            speed += s.distance_damping * parting
        if not paper and abs(along) > s.stroll_mps:
            speed += s.lead * along
        fastest = PAPER_SPEED if paper else s.max_approach_mps
        speed = min(max(speed, -min(s.max_retreat_mps, fastest)), fastest)
        # nobody is served by driving past someone who stands beside the camera's view
        return Twist(cos(mount) * max(0.0, cos(off)) * speed, self._turn(omega))

    def _turn(self, omega: float) -> float:
        limit = radians(self.settings.max_turn_degps)
        return min(max(omega, -limit), limit)
