"""Rays meet walls and legs where geometry says."""

from math import cos, hypot, inf, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.geometry import Array
from followerd.sim.raycast import cast, cast_one, distance_to_segments

NO_SEGMENTS, NO_CIRCLES = np.zeros((0, 4)), np.zeros((0, 3))
coordinate = st.floats(-6, 6, width=32)
segment = st.tuples(coordinate, coordinate, coordinate, coordinate).filter(
    lambda s: hypot(s[2] - s[0], s[3] - s[1]) > 0.1
)
circle = st.tuples(coordinate, coordinate, st.floats(0.05, 2))
ray = st.tuples(coordinate, coordinate, st.floats(-7, 7))


def shot(x: float, y: float, angle: float, segments: Array, circles: Array) -> float:
    direction = np.array([[cos(angle), sin(angle)]])
    return float(cast(np.array([x, y]), direction, segments, circles)[0])


@pytest.mark.parametrize("angle", np.radians([-80, -45, 0, 30, 60]).tolist())
def test_a_wall_ahead_is_as_far_as_trigonometry_says(angle: float) -> None:
    wall = np.array([[2.0, -50.0, 2.0, 50.0]])
    assert shot(0, 0, angle, wall, NO_CIRCLES) == pytest.approx(2.0 / cos(angle))
    assert shot(0, 0, angle + pi, wall, NO_CIRCLES) == inf


@pytest.mark.parametrize(("offset", "range_"), [(0.0, 1.9), (0.06, 2 - 0.08), (0.11, inf)])
def test_a_leg_is_round(offset: float, range_: float) -> None:
    leg = np.array([[2.0, offset, 0.1]])
    assert shot(0, 0, 0, NO_SEGMENTS, leg) == pytest.approx(range_)


def test_a_ray_that_starts_inside_a_circle_hits_its_far_side() -> None:
    assert shot(0.5, 0, 0, NO_SEGMENTS, np.array([[0.0, 0.0, 2.0]])) == pytest.approx(1.5)


def test_nothing_there_is_infinitely_far() -> None:
    assert shot(0, 0, 0, NO_SEGMENTS, NO_CIRCLES) == inf


def test_circles_may_stand_elsewhere_for_each_ray() -> None:
    rays = np.array([[1.0, 0.0], [1.0, 0.0]])
    moving = np.array([[[2.0, 3.0], [0.0, 0.0], [0.5, 0.5]]])
    assert cast(np.zeros(2), rays, NO_SEGMENTS, moving) == pytest.approx([1.5, 2.5])


@given(st.lists(ray, min_size=1, max_size=12), st.lists(segment, max_size=8))
def test_many_rays_and_segments_agree_with_one_at_a_time(
    rays: list[tuple[float, float, float]], segments: list[tuple[float, float, float, float]]
) -> None:
    pieces = np.array(segments, float).reshape(-1, 4)
    origins = np.array([(x, y) for x, y, _ in rays])
    directions = np.array([(cos(a), sin(a)) for _, _, a in rays])
    together = cast(origins, directions, pieces, NO_CIRCLES)
    for (x, y, angle), found in zip(rays, together.tolist(), strict=True):
        alone = _by_hand(x, y, angle, segments)
        if alone is not None:
            assert found == pytest.approx(alone, abs=1e-6)


def _by_hand(
    x: float, y: float, angle: float, segments: list[tuple[float, float, float, float]]
) -> float | None:
    """The same by solving 2 x 2 systems; None where an end is grazed and both answers are right."""
    best = inf
    for x0, y0, x1, y1 in segments:
        system = np.array([[cos(angle), x0 - x1], [sin(angle), y0 - y1]])
        if abs(np.linalg.det(system)) < 1e-6:
            return None
        t, u = np.linalg.solve(system, [x0 - x, y0 - y]).tolist()
        if min(abs(t), abs(u), abs(u - 1)) < 1e-6:
            return None
        if t > 0 and 0 < u < 1:
            best = min(best, t)
    return best


@given(ray, st.lists(circle, min_size=1, max_size=6))
def test_a_hit_on_circles_lies_on_one_and_enters_none_before(
    ray: tuple[float, float, float], circles: list[tuple[float, float, float]]
) -> None:
    x, y, angle = ray
    found = shot(x, y, angle, NO_SEGMENTS, np.array(circles))
    steps = np.linspace(0.0, min(found, 30.0), 50)[:-1]
    outside = [hypot(x - cx, y - cy) - r for cx, cy, r in circles]
    if min(outside) < 1e-3:
        return  # starts inside or on the rim
    for cx, cy, r in circles:
        gaps = np.hypot(x + steps * cos(angle) - cx, y + steps * sin(angle) - cy) - r
        assert gaps.min() > -1e-6
    if found < inf:
        end = x + found * cos(angle), y + found * sin(angle)
        rim = min(abs(hypot(end[0] - cx, end[1] - cy) - r) for cx, cy, r in circles)
        assert rim < 1e-5


@pytest.mark.parametrize(
    ("x", "y", "distance"), [(0.5, 2.0, 2.0), (-1.0, 1.0, sqrt(2)), (2.0, 0.0, 1.0), (0.3, 0, 0)]
)
def test_distance_to_a_segment_counts_its_ends(x: float, y: float, distance: float) -> None:
    found = distance_to_segments(x, y, np.array([[0.0, 0.0, 1.0, 0.0]]))
    assert found == pytest.approx([distance], abs=1e-12)


@given(ray, st.lists(segment, max_size=8), st.lists(circle, max_size=6))
def test_a_single_ray_without_arrays_finds_the_same(
    ray: tuple[float, float, float],
    segments: list[tuple[float, float, float, float]],
    circles: list[tuple[float, float, float]],
) -> None:
    x, y, angle = ray
    if _by_hand(x, y, angle, segments) is None:
        return
    arrays = np.array(segments, float).reshape(-1, 4), np.array(circles, float).reshape(-1, 3)
    alone = cast_one(x, y, cos(angle), sin(angle), segments, circles)
    found = shot(x, y, angle, *arrays)
    if any(abs(cast_gap(x, y, angle, c)) < 1e-6 for c in circles):
        return
    assert alone == pytest.approx(found, abs=1e-9)


def cast_gap(x: float, y: float, angle: float, circle: tuple[float, float, float]) -> float:
    """By how much a ray's line passes outside a circle, m."""
    cx, cy, radius = circle
    return abs((cx - x) * sin(angle) - (cy - y) * cos(angle)) - radius
