"""Jia's follow law: drive the arc that meets the person, in gears chosen by fuzzy rules.

Jia et al. 2015, eq. 12 and tables 1 and 2. The person is at (x, y) in `base`; the circle through
them that touches the x axis has the curvature 2y / (x² + y²), and the gain k multiplies it.
"""

from math import cos, hypot, sin
from typing import Literal

from pydantic import Field

from followerd.control.fuzzy import load
from followerd.control.interfaces import Scene, Target
from followerd.messages import WheelSpeeds
from followerd.settings import Settings

NEAREST = 0.2  # m, the arc to anything nearer is that to there
PAPER_SPEED = 0.2  # m/s, end of the speed's domain in the paper


class FuzzyGearsSettings(Settings):
    """`paper` is tables and wheel law alone; `default` also keeps its distance and turns."""

    profile: Literal["paper", "default"] = "default"
    rules: str | None = Field(
        None, description="a YAML file of rules, or shipped ones by name; default: the profile's"
    )
    max_speed_mps: float = Field(1.2, gt=0, description="fastest; `paper` has 0.2")
    max_gain: float = Field(3.0, gt=0, description="largest gear k")
    half_track_m: float = Field(0.1785, gt=0, description="half the wheels' distance")
    stop_m: float = Field(1.15, gt=0, description="never forward when the person is this near")
    full_m: float = Field(1.5, gt=0, description="from there on as fast as the rules say")
    turn_gain_per_s: float = Field(1.2, gt=0, description="turn rate per radian, near the person")
    near_turn_radps: float = Field(0.8, gt=0, description="fastest of that turn")
    loop_gain_per_s: float = Field(3.0, gt=0, description="most that 2 v k / range may be")
    max_turn_radps: float = Field(1.5, gt=0, description="wheels are slowed together to keep it")
    max_wheel_mps: float = Field(1.2, gt=0, description="wheels are slowed together to keep it")

    @property
    def top_speed(self) -> float:
        """Fastest of the profile, m/s."""
        return (
            min(PAPER_SPEED, self.max_speed_mps) if self.profile == "paper" else self.max_speed_mps
        )


class FuzzyGears:
    """Wheel speeds on the arc to the person."""

    Settings = FuzzyGearsSettings

    def __init__(self, settings: FuzzyGearsSettings | None = None) -> None:
        self.settings = settings or FuzzyGearsSettings()
        rules = load(self.settings.rules or self.settings.profile)
        self.speed, self.gear = rules.speed(), rules.gear()

    def wish(self, target: Target, _: Scene | None = None) -> WheelSpeeds:
        """The motion that follows `target`; without a range it only turns."""
        s = self.settings
        if target.range is None:
            return self._wheels(0.0, 0.0 if s.profile == "paper" else self._turn(target.bearing))
        x, y = target.range * cos(target.bearing), target.range * sin(target.bearing)
        vx, vy = target.velocity
        k = s.max_gain * self.gear.at(y, vy)
        v = s.top_speed * self.speed.at(x, vx)
        if s.profile == "paper":
            return self._wheels(v, v * k * _curvature(x, y))
        gate = min(max((x - s.stop_m) / (s.full_m - s.stop_m), 0.0), 1.0)
        v *= gate
        if v > 0.0:
            k = min(k, 0.5 * s.loop_gain_per_s * max(hypot(x, y), NEAREST) / v)
        arc = v * k * _curvature(x, y)
        return self._wheels(v, gate * arc + (1.0 - gate) * self._turn(target.bearing))

    def _turn(self, bearing: float) -> float:
        """Turn rate of a robot that is near, rad/s."""
        limit = self.settings.near_turn_radps
        return min(max(self.settings.turn_gain_per_s * bearing, -limit), limit)

    def _wheels(self, v: float, omega: float) -> WheelSpeeds:
        """Wheel speeds (eq. 12); where a limit is passed both are slowed, on the same arc."""
        s = self.settings
        aside = s.half_track_m * omega
        fastest = abs(v) + abs(aside)
        scale = min(
            1.0,
            s.max_wheel_mps / fastest if fastest > 0.0 else 1.0,
            s.max_turn_radps / abs(omega) if omega else 1.0,
        )
        return WheelSpeeds(scale * (v - aside), scale * (v + aside))


def _curvature(x: float, y: float) -> float:
    """Of the circle through (x, y) that touches the x axis, 1/m."""
    return 2.0 * y / max(x * x + y * y, NEAREST**2)
