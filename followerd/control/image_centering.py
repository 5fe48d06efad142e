"""Zhuang's follow law: keep the person in the middle of the image and at a distance.

Zhuang et al., section 4: no turn inside the stationary band, forward beyond the maximum distance,
back below the safe one.
"""

from math import cos, radians, sin
from typing import Literal

from pydantic import Field

from followerd.control.interfaces import Scene, Target
from followerd.messages import Twist
from followerd.settings import Settings


class ImageCenteringSettings(Settings):
    """`paper` moves at set speeds outside its bands, `default` smoothly."""

    profile: Literal["paper", "default"] = "default"
    turn_gain_per_s: float = Field(1.5, gt=0, description="turn rate per radian of bearing")
    stationary_band_deg: float = Field(
        5.3, ge=0, description="half band without turning: 10.4 % of the width of a 48 degree view"
    )
    max_turn_degps: float = Field(57.0, gt=0, description="fastest turn")
    max_distance_m: float = Field(1.5, gt=0, description="forward beyond it; `default` keeps it")
    safe_distance_m: float = Field(1.0, gt=0, description="never forward below it")
    back_distance_m: float = Field(0.8, gt=0, description="backward below it")
    forward_mps: float = Field(0.4, gt=0, description="speed of `paper`")
    max_forward_mps: float = Field(0.8, gt=0, description="fastest of `default`")
    back_mps: float = Field(0.1, ge=0, le=0.15, description="fastest backward speed")
    distance_gain_per_s: float = Field(0.9, gt=0, description="speed per metre, of `default`")
    lead: float = Field(0.9, ge=0, le=1.2, description="share of the person's speed fed forward")
    stroll_mps: float = Field(0.1, ge=0, description="slower persons are taken to stand")
    turn_only: bool = Field(False, description="fixate (section 5.1): never forward or back")


class ImageCentering:
    """Turn toward the person, keep the distance."""

    Settings = ImageCenteringSettings

    def __init__(self, settings: ImageCenteringSettings | None = None) -> None:
        self.settings = settings or ImageCenteringSettings()

    def wish(self, target: Target, _: Scene | None = None) -> Twist:
        """The motion that follows `target`; no forward speed without a range."""
        paper = self.settings.profile == "paper"
        v, omega = self._stepwise(target) if paper else self._smooth(target)
        return Twist(0.0 if self.settings.turn_only else v, omega)

    def _stepwise(self, target: Target) -> tuple[float, float]:
        s = self.settings
        outside = abs(target.bearing) > radians(s.stationary_band_deg)
        omega = s.turn_gain_per_s * target.bearing if outside else 0.0
        if target.range is None:
            v = 0.0
        elif target.range > s.max_distance_m:
            v = s.forward_mps
        else:
            v = -s.back_mps if target.range < s.back_distance_m else 0.0
        return v, self._turn(omega)

    def _smooth(self, target: Target) -> tuple[float, float]:
        s = self.settings
        band = radians(s.stationary_band_deg)
        beyond = target.bearing - min(max(target.bearing, -band), band)
        c, w = cos(target.bearing), sin(target.bearing)
        along = c * target.velocity[0] + w * target.velocity[1]
        across = c * target.velocity[1] - w * target.velocity[0]
        omega = s.turn_gain_per_s * beyond
        if target.range is None:
            return 0.0, self._turn(omega)
        passing = across - min(max(across, -s.stroll_mps), s.stroll_mps)
        omega += s.lead * passing / max(target.range, s.safe_distance_m)
        v = s.distance_gain_per_s * (target.range - s.max_distance_m)
        if abs(along) > s.stroll_mps:
            v += s.lead * along
        if target.range < s.back_distance_m:
            return max(v, -s.back_mps) if v < 0 else 0.0, self._turn(omega)
        # nobody is served by driving past someone who stands beside the robot
        ahead = max(0.0, c) if target.range > s.safe_distance_m else 0.0
        return min(max(0.0, v), s.max_forward_mps) * ahead, self._turn(omega)

    def _turn(self, omega: float) -> float:
        limit = radians(self.settings.max_turn_degps)
        return min(max(omega, -limit), limit)
