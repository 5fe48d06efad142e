"""How fast the robot may drive and turn, so that it can stop before its margins are touched."""

from math import copysign, hypot, inf, radians, sqrt

from followerd.control.clearance import (
    Footprint,
    stopping_distance,
    stopping_speed,
    time_to_contact,
)
from followerd.control.limits import GuardSettings
from followerd.control.obstacles import Obstacles
from followerd.geometry import Array
from followerd.messages import Twist

SLOWEST = 1e-4  # m/s, for the curvature of what hardly moves


class Way:
    """The free way of the swept footprint, turned into speeds."""

    def __init__(self, settings: GuardSettings) -> None:
        self.settings = settings
        self.body = Footprint(settings.front_m, settings.rear_m, settings.half_width_m)
        self._blurred = self.body.grown(settings.blur_m, settings.blur_m)

    def reach(self, v: float) -> float:
        """How far from the robot's origin returns matter at speed `v`, m."""
        s = self.settings
        braking = stopping_distance(abs(v), s.reaction_s, s.deceleration_mps2)
        return braking + s.margin_m + hypot(max(s.front_m, s.rear_m), s.half_width_m + s.beside_m)

    def free_turn(self, omega: float, obstacles: Obstacles) -> float:
        """The turn rate, rad/s, that can be stopped before a corner touches something."""
        s, angle = self.settings, self.free_angle(omega, obstacles)
        return stopping_speed(angle, s.reaction_s, radians(s.turn_deceleration_degps2))

    def free_angle(self, side: float, obstacles: Obstacles) -> float:
        """How far the robot may turn to a side (left positive), rad, and keep its margins."""
        s = self.settings
        grown = self.body.grown(s.turn_margin_m, s.turn_margin_m)
        angles = self._contact(obstacles.points, Twist(0.0, copysign(1.0, side)), grown)
        return max(0.0, _soonest(angles) - radians(s.turn_margin_deg))

    def free_speed(self, twist: Twist, obstacles: Obstacles) -> tuple[float, str]:
        """The speed along the arc of `twist`, m/s, that keeps the margins, and what limits it.

        To what lies beside the way only the margin beside the footprint is kept; near things
        there slow the robot down.
        """
        s, speed = self.settings, abs(twist.v)
        # the same arc at 1 m/s: its seconds are metres
        unit = Twist(copysign(1.0, twist.v), twist.omega / max(speed, SLOWEST))
        way = self._contact(obstacles.points, unit, self.body.grown(0.0, s.side_margin_m))
        ahead = self._stopping_within(_soonest(way - obstacles.margins))
        if ahead <= s.beside_speed_mps or speed <= s.beside_speed_mps:
            return ahead, f"free way {_soonest(way):.2f} m"
        wide = self.body.grown(0.0, s.beside_m)
        beside = _soonest(time_to_contact(obstacles.points, unit, wide))
        past = sqrt(s.beside_speed_mps**2 + 2.0 * s.deceleration_mps2 * beside)
        return (past, "close beside the way") if past < ahead else (ahead, "")

    def _contact(self, points: Array, twist: Twist, grown: Footprint) -> Array:
        """Seconds (N,) until the footprint `grown` by its margins touches each point.

        What is inside the margins already counts when the footprint would touch it, as far as the
        laser can tell: the robot may drive on past a door post, or away from it.
        """
        time = time_to_contact(points, twist, grown)
        for smaller in (self._blurred, self.body):
            inside = time == 0.0
            if not inside.any():
                break
            time[inside] = time_to_contact(points[inside], twist, smaller)
        return time

    def _stopping_within(self, way: float) -> float:
        return stopping_speed(way, self.settings.reaction_s, self.settings.deceleration_mps2)


def _soonest(ways: Array) -> float:
    return float(ways.min(initial=inf))
