"""Poses cancel, cameras project and back-project."""

from math import pi, radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.geometry import Camera, Pose2, wrap_angle

metres = st.floats(-50, 50)
angles = st.floats(-10, 10)
poses = st.builds(Pose2, metres, metres, angles)


@given(poses, metres, metres)
def test_a_pose_and_its_inverse_cancel(pose: Pose2, x: float, y: float) -> None:
    assert (~pose).apply_point(*pose.apply_point(x, y)) == pytest.approx((x, y), abs=1e-9)
    identity = pose @ ~pose
    assert (identity.x, identity.y) == pytest.approx((0, 0), abs=1e-9)
    assert wrap_angle(identity.theta) == pytest.approx(0, abs=1e-9)


@given(poses, poses, metres, metres)
def test_composition_is_application_in_turn(a: Pose2, b: Pose2, x: float, y: float) -> None:
    one = (a @ b).apply(np.array([[x, y]]))[0]
    assert one == pytest.approx(a.apply_point(*b.apply_point(x, y)), abs=1e-8)


@given(st.floats(-100, 100))
def test_wrapped_angles_stand_for_the_same_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -pi <= wrapped < pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-9)


def test_moving_at_constant_twist_follows_the_circle() -> None:
    pose = Pose2().moved(1.0, pi / 2, 1.0)  # a quarter of a circle of radius 2/pi
    assert (pose.x, pose.y, pose.theta) == pytest.approx((2 / pi, 2 / pi, pi / 2))


@given(st.floats(-0.3, 0.3), st.floats(-0.5, 0.5), st.floats(1.0, 6.0), st.floats(-0.4, 0.4))
def test_ground_points_come_back_from_the_image(
    elevation: float, yaw: float, distance: float, bearing: float
) -> None:
    camera = Camera.from_hfov(192, 144, radians(48), x=0.1, z=0.6, yaw=yaw, elevation=elevation)
    angle = yaw + bearing
    point = (0.1 + distance * np.cos(angle), distance * np.sin(angle))
    column, row, depth = camera.project(np.array([[*point, 0.0]]))[0]
    if depth > 0.1 and row > camera.horizon + 3:
        assert camera.ground_point(column, row) == pytest.approx(point, abs=1e-6)


def test_left_of_the_image_is_a_positive_bearing() -> None:
    camera = Camera.from_hfov(192, 144, radians(48))
    assert camera.bearing(0) == pytest.approx(radians(24), abs=0.01)
    assert camera.bearing(camera.column(0.2)) == pytest.approx(0.2)


def test_near_the_horizon_there_is_no_ground_point() -> None:
    camera = Camera.from_hfov(192, 144, radians(48), elevation=radians(-5))
    assert camera.ground_point(96, camera.horizon + 2) is None
