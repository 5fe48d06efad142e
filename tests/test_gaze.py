"""Where the camera's head pointed when an image was taken."""

from math import radians

import numpy as np
import pytest

from followerd.estimation.gaze import AHEAD, RESTING, Gaze
from followerd.geometry import Camera
from followerd.messages import Image, PtzState

MOUNTED = Camera.from_hfov(192, 144, radians(48), z=0.6, yaw=radians(3), elevation=radians(-5))


def gaze(*states: tuple[float, float, bool], zoom: float = 1.0) -> Gaze:
    """A gaze that heard of (stamp s, pan deg, moving)."""
    told = Gaze()
    for stamp, pan, moving in states:
        told.note(PtzState(stamp, radians(pan), radians(-pan / 2), zoom, moving))
    return told


def pan_at(told: Gaze, stamp: float) -> float | None:
    """Degrees."""
    state = told.at(stamp)
    return None if state is None else float(np.degrees(state.pan))


def test_between_two_reports_the_head_turned_evenly() -> None:
    told = gaze((1.0, 0, True), (1.1, 10, True), (1.2, 30, False))
    assert pan_at(told, 1.05) == pytest.approx(5)
    assert pan_at(told, 1.15) == pytest.approx(20)
    state = told.at(1.15)
    assert state is not None
    assert state.tilt == pytest.approx(radians(-10))
    assert state.moving


def test_a_turning_head_is_extrapolated_for_a_moment_only() -> None:
    told = gaze((1.0, 0, True), (1.1, 10, True))
    assert pan_at(told, 1.15) == pytest.approx(15)
    assert pan_at(told, 1.1 + AHEAD + 0.01) is None


def test_a_resting_head_rests_until_its_silence_is_suspicious() -> None:
    told = gaze((1.0, 0, True), (1.1, 10, False))
    assert pan_at(told, 1.1 + RESTING) == pytest.approx(10)
    assert pan_at(told, 1.1 + RESTING + 0.01) is None


def test_before_the_first_report_nothing_is_known() -> None:
    assert pan_at(Gaze(), 1.0) is None
    assert pan_at(gaze((1.0, 5, False)), 0.9) is None
    assert pan_at(gaze((1.0, 5, True)), 1.1) == pytest.approx(5)


def test_a_report_out_of_order_changes_nothing() -> None:
    told = gaze((1.0, 0, True), (1.2, 20, True), (1.1, 50, True))
    assert pan_at(told, 1.1) == pytest.approx(10)


def test_an_image_gets_the_camera_as_it_was_turned_and_zoomed() -> None:
    told = gaze((1.0, 20, False), zoom=2.0)
    image = Image(7, 1.02, 1.04, np.zeros((144, 192, 3), np.uint8), MOUNTED)
    aimed = told.aimed(image)
    assert aimed is not None
    assert (aimed.id, aimed.stamp) == (7, 1.02)
    assert aimed.camera.yaw == pytest.approx(radians(23))
    assert aimed.camera.elevation == pytest.approx(radians(-15))
    assert (aimed.camera.fx, aimed.camera.cx) == (2 * MOUNTED.fx, MOUNTED.cx)
    # a person straight ahead of the turned camera stands to the robot's left
    assert aimed.camera.bearing(aimed.camera.cx) == pytest.approx(radians(23))
    assert Gaze().aimed(image) is None


def test_a_head_at_home_leaves_the_camera_as_it_is() -> None:
    assert MOUNTED.turned(0.0, 0.0) is MOUNTED
