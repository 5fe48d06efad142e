"""A scan is cut where the range jumps."""

from math import inf, nan, radians

import numpy as np
import pytest

from followerd.geometry import Array, Pose2
from followerd.messages import Clusters, Scan
from followerd.perception.clusters import ClusterSettings, find_clusters

ANGLES = np.radians(np.arange(-90, 91))


def scan_of(ranges: Array, mount: Pose2 | None = None) -> Scan:
    return Scan(
        3.0, 3.01, ANGLES[0], radians(1), ranges, 8.0, np.zeros(ranges.size), mount or Pose2()
    )


def clusters_of(ranges: Array, mount: Pose2 | None = None) -> Clusters:
    scan = scan_of(ranges, mount)
    return find_clusters(scan, scan.points(), ClusterSettings())


def beams(ranges: Array, first: int, last: int, at: float) -> Array:
    """`ranges` with beams first..last (degrees) at `at` m."""
    changed = ranges.copy()
    changed[first + 90 : last + 91] = at
    return changed


NOTHING = np.full(181, inf)


def test_an_empty_scan_has_no_clusters() -> None:
    assert clusters_of(NOTHING).first.size == 0
    assert clusters_of(np.full(181, nan)).centre.shape == (0, 2)


def test_two_legs_are_two_clusters_with_bearing_range_and_width() -> None:
    ranges = beams(beams(NOTHING, -6, -3, 2.0), 4, 7, 2.1)
    found = clusters_of(ranges)
    assert found.stamp == 3.0
    assert found.first.tolist() == [84, 94]
    assert found.last.tolist() == [87, 97]
    assert found.count.tolist() == [4, 4]
    assert found.bearing == pytest.approx(np.radians([-4.5, 5.5]))
    assert found.range == pytest.approx([2.0, 2.1], abs=2e-3)
    assert found.nearest == pytest.approx([2.0, 2.1])
    assert found.width == pytest.approx([2.0 * radians(3), 2.1 * radians(3)], rel=0.01)
    assert found.leg_like.all()


def test_positions_are_in_base() -> None:
    found = clusters_of(beams(NOTHING, -1, 1, 2.0), Pose2(0.2, 0.0, radians(90)))
    assert found.centre[0] == pytest.approx([0.2, 2.0], abs=1e-3)


def test_a_wall_is_one_cluster_and_no_leg() -> None:
    with np.errstate(divide="ignore"):
        ranges = np.where(np.abs(ANGLES) < radians(60), 2.0 / np.cos(ANGLES), inf)
    found = clusters_of(ranges)
    assert found.first.size == 1
    assert not found.leg_like.any()


def test_a_leg_before_a_wall_is_a_leg_and_the_wall_beside_it_is_not() -> None:
    wall = beams(NOTHING, -40, 40, 4.0)
    found = clusters_of(beams(wall, -2, 2, 2.0))
    assert found.leg_like.tolist() == [False, True, False]


def test_a_piece_of_wall_between_two_nearer_things_is_no_leg() -> None:
    ranges = beams(beams(beams(NOTHING, -20, -3, 2.0), -2, 2, 4.0), 3, 20, 2.0)
    assert not clusters_of(ranges).leg_like[1]


def test_a_leg_half_a_stride_behind_the_other_is_still_a_leg() -> None:
    found = clusters_of(beams(beams(NOTHING, -3, -1, 2.0), 0, 2, 2.25))
    assert found.leg_like.tolist() == [True, True]


def test_a_missing_beam_does_not_split_and_many_do() -> None:
    holed = beams(beams(NOTHING, -5, 5, 2.0), 0, 0, nan)
    assert clusters_of(holed).first.size == 1
    assert clusters_of(beams(holed, -1, 2, inf)).first.size == 2


def test_a_single_return_is_no_leg() -> None:
    assert not clusters_of(beams(NOTHING, 0, 0, 2.0)).leg_like.any()


def test_every_return_belongs_to_exactly_one_cluster() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        ranges = rng.uniform(0.5, 6.0, 181)
        ranges[rng.random(181) < 0.2] = inf
        found = clusters_of(ranges)
        assert found.count.sum() == np.isfinite(ranges).sum()
        assert (found.first[1:] > found.last[:-1]).all()
        assert (found.first <= found.last).all()
