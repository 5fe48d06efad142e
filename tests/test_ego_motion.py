"""The pose between the base's packets, and a little beyond the newest."""

from math import radians

import numpy as np
import pytest

from followerd.estimation.ego_motion import EgoMotion, EgoMotionSettings
from followerd.geometry import Pose2, wrap_angle
from followerd.messages import Command, Odometry, Twist, WheelSpeeds


def packet(stamp: float, pose: Pose2, twist: Twist) -> Odometry:
    return Odometry(stamp, stamp + 0.005, pose, twist)


def steady(twist: Twist, until: float) -> EgoMotion:
    """Packets every 100 ms of a base at constant twist."""
    ego = EgoMotion()
    for stamp in np.arange(0.0, until + 1e-9, 0.1):
        ego.observe(packet(float(stamp), Pose2().moved(twist.v, twist.omega, stamp), twist))
    return ego


def test_without_a_packet_nothing_is_known() -> None:
    ego = EgoMotion()
    assert ego.pose_at(0.0) is None
    assert ego.twist_at(0.0) is None


def test_between_packets_the_pose_is_interpolated() -> None:
    twist = Twist(0.5, 0.6)
    ego = steady(twist, 1.0)
    true = Pose2().moved(0.5, 0.6, 0.537)
    pose, speed = ego.pose_at(0.537), ego.twist_at(0.537)
    assert pose is not None
    assert (pose.x, pose.y, pose.theta) == pytest.approx((true.x, true.y, true.theta), abs=1e-3)
    assert speed is not None
    assert (speed.v, speed.omega) == pytest.approx((0.5, 0.6))


def test_a_turn_through_half_a_revolution_is_interpolated_the_short_way() -> None:
    ego = EgoMotion()
    ego.observe(packet(0.0, Pose2(theta=radians(179)), Twist()))
    ego.observe(packet(0.1, Pose2(theta=radians(-179)), Twist()))
    pose = ego.pose_at(0.05)
    assert pose is not None
    assert abs(wrap_angle(pose.theta - radians(180))) < 1e-9


def test_beyond_the_newest_packet_the_measured_speed_goes_on() -> None:
    ego = steady(Twist(0.4, -0.3), 1.0)
    true = Pose2().moved(0.4, -0.3, 1.15)
    pose = ego.pose_at(1.15)
    assert pose is not None
    assert (pose.x, pose.y, pose.theta) == pytest.approx((true.x, true.y, true.theta), abs=1e-4)


def test_a_command_is_ramped_toward_after_its_latency() -> None:
    ego = EgoMotion(EgoMotionSettings(accel_mps2=0.5, latency_s=0.03))
    ego.observe(packet(0.0, Pose2(), Twist()))
    ego.commanded(Command(0.0, Twist(0.5, 0.0), expires=9.0))
    still, moving = ego.twist_at(0.03), ego.twist_at(0.13)
    assert still == Twist()
    assert moving is not None
    assert moving.v == pytest.approx(0.05)
    pose = ego.pose_at(0.13)
    assert pose is not None
    assert pose.x == pytest.approx(0.5 * 0.5 * 0.1**2, rel=0.01)


def test_a_command_is_no_longer_believed_after_it_expired() -> None:
    ego = EgoMotion(EgoMotionSettings(latency_s=0.0))
    ego.observe(packet(0.0, Pose2(), Twist(0.2, 0.0)))
    ego.commanded(Command(0.0, Twist(0.2, 0.0), expires=0.1))
    twist = ego.twist_at(0.3)
    assert twist is not None
    assert twist.v == pytest.approx(0.1, abs=0.01)


def test_a_stop_is_extrapolated_as_braking() -> None:
    ego = EgoMotion(EgoMotionSettings(accel_mps2=0.5, latency_s=0.0))
    ego.observe(packet(0.0, Pose2(), Twist(0.1, 0.0)))
    ego.commanded(Command(0.0))
    assert ego.twist_at(0.4) == Twist()
    pose = ego.pose_at(0.4)
    assert pose is not None
    assert pose.x == pytest.approx(0.1**2 / (2 * 0.5), rel=0.05)


def test_wheel_speeds_leave_the_measured_twist_as_it_is() -> None:
    ego = EgoMotion()
    ego.observe(packet(0.0, Pose2(), Twist(0.2, 0.1)))
    ego.commanded(Command(0.0, WheelSpeeds(0.5, 0.5), expires=9.0))
    assert ego.twist_at(0.2) == Twist(0.2, 0.1)


def test_what_was_asked_before_does_not_change_the_answer() -> None:
    commands = [Command(0.1, Twist(0.5, 0.4), expires=0.3), Command(0.2, Twist(-0.1), expires=9.0)]

    def told(questions: tuple[float, ...]) -> EgoMotion:
        ego = EgoMotion()
        ego.observe(packet(0.0, Pose2(), Twist(0.3, 0.1)))
        for command in commands:
            for stamp in questions:
                ego.pose_at(stamp)
            ego.commanded(command)
        return ego

    asked = told((0.1, 0.377, 0.05))
    for stamp in (0.09, 0.377, 0.25, 0.4):
        assert asked.pose_at(stamp) == told(()).pose_at(stamp)
        assert asked.twist_at(stamp) == told(()).twist_at(stamp)


def test_the_next_packet_rebases_the_extrapolation() -> None:
    ego = steady(Twist(0.5, 0.0), 1.0)
    slipped = Pose2(0.2, 0.0, 0.0)
    ego.observe(packet(1.1, slipped, Twist()))
    assert ego.pose_at(1.1) == slipped
    late = ego.pose_at(1.2)
    assert late is not None
    assert late.x == pytest.approx(0.2)


def test_a_packet_out_of_order_is_dropped() -> None:
    ego = steady(Twist(0.5, 0.0), 1.0)
    ego.observe(packet(0.9, Pose2(9.0, 9.0, 0.0), Twist()))
    pose = ego.pose_at(0.9)
    assert pose is not None
    assert pose.x == pytest.approx(0.45)


@pytest.mark.parametrize("stamp", [1.51, -0.1, 50.0])
def test_far_from_any_packet_it_refuses(stamp: float) -> None:
    ego = steady(Twist(0.5, 0.0), 1.0)
    assert ego.pose_at(stamp) is None
    assert ego.twist_at(stamp) is None


def test_inside_a_long_gap_it_refuses() -> None:
    ego = EgoMotion()
    ego.observe(packet(0.0, Pose2(), Twist()))
    ego.observe(packet(0.8, Pose2(), Twist()))
    assert ego.pose_at(0.4) is None
    assert ego.twist_at(0.4) is None


def test_only_the_recent_past_is_kept() -> None:
    ego = steady(Twist(0.5, 0.0), 10.0)
    assert ego.pose_at(6.0) is None
    assert ego.pose_at(7.5) is not None
    for k in range(100):
        ego.commanded(Command(0.1 * k))
    ego.observe(packet(10.1, Pose2(), Twist()))
    assert ego.pose_at(10.2) == Pose2()


def test_whether_the_wheels_turn_is_known_near_a_packet_only() -> None:
    assert steady(Twist(0.5, 0.0), 1.0).rolls(1.1)
    assert steady(Twist(0.0, -0.2), 1.0).rolls(0.55)
    assert not steady(Twist(0.005, 0.01), 1.0).rolls(1.0)
    assert not steady(Twist(0.5, 0.0), 1.0).rolls(2.0)
