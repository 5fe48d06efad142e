"""Kwolek's follow law: keep 1.6 m from the person, and their head in the middle of the image.

A PD law with insensitivity zones (Kwolek 2004, section 6). The camera may look anywhere along the
robot's axis: where it looks back the robot leads, and the person walks behind it.
"""

from math import atan2, copysign, cos, exp, hypot, pi, radians, sin
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
    ahead: float = Field(
        2.5, ge=0, description="turn back before a person who comes after the robot, per angle off"
    )
    ahead_most_deg: float = Field(25.0, ge=0, lt=60, description="that the person is let aside")
    stroll_mps: float = Field(0.1, ge=0, description="slower persons are taken to stand")
    max_approach_mps: float = Field(0.8, gt=0, description="towards the person")
    max_retreat_mps: float = Field(
        0.15, ge=0, description="away from the person; more only where the laser looks that way"
    )
    max_turn_degps: float = Field(57.0, gt=0, description="fastest turn")


PAPER_SPEED = 0.25  # m/s
WAY, FORGOTTEN = 1.0, 1.0  # m, s: over which the person's way is found, after which it is unknown


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


class Way:
    """Where a person walks to, over their last metre: one look at their speed is too rough."""

    def __init__(self) -> None:
        self._walked = (0.0, 0.0)  # m in `odom`, older steps count less
        self._at: float | None = None  # s

    def after(self, velocity: tuple[float, float], scene: Scene) -> float:
        """Its direction in `base`, rad, once they walk at `velocity` (m/s, in `base`) now."""
        c, w = cos(scene.base.theta), sin(scene.base.theta)
        vx, vy = c * velocity[0] - w * velocity[1], w * velocity[0] + c * velocity[1]
        since = 0.0 if self._at is None else scene.now - self._at
        x, y = self._walked if since < FORGOTTEN else (0.0, 0.0)
        self._at, since = scene.now, min(max(since, 1e-3), FORGOTTEN)
        left = exp(-hypot(vx, vy) * since / WAY)
        self._walked = left * x + since * vx, left * y + since * vy
        return wrap_angle(atan2(self._walked[1], self._walked[0]) - scene.base.theta)


class DistancePd:
    """Turn to the person, keep the distance."""

    Settings = DistancePdSettings

    def __init__(self, settings: DistancePdSettings | None = None) -> None:
        self.settings = s = settings or DistancePdSettings()
        self._distance = Zone(s.distance_zone_m, s.restart)
        self._bearing = Zone(radians(s.bearing_zone_deg), s.restart)
        self._way = Way()

    def wish(self, target: Target, scene: Scene) -> Twist:
        """The motion that follows `target`; no speed without a range."""
        s = self.settings
        paper, mount = s.profile == "paper", radians(s.mount_yaw_deg)
        off = wrap_angle(target.bearing - mount)
        back = 0.0 if paper or target.range is None else self._back_before(target, scene)
        omega = s.bearing_gain_per_s * self._bearing.beyond(off - back)
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

    def _back_before(self, target: Target, scene: Scene) -> float:
        """How far (rad) to look past a person who comes after the robot.

        Driving straight away from somebody who walks their own way at u sends the robot to their
        side: seen from them at an angle a to that way and a distance r, a' = u/r sin a. Turning
        by more than a across the way makes it -(ahead - 1) u/r a.
        """
        s = self.settings
        way = self._way.after(target.velocity, scene)
        vx, vy = target.velocity
        coming = -(cos(target.bearing) * vx + sin(target.bearing) * vy)
        if coming <= s.stroll_mps:
            return 0.0
        aside = wrap_angle(target.bearing + pi - way)
        most = radians(s.ahead_most_deg)
        return min(max(s.ahead * aside, -most), most)

    def _turn(self, omega: float) -> float:
        limit = radians(self.settings.max_turn_degps)
        return min(max(omega, -limit), limit)
