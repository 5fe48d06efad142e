"""Kwolek's PD law: continuous zones, damping, and a camera that may look back."""

from math import atan2, cos, degrees, hypot, pi, radians, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.control.distance_pd import DistancePd, DistancePdSettings, Zone
from followerd.control.interfaces import Scene, Target
from followerd.control.registry import CONTROLLERS
from followerd.geometry import Pose2, wrap_angle
from followerd.messages import Twist

STANDING = Scene(0.0, Pose2(), Twist())


def law(**changes: object) -> DistancePd:
    return DistancePd(DistancePdSettings.model_validate(changes))


@given(st.floats(0.0, 0.2), st.floats(-2.0, 2.0))
def test_an_error_that_acts_counts_from_the_zones_edge_on(half: float, error: float) -> None:
    zone = Zone(half, 1.5)
    zone.beyond(10.0)
    assert abs(zone.beyond(error)) == pytest.approx(max(abs(error) - half, 0.0))


def test_once_inside_the_zone_an_error_must_grow_to_count_again() -> None:
    zone = Zone(0.1, 1.5)
    assert zone.beyond(0.12) == 0.0
    assert zone.beyond(0.16) == pytest.approx(0.06)
    assert zone.beyond(-0.12) == pytest.approx(-0.02)
    assert zone.beyond(0.09) == 0.0
    assert zone.beyond(0.12) == 0.0


@pytest.mark.parametrize(
    ("target", "twist"),
    [
        (Target(0.0, 1.6), Twist()),
        (Target(0.02, 1.65), Twist()),
        (Target(0.0, 1.88), Twist(0.24, 0.0)),
        (Target(0.0, 1.42), Twist(-0.12, 0.0)),
        (Target(0.0, 0.9), Twist(-0.15, 0.0)),
        (Target(0.0, 9.0), Twist(0.8, 0.0)),
        (Target(0.0, 1.6, (0.5, 0.0)), Twist(0.4, 0.0)),
        (Target(0.5, None), Twist(0.0, 1.8 * (0.5 - radians(2.3)))),
        (Target(pi, 3.0), Twist(0.0, radians(57.0))),
    ],
)
def test_what_it_wishes(target: Target, twist: Twist) -> None:
    wish = law().wish(target, STANDING)
    assert wish.v == pytest.approx(twist.v)
    assert abs(wish.omega) == pytest.approx(abs(twist.omega))


def test_profile_paper_is_slow_and_leads_nobody() -> None:
    paper = law(profile="paper")
    assert paper.wish(Target(0.0, 4.0), STANDING).v == 0.25
    assert paper.wish(Target(0.0, 1.6, (0.5, 0.0)), STANDING).v == 0.0


@given(
    st.floats(-1.5, 1.5), st.floats(0.6, 5.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0),
    st.floats(-0.5, 0.5), st.floats(-1.0, 1.0),
)  # fmt: skip
def test_a_camera_that_looks_back_flips_the_speed_and_nothing_else(
    bearing: float, distance: float, vx: float, vy: float, v: float, omega: float
) -> None:
    ahead = law().wish(Target(bearing, distance, (vx, vy)), Scene(0.0, Pose2(), Twist(v, omega)))
    back = law(mount_yaw_deg=180).wish(
        Target(wrap_angle(bearing + pi), distance, (-vx, -vy)),
        Scene(0.0, Pose2(), Twist(-v, omega)),
    )
    assert back.v == pytest.approx(-ahead.v, abs=1e-9)
    assert back.omega == pytest.approx(ahead.omega, abs=1e-6)


def test_it_is_found_by_its_name() -> None:
    found = CONTROLLERS.load("distance_pd")(DistancePdSettings())
    assert found.wish(Target(0.0, 1.6), STANDING) == Twist()


def led(speed: float, **changes: object) -> tuple[list[float], list[float]]:
    """A robot leads somebody who walks along x whatever it does, and begins 0.3 m beside them.

    How far aside it is from their way, as they see it, and how far the camera looks past them, deg.
    """
    follow = law(mount_yaw_deg=180, max_retreat_mps=0.8, **changes)
    pose, v, omega = Pose2(1.6, 0.3), 0.0, 0.0
    aside, off = [], []
    for k in range(800):
        now = 0.05 * k
        away = (~pose).apply_point(speed * now, 0.0)
        bearing, c, s = atan2(away[1], away[0]), cos(pose.theta), sin(pose.theta)
        target = Target(bearing, hypot(*away), (c * speed, -s * speed))
        wish = follow.wish(target, Scene(now, pose, Twist(v, omega)))
        v, omega = v + (wish.v - v) / 6.0, omega + (wish.omega - omega) / 6.0
        pose = pose @ Pose2(0.05 * v, 0.0, 0.05 * omega)
        aside.append(abs(degrees(atan2(pose.y, pose.x - speed * now))))
        off.append(abs(degrees(wrap_angle(bearing - pi))))
    return aside, off


@pytest.mark.parametrize("speed", [0.15, 0.25, 0.4, 0.6, 0.75])
def test_a_robot_that_leads_stays_before_a_person_who_ignores_it(speed: float) -> None:
    aside, off = led(speed)
    assert aside[0] > 10.0
    assert max(aside[400:]) < 4.0
    assert max(off[100:]) < 26.0


def test_without_turning_back_it_ends_beside_them() -> None:
    aside, _ = led(0.6, ahead=0.0)
    assert max(aside[400:]) > 90.0


def test_who_walks_away_or_stands_is_looked_at_straight() -> None:
    seeking, plain = law(), law(ahead=0.0)
    for velocity in ((0.4, 0.2), (-0.05, 0.1)):
        target = Target(0.0, 1.6, velocity)
        assert seeking.wish(target, STANDING) == plain.wish(target, STANDING)
