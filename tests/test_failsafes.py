"""FAILSAFES F1 to F19, one by one, each with its figure; what more each owes stands in its file."""

import asyncio
from dataclasses import replace
from itertools import pairwise
from math import hypot, inf, radians
from pathlib import Path

import numpy as np
import pytest

from followerd import app, clock
from followerd.bench.closed_loop import simulate
from followerd.bench.fault_runs import Job, run
from followerd.bench.mishaps import HUNG
from followerd.config import load
from followerd.control.limits import GuardSettings
from followerd.control.novelty import Novelty
from followerd.control.transitions import Action
from followerd.errors import ConfigError
from followerd.events import Hand, Late, Operator, Presence
from followerd.geometry import Camera, Pose2
from followerd.hw.p2os.commands import Cmd, command
from followerd.hw.p2os.protocol import PacketDecoder
from followerd.hw.p2os.writer import HALT, Writer
from followerd.messages import (
    Decision,
    Image,
    Measurement,
    Mode,
    Odometry,
    Reason,
    RobotPose,
    Scan,
    StopReason,
    TrackPhase,
    Twist,
)
from followerd.pipeline import PipelineSettings
from followerd.runtime.auto_operator import AutoOperator
from followerd.runtime.daemon import Daemon
from followerd.runtime.pressure import Pressure
from followerd.runtime.stats import Stats
from followerd.trackers.legs import Legs, LegsSettings
from followerd.trackers.looking import Looking
from tests import test_p2os_writer as base_writer
from tests import test_recording as recording
from tests import test_stream_field_tracker as on_map
from tests.follow_rig import BASE_FROM_LASER, BEARINGS, Rig, standing, walking
from tests.test_pipeline import Elsewhere

STROLL = walking(2.0, [(0.0, 2.5), (0.5, 60.0)])
BROKE = 5.5  # s
FED = 9.0  # s
STOP_AT_9600 = 10 * len(HALT) / 9600  # s, on the wire


def kinds(decision: Decision) -> set[StopReason]:
    return {reason.stop for reason in decision.reasons}


def following(rig: Rig | None = None) -> Rig:
    """Under way at BROKE."""
    rig = (rig or Rig(STROLL)).armed()
    rig.run(BROKE - rig.now)
    assert rig.twist.v > 0.3
    return rig


def mode_of(rig: Rig) -> Mode:
    return rig.decisions[-1].mode


def speed(rig: Rig) -> float:
    """The forward speed that is commanded."""
    return getattr(rig.command.motion, "v", 0.0)


def stop_after(rig: Rig, seconds: float) -> float:
    """Time from now to the first command that stops, or to the end of the last one's life."""
    began = rig.now
    while not rig.command.stops and rig.now <= rig.command.expires:
        rig.run(0.005)
        assert rig.now < began + seconds, "it drives on"
    return rig.now - began


def test_f01_no_command_outlives_250_ms() -> None:
    rig = following()
    moving = [d.command for d in rig.decisions if not d.command.stops]
    assert max(c.expires - c.stamp for c in moving) <= 0.25 - STOP_AT_9600
    # and one that expires is a stop on the wire, with nobody's help
    base_writer.test_without_a_newer_command_the_robot_stops_when_it_expires(seen_standing())


@pytest.mark.slow
def test_f01_a_stale_decision_stops_within_250_ms() -> None:
    assert time_to_stop(HUNG) <= 0.25


def time_to_stop(fault: str) -> float:
    """From the fault to zero velocity's last byte, while the whole daemon follows somebody."""
    outcome = run(Job(fault, "corridor", 1))
    assert outcome.moved
    assert outcome.time_to_stop is not None
    assert outcome.collisions == 0
    return outcome.time_to_stop


def after_a_gap(kind: type[Odometry | Scan], fault: str) -> tuple[float, set[Reason]]:
    """The longest time (s) between measurements, and why anything stood, under way with a fault."""
    config = load("hpf-sim", {"laser.baud": 38400, "laser.resolution_deg": 1, "seed": 1})
    world = app.rig(config)
    stamps: list[float] = []
    stops: set[Reason] = set()

    def measured(measurement: Measurement) -> None:
        if isinstance(measurement, kind) and clock.now() > FED:
            if not stamps:
                world.inject(fault)
            stamps.append(measurement.stamp)

    def decided(decision: Decision) -> None:
        if stamps:
            stops.update(reason for reason in decision.reasons if reason.full_stop)

    def attach(daemon: Daemon) -> None:
        daemon.measurement_watchers.append(measured)
        daemon.decision_watchers.append(decided)

    simulate(config, FED + 1.0, attach, world=world)
    return max(later - earlier for earlier, later in pairwise(stamps)), stops


def seen_standing() -> Writer:
    """A writer of a base that stands with its motors on."""
    writer = Writer(9600, base_writer.CAPS)
    writer.due(0.0)
    writer.due(0.2)
    writer.note(base_writer.status(0.35))
    writer.due(1.0)
    return writer


def test_f02_a_stale_scan_slows_then_stops_within_300_ms_and_is_named() -> None:
    limit = PipelineSettings(stale_after_s={"scan": 0.25})
    rig = following(
        Rig(STROLL, settings=limit, dead=lambda name, time: name == "scan" and time > BROKE)
    )
    assert stop_after(rig, 1.0) <= 0.3
    rig.run(0.1)
    since = [d for d in rig.decisions if d.stamp > BROKE]
    late = [reason for d in since for reason in d.reasons if reason.device == "scan"]
    assert not late[0].full_stop
    assert late[-1].full_stop
    assert "s old" in late[-1].detail


def test_f02_a_laser_too_slow_to_drive_by_is_refused() -> None:
    slow = load("hpf-sim", {"laser.baud": 38400, "laser.resolution_deg": 0.5})
    with pytest.raises(ConfigError, match="too slow to drive by"):
        app.pipeline_settings(slow)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["off", "stuck", "garbage", "disconnect"])
def test_f02_a_dead_laser_stops_the_whole_daemon_within_300_ms(kind: str) -> None:
    """At 38400 baud, from the fault; a telegram under way at that moment still arrives."""
    assert time_to_stop(f"laser:{kind}") <= 0.3


def picture(number: int, pixels: np.ndarray) -> Image:
    camera = Camera.from_hfov(8, 16, radians(48.0), z=0.6, elevation=0.0)
    return Image(number, 0.1 * number, 0.1 * number, pixels, camera)


def scan(ranges: np.ndarray) -> Scan:
    return Scan(
        0.0, 0.0, BEARINGS[0], radians(1.0), ranges, 8.0, np.zeros(ranges.size), BASE_FROM_LASER
    )


def test_f03_the_same_picture_again_is_no_new_one() -> None:
    rng = np.random.default_rng(0)
    frames = np.cumsum(rng.integers(0, 9, (4, 16, 32, 3)), axis=2).astype(np.uint8)
    looking = Looking(Legs(LegsSettings(), rng), lambda _: None, lambda _: None)
    shown = [*frames, frames[3], frames[3], frames[0]]
    seen = [looking.take(picture(k, pixels)) for k, pixels in enumerate(shown)]
    assert [looking.step(one)[0] for one in seen] == [True, True, True, True, False, False, True]


def test_f03_the_same_scan_again_is_no_new_one() -> None:
    novelty, rng = Novelty(), np.random.default_rng(0)
    ranges = rng.uniform(1.0, 3.0, BEARINGS.size)
    assert novelty.is_new(scan(ranges), None, 1.0)
    assert not novelty.is_new(scan(ranges), None, 1.1)
    assert novelty.is_new(scan(ranges + 0.001), None, 1.2)
    nothing = np.full(BEARINGS.size, inf)
    assert all(novelty.is_new(scan(nothing), None, now) for now in (1.3, 1.4, 1.5))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["off", "stuck", "garbage"])
def test_f03_without_new_pictures_it_crawls_by_the_legs_for_2_s_at_most(kind: str) -> None:
    assert time_to_stop(f"camera:{kind}") <= 0.3 + 2.0


def test_f03_by_the_legs_alone_it_is_slow_within_300_ms() -> None:
    rig = following(Rig(STROLL, dead=lambda name, time: name == "image" and time > BROKE))
    rig.run(0.3)
    assert 0.0 < speed(rig) <= 0.3


def test_f04_a_silent_base_disarms_within_350_ms_and_does_not_resume() -> None:
    rig = following(
        Rig(STROLL, dead=lambda name, time: name == "odometry" and BROKE < time < BROKE + 1.0)
    )
    assert stop_after(rig, 1.0) <= 0.35 - STOP_AT_9600
    rig.run(0.1)
    assert StopReason.ODOMETRY_STALE in kinds(rig.decisions[-1])
    rig.run(5.0)
    assert rig.decisions[-1].mode is Mode.DISARMED
    assert rig.stopped


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["off", "stuck", "garbage", "disconnect"])
def test_f04_a_dead_base_is_told_to_stop_within_350_ms(kind: str) -> None:
    assert time_to_stop(f"robot:{kind}") <= 0.35


@pytest.mark.slow
def test_f04_two_lost_packets_alone_are_no_stop() -> None:
    """The third is seen to come before the two that are missing stop the robot."""
    gap, stops = after_a_gap(Odometry, "robot:off+0.2")
    assert gap == pytest.approx(0.3, abs=0.02)
    assert not stops


@pytest.mark.slow
def test_f02_one_lost_telegram_alone_is_no_stop() -> None:
    gap, stops = after_a_gap(Scan, "laser:off+0.05")
    assert gap == pytest.approx(2 * 0.107, abs=0.02)
    assert not stops


def report(x: float, v: float, stall: bool = False) -> Odometry:
    return Odometry(0.0, 0.0, Pose2(x), Twist(v, 0.0), (stall, stall))


def test_f04_a_base_that_repeats_itself_is_told_from_one_that_stands() -> None:
    drive = Twist(0.3, 0.0)
    novelty = Novelty()
    assert all(novelty.is_new(report(1.0, 0.0), None, 0.1 * k) for k in range(50))
    told = [novelty.is_new(report(1.0, 0.0), drive, 5.0 + 0.1 * k) for k in range(10)]
    assert told[:5] == [True] * 5  # it takes a moment to obey
    assert told[6:] == [False] * 4
    assert novelty.is_new(report(1.1, 0.3), drive, 6.0)
    assert not novelty.is_new(report(1.1, 0.3), drive, 6.1)
    assert novelty.is_new(report(1.1, 0.3, stall=True), drive, 6.2)


def test_f05_a_late_loop_stops() -> None:
    """The last resort outside the loop has tests/test_last_resort.py."""
    rig = following()
    rig.give(Late(0.25))
    assert rig.decisions[-1].mode is Mode.HOLDING
    assert speed(rig) == 0.0


def test_f06_the_speed_fits_the_watchdog_of_the_base() -> None:
    assert GuardSettings().speed_cap == pytest.approx(0.7)
    assert GuardSettings().speed_cap * 2.0 <= 1.4
    assert GuardSettings(max_speed_mps=2.0, watchdog_s=4.0).speed_cap == pytest.approx(0.35)


@pytest.mark.slow
def test_f06_a_base_stopped_by_its_watchdog_is_not_moved_by_whoever_connects_next() -> None:
    """SYNC0 is PULSE to a base whose session is still open: it would go on as it was told last."""

    async def story() -> tuple[float, float]:
        config = load("hpf-sim", {"seed": 1})
        world = app.rig(config)
        running = asyncio.ensure_future(world.run())
        daemon = app.build(config, app.in_memory(world))
        operator = AutoOperator(daemon)
        driving = asyncio.ensure_future(clock.together(operator.run(), daemon.run()))
        while not world.truths or world.truths[-1].twist.v < 0.3:
            await clock.sleep(0.1)
        line = world.robot
        vars(line)["transmit"] = lambda *_: None  # killed: not even a farewell gets out
        driving.cancel()
        await asyncio.gather(driving, return_exceptions=True)
        del vars(line)["transmit"]
        await clock.sleep(4.0)
        stood = world.truths[-1].pose
        manual = load("hpf-sim", {"seed": 1, "operator": "manual"})
        again = app.build(manual, app.in_memory(world))
        await clock.within(6.0, again.run())
        running.cancel()
        after = world.truths[-1].pose
        return hypot(after.x - stood.x, after.y - stood.y), abs(after.theta - stood.theta)

    assert clock.run_virtual(story()) == (0.0, 0.0)


@pytest.mark.slow
def test_f06_a_base_cut_off_stops_by_its_own_watchdog() -> None:
    """Killed for good: tests/test_real_time.py and tests/test_unplug.py."""
    outcome = run(Job("robot:disconnect", "corridor", 1))
    assert outcome.standstill is not None
    assert outcome.standstill <= 2.0 + 1.5  # and braking
    assert outcome.stop_distance is not None
    assert outcome.stop_distance <= 1.4 + 0.5


def test_f07_no_packet_with_one_bit_turned_is_accepted() -> None:
    """Fuzzing by the million: tests/test_fuzz.py; 1 % of telegrams hurt: tests/test_soak.py."""
    packet = command(Cmd.VEL, 300)
    assert len(PacketDecoder().feed(packet)) == 1
    for bit in range(8 * len(packet)):
        hurt = bytearray(packet)
        hurt[bit // 8] ^= 1 << bit % 8
        decoder = PacketDecoder()
        assert not decoder.feed(bytes(hurt))
        assert decoder.feed(40 * packet)


def test_f08_an_unsure_identity_ends_translation_within_300_ms_until_five_good_frames() -> None:
    doubt = (BROKE, BROKE + 1.0)
    doubted = (TrackPhase.CONFIRMED, TrackPhase.TENTATIVE)
    rig = following(Rig(STROLL, phase=lambda t: doubted[doubt[0] < t < doubt[1]]))
    rig.run(0.3)
    assert speed(rig) == 0.0
    rig.run(doubt[1] - rig.now)
    good = 0
    while rig.decisions[-1].mode is not Mode.FOLLOWING:
        rig.run(1 / 15)
        good += 1
        assert good < 15
    assert good >= 5


def test_f09_a_lost_person_is_coasted_to_searched_for_and_given_up() -> None:
    seen = (TrackPhase.CONFIRMED, TrackPhase.LOST)
    rig = following(Rig(STROLL, phase=lambda t: seen[t > BROKE]))
    rig.legs_visible = False
    while rig.decisions[-1].track is None or rig.decisions[-1].track.phase is not TrackPhase.LOST:
        rig.run(0.005)
    rig.run(0.5)
    assert speed(rig) == 0.0
    assert mode_of(rig) is Mode.SEARCHING
    turns = []
    while mode_of(rig) is Mode.SEARCHING:
        rig.run(0.1)
        turns.append(abs(getattr(rig.command.motion, "omega", 0.0)))
    assert max(turns) <= 0.5
    assert len(turns) * 0.1 <= 10.1
    assert mode_of(rig) is Mode.IDLE
    assert StopReason.TARGET_LOST in kinds(rig.decisions[-1])


def test_f10_somebody_in_the_stop_zone_stops_it_within_400_ms() -> None:
    ahead = [100.0]
    rig = following(Rig(STROLL, others=[lambda _: (ahead[0], 0.0)]))
    ahead[0] = rig.pose.x + 0.75
    assert stop_after(rig, 1.0) <= 0.4
    assert kinds(rig.decisions[-1]) & {StopReason.OBSTACLE, StopReason.PERSON_TOO_CLOSE}
    rig.run(3.0)
    assert rig.stopped


def test_f11_nobody_is_approached_below_one_metre_or_at_an_unknown_distance() -> None:
    near = Rig(standing(0.95)).armed().run(4.0)
    assert max(twist.v for _, _, twist in near.trace) <= 0.0
    unknown = Rig(standing(3.0), feet=False, legs_visible=False).armed().run(4.0)
    assert max(twist.v for _, _, twist in unknown.trace) == 0.0
    assert GuardSettings().max_reverse_mps <= 0.15


def test_f12_speed_is_capped_and_lower_near_somebody_else() -> None:
    fast = Rig(walking(2.0, [(0.0, 4.0), (1.5, 60.0)])).armed().run(8.0)
    assert max(twist.v for _, _, twist in fast.trace) <= 0.7 + 1e-6
    beside = following()
    beside.others = [lambda _: (beside.pose.x + 1.0, 0.75)]
    beside.run(2.0)
    assert 0.0 <= beside.twist.v <= 0.3 + 1e-6


@pytest.mark.parametrize(("stall", "bump"), [(True, 0), (False, 2)])
def test_f13_a_stall_or_a_bump_latches_until_armed_again(stall: bool, bump: int) -> None:
    rig = following()
    newest = rig.pipeline._odometry
    assert newest is not None
    rig.give(replace(newest, wheel_stall=(stall, False), bumpers_front=bump))
    assert rig.command.stops
    rig.run(5.0)
    assert rig.decisions[-1].mode is Mode.FAULT
    assert rig.stopped


def test_f14_a_session_that_is_gone_ends_within_a_second_what_it_armed() -> None:
    rig = Rig(STROLL).armed()
    rig.operate(Action.HOLD)
    rig.give(Operator(Action.ARM, "page"))
    while rig.now < BROKE:
        rig.run(0.1)
        rig.give(Presence("page"))
    assert rig.twist.v > 0.2
    assert stop_after(rig, 2.0) <= 1.0
    assert StopReason.OPERATOR_GONE in kinds(rig.decisions[-1])


def test_f14_a_hand_that_lets_go_stops_within_250_ms() -> None:
    rig = Rig(standing(4.0)).run(3.0)
    rig.give(Operator(Action.MANUAL, "page"))
    while rig.now < 6.0:
        rig.run(0.1)
        rig.give(Presence("page"))
        rig.give(Hand("page", Twist(0.3, 0.0)))
    assert rig.twist.v > 0.1
    assert stop_after(rig, 1.0) <= 0.25


def test_f15_after_a_suspend_it_is_disarmed_and_only_one_clock_is_read() -> None:
    rig = following()
    rig.give(Late(30.0))
    assert rig.decisions[-1].mode is Mode.DISARMED
    rig.run(5.0)
    assert rig.stopped
    package = Path(app.__file__).parent
    readers = [p.name for p in package.rglob("*.py") if "time.time()" in p.read_text()]
    assert readers == ["clock.py"]


@pytest.mark.slow
def test_f16_a_full_disk_ends_the_recording_and_nothing_else(tmp_path: Path) -> None:
    recording.test_a_disk_that_fills_ends_the_recording_and_nothing_else(tmp_path)


def test_f16_a_computer_short_of_time_or_memory_is_noticed_and_let_off() -> None:
    stats, memory = Stats(0.0), [100.0]
    pressure = Pressure(stats, lambda: memory[0])
    stats.lags.extend([(0.0, 0.002)] * 50)
    pressure.look()
    assert not pressure.why
    stats.lags.extend([(0.0, 0.030)] * 50)
    pressure.look()
    assert "30 ms late" in pressure.why
    stats.lags.extend([(0.0, 0.002)] * 50)
    memory[0] = 900.0
    pressure.look()
    assert "900 MB" in pressure.why
    memory[0] = 100.0
    pressure.look()
    assert not pressure.why


@pytest.mark.slow
def test_f16_under_pressure_nobody_but_the_tracker_gets_pictures_and_it_follows_on() -> None:
    config = load("hpf-sim", {"seed": 1})
    shown: list[Measurement] = []
    daemons: list[Daemon] = []

    def attach(daemon: Daemon) -> None:
        daemons.append(daemon)
        daemon.pressure.why = "short of time"
        daemon.measurement_watchers.append(shown.append)

    summary = simulate(config, FED, attach)
    assert summary["frames"] > 100
    assert not [one for one in shown if isinstance(one, Image)]
    assert [one for one in shown if isinstance(one, Scan)]
    assert summary["mode_s"]["following"] > 2.0


class LosingItself(Elsewhere):
    """A localizer that loses its way at BROKE."""

    def step(
        self, scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        at = Pose2(1.0, 2.0, 0.5)
        return RobotPose(scan.stamp, at @ ego, at, 1e-4 * np.eye(3), scan.stamp > BROKE)


class Jumping(Elsewhere):
    """A localizer that finds itself 1 m away from BROKE on."""

    def step(
        self, scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        at = Pose2(1.0 if scan.stamp > BROKE else 0.0)
        return RobotPose(scan.stamp, at @ ego, at, np.eye(3))


def test_f17_who_is_lost_on_the_map_follows_on_in_odom() -> None:
    rig = Rig(STROLL)
    rig.pipeline.localizer = LosingItself()
    rig.armed().run(BROKE + 1.0 - rig.now)
    assert rig.decisions[-1].pose is not None
    assert rig.decisions[-1].pose.lost
    assert rig.decisions[-1].mode is Mode.FOLLOWING
    assert rig.twist.v > 0.3


class Restarted(Elsewhere):
    """A localizer that is sure, and notes from where it has to begin anew."""

    def __init__(self) -> None:
        super().__init__()
        self.begun: list[Pose2 | None] = []

    def start(self, at: Pose2 | None) -> None:
        self.begun.append(at)

    def step(
        self, scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        at = Pose2(1.0)
        return RobotPose(scan.stamp, at @ ego, at, 1e-4 * np.eye(3), lost=False)


def test_f17_after_a_while_without_odometry_the_pose_is_no_longer_sure() -> None:
    """The robot may have moved, or the base's odometry begun anew."""
    localizer = Restarted()
    rig = Rig(STROLL, dead=lambda name, time: name == "odometry" and BROKE < time < BROKE + 1.0)
    rig.pipeline.localizer = localizer
    rig.armed().run(BROKE - rig.now)
    assert not localizer.begun
    rig.run(2.0)
    (at,) = localizer.begun
    assert at is not None
    assert at.x - 1.0 == pytest.approx(rig.pose.x, abs=0.3)


def test_f17_walls_of_the_map_excuse_no_return_once_the_robot_is_lost() -> None:
    rig = Rig(STROLL)
    rig.pipeline.localizer = LosingItself()
    rig.pipeline._walls = np.array([[[-9.0, 9.0], [9.0, 9.0]]])
    rig.armed().run(BROKE - rig.now)
    before = rig.pipeline.view
    rig.run(0.3)
    after = rig.pipeline.view
    assert before is not None
    assert before.mapped is not None
    assert after is not None
    assert after.mapped is None


def test_f17_a_tracker_on_the_map_is_off_it_within_a_second() -> None:
    stage = on_map.Stage()
    stage.enrol()
    stage.walk(0.6, 0.0)
    assert stage.tracker.courses().size  # ways that the map leaves
    stage.map_from_odom = None
    stage.walk(1.0 + on_map.PERIOD, 0.0)
    assert not stage.tracker._on_map
    assert not stage.tracker.courses().size


@pytest.mark.parametrize("by_map", [True, False])
def test_f17_a_jump_on_the_map_stops_only_who_thinks_there(by_map: bool) -> None:
    rig = Rig(STROLL)
    rig.pipeline.localizer = Jumping()
    rig.pipeline._by_map = by_map
    rig.armed().run(BROKE + 0.3 - rig.now)
    assert (rig.decisions[-1].mode is Mode.HOLDING) is by_map


def test_f18_nothing_moves_before_all_is_fresh_for_2_s_enrolled_and_confirmed() -> None:
    rig = Rig(standing(3.0)).run(1.0)
    assert StopReason.START_UP.value in rig.operate(Action.ARM).refused
    rig.run(2.0)
    assert StopReason.NO_TARGET.value in rig.operate(Action.ARM).refused
    rig.operate(Action.ENROL)
    assert StopReason.NOT_CONFIRMED.value in rig.operate(Action.ARM).refused
    rig.operate(Action.CONFIRM)
    rig.run(1.0)
    assert all(decision.command.stops for decision in rig.decisions)
    assert not rig.operate(Action.ARM).refused
    rig.run(4.0)
    assert rig.twist.v > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["camera:off", "laser:stuck", "robot:stuck"])
def test_f19_every_stop_has_a_reason_a_device_and_a_time(fault: str) -> None:
    outcome = run(Job(fault, "corridor", 2))
    assert outcome.stops >= 1
    assert outcome.unnamed_stops == 0
    assert outcome.false_stops == 0


def test_f19_every_change_of_a_wish_has_a_reason() -> None:
    rig = following(Rig(STROLL, dead=lambda name, time: name == "scan" and time > BROKE + 2.0))
    rig.run(4.0)
    for before, after in pairwise(rig.decisions):
        if not before.command.stops and after.command.stops and after.wish is not None:
            assert after.reasons
            assert all(reason.device for reason in after.reasons)
