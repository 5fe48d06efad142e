"""Legs in scans: of every scanner, in the sun, half hidden, and before a map."""

from dataclasses import replace
from math import inf, nan, radians

import numpy as np
import pytest

from followerd.geometry import Array, Pose2
from followerd.messages import Scan
from followerd.perception.background import Background, BackgroundSettings
from followerd.perception.foreground import ForegroundSettings, foreground, on_walls
from followerd.perception.legs import LegSettings, People, find_people, speckle
from tests.laser_scenes import legs, scan_of

SETTINGS = LegSettings()
AHEAD = (2.0, 0.0)
ROOM = np.array([[-1, -3, 5, -3], [5, -3, 5, 3], [5, 3, -1, 3], [-1, 3, -1, -3]], float)


def found(scan: Scan) -> People:
    return find_people(scan, SETTINGS)


def nearest(people: People, at: tuple[float, float]) -> float:
    """Distance of the best pair, m."""
    return float(np.hypot(*(people.position[people.both] - at).T).min(initial=inf))


def combed(scan: Scan, offset: int, teeth: int) -> Scan:
    """Only every `teeth`-th beam, as one turn of an interlacing mirror sees."""
    return replace(
        scan,
        angle_min=scan.angle_min + offset * scan.angle_increment,
        angle_increment=teeth * scan.angle_increment,
        ranges=scan.ranges[offset::teeth],
        beam_times=scan.beam_times[offset::teeth],
    )


@pytest.mark.parametrize("step_deg", [0.25, 0.35, 0.5, 1.0])
@pytest.mark.parametrize("distance", [0.8, 2.0, 3.0])
def test_two_legs_are_one_person_at_every_resolution(step_deg: float, distance: float) -> None:
    rng = np.random.default_rng(1)
    at = (distance, 0.3)
    people = found(scan_of(legs(at, 0.2), walls=ROOM, step_deg=step_deg, rng=rng))
    assert nearest(people, at) < 0.06


@pytest.mark.parametrize("offset", [0, 1])
def test_one_comb_of_an_interlaced_scan_shows_them_too(offset: int) -> None:
    whole = scan_of(legs(AHEAD, 0.0), walls=ROOM, step_deg=0.5, rng=np.random.default_rng(2))
    assert nearest(found(combed(whole, offset, 2)), AHEAD) < 0.06


def test_combs_of_a_walking_person_make_one_scan() -> None:
    first = scan_of(legs(AHEAD, 0.0, 0.00), walls=ROOM)
    second = scan_of(legs((2.02, 0.0), 0.0, 0.02), walls=ROOM)
    both = first.ranges.copy()
    both[1::2] = second.ranges[1::2]
    assert nearest(found(replace(first, ranges=both)), AHEAD) < 0.06


def test_positions_are_in_base() -> None:
    mount = Pose2(0.2, -0.1, radians(30))
    assert nearest(found(scan_of(legs(AHEAD, 0.0), mount=mount)), AHEAD) < 0.03


def test_walls_are_nobody() -> None:
    people = found(scan_of(np.empty((0, 3)), walls=ROOM))
    assert len(people.position) == 0


def test_an_empty_scan_shows_nobody() -> None:
    for nothing in (inf, nan):
        scan = scan_of(np.empty((0, 3)))
        assert not len(found(replace(scan, ranges=np.full(scan.ranges.size, nothing))).position)


def test_lone_returns_are_speckle() -> None:
    scan = scan_of(np.empty((0, 3)))
    ranges = scan.ranges.copy()
    ranges[40:320:7] = 2.0
    speckled = replace(scan, ranges=ranges)
    assert not len(found(speckled).position)
    assert speckle(speckled) > 0.05
    assert speckle(scan_of(legs(AHEAD, 0.0))) == 0.0


def test_dazzled_beams_do_not_cut_a_leg() -> None:
    scan = scan_of(legs((1.0, 0.0), 0.0))
    ranges = scan.ranges.copy()
    ranges[np.flatnonzero(np.isfinite(ranges))[3::5]] = nan
    assert nearest(found(replace(scan, ranges=ranges)), (1.0, 0.0)) < 0.05


def test_a_leg_beside_what_hides_the_other_is_moved_behind_it() -> None:
    person = legs(AHEAD, 0.0)  # left leg at y = 0.1, right at y = -0.1
    screen = np.array([[1.0, -1.0, 1.0, -0.01]])
    people = found(scan_of(person, walls=screen))
    off = np.hypot(*(people.position - AHEAD).T)
    assert off.min() < 0.05
    assert not people.both[off.argmin()]


BOARDS = np.array([[[2.0, -1.0], [2.6, 0.2]], [[3.0, 1.0], [4.2, 1.4]], [[1.2, 1.2], [1.3, 2.2]]])
MAP = np.concatenate([BOARDS, ROOM.reshape(-1, 2, 2)])


@pytest.mark.parametrize("step_deg", [0.5, 1.0])
def test_a_mapped_room_shows_no_ghosts_and_a_person_in_it(step_deg: float) -> None:
    rng = np.random.default_rng(3)
    ghosts, missed = 0, 0
    for _ in range(60):
        pose = Pose2(rng.uniform(0.3, 1.5), rng.uniform(-2.0, 0.8), rng.uniform(-0.6, 0.6))
        wrong = Pose2(*(0.04, 0.04, 0.015) * rng.standard_normal(3))
        believed = Pose2(pose.x + wrong.x, pose.y + wrong.y, pose.theta + wrong.theta)
        at = pose.apply_point(1.2, -0.5)
        for circles in (np.empty((0, 3)), legs(at, 1.0)):
            scan = scan_of(circles, walls=MAP.reshape(-1, 4), step_deg=step_deg, pose=pose, rng=rng)
            new = foreground(scan, MAP, believed, ForegroundSettings())
            people = find_people(scan, SETTINGS, new)
            if len(circles):
                off = np.hypot(*(people.position - (1.2, -0.5)).T)
                missed += off.min(initial=inf) > 0.3
            else:
                ghosts += len(people.position) > 0
    assert ghosts <= 1
    assert missed <= 12  # some stand in a board, behind one, or outside the room


def test_ranges_alone_show_ghosts_at_the_ends_of_boards() -> None:
    near = ForegroundSettings(from_walls_m=0.0, from_walls_share=0.0)
    rng = np.random.default_rng(4)
    shown = {True: 0, False: 0}
    for _ in range(40):
        pose = Pose2(rng.uniform(0.3, 1.5), rng.uniform(-2.0, 0.8), rng.uniform(-0.6, 0.6))
        believed = Pose2(pose.x + 0.06, pose.y - 0.05, pose.theta + 0.02)
        scan = scan_of(np.empty((0, 3)), walls=MAP.reshape(-1, 4), pose=pose, rng=rng)
        for both, settings in ((True, ForegroundSettings()), (False, near)):
            shown[both] += int(foreground(scan, MAP, believed, settings).sum())
    assert shown[False] > 20
    assert shown[True] == 0


def test_without_walls_every_return_is_new() -> None:
    scan = scan_of(legs(AHEAD, 0.0))
    new = foreground(scan, np.empty((0, 2, 2)), Pose2(), ForegroundSettings())
    assert (new == np.isfinite(scan.ranges)).all()


def stood(seconds: float, points: Array, but: tuple[float, float]) -> Background:
    background = Background(BackgroundSettings())
    for step in range(round(10 * seconds)):
        background.learn(points, np.array(but), 0.6, 0.1 * step, 0.1)
    return background


def test_what_stands_for_long_is_background_but_for_the_person() -> None:
    chair, person = (3.0, 1.0), (1.0, 0.0)
    points = np.array([chair, person])
    assert stood(6.0, points, person).stands(points, 6.0).tolist() == [True, False]
    assert not stood(2.0, points, person).stands(points, 2.0).any()


def test_what_was_carried_away_is_forgotten() -> None:
    chair = np.array([[3.0, 1.0]])
    background = stood(6.0, chair, (0.0, 0.0))
    assert background.stands(chair + 0.08, 7.0).all()
    assert not background.stands(chair, 60.0).any()


@pytest.mark.parametrize(("aside", "explained"), [(0.0, True), (0.15, False), (0.5, False)])
def test_a_boards_end_is_the_maps_and_a_leg_beside_it_is_not(aside: float, explained: bool) -> None:
    board = np.array(
        [[[1.0, -0.03], [1.9, -0.03]], [[1.0, 0.03], [1.9, 0.03]], [[1.0, -0.03], [1.0, 0.03]]]
    )
    drawn = board.reshape(-1, 4) if explained else board.reshape(-1, 4)[:0]
    circles = np.empty((0, 3)) if explained else np.array([[1.05, aside, 0.06]])
    scan = scan_of(circles, walls=drawn)
    points = scan.points()
    near = np.flatnonzero(np.hypot(*points.T) < 1.5)
    first, last = near[:1], near[-1:]
    assert on_walls(points, first, last, board, 0.1).tolist() == [explained]
