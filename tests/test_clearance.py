"""How far a footprint may go: exact against brute force, and the braking law."""

from math import inf, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.control.clearance import (
    Footprint,
    stopping_distance,
    stopping_speed,
    time_to_contact,
)
from followerd.geometry import Pose2
from followerd.messages import Twist

BODY = Footprint(0.21, 0.30, 0.21)


def contact(x: float, y: float, twist: Twist, body: Footprint = BODY) -> float:
    return float(time_to_contact(np.array([[x, y]]), twist, body)[0])


@pytest.mark.parametrize(
    ("x", "y", "twist", "seconds"),
    [
        (1.21, 0.0, Twist(0.5, 0.0), 2.0),
        (1.21, 0.2, Twist(0.5, 0.0), 2.0),
        (1.21, 0.22, Twist(0.5, 0.0), inf),  # beside the way
        (-1.3, 0.0, Twist(0.5, 0.0), inf),  # behind
        (-1.3, 0.0, Twist(-0.5, 0.0), 2.0),
        (0.1, 0.1, Twist(0.5, 0.0), 0.0),  # inside
        (0.1, 0.1, Twist(0.0, 0.5), 0.0),
        (0.5, 0.0, Twist(0.0, 1.0), inf),  # out of reach of the corners
        (0.0, 0.3, Twist(0.0, 1.0), inf),  # the front corner passes just inside
        (0.0, 0.3, Twist(0.0, -1.0), 0.7954),  # the rear one swings out: acos(.21 / .3)
        (1.0, 1.0, Twist(1.0, 1.0), pi / 2 - 0.2116),  # on the arc, met by the front
    ],
)
def test_known_contacts(x: float, y: float, twist: Twist, seconds: float) -> None:
    assert contact(x, y, twist) == pytest.approx(seconds, abs=2e-3)


def test_turning_left_and_right_are_mirror_images() -> None:
    assert contact(0.1, 0.3, Twist(0.2, 0.7)) == contact(0.1, -0.3, Twist(0.2, -0.7))


def test_no_points_no_contact() -> None:
    assert time_to_contact(np.empty((0, 2)), Twist(0.5, 0.3), BODY).size == 0


speeds = st.sampled_from([0.0, 0.3, -0.3, 0.7])
turns = st.sampled_from([0.0, 0.2, -0.5, 1.0, -1.4])
spots = st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2))


@given(speeds, turns, spots)
def test_contact_comes_when_the_moved_footprint_covers_the_point(
    v: float, omega: float, spot: tuple[float, float]
) -> None:
    if v == omega == 0.0:
        return
    twist, point = Twist(v, omega), np.array([spot])
    time = contact(*spot, twist)
    span = min(5.0, 0.99 * pi / max(abs(omega), 1e-9))
    before = np.arange(0.0, min(time, span), 0.05)
    slim = BODY.grown(-1e-6, -1e-6)
    for t in before:
        assert not slim.covers((~Pose2().moved(v, omega, t)).apply(point))[0]
    if time < span:
        touching = BODY.grown(1e-6, 1e-6)
        assert touching.covers((~Pose2().moved(v, omega, time)).apply(point))[0]


@given(st.floats(0, 5), st.floats(0.05, 1), st.floats(0.1, 2))
def test_what_stops_in_a_way_needs_just_that_way(way: float, reaction: float, brake: float) -> None:
    speed = stopping_speed(way, reaction, brake)
    assert stopping_distance(speed, reaction, brake) == pytest.approx(way, abs=1e-9)


@given(st.floats(-1, 5), st.floats(0, 1))
def test_more_room_never_means_less_speed(way: float, more: float) -> None:
    assert stopping_speed(way + more, 0.25, 0.5) >= stopping_speed(way, 0.25, 0.5)


def test_without_room_there_is_no_speed() -> None:
    assert stopping_speed(0.0, 0.25, 0.5) == stopping_speed(-1.0, 0.25, 0.5) == 0.0
