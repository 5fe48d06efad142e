"""Whose legs are whose: who comes in from outside stays somebody else, seen or not (F8)."""

from dataclasses import replace
from math import atan2, hypot

import numpy as np
import pytest

from followerd.estimation.own_legs import Expected, OwnLegs, OwnLegsSettings
from followerd.geometry import Pose2
from followerd.messages import Scan
from followerd.perception.clusters import ClusterSettings, find_clusters
from tests.test_trust import person, scan

THERE = 4.4, 0.0  # m, where the person stands


@pytest.mark.parametrize("before", [0.5, 0.7])
@pytest.mark.parametrize("unseen", [1, 2])
@pytest.mark.parametrize("hurry", [0.1, 0.14])
def test_who_crosses_and_looks_like_no_leg_for_a_moment_stays_somebody_else(
    before: float, unseen: int, hurry: float
) -> None:
    legs, expected = OwnLegs(OwnLegsSettings()), Expected(0.0, THERE[0], 0.9)
    passer = THERE[0] - before
    for k, y in enumerate(np.arange(1.6, -1.2, -hurry)):
        legs_seen = person(passer, y)
        if k % 4 >= 4 - unseen and y < 0.9:
            legs_seen = ()
        elif k % 4 == 1:
            legs_seen = legs_seen[:1]
        own = person(*THERE) if abs(y) > 0.45 else ()  # far off a leg falls between two beams
        one = scan(0.107 * k, *own, *legs_seen)
        clusters = find_clusters(one, one.points(), ClusterSettings())
        found = legs.find(clusters, Pose2(), expected)
        assert (np.hypot(*(clusters.centre[found] - THERE).T) < 0.3).all(), f"at y = {y:.2f}"


@pytest.mark.parametrize("thin", [3, 5])
def test_who_crosses_far_off_and_is_hit_by_single_beams_stays_somebody_else(thin: int) -> None:
    legs, expected = OwnLegs(OwnLegsSettings()), Expected(0.0, THERE[0], 0.9)
    passer = THERE[0] - 0.5
    for k, y in enumerate(np.arange(1.5, -1.2, -0.1)):
        own = person(*THERE) if abs(y) > 0.45 else ()
        if thin <= k < 2 * thin:
            one = one_beam(scan(0.107 * k, *own), passer, y)
        else:
            one = scan(0.107 * k, *own, *person(passer, y))
        clusters = find_clusters(one, one.points(), ClusterSettings())
        found = legs.find(clusters, Pose2(), expected)
        assert (np.hypot(*(clusters.centre[found] - THERE).T) < 0.3).all(), f"at y = {y:.2f}"


def one_beam(one: Scan, x: float, y: float) -> Scan:
    """The same scan with a single return of what stands at (x, y)."""
    ranges = one.ranges.copy()
    ranges[round((atan2(y, x) - one.angle_min) / one.angle_increment)] = hypot(x, y)
    return replace(one, ranges=ranges)


def test_who_was_seen_apart_from_the_person_is_never_taken_for_them() -> None:
    legs, expected = OwnLegs(OwnLegsSettings()), Expected(0.0, THERE[0], 0.9)
    for k, y in enumerate(np.arange(1.6, 0.1, -0.1)):
        own = person(*THERE) if y > 0.6 else ()
        hear(legs, 0.107 * k, expected, *own, *person(THERE[0] - 0.3, y))
    for k in range(15, 50):  # the person does not come back, the other stays
        assert not hear(legs, 0.107 * k, expected, *person(THERE[0] - 0.3, 0.2)).size


def test_legs_not_seen_before_stand_in_the_cameras_line() -> None:
    """After a time without scans the nearest legs may be anybody's (FAILSAFES F8)."""
    there = (2.2, -0.6)
    expected = Expected(0.0, 2.3, 0.8)
    assert hear(OwnLegs(OwnLegsSettings()), 0.0, expected, *person(*there)).size
    in_line = replace(expected, sight=0.0)
    assert not hear(OwnLegs(OwnLegsSettings()), 0.0, in_line, *person(*there)).size
    assert hear(OwnLegs(OwnLegsSettings()), 0.0, in_line, *person(2.2, -0.1)).size == 2


def test_a_mixed_return_beside_the_person_is_nobodys_leg() -> None:
    """A beam that grazes a leg and the wall behind gives a return between them for one scan."""
    legs, expected = OwnLegs(OwnLegsSettings()), Expected(0.0, 2.0, 0.4)
    right, left = person(2.0, 0.0)
    hear(legs, 0.0, expected, right, left)
    hear(legs, 0.027, expected, right, left, (2.38, 0.3))
    for k in range(2, 9):  # the left leg falls between two beams
        assert hear(legs, 0.027 * k, expected, right).size == 1
    for k in range(9, 12):  # it is back, and nearer to where the mixed return was
        assert hear(legs, 0.027 * k, expected, right, (2.15, 0.2)).size == 2


def test_the_person_is_alone_until_somebody_is_there_for_two_scans() -> None:
    legs, expected = OwnLegs(OwnLegsSettings()), Expected(0.0, THERE[0], 0.9)
    third = (THERE[0] - 0.3, 0.3)
    hear(legs, 0.0, expected, *person(*THERE))
    assert legs.alone
    hear(legs, 0.027, expected, *person(*THERE), third)
    assert legs.alone
    hear(legs, 0.054, expected, *person(*THERE), third)
    assert not legs.alone


def hear(legs: OwnLegs, stamp: float, expected: Expected, *seen: tuple[float, float]) -> np.ndarray:
    one = scan(stamp, *seen)
    return legs.find(find_clusters(one, one.points(), ClusterSettings()), Pose2(), expected)
