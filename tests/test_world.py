"""The robot's body moves as its wheels say, walls and people are solid, legs swing in the scan."""

from itertools import pairwise
from math import atan2, cos, hypot, inf, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followerd.geometry import Pose2, wrap_angle
from followerd.sim.people import swing
from followerd.sim.world import World
from tests.scenes import ROOM, person, scene, walker, world

speed = st.floats(-0.8, 0.8)
FAN = np.radians(np.arange(-90.0, 90.5, 0.5))
NOW = np.zeros(FAN.size)
CENTRE = Pose2()


def run(one: World, seconds: float, step: float = 0.02) -> None:
    until = one.now + seconds
    while one.now < until - 1e-9:
        one.advance(min(until, one.now + step))


@given(speed, speed, st.lists(st.floats(0.001, 0.3), min_size=1, max_size=8))
@settings(max_examples=30)
def test_an_ideal_robot_rolls_along_the_arc_however_time_is_cut(
    left: float, right: float, steps: list[float]
) -> None:
    one = world()
    one.drive(left, right)
    for now in np.cumsum(steps).tolist():
        one.advance(now)
    total = sum(steps)
    omega = (right - left) / one.scenario.robot.track_m
    ideal = CENTRE.moved(0.5 * (left + right), omega, total)
    assert (one.pose.x, one.pose.y) == pytest.approx((ideal.x, ideal.y), abs=1e-6)
    assert wrap_angle(one.pose.theta - ideal.theta) == pytest.approx(0.0, abs=1e-6)
    assert one.wheel_travel == pytest.approx((left * total, right * total), abs=1e-9)


def test_wheels_of_wrong_size_and_slip_let_odometry_drift_but_not_run_away() -> None:
    ends = []
    for seed in range(12):
        one = world(seed=seed, robot={"wheel_error": 0.01, "slip": 0.03})
        one.drive(0.4, 0.4)
        run(one, 10.0)
        assert one.wheel_travel == pytest.approx((4.0, 4.0))
        ends.append((one.pose.x, one.pose.y, one.pose.theta))
    spread = np.std(ends, axis=0)
    assert 0.005 < spread[0] < 0.2
    assert 0.02 < spread[2] < 0.5


def test_a_wall_holds_the_robot_and_counts_once() -> None:
    one = world(walls=[{"points_m": [[1.0, -3.0], [1.0, 3.0]]}])
    one.drive(0.5, 0.5)
    run(one, 3.0)
    assert one.pose.x == pytest.approx(0.75, abs=0.03)
    assert one.blocked == (True, True)
    assert one.bumpers == (0b00100, 0)
    assert one.truth().collisions == 1
    assert one.wheel_travel[0] == pytest.approx(one.pose.x)
    one.drive(-0.2, 0.2)
    run(one, 1.0)
    assert one.pose.theta > 1.0  # it can still turn on the spot
    assert one.blocked == (False, False)


def test_the_robot_can_back_off_a_wall_and_bump_again() -> None:
    one = world(walls=[{"points_m": [[1.0, -3.0], [1.0, 3.0]]}])
    for v in (0.5, -0.3, 0.5):
        one.drive(v, v)
        run(one, 2.5)
    assert one.truth().collisions == 2
    one.drive(-0.3, -0.3)
    run(one, 0.5)
    assert one.bumpers == (0, 0)


def test_backing_into_a_wall_presses_a_rear_bumper() -> None:
    one = world(walls=[{"points_m": [[-1.0, -3.0], [-1.0, 3.0]]}])
    one.drive(-0.5, -0.5)
    run(one, 3.0)
    assert one.bumpers == (0, 0b00100)


def test_driving_into_somebody_in_full_view_is_the_robots_own_collision() -> None:
    one = world(person(2.0, 0.0))
    one.drive(0.5, 0.5)
    run(one, 6.0)
    truth = one.truth()
    assert (truth.collisions, truth.bumped) == (1, 0)
    assert truth.min_person_distance == pytest.approx(0.45, abs=0.03)
    assert truth.pose.x < 1.6


def test_somebody_who_walks_into_the_standing_robot_is_counted_apart() -> None:
    one = world(walker((3.0, 0.0), (-3.0, 0.05)))
    run(one, 6.0)
    truth = one.truth()
    assert (truth.collisions, truth.bumped) == (0, 1)
    assert truth.min_any_distance < 0.1
    assert truth.min_person_distance == inf


def test_the_robot_is_not_blamed_for_whom_it_could_not_see() -> None:
    one = world(person(6.0, 0.0), walker((1.0, 1.6), (1.0, -1.6), speed=1.4, start_after_s=0.9))
    one.drive(0.3, 0.3)
    run(one, 2.2)
    blamed = one.truth()
    hidden = world(
        person(6.0, 0.0),
        walker((1.0, 1.6), (1.0, -1.6), speed=1.4, start_after_s=0.9),
        boxes=[{"x_m": 0.6, "y_m": 0.95, "length_m": 1.0, "width_m": 0.1, "height_m": 2.0}],
    )
    hidden.drive(0.3, 0.3)
    run(hidden, 2.2)
    assert blamed.min_person_distance < hidden.truth().min_person_distance


def test_the_robot_of_a_watching_scenario_never_moves() -> None:
    one = world(task="watch")
    one.drive(0.5, 0.3)
    run(one, 2.0)
    assert one.pose == Pose2()
    assert one.wheel_travel == (0.0, 0.0)


def test_a_scenario_begins_at_the_first_advance() -> None:
    late = World(scene(walker((2, 0), (9, 0))), np.random.default_rng(0))
    late.advance(5000.0)
    late.advance(5002.0)
    early = world(walker((2, 0), (9, 0)))
    early.advance(2.0)
    assert late.now == 5002.0
    assert late.truth().target == early.truth().target


def test_ranges_see_the_walls_of_a_room() -> None:
    one = world(person(-3.0, 0.0), walls=ROOM)
    ranges = one.ranges(Pose2(0.1, 0.0, 0.0), FAN, NOW)
    assert ranges[180] == pytest.approx(7.9)
    assert ranges[0] == pytest.approx(4.0)
    assert ranges[360] == pytest.approx(4.0)


def test_a_person_is_two_legs_in_the_scan() -> None:
    one = world(person(2.0, 0.0))
    ranges = one.ranges(CENTRE, FAN, NOW)
    hits = np.isfinite(ranges)
    edges = np.flatnonzero(np.diff(hits.astype(int)))
    assert len(edges) == 4  # two groups of beams
    assert ranges[hits].min() == pytest.approx(2.0 - 0.065, abs=0.03)
    for first, last in ((edges[0], edges[1]), (edges[2], edges[3])):
        assert 0.08 < 2.0 * (FAN[last] - FAN[first]) < 0.15  # m, width of a leg


def test_old_beams_were_measured_from_where_the_robot_was() -> None:
    one = world(person(-3.0, 0.0), walls=ROOM)
    one.drive(-0.2, 0.2)
    run(one, 1.0)
    before = one.ranges(CENTRE, FAN, NOW)
    run(one, 0.05)
    again = one.ranges(CENTRE, FAN, np.full(FAN.size, 0.05))
    assert again == pytest.approx(before, abs=0.01)
    assert np.abs(one.ranges(CENTRE, FAN, NOW) - before).max() > 0.05


def test_old_beams_meet_the_legs_where_they_were() -> None:
    one = world(walker((2.0, 0.3), (9.0, 0.3)))
    run(one, 3.0)
    before = one.ranges(CENTRE, FAN, NOW)
    run(one, 0.02)
    again = one.ranges(CENTRE, FAN, np.full(FAN.size, 0.02))
    assert again == pytest.approx(before, abs=0.005)


def test_a_sonar_disc_hears_the_nearest_thing_in_its_cone() -> None:
    one = world(person(1.5, 0.0), walls=ROOM)
    ahead, left = one.sonar([Pose2(0.1, 0.0, 0.0), Pose2(0.0, 0.1, pi / 2)])
    assert ahead == pytest.approx(1.34, abs=0.05)
    assert left == pytest.approx(3.9, abs=0.01)
    assert world().sonar([CENTRE]) == [5.0]


def test_a_wall_takes_a_person_out_of_sight() -> None:
    wall = {"points_m": [[1.0, -1.0], [1.0, 1.0]]}
    assert not world(person(3.0, 0.0), walls=[wall]).truth().target.in_sight
    assert world(person(3.0, 0.0), walls=[wall | {"height_m": 0.8}]).truth().target.in_sight


def test_others_take_a_person_out_of_sight() -> None:
    one = world(person(3.0, 0.0), person(1.5, 0.05, name="near"), person(4.0, 1.0, name="beside"))
    truth = one.truth()
    assert not truth.target.in_sight
    assert [other.in_sight for other in truth.others] == [True, True]


def test_truth_gives_the_target_relative_to_the_robot() -> None:
    one = world(person(2.0, 1.0), robot={"x_m": 1.0, "yaw_deg": 90.0})
    target = one.truth().target
    assert target.distance == pytest.approx(hypot(1.0, 1.0))
    assert target.bearing == pytest.approx(-pi / 4)


def test_walkers_stand_set_off_gently_and_stop_where_they_should() -> None:
    one = world(walker((2.0, 0.0), (5.0, 0.0), speed=0.9, start_after_s=4.0))
    motions = [one.people[0].at(t) for t in np.arange(0.0, 12.0, 0.02).tolist()]
    assert all(m.x == 2.0 for m in motions[:200])
    changes = [abs(b.speed - a.speed) / 0.02 for a, b in pairwise(motions)]
    assert max(changes) < 2.0
    assert max(m.speed for m in motions) == pytest.approx(0.9)
    assert motions[-1].x == pytest.approx(5.0, abs=0.01)
    assert motions[-1].speed == 0.0


@pytest.mark.parametrize("v", [0.4, 0.8, 1.2])
def test_the_standing_foot_stays_on_its_place(v: float) -> None:
    one = world(walker((2.0, 0.0), (20.0, 0.0), speed=v))
    times = np.arange(4.0, 8.0, 0.01).tolist()
    motions = [one.people[0].at(t) for t in times]
    feet = np.array([[m.x + swing(m, side) for side in (1, -1)] for m in motions])
    slowest = np.abs(np.diff(feet, axis=0) / 0.01).min(axis=1)
    assert np.median(slowest) < 0.1 * v
    assert (feet.max(axis=1) - feet.min(axis=1)).max() == pytest.approx(0.24 + 0.31 * v, rel=0.1)


def test_walkers_turn_after_the_path() -> None:
    one = world(walker((2.0, 0.0), (4.0, 0.0), (4.0, 4.0), speed=0.8))
    turns = [one.people[0].at(t) for t in np.arange(0.5, 7.0, 0.1).tolist()]
    assert turns[0].heading == pytest.approx(0.0, abs=0.01)
    assert turns[-1].heading == pytest.approx(pi / 2, abs=0.05)
    rates = [wrap_angle(b.heading - a.heading) / 0.1 for a, b in pairwise(turns)]
    assert max(rates) < radians(150)
    for a, b in pairwise(turns[5:]):
        course = atan2(b.y - a.y, b.x - a.x)
        assert abs(wrap_angle(course - a.heading)) < radians(60)


def test_a_crosser_passes_behind_the_target_at_the_given_distance() -> None:
    crosser = walker((4.0, -2.5), (4.0, 2.5), crosses_m=0.7, name="crosser")
    one = world(walker((1.0, 0.0), (9.0, 0.0), speed=0.6), crosser)
    target, other = one.people
    crossing = min(np.arange(0.0, 15.0, 0.02).tolist(), key=lambda t: abs(other.at(t).y))
    assert target.at(crossing).x - 4.0 == pytest.approx(0.7, abs=0.1)


def test_the_same_seed_and_calls_give_the_same_world_to_the_bit() -> None:
    def story(seed: int) -> bytes:
        one = world(
            walker((2, 0), (6, 1)), seed=seed, walls=ROOM, robot={"wheel_error": 0.01, "slip": 0.03}
        )
        record = []
        for k in range(100):
            one.drive(0.3 + 0.1 * sin(k / 9), 0.3 + 0.1 * cos(k / 7))
            one.advance(0.037 * (k + 1))
            record.append(one.ranges(CENTRE, FAN, NOW).tobytes() + repr(one.truth()).encode())
        return b"".join(record)

    assert story(1) == story(1)
    assert story(1) != story(2)
