"""The hybrid filter follows moving boxes, and the image plane follows the robot."""

from math import radians

import numpy as np
import pytest

from followerd.estimation.hybrid import PAPER_NOISE, HybridFilter
from followerd.estimation.image_plane import by_odometry
from followerd.estimation.particles import Estimator
from followerd.geometry import Array, Camera, Pose2

CAMERA = Camera.from_hfov(192, 144, radians(48), z=0.6, elevation=radians(-5))
DT = 1 / 15


def hybrid(box: Array, count: int = 150) -> HybridFilter:
    return HybridFilter(box, count, PAPER_NOISE, (192, 144), np.random.default_rng(5))


def seen(x: float, y: float, height: float = 1.5, width: float = 0.5) -> Array:
    """Box (4,) of somebody standing at (x, y) of `base`."""
    foot, head = CAMERA.project(np.array([[x, y, 0.0], [x, y, height]]))
    w = width * CAMERA.fx / foot[2]
    return np.array([foot[0], 0.5 * (foot[1] + head[1]), w, foot[1] - head[1]])


def test_it_follows_a_box_that_moves_and_grows() -> None:
    box = np.array([60.0, 70.0, 20.0, 50.0])
    tracker = hybrid(box)
    noise = np.random.default_rng(6)
    for _ in range(40):
        box = box + (1.5, 0.4, 0.2, 0.5)
        tracker.predict(DT)
        measured = box + noise.normal(0.0, 0.7, 4)
        clutter = np.array([20.0, 100.0, 20.0, 50.0])
        assert tracker.update(np.array([clutter, measured]), "max") is not None
    assert tracker.box() == pytest.approx(box, abs=4.0)
    assert tracker.size[2:] / 15 == pytest.approx([0.2, 0.5], abs=0.4)


def test_the_predicted_size_gates_candidates() -> None:
    tracker = hybrid(np.array([60.0, 70.0, 20.0, 50.0]))
    tracker.predict(DT)
    near, far = tracker.shape_distance(np.array([[21.0, 52.0], [60.0, 50.0]]))
    assert near < 1.0
    assert far > 9.21


def test_without_candidates_nothing_is_updated() -> None:
    tracker = hybrid(np.array([60.0, 70.0, 20.0, 50.0]))
    tracker.predict(DT)
    assert tracker.update(np.empty((0, 4)), "max") is None
    assert tracker.update(np.array([[1e4, 70.0, 20.0, 50.0]]), "max") is None


def test_coasting_freezes_the_size_and_bounds_its_doubt() -> None:
    tracker = hybrid(np.array([60.0, 70.0, 20.0, 50.0]))
    for _ in range(100):
        tracker.predict(DT)
        tracker.coast(DT)
    assert tracker.size == pytest.approx([20.0, 50.0, 0.0, 0.0])
    assert tracker.P[0, 0] <= 16.0 * 9.0 + 1e-9
    assert np.isfinite(tracker.particles).all()


@pytest.mark.parametrize("how", ["max", "mean", "cluster"])
def test_the_estimate_stays_with_the_supported_candidate(how: Estimator) -> None:
    tracker = hybrid(np.array([60.0, 70.0, 20.0, 50.0]), 400)
    tracker.predict(DT)
    candidates = np.array([[62.0, 70.0, 20.0, 50.0], [150.0, 70.0, 20.0, 50.0]])
    found = tracker.update(candidates, how)
    assert found is not None
    assert found.candidate == 0
    assert found.support > 0.99


@pytest.mark.parametrize(
    "motion",
    [Pose2(0.1, 0.0, 0.0), Pose2(0.0, 0.0, radians(4)), Pose2(0.08, 0.01, radians(-5))],
)
def test_somebody_who_stands_still_is_where_the_homography_says(motion: Pose2) -> None:
    before, now = Pose2(1.0, -2.0, 0.7), Pose2(1.0, -2.0, 0.7) @ motion
    was = seen(3.0, 0.3)
    change = by_odometry(CAMERA, before, now, was)
    tracker = hybrid(was)
    tracker.move_camera(change.homography, change.below, change.zoom)
    there = seen(*(~motion).apply_point(3.0, 0.3))
    assert tracker.box() == pytest.approx(there, abs=0.6)
    assert tracker.particles[:, :2].mean(axis=0) == pytest.approx(there[:2], abs=1.0)


def test_without_a_foot_under_the_horizon_only_the_turn_is_undone() -> None:
    shirt = np.array([96.0, 20.0, 30.0, 40.0])
    turned = by_odometry(CAMERA, Pose2(), Pose2(0.5, 0.0, radians(5)), shirt)
    assert turned.zoom == 1.0
    assert turned.below == 0.0
    x, y, z = turned.homography @ (96.0, 20.0, 1.0)
    assert x / z == pytest.approx(CAMERA.column(CAMERA.bearing(96.0) - radians(5)), abs=0.5)
    assert y / z == pytest.approx(20.0, abs=0.5)


def test_standing_still_changes_nothing() -> None:
    pose = Pose2(3.0, 1.0, -2.0)
    change = by_odometry(CAMERA, pose, pose, seen(2.5, 0.0))
    assert change.homography / change.homography[2, 2] == pytest.approx(np.eye(3), abs=1e-9)
    assert change.zoom == pytest.approx(1.0)
