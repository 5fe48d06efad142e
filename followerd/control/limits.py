"""The figures the guard holds the robot to."""

from dataclasses import astuple
from math import degrees, inf

from pydantic import Field

from followerd.messages import Chassis
from followerd.settings import Settings


class GuardSettings(Settings):
    """The body, and what the robot owes the people around it."""

    front_m: float = Field(0.21, gt=0, description="from the wheels' axis to the front")
    rear_m: float = Field(0.30, gt=0, description="from the wheels' axis to the rear")
    half_width_m: float = Field(0.213, gt=0)
    track_m: float = Field(0.357, gt=0, description="between the wheels")

    max_speed_mps: float = Field(0.7, gt=0, description="forward")
    max_reverse_mps: float = Field(0.15, ge=0, le=0.15)
    max_turn_degps: float = Field(57.0, gt=0)
    accel_mps2: float = Field(0.5, gt=0, description="how fast a speed may grow")
    turn_accel_degps2: float = Field(100.0, gt=0)
    start_mps: float = Field(0.1, gt=0, description="a standing robot needs room for it")
    start_degps: float = Field(10.0, gt=0, description="the same, for a turn on the spot")
    watchdog_s: float = Field(2.0, gt=0, description="the base's own, when we fall silent")
    blind_distance_m: float = Field(1.4, gt=0, description="farthest way in that time")

    reaction_s: float = Field(0.25, gt=0, description="from a measurement to braking wheels")
    deceleration_mps2: float = Field(0.5, gt=0, description="of a controlled stop")
    turn_deceleration_degps2: float = Field(100.0, gt=0)
    margin_m: float = Field(0.70, gt=0, description="kept to anything ahead")
    target_margin_m: float = Field(0.45, gt=0, description="kept to the confirmed target's returns")
    side_margin_m: float = Field(0.08, ge=0, description="beside the swept footprint")
    beside_m: float = Field(0.20, gt=0, description="something nearer to the sides slows")
    beside_speed_mps: float = Field(0.4, gt=0, description="past something that near")
    turn_margin_m: float = Field(0.04, ge=0, description="around the footprint, in turns")
    blur_m: float = Field(0.015, ge=0, description="of returns: passed nearer is touched")
    turn_margin_deg: float = Field(2.0, ge=0, description="kept of the free angle")

    person_within_m: float = Field(1.2, gt=0, description="another person this near slows")
    person_aside_m: float = Field(0.9, gt=0, description="half width of the way for that")
    person_speed_mps: float = Field(0.3, gt=0, description="near another person")
    min_target_m: float = Field(1.0, gt=0, description="no forward speed nearer to the target")
    approach_s: float = Field(0.5, gt=0, description="time left to that distance, at least")

    sonar_margin_m: float = Field(0.30, gt=0, description="kept to sonar echoes, which are blurred")
    sonar_age_s: float = Field(0.5, gt=0, description="older sonar readings are forgotten")
    sonar_reach_m: float = Field(2.0, gt=0, description="longer sonar readings say nothing")
    rear_discs: int = Field(4, ge=1, description="fresh sonar discs needed to look behind")
    rear_margin_m: float = Field(0.30, gt=0, description="kept behind")
    max_missing_share: float = Field(0.3, gt=0, lt=1, description="of beams not measured")
    slow_after: float = Field(0.7, gt=0, le=1, description="share of a stream's age limit")
    slow_speed_mps: float = Field(0.3, gt=0, description="with data that old")
    valid_s: float = Field(0.22, gt=0, le=0.22, description="longest life of a command")

    def fitted(self, base: Chassis) -> "GuardSettings":
        """For the dimensions of `base`; the config can only make it larger and slower to stop.

        The track is the base's unless the config names one.
        """
        if not all(0.0 < figure < inf for figure in astuple(base)):
            return self
        larger = {
            "front_m": max(self.front_m, base.front),
            "rear_m": max(self.rear_m, base.rear),
            "half_width_m": max(self.half_width_m, base.half_width),
            "watchdog_s": max(self.watchdog_s, base.watchdog),
            "deceleration_mps2": min(self.deceleration_mps2, base.deceleration),
            "turn_deceleration_degps2": min(
                self.turn_deceleration_degps2, degrees(base.turn_deceleration)
            ),
        }
        if "track_m" not in self.model_fields_set:
            larger["track_m"] = base.track
        return self.model_copy(update=larger)

    @property
    def speed_cap(self) -> float:
        """Fastest forward speed, m/s: what the base's watchdog allows blindly counts too."""
        return min(self.max_speed_mps, self.blind_distance_m / self.watchdog_s)
