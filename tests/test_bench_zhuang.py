"""Rides of a tracker on a simulated robot, and what is measured on them."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import degrees, inf, radians

import numpy as np
import pytest

from followerd.bench import speed, zhuang
from followerd.bench.ride import Agility, Frame, Ride
from followerd.bench.scripts import BangBang, Chaperon, Follow, seen
from followerd.bench.speed import Tape, percentiles, play, record, stages
from followerd.bench.zhuang import CAMERA, CASES, INSTANT, centre_error, figures
from followerd.geometry import Pose2, wrap_angle
from followerd.messages import Box, Image, TrackPhase, TrackState, Twist
from followerd.sim.scenarios import load
from followerd.sim.truth import Actor, Truth
from followerd.sim.world import World

STANDING = TrackState(0.0, TrackPhase.CONFIRMED, 1.0)


def truth(stamp: float = 0.0, bearing: float = 0.0, distance: float = 3.0) -> Truth:
    target = Actor("", 0.0, 0.0, 0.0, (0.0, 0.0), distance, bearing, True)
    return Truth(stamp, Pose2(), Twist(), target, (), 0, 0, inf, inf)


def frame(
    number: int, true_x: float | None, claimed_x: float | None, distance: float = 1.5
) -> Frame:
    image = Image(number, number / 15, number / 15, np.zeros((144, 192, 3), np.uint8), CAMERA)
    box = None if true_x is None else Box.around(true_x, 70, 30, 90)
    lost = TrackState(0.0, TrackPhase.LOST, 0.0)
    claim = Box.around(claimed_x, 70, 30, 90) if claimed_x is not None else None
    track = lost if claim is None else replace(STANDING, box=claim, range=1.6)
    return Frame(image, truth(distance=distance), box, 1.0, track, 0.002)


def test_loss_is_a_centre_more_than_15_px_off_or_no_claim_at_all() -> None:
    frames = [frame(0, 90, 90), frame(1, 90, 104), frame(2, 90, 106), frame(3, 90, None)]
    result = figures("S4", [*frames, frame(4, None, 20)])  # out of view: not counted
    assert result["loss_percent"] == (50.0, "%")
    assert result["error_px"] == (7.0, "px")
    assert result["frame_ms"][0] == pytest.approx(2.0)
    assert centre_error(frame(0, 90, None)) == inf


def test_where_the_track_drives_a_person_out_of_view_is_lost() -> None:
    frames = [frame(0, 90, 90), frame(1, None, 90)]
    assert figures("S1", frames)["loss_percent"] == (50.0, "%")


def test_a_ride_that_lost_at_once_has_no_error_in_track() -> None:
    assert figures("S4", [frame(i, 90, None) for i in range(3)])["error_px"] == (None, "px")


def test_fixation_is_the_share_in_the_band_and_the_time_to_get_there() -> None:
    result = figures("S1", [frame(i, 150 - 10 * i, 90) for i in range(6)])
    assert result["in_band_percent"][0] == pytest.approx(100 * 2 / 6)  # 110 and 100
    assert result["settling_s"][0] == pytest.approx(4 / 15)
    assert figures("S1", [frame(i, 150, 150) for i in range(2)])["settling_s"][0] is None


def test_following_is_measured_by_the_true_distance_and_the_claimed_range() -> None:
    result = figures("S2", [frame(0, 90, 90, 1.7), frame(1, 90, 90, 1.9)])
    assert result["gap_error_m"][0] == pytest.approx(0.3)
    assert result["range_error_m"][0] == pytest.approx(0.2)


@pytest.fixture(scope="module")
def jerked() -> tuple[Tape, list[Frame]]:
    """Four seconds of S3 on a base without slip."""
    scenario = load("s3")
    robot = scenario.robot.model_copy(update={"slip": 0.0, "wheel_error": 0.0})
    world = World(scenario.model_copy(update={"robot": robot}), np.random.default_rng(5))
    tape = Tape()
    ride = Ride(world, CAMERA, BangBang(np.random.default_rng(6)), INSTANT)
    return tape, list(ride.frames(tape, 60))


def test_the_jerked_camera_turns_at_full_rate_and_keeps_the_person_in_view(
    jerked: tuple[Tape, list[Frame]],
) -> None:
    _, frames = jerked
    rates = [degrees(f.truth.twist.omega) for f in frames[2:]]
    assert np.abs(rates) == pytest.approx(60.0)
    assert np.count_nonzero(np.diff(np.sign(rates))) >= 60 / 15 / 0.6 - 1
    assert max(abs(degrees(f.truth.target.bearing)) for f in frames) < 15.0
    assert frames[-1].truth.pose.x == pytest.approx(0.4 * 4, abs=0.2)


def test_the_poses_given_to_the_tracker_are_those_of_the_images_not_of_the_packets(
    jerked: tuple[Tape, list[Frame]],
) -> None:
    tape, frames = jerked
    errors = []
    for (_, ego), f in zip(tape.seen, frames, strict=True):
        assert ego is not None
        errors.append(abs(degrees(wrap_angle(ego.theta - f.truth.pose.theta))))
    assert max(errors) < 1.0  # a packet may be 100 ms old: 6 degrees
    assert max(errors) > 0.0  # rounded, not the truth


def test_without_odometry_the_tracker_gets_no_pose() -> None:
    tape = Tape()
    ride = Ride(World(load("s4"), np.random.default_rng(1)), CAMERA, Chaperon(), Agility())
    list(ride.frames(tape, 3, with_odometry=False))
    assert [ego for _, ego in tape.seen] == [None] * 3


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    cut = {name: replace(CASES[name], frames=8) for name in ("S3", "S3-uncompensated")}
    monkeypatch.setattr(zhuang, "CASES", cut)


@pytest.mark.slow
@pytest.mark.usefixtures("short")
def test_one_seed_gives_one_ride() -> None:
    once, again, other = (zhuang.run(zhuang.Job("S3", "hpf/default", seed)) for seed in (1, 1, 2))
    assert np.array_equal(once.true_x, again.true_x)
    assert np.array_equal(once.claimed_x, again.claimed_x)
    assert not np.array_equal(once.true_x, other.true_x)


@pytest.mark.slow
@pytest.mark.usefixtures("short")
def test_the_suite_reports_every_scenario_tracker_and_metric() -> None:
    with ThreadPoolExecutor(1) as pool:
        report = zhuang.suite(pool, seeds=1, quick=False)
    names = {(row.scenario, row.tracker, row.metric) for row in report.rows}
    assert names == {
        (scenario, tracker, metric)
        for scenario in ("S3", "S3-uncompensated")
        for tracker in ("hpf/paper", "hpf/default")
        for metric in ("loss_percent", "error_px", "frame_ms")
    }
    assert {row.seeds for row in report.rows} == {1}
    assert len(report.plots) == 2


def test_every_scenario_names_a_world_that_ships() -> None:
    for case in CASES.values():
        assert load(case.world).name == case.world


def test_the_follow_law_stands_without_a_track_and_leads_by_the_persons_velocity() -> None:
    lost = TrackState(0.0, TrackPhase.LOST, 0.0)
    for law in (Follow(), Follow(turn_only=True)):
        assert law.wish(truth(), None, Pose2()) == law.wish(truth(), lost, Pose2()) == Twist()
    aside = replace(STANDING, bearing=radians(15), range=3.0)
    assert Follow(turn_only=True).wish(truth(), aside, None).v == 0.0
    assert Follow(turn_only=True).wish(truth(), aside, None).omega > 0.0
    assert Follow().wish(truth(), aside, None).v > 0.0
    west = seen(replace(aside, velocity=(0.0, 0.8)), Pose2(0.0, 0.0, radians(90)))
    assert west is not None
    assert west.velocity == pytest.approx((0.8, 0.0))  # straight away from the robot
    hidden = seen(replace(aside, phase=TrackPhase.OCCLUDED), None)
    assert hidden is not None
    assert hidden.range is None


def test_speed_is_measured_on_the_same_frames_for_every_tracker() -> None:
    tape = record((192, 144), 6)
    assert [image.id for image, _ in tape.seen] == list(range(6))
    times = play(tape, "hpf/paper", 100)
    assert times.size == 5  # the enrolment is no frame's work
    assert (times > 0).all()
    rows = percentiles("192x144/100", "hpf/paper", times)
    assert [row.metric for row in rows] == ["frame_ms_p50", "frame_ms_p99"]
    parts = stages(tape, "192x144", "hpf/paper")
    assert {"look_ms", "predict_ms"} <= {row.metric for row in parts}
    assert all(row.value is not None and row.value >= 0 for row in parts)


def test_what_else_the_machine_does_is_not_taken_for_the_trackers_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    passes = iter([np.array([9e-3, 1e-3]), np.array([2e-3, 7e-3]), np.array([3e-3, 4e-3])])
    monkeypatch.setattr(speed, "PASSES", 3)
    monkeypatch.setattr(speed, "once", lambda *_: next(passes))
    assert play(Tape(), "hpf", 150).tolist() == pytest.approx([2.0, 1.0])
