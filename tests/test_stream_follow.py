"""The stream-field follow law: where it goes, and where it never goes."""

from dataclasses import replace
from math import hypot, isfinite, pi, radians
from time import process_time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.bench.closed_loop import simulate
from followerd.config import load
from followerd.control.clearance import time_to_contact
from followerd.control.ground import Ground
from followerd.control.image_centering import ImageCentering
from followerd.control.interfaces import Scene, Target
from followerd.control.registry import CONTROLLERS
from followerd.control.stream_follow import StreamFollow, StreamFollowSettings
from followerd.control.surroundings import Surroundings
from followerd.geometry import Pose2
from followerd.messages import TrackPhase, Twist
from tests import follow_rig
from tests.stream_scenes import BODY, Drive, view_of, walls

CONFIRMED, OCCLUDED = TrackPhase.CONFIRMED, TrackPhase.OCCLUDED
NO_CIRCLES = np.empty((0, 3))


def until_near(drive: Drive, x: float, y: float, seconds: float = 30.0, near: float = 1.75) -> bool:
    """Drive toward a standing person; whether the robot comes near and sees them."""
    end = drive.now + seconds
    while drive.now < end:
        drive.step(drive.target(x, y))
        if drive.sees(x, y) and hypot(x - drive.base.x, y - drive.base.y) < near:
            return True
    return False


def test_with_nothing_about_it_does_as_zhuangs_law() -> None:
    drive = Drive()
    zhuang = ImageCentering(StreamFollowSettings())
    for target in (drive.target(3.0, 0.0), drive.target(3.0, 1.0), drive.target(2.0, -0.5)):
        wish, plain = drive.wish(target), zhuang.wish(target)
        assert (wish.v, wish.omega) == pytest.approx((plain.v, plain.omega))


def test_it_stands_before_a_standing_person() -> None:
    assert Drive().wish(Target(0.0, 1.5)) == Twist()


def test_without_a_range_it_only_turns() -> None:
    wish = Drive().wish(Target(0.5, None))
    assert wish.v == 0.0
    assert wish.omega > 0.0


@pytest.mark.parametrize("side", [1.0, pytest.param(-1.0, marks=pytest.mark.slow)])
def test_it_rounds_a_pillar_on_the_nearer_side(side: float) -> None:
    drive = Drive(circles=np.array([[2.0, 0.15 * side, 0.3]]))
    assert not drive.law.lines().size
    assert until_near(drive, 4.5, 0.0)
    assert np.hypot(*(drive.law.lines()[:, 0] - (drive.base.x, drive.base.y)).T).max() < 1.0
    assert not drive.touched
    passing = min(drive.trace, key=lambda pose: abs(pose.x - 2.0))
    assert passing.y * side < 0.0


@pytest.mark.slow
def test_it_goes_round_a_wall_to_the_person_behind() -> None:
    drive = Drive(walls((2.0, -4.0), (2.0, 1.0)))
    assert until_near(drive, 4.0, -0.5)
    assert not drive.touched


@pytest.mark.slow
def test_it_finds_out_of_a_dead_end() -> None:
    drive = Drive(walls((-1.0, 1.2), (1.5, 1.2), (1.5, -1.2), (-1.0, -1.2)))
    assert until_near(drive, 3.0, 0.0, 60.0, near=2.2)  # it stays where it sees them from
    assert not drive.touched


def test_a_person_nobody_can_get_at_is_not_driven_at() -> None:
    drive = Drive(walls((2.0, -1.0), (4.0, -1.0), (4.0, 1.0), (2.0, 1.0), (2.0, -1.0)))
    for _ in range(80):
        drive.step(drive.target(3.0, 0.0))
    assert not drive.touched


def test_a_hidden_person_is_looked_for_from_a_view_point() -> None:
    """The place where they should be comes into sight long before the robot would be there."""
    drive = Drive(walls((2.0, -0.8), (2.0, 0.8)))
    hidden = (3.2, -0.2)
    for _ in range(200):
        drive.step(drive.target(*hidden, sigma=0.4, phase=OCCLUDED))
        if drive.sees(*hidden):
            break
    assert drive.sees(*hidden)
    assert drive.base.x < 2.0
    assert hypot(hidden[0] - drive.base.x, hidden[1] - drive.base.y) > 1.1
    assert not drive.touched


def test_it_takes_a_wider_course_before_the_person_goes_out_of_sight() -> None:
    """They round a board's end: the robot leaves its straight way to see behind the board."""
    drive = Drive(walls((2.0, -1.5), (2.0, 0.0)))
    wish = drive.wish(drive.target(2.1, 0.4, (0.4, -0.4)))
    plain = ImageCentering(StreamFollowSettings()).wish(drive.target(2.1, 0.4, (0.4, -0.4)))
    assert wish.omega > plain.omega


def test_nobody_is_driven_at_who_is_near() -> None:
    drive = Drive(walls((0.5, -1.5), (0.5, -0.5)))
    for phase in (CONFIRMED, OCCLUDED):
        assert drive.wish(drive.target(0.9, 0.0, (0.5, 0.0), 0.3, phase)).v <= 0.0
        drive.now += 1.0


def test_a_return_from_inside_the_robot_is_no_wonder() -> None:
    wish = Drive(walls((0.0, 0.0), (0.0, 1.0))).wish(Target(0.3, 3.0))
    assert isfinite(wish.omega)
    assert wish.v == 0.0


points = st.tuples(st.floats(-4, 4), st.floats(-4, 4))


@given(
    st.lists(st.tuples(points, points), max_size=5),
    points,
    points,
    st.floats(0.0, 2.0),
    st.sampled_from(TrackPhase),
)
def test_no_wish_leads_into_what_is_seen(
    lines: list[tuple[tuple[float, float], tuple[float, float]]],
    person: tuple[float, float],
    velocity: tuple[float, float],
    sigma: float,
    phase: TrackPhase,
) -> None:
    drive = Drive(np.array([(*a, *b) for a, b in lines]).reshape(-1, 4))
    wish = drive.wish(drive.target(*person, velocity, sigma, phase))
    assert isfinite(wish.v)
    assert isfinite(wish.omega)
    assert abs(wish.omega) <= radians(57.0) + 1e-9
    seen = drive.law.nearby(drive.base)
    if wish.v > 0.0 and len(seen):
        assert time_to_contact(seen, wish, BODY).min() > 0.99


@pytest.mark.slow
def test_the_way_through_a_gap_of_a_metre_is_driven_without_scraping_or_sticking() -> None:
    """Through the guard: two boards, and the person walks on between them."""
    door = np.concatenate([walls((3.0, 0.5), (3.0, 3.0)), walls((3.0, -3.0), (3.0, -0.5))])
    path = follow_rig.walking(2.0, [(0.0, 4.0), (0.6, 12.0)])
    rig = follow_rig.Rig(person=path, walls=door)
    rig.pipeline.controller = StreamFollow()
    rig.armed()
    least = 9.0
    while rig.now < 16.0:
        rig.run(0.1)
        for post in (0.5, -0.5):
            x, y = (~rig.pose).apply_point(3.0, post)
            aside = max(abs(y) - BODY.half_width, 0.0)
            beyond = max(x - BODY.front, -x - BODY.rear, 0.0)
            least = min(least, hypot(aside, beyond))
    assert rig.pose.x > 4.5
    assert least > 0.1


def test_what_is_out_of_view_is_remembered_and_what_was_seen_through_is_gone() -> None:
    known, pillar = Surroundings(5.0, 4.0), np.array([[2.0, 0.0, 0.2]])
    empty = np.empty((0, 4))
    known.see(view_of(Pose2(), 0.0, empty, pillar), (), None)
    assert len(known.points)
    known.see(view_of(Pose2(theta=pi), 1.0, empty, pillar), (), None)
    assert len(known.points)
    wall = walls((4.0, -4.0), (4.0, 4.0))
    known.see(view_of(Pose2(), 2.0, wall, NO_CIRCLES), (), None)
    assert known.points[:, 0].min() > 3.0
    known.see(view_of(Pose2(theta=pi), 9.0, empty, NO_CIRCLES), (), None)
    assert not len(known.points)


def test_what_is_remembered_stays_where_it_is_on_the_map_while_odometry_drifts() -> None:
    law, pillar, empty = StreamFollow(), np.array([[1.0, 0.0, 0.1]]), np.empty((0, 4))
    person = Target(0.0, 3.0)
    for k in range(4):
        drift = Pose2(theta=0.1 * k)
        base = drift @ Pose2(theta=0.0 if k == 0 else pi)
        view = view_of(Pose2(theta=0.0 if k == 0 else pi), 0.2 * k, empty, pillar)
        view = replace(view, base=base, map_from_odom=~drift)
        law.wish(person, Scene(view.scan.stamp, base, Twist(), view=view))
    remembered = law.nearby(base)
    assert remembered.mean(axis=0) == pytest.approx((-0.9, 0.0), abs=0.05)
    # nothing drifts by metres: the robot was taken for somewhere else
    view = replace(view, scan=replace(view.scan, stamp=3.0), map_from_odom=Pose2(1.0, 1.0))
    law.wish(person, Scene(3.0, base, Twist(), view=view))
    assert law.nearby(base).mean(axis=0) == pytest.approx((-0.9, 0.0), abs=0.05)


def test_the_persons_own_legs_stand_in_nobodys_way() -> None:
    known, legs = Surroundings(5.0, 4.0), np.array([[2.0, 0.1, 0.06], [2.1, -0.1, 0.06]])
    known.see(view_of(Pose2(), 0.0, np.empty((0, 4)), legs), (), (2.05, 0.0))
    assert not len(known.points)
    known.see(view_of(Pose2(), 1.0, np.empty((0, 4)), legs), (slice(80, 100),), None)
    assert not len(known.points)


def test_ways_over_the_floor_are_nearly_as_short_as_can_be() -> None:
    nothing = np.empty((0, 2))
    ground = Ground(nothing, (0.05, 0.05), 0.36, 0.5)
    for goal in ((3.05, 0.05), (2.05, 2.05), (-1.05, 2.55)):
        ground.spread(goal, nothing)
        way = ground.way(goal)
        length = np.hypot(*np.diff(way, axis=0).T).sum()
        assert length < 1.1 * hypot(goal[0] - 0.05, goal[1] - 0.05)
        assert way[-1] == pytest.approx(goal)


def test_where_no_way_leads_the_nearest_place_is_gone_to() -> None:
    wall = np.column_stack([np.full(400, 2.0), np.linspace(-6.0, 6.0, 400)])
    ground = Ground(wall, (0.0, 0.0), 0.36, 0.5)
    ground.spread((4.0, 0.0), np.empty((0, 2)))
    x, y = ground.way((4.0, 0.0))[-1].tolist()
    assert 1.4 < x < 1.75
    assert abs(y) < 0.3


def test_it_is_found_by_its_name() -> None:
    assert isinstance(CONTROLLERS.load("stream_field")(StreamFollowSettings()), StreamFollow)


@pytest.mark.slow
@pytest.mark.realtime
def test_a_wish_costs_a_fraction_of_a_millisecond() -> None:
    room = walls((-2.0, -3.0), (6.0, -3.0), (6.0, 3.0), (-2.0, 3.0), (-2.0, -3.0))
    boards = np.concatenate([room, walls((2.0, -0.8), (2.0, 0.8)), walls((3.5, 0.0), (3.5, 2.0))])
    best = 1.0
    for _ in range(5):
        drive, spent = Drive(boards), 0.0
        for k in range(100):
            target = drive.target(3.0, -0.2, (0.0, 0.5), 0.3, OCCLUDED if k % 2 else CONFIRMED)
            began = process_time()
            drive.wish(target)
            spent += process_time() - began
            drive.now += 1.0 / 45.0
        best = min(best, spent / 100)
    assert best < 0.002


@pytest.mark.slow
def test_the_whole_daemon_follows_among_boards_and_touches_none() -> None:
    config = load("stream_field-sim", {"sim.scenario": "boards", "seed": 1})
    figures = simulate(config, 18.0)["follow"]
    assert figures["collision_count"] == 0
    assert figures["tracking_rate"] > 0.8
    assert figures["wrong_follow_m"] == 0.0
