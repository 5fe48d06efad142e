"""Events in, decisions out, in a kinematic closed loop with a perfect track."""

from dataclasses import replace
from math import cos, hypot, radians, sin

import numpy as np
import pytest

from followerd.control.freshness import Freshness
from followerd.control.image_centering import ImageCentering, ImageCenteringSettings
from followerd.control.limits import GuardSettings
from followerd.control.transitions import Action
from followerd.events import Tick
from followerd.geometry import Pose2
from followerd.messages import (
    Decision,
    Fault,
    Mode,
    RobotPose,
    Scan,
    StopReason,
    TrackPhase,
    Twist,
)
from followerd.pipeline import Pipeline, PipelineSettings
from followerd.streams import STREAMS
from tests.follow_rig import Rig, standing, walking, wall

STROLL = walking(2.0, [(0.0, 4.0), (0.5, 60.0)])
BOX = wall(3.0, -0.4, 3.0, 0.4)


def fast() -> PipelineSettings:
    """A base whose own watchdog is set to 1 s may drive at 1 m/s."""
    return PipelineSettings(guard=GuardSettings(max_speed_mps=1.0, watchdog_s=1.0))


def kinds(decision: Decision) -> set[StopReason]:
    return {reason.stop for reason in decision.reasons}


@pytest.mark.parametrize(
    "speed", [0.8, *(pytest.param(v, marks=pytest.mark.slow) for v in (0.3, 0.5))]
)
def test_a_walking_person_is_followed_at_the_distance_through_stops(speed: float) -> None:
    settings = fast() if speed > 0.6 else PipelineSettings()
    law = ImageCenteringSettings(max_forward_mps=1.0)
    legs = [(0.0, 4.0), (speed, 14.0), (0.0, 18.0), (speed, 26.0)]
    rig = Rig(walking(1.8, legs), settings=settings, law=law).armed()
    rig.run(6.0)
    distances = [rig.run(0.1).range for _ in range(150)]
    assert max(distances[15:40]) < 1.8
    assert distances[40] > 1.2
    # who stops at once from a fast walk is come nearer to: 0.8 m/s are braked in 0.84 m
    assert min(distances) > (1.2 if speed < 0.6 else 0.9)
    assert rig.decisions[-1].mode is Mode.FOLLOWING


def test_a_person_who_walks_in_a_circle_is_kept_in_view() -> None:
    def circle(time: float) -> tuple[float, float]:
        angle = max(0.0, time - 4.0) * 0.3
        return 2.0 * cos(angle), 2.0 * sin(angle)

    rig = Rig(circle).armed()
    for _ in range(60):
        rig.run(0.25)
        x, y = (~rig.pose).apply_point(*rig.person(rig.now))
        assert abs(np.arctan2(y, x)) < radians(20)
    assert 1.2 < rig.range < 1.8


def test_without_feet_the_laser_alone_gives_the_distance() -> None:
    rig = Rig(STROLL, feet=False).armed().run(10.0)
    assert rig.range == pytest.approx(1.55, abs=0.2)


def test_without_feet_and_laser_legs_the_robot_only_turns() -> None:
    rig = Rig(standing(3.0, 1.5), feet=False)
    rig.legs_visible = False
    rig.armed().run(4.0)
    assert rig.pose.theta > 0.3
    assert hypot(rig.pose.x, rig.pose.y) < 1e-6
    assert StopReason.RANGE_UNKNOWN not in kinds(rig.decisions[-1])  # the law asks for no speed


def test_an_approaching_person_is_not_run_into() -> None:
    rig = Rig(walking(3.0, [(0.0, 6.0), (-0.4, 8.4)])).armed().run(3.4)
    where = rig.pose.x
    rig.run(3.0)
    assert rig.range > 0.6
    assert rig.pose.x < where


def test_a_box_in_the_way_is_not_touched() -> None:
    rig = Rig(STROLL, walls=BOX).armed().run(6.5)
    assert abs(rig.twist.v) < 0.02
    assert 3.0 - rig.pose.x - 0.21 > 0.6
    assert StopReason.OBSTACLE in kinds(rig.decisions[-1])
    rig.run(3.5)  # meanwhile who is seen behind it comes to be doubted
    assert abs(rig.twist.v) < 0.02
    assert 3.0 - rig.pose.x - 0.21 > 0.6


def test_the_robot_drives_through_a_door_of_ninety_centimetres() -> None:
    door = np.vstack([wall(2.5, 0.45 + 0.05, 2.5, 4.0), wall(2.5, -4.0, 2.5, -0.45 + 0.05)])
    rig = Rig(STROLL, walls=door).armed().run(14.0)
    assert rig.pose.x > 4.0
    assert rig.range < 1.8


def test_the_robot_follows_along_a_narrow_corridor() -> None:
    corridor = np.vstack([wall(-2, 0.6, 20, 0.6), wall(-2, -0.6, 20, -0.6)])
    rig = Rig(STROLL, walls=corridor).armed().run(14.0)
    assert rig.range < 1.8


def test_somebody_who_steps_between_stops_the_robot_in_time() -> None:
    def stepping(time: float) -> tuple[float, float]:
        return 3.6, max(0.0, 1.5 - max(0.0, time - 5.0))

    rig = Rig(STROLL, others=[stepping]).armed()
    for _ in range(100):
        rig.run(0.1)
        x, y = stepping(rig.now)
        assert hypot(x - rig.pose.x, y - rig.pose.y) > 0.6
    assert rig.stopped


def test_another_person_beside_the_way_is_passed_slowly() -> None:
    rig = Rig(STROLL, others=[standing(3.5, 0.8)]).armed()
    slow = []
    for _ in range(100):
        rig.run(0.1)
        if 0.1 < 3.5 - rig.pose.x < 0.9:
            slow.append(rig.twist.v)
    assert slow
    assert max(slow) < 0.36
    assert rig.pose.x > 4.0


@pytest.mark.parametrize("stream", list(STREAMS))
def test_a_dead_stream_stops_the_robot_within_its_bound(stream: str) -> None:
    died = 8.0
    rig = Rig(STROLL, dead=lambda name, time: name == stream and time > died).armed()
    rig.run(died - rig.now)
    assert rig.twist.v > 0.3
    rig.legs_visible = stream != "image"  # which would carry the track on, slowly
    rig.run(STREAMS[stream].stale_after + 0.06)
    assert rig.command.stops
    assert STREAMS[stream].reason in kinds(rig.decisions[-1])
    rig.run(1.5)
    assert rig.stopped


@pytest.mark.parametrize(("stream", "mode"), [("scan", "following"), ("odometry", "disarmed")])
def test_after_a_gap_sensors_resume_and_the_base_needs_arming(stream: str, mode: str) -> None:
    rig = Rig(STROLL, dead=lambda name, time: name == stream and 8.0 < time < 9.0).armed()
    rig.run(8.0)
    assert rig.decisions[-1].mode.value == mode
    assert rig.stopped is (mode == "disarmed")


def test_a_lost_person_is_searched_then_given_up_without_driving() -> None:
    lost = 8.0
    rig = Rig(
        STROLL, phase=lambda time: TrackPhase.LOST if time > lost else TrackPhase.CONFIRMED
    ).armed()  # fmt: skip
    rig.run(lost - rig.now)
    rig.legs_visible = False
    rig.run(0.8)
    modes = [rig.decisions[-1].mode]
    rig.run(1.5)
    where = rig.pose
    rig.run(3.0)
    assert abs(rig.twist.omega) > 0.3
    assert hypot(rig.pose.x - where.x, rig.pose.y - where.y) < 1e-3
    rig.run(8.0)
    modes.append(rig.decisions[-1].mode)
    assert modes == [Mode.SEARCHING, Mode.IDLE]
    assert rig.stopped


def test_a_camera_that_nobody_needs_stops_nothing() -> None:
    pipeline = Pipeline(PipelineSettings(), ImageCentering(), needs=("scan",))
    pipeline.step(Fault(1.0, "camera", StopReason.LINK_LOST), 1.0)
    assert StopReason.LINK_LOST not in kinds(pipeline.step(Tick(), 1.1))
    assert StopReason.IMAGE_STALE not in kinds(pipeline.step(Tick(), 1.2))
    assert StopReason.LINK_LOST in kinds(
        pipeline.step(Fault(1.3, "laser", StopReason.LINK_LOST), 1.3)
    )


class Elsewhere:
    """A localizer that notes who is left out, and loses its way at 8 s."""

    def __init__(self) -> None:
        self.people: list[tuple[float, float] | None] = []
        self.starts = 0

    def start(self, at: Pose2 | None) -> None:
        assert at is None
        self.starts += 1

    def step(
        self, scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        self.people.append(person)
        at = Pose2(1.0, 2.0, 0.5)
        return RobotPose(scan.stamp, at @ ego, at, np.eye(3), scan.stamp > 8.0)


def test_a_localizers_pose_stands_in_every_decision_and_being_lost_begins_a_search() -> None:
    rig, localizer = Rig(STROLL), Elsewhere()
    rig.pipeline.localizer = localizer
    rig.armed().run(7.9 - rig.now)
    pose = rig.decisions[-1].pose
    assert pose is not None
    assert not pose.lost
    assert localizer.starts == 0
    person = localizer.people[-1]
    assert person is not None
    assert hypot(*person) == pytest.approx(rig.range, abs=0.2)
    rig.run(0.5)
    pose = rig.decisions[-1].pose
    assert pose is not None
    assert pose.lost
    assert localizer.starts == 1
    assert rig.decisions[-1].mode is Mode.FOLLOWING  # in `odom` nothing has changed


def test_a_camera_gap_of_400_ms_is_crawled_through_by_the_legs() -> None:
    rig = Rig(STROLL, dead=lambda name, time: name == "image" and 8.0 < time < 8.4).armed()
    rig.run(8.0 - rig.now)
    began = len(rig.decisions)
    rig.run(1.0)
    gap = rig.decisions[began:]
    assert {decision.mode for decision in gap} == {Mode.FOLLOWING}
    assert not any(decision.command.stops for decision in gap)
    assert any(decision.track is not None and decision.track.by_legs for decision in gap)


@pytest.mark.parametrize("fails", ["blind", pytest.param("lost", marks=pytest.mark.slow)])
def test_by_the_legs_alone_the_robot_crawls_for_a_while_and_stops(fails: str) -> None:
    failed = 8.0
    rig = Rig(
        STROLL,
        dead=lambda name, time: fails == "blind" and name == "image" and time > failed,
        phase=lambda time: TrackPhase.LOST if time > failed else TrackPhase.CONFIRMED,
    ).armed()
    rig.run(failed - rig.now + 0.9)  # 0.5 m/s is braked to a crawl
    assert 0.1 < rig.twist.v < 0.31
    rig.run(1.2)
    assert rig.twist.v < 0.31
    rig.run(0.5 if fails == "blind" else 4.0)
    assert rig.command.stops or rig.command.motion == Twist(0.0, rig.twist.omega)
    rig.run(1.0)
    assert abs(rig.twist.v) < 1e-6
    if fails == "blind":
        assert StopReason.IMAGE_STALE in kinds(rig.decisions[-1])


def test_somebody_who_comes_near_ends_the_crawl_of_a_blind_robot() -> None:
    """Whose legs are whose, the laser alone cannot say (FAILSAFES F8)."""

    def crossing(time: float) -> tuple[float, float]:
        return 4.0, 3.0 - 1.2 * max(0.0, time - 6.4)

    rig = Rig(
        STROLL, others=[crossing], dead=lambda name, time: name == "image" and time > 8.0
    ).armed()
    rig.run(8.35 - rig.now)
    near = None
    while rig.now < 9.8:
        rig.run(0.02)
        x, y = rig.person(rig.now)
        if near is None and hypot(crossing(rig.now)[0] - x, crossing(rig.now)[1] - y) < 0.45:
            near = rig.now
        if near is not None and rig.now > near + 0.3:
            assert rig.command.stops
    assert near is not None


@pytest.mark.slow
def test_behind_a_table_the_camera_alone_leads_on() -> None:
    rig = Rig(STROLL).armed()
    rig.run(8.0 - rig.now)
    rig.legs_visible = False
    began = len(rig.decisions)
    rig.run(3.0)
    assert {decision.mode for decision in rig.decisions[began:]} == {Mode.FOLLOWING}
    assert rig.range < 2.0
    rig.legs_visible = True
    rig.run(1.0)
    track = rig.decisions[-1].track
    assert track is not None
    assert track.range == pytest.approx(rig.range, abs=0.15)


def test_a_short_occlusion_is_driven_through_slowly() -> None:
    def phase(time: float) -> TrackPhase:
        return TrackPhase.OCCLUDED if 8.0 < time < 8.8 else TrackPhase.CONFIRMED

    rig = Rig(STROLL, phase=phase).armed()
    rig.run(8.6 - rig.now)
    assert 0.2 < rig.twist.v < 0.45
    rig.run(4.0)
    assert rig.range < 1.9


def test_the_emergency_stop_stops_and_latches() -> None:
    rig = Rig(STROLL).armed().run(4.0)
    decision = rig.operate(Action.STOP)
    assert decision.command.stops
    assert decision.command.emergency
    rig.run(5.0)
    assert rig.stopped
    assert rig.decisions[-1].mode is Mode.ESTOP


def test_motors_go_off_only_when_the_wheels_stand() -> None:
    rig = Rig(STROLL).armed().run(4.0)
    assert rig.operate(Action.DISARM).motors
    rig.run(0.3)
    assert rig.motors
    rig.run(2.5)
    assert rig.stopped
    assert not rig.motors


def test_a_device_fault_stops_at_once() -> None:
    rig = Rig(STROLL).armed().run(4.0)
    decision = rig.give(Fault(rig.now, "camera", StopReason.LINK_LOST))
    assert decision.command.stops
    assert decision.mode is Mode.FAULT


def test_nothing_moves_before_arming_whatever_is_seen() -> None:
    rig = Rig(STROLL).run(3.0)
    rig.operate(Action.ENROL)
    rig.run(3.0)
    assert rig.operate(Action.ARM).refused == StopReason.NOT_CONFIRMED.value
    assert all(decision.command.stops for decision in rig.decisions)
    assert rig.pose == Pose2()


def test_enrolling_somebody_else_forgets_the_first() -> None:
    rig = Rig(STROLL).armed().run(2.0)
    decision = rig.operate(Action.ENROL)
    assert decision.mode is Mode.DISARMED
    assert decision.track is None


def test_every_command_names_its_cause_and_never_outlives_its_data() -> None:
    rig = Rig(STROLL).armed().run(4.0)
    seen = set()
    for decision, (event, now) in zip(rig.decisions, rig.events, strict=True):
        command = decision.command
        seen.add(command.cause)
        assert command.cause_received == getattr(event, "received", None)
        if not command.stops:
            assert now < command.expires <= now + 0.25
    assert seen == {"", "scan", "odometry", "image"}


def test_every_changed_wish_has_a_reason() -> None:
    rig = Rig(STROLL, walls=BOX, others=[standing(2.5, 0.8)]).armed().run(10.0)
    for decision in rig.decisions:
        wished = decision.wish or Twist()
        if (decision.command.motion or Twist()) != wished:
            assert decision.command.reasons


def test_the_same_events_give_the_same_decisions() -> None:
    rig = Rig(STROLL, walls=BOX).armed().run(6.0)
    again = Pipeline(rig.settings, ImageCentering(rig.law))
    for (event, now), first in zip(rig.events, rig.decisions, strict=True):
        second = again.step(event, now)
        assert replace(second, track=None) == replace(first, track=None)
        assert (second.track is None) == (first.track is None)
        if second.track is not None and first.track is not None:
            assert second.track.position == first.track.position


def test_the_track_carries_range_and_position_in_odom() -> None:
    rig = Rig(STROLL, noise=0.0).armed().run(6.0)
    track = rig.decisions[-1].track
    assert track is not None
    assert track.position is not None
    assert track.range is not None
    x, y = rig.person(track.stamp)
    assert hypot(track.position[0] - x, track.position[1] - y) < 0.15
    assert track.range == pytest.approx(rig.range, abs=0.15)


def test_where_the_robot_was_is_known_for_recent_stamps_only() -> None:
    rig = Rig(STROLL).armed().run(3.0)
    assert rig.pipeline.ego_at(rig.now - 0.5) is not None
    assert rig.pipeline.ego_at(rig.now + 1.0) is None


def test_a_scan_from_an_unknown_place_does_not_drive() -> None:
    rig = Rig(STROLL).armed().run(4.0)
    assert not rig.command.stops
    scan = next(event for event, _ in rig.events if isinstance(event, Scan))
    assert rig.give(replace(scan, stamp=rig.now - 30.0)).command.stops


def test_a_config_lowers_age_limits_and_never_raises_them() -> None:
    fresh = Freshness({"scan": 0.2, "image": 5.0})
    assert fresh.stale_after == {"scan": 0.2, "image": 0.3, "odometry": 0.32}
    with pytest.raises(ValueError, match="sonar"):
        PipelineSettings.model_validate({"stale_after_s": {"sonar": 1.0}})


def test_an_idle_pipeline_only_says_what_is_missing() -> None:
    decision = Pipeline(PipelineSettings(), ImageCentering()).step(Tick(), 1.0)
    assert decision.command.stops
    assert decision.sequence == 1
    assert not decision.motors
    assert {StopReason.SCAN_STALE, StopReason.IMAGE_STALE, StopReason.NO_TARGET} <= kinds(decision)
