"""Where the law stands to see the person, wherever they walk next."""

from math import hypot, pi

import numpy as np
import pytest

from followerd.control.ground import Ground, Point
from followerd.control.lookout import LookoutSettings, lookout, unseen, walks
from followerd.geometry import Array

SETTINGS = LookoutSettings()


def wall(start: Point, end: Point) -> Array:
    """Returns every 3 cm (N, 2)."""
    count = int(hypot(end[0] - start[0], end[1] - start[1]) / 0.03) + 2
    return np.linspace(start, end, count)


def ground(here: Point, *walls: Array) -> Ground:
    return Ground(np.concatenate([np.empty((0, 2)), *walls]), here, 0.36, 0.5)


BOARDS = [wall((x, -1.0), (x, 0.0)) for x in (1.0, 2.5, 4.0)]


def test_nobody_walks_through_a_wall() -> None:
    board = wall((1.0, -3.0), (1.0, 3.0))
    spots = walks(ground((-2.0, 0.0), board), (0.0, 0.0), (0.8, 0.0), 0.0, 4.0)
    assert spots.shape[2] == 2
    assert (spots[..., 0] < 1.0).all()


@pytest.mark.parametrize("sigma", [0.05, 0.5])
def test_who_walks_may_turn_to_either_side_and_gets_no_farther_than_time_allows(
    sigma: float,
) -> None:
    spots = walks(ground((-2.0, 0.0)), (0.0, 0.0), (0.6, 0.0), sigma, 4.0)
    assert spots[-1, :, 1].max() > 0.5
    assert spots[-1, :, 1].min() < -0.5
    assert np.hypot(*spots.reshape(-1, 2).T).max() <= 2.4 + sigma


def test_what_is_beside_the_laser_is_not_seen_under_way_but_from_the_end() -> None:
    floor, spots = ground((0.0, 0.0)), np.full((4, 1, 2), (-1.0, 2.0))
    away, toward = unseen(floor, np.array([(0.3, -0.3), (-0.3, 0.3)]), spots, 0.5 * pi, SETTINGS)
    assert toward == 0.0
    assert 0.0 < away < 1.0


def test_it_drives_along_the_boards_and_not_in_between_after_the_person() -> None:
    """They turn in between two boards, and may come out again behind the next one."""
    here, person = (0.9, 1.4), (2.0, -0.6)
    floor = ground(here, *BOARDS)
    places = []
    for velocity in ((0.35, -0.5), (0.4, -0.45), (0.45, -0.4), (0.5, -0.3)):
        spots = walks(floor, person, velocity, 0.05, SETTINGS.horizon_s)
        places.append(lookout(floor, person, spots, -0.5, None, SETTINGS))
    x, y = np.array(places).T
    assert x.mean() > here[0] + 0.1
    assert y.min() > 0.5


def test_whoever_walks_in_the_open_is_seen_from_here() -> None:
    floor = ground((0.0, 0.0))
    spots = walks(floor, (1.8, 0.0), (0.05, 0.0), 0.05, SETTINGS.horizon_s)
    assert lookout(floor, (1.8, 0.0), spots, 0.0, None, SETTINGS) == (0.0, 0.0)


def test_no_place_is_looked_for_where_nothing_would_be_seen_from_any() -> None:
    """Behind a long wall: the way there is the law's business."""
    floor = ground((0.0, 0.0), wall((1.0, -4.0), (1.0, 4.0)))
    spots = walks(floor, (3.0, 0.0), (0.0, 0.0), 0.3, SETTINGS.horizon_s)
    place = lookout(floor, (3.0, 0.0), spots, 0.0, None, SETTINGS)
    assert place is None or place[0] < 0.7
