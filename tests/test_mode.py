"""When the robot may move: one table, and the times that bound doubt."""

from math import inf, radians

import pytest

from followerd.control.freshness import Freshness
from followerd.control.mode import Modes, ModeSettings, Permission
from followerd.control.transitions import ARMED, LONGEST, TRANSITIONS, Action, Signal
from followerd.geometry import Pose2
from followerd.messages import (
    BatteryLevel,
    Fault,
    Mode,
    Odometry,
    StopReason,
    TrackPhase,
    TrackState,
    Twist,
)
from followerd.streams import STREAMS


class Story:
    """Modes with fresh data every 50 ms, as the pipeline drives them."""

    def __init__(self) -> None:
        self.freshness = Freshness()
        self.modes = Modes(ModeSettings(), self.freshness)
        self.now = 0.0
        self.dead: set[str] = set()
        self.phase = TrackPhase.CONFIRMED
        self.confidence = 0.9
        self.bearing = 0.2
        self.by_legs = False
        self.sigma = 0.1
        self.motors = True
        self.base: dict[str, object] = {}
        self.battery = BatteryLevel.UNKNOWN

    def run(self, seconds: float) -> Permission:
        for _ in range(round(seconds / 0.05)):
            self.now += 0.05
            for name in STREAMS.keys() - self.dead:
                self.freshness.saw(name, self.now, self.now)
            if "image" not in self.dead:
                track = TrackState(
                    self.now,
                    self.phase,
                    self.confidence,
                    bearing=self.bearing,
                    by_legs=self.by_legs,
                )
                self.modes.track(track if self.modes.enrolled else None, self.sigma, self.now)
            if "odometry" not in self.dead:
                self.modes.base(self.odometry(), self.now)
            permission = self.modes.permission(self.now)
        return permission

    def odometry(self) -> Odometry:
        stall = (bool(self.base.get("stall")), False)
        return Odometry(
            self.now, self.now, Pose2(), Twist(), stall,
            bumpers_front=2 if self.base.get("bump") else 0,
            stop_button=bool(self.base.get("stop_button")),
            motors_enabled=self.motors,
            battery=11.3,
            battery_level=self.battery,
        )  # fmt: skip

    def do(self, *actions: Action) -> str:
        return "".join(self.modes.operate(action, self.now) for action in actions)

    def mode(self) -> Mode:
        return self.modes.mode


def following() -> Story:
    story = Story()
    story.run(2.5)
    assert story.do(Action.ENROL, Action.CONFIRM) == ""
    story.run(0.1)
    assert story.do(Action.ARM) == ""
    story.run(0.5)
    assert story.mode() is Mode.FOLLOWING
    return story


def kinds(permission: Permission) -> set[StopReason]:
    return {reason.stop for reason in permission.reasons}


def test_a_fresh_daemon_is_disarmed_and_says_what_is_missing() -> None:
    story = Story()
    permission = story.modes.permission(0.0)
    assert story.mode() is Mode.DISARMED
    assert not permission.move
    assert {StopReason.SCAN_STALE, StopReason.NO_TARGET} <= kinds(permission)


def test_following_allows_everything() -> None:
    assert following().run(1.0) == Permission(True, inf)


@pytest.mark.parametrize(
    ("before", "seconds", "text"),
    [
        ((), 2.5, "no person enrolled"),
        ((Action.ENROL,), 2.5, "not confirmed"),
        ((Action.ENROL, Action.CONFIRM), 1.5, "waiting for all sensors"),
    ],
)
def test_arming_is_refused_with_the_reason(
    before: tuple[Action, ...], seconds: float, text: str
) -> None:
    story = Story()
    story.run(seconds)
    story.do(*before)
    assert text in story.do(Action.ARM)
    assert story.mode() is Mode.DISARMED


def test_arming_with_a_silent_sensor_names_it() -> None:
    story = Story()
    story.dead = {"scan"}
    story.run(3.0)
    story.do(Action.ENROL, Action.CONFIRM)
    assert "laser data too old (scan): nothing yet" in story.do(Action.ARM)


def test_arming_with_the_stop_button_pressed_is_refused() -> None:
    story = Story()
    story.base = {"stop_button": True}
    story.run(3.0)
    story.do(Action.ENROL, Action.CONFIRM)
    assert "STOP button" in story.do(Action.ARM)


def test_a_gap_starts_the_two_fresh_seconds_again() -> None:
    story = Story()
    story.run(2.5)
    story.do(Action.ENROL, Action.CONFIRM)
    story.dead = {"scan"}
    story.run(0.5)
    story.dead = set()
    story.run(1.0)
    assert story.do(Action.ARM) == StopReason.START_UP.value
    story.run(1.2)
    assert story.do(Action.ARM) == ""


def test_confirming_nobody_is_refused() -> None:
    assert "no person enrolled" in Story().do(Action.CONFIRM)


def test_ready_waits_for_motors_and_five_good_frames() -> None:
    story = Story()
    story.run(2.5)
    story.do(Action.ENROL, Action.CONFIRM)
    story.motors = False
    story.do(Action.ARM)
    permission = story.run(1.0)
    assert story.mode() is Mode.READY
    assert kinds(permission) == {StopReason.START_UP}
    story.motors = True
    story.run(0.05)
    assert story.mode() is Mode.FOLLOWING


def test_motors_that_do_not_come_on_disarm() -> None:
    story = Story()
    story.run(2.5)
    story.do(Action.ENROL, Action.CONFIRM)
    story.motors = False
    story.do(Action.ARM)
    permission = story.run(3.2)
    assert story.mode() is Mode.DISARMED
    assert StopReason.MOTORS_OFF in kinds(permission)


@pytest.mark.parametrize(
    ("base", "mode", "reason"),
    [
        ("stall", Mode.FAULT, StopReason.WHEEL_STALL),
        ("bump", Mode.FAULT, StopReason.BUMPER),
        ("stop_button", Mode.DISARMED, StopReason.STOP_BUTTON),
    ],
)
def test_stall_bump_and_stop_button_need_arming_again(
    base: str, mode: Mode, reason: StopReason
) -> None:
    story = following()
    story.base = {base: True}
    assert kinds(story.run(0.05)) >= {reason}
    assert story.mode() is mode
    story.base = {}
    assert not story.run(5.0).move
    assert story.do(Action.ARM) == ""
    story.run(0.5)
    assert story.mode() is Mode.FOLLOWING


def test_a_low_battery_is_a_warning() -> None:
    story = following()
    story.battery = BatteryLevel.LOW
    permission = story.run(1.0)
    assert (permission.move, permission.max_speed) == (True, inf)
    assert [str(reason) for reason in permission.reasons] == ["battery low (base): low, 11.3 V"]


@pytest.mark.parametrize("phase", [TrackPhase.CONFIRMED, TrackPhase.OCCLUDED])
def test_with_a_weak_battery_the_robot_limps(phase: TrackPhase) -> None:
    story = following()
    story.battery, story.phase = BatteryLevel.WEAK, phase
    permission = story.run(1.0)
    assert story.mode() is Mode.FOLLOWING
    assert permission.max_speed == 0.3
    assert StopReason.LOW_BATTERY in kinds(permission)
    story.battery, story.phase = BatteryLevel.GOOD, TrackPhase.CONFIRMED
    assert story.run(1.0) == Permission(True, inf)


def test_an_empty_battery_disarms_and_refuses_arming() -> None:
    story = following()
    story.battery = BatteryLevel.EMPTY
    assert kinds(story.run(0.05)) == {StopReason.LOW_BATTERY}
    assert story.mode() is Mode.DISARMED
    assert "battery low (base): empty, 11.3 V" in story.do(Action.ARM)
    story.battery = BatteryLevel.GOOD
    assert not story.run(5.0).move
    assert story.do(Action.ARM) == ""


def test_motors_switched_off_by_hand_disarm() -> None:
    story = following()
    story.motors = False
    assert StopReason.MOTORS_OFF in kinds(story.run(0.05))
    assert story.mode() is Mode.DISARMED


def test_a_lost_base_disarms_and_does_not_resume() -> None:
    story = following()
    story.dead = {"odometry"}
    permission = story.run(0.5)
    assert story.mode() is Mode.DISARMED
    assert StopReason.ODOMETRY_STALE in kinds(permission)
    story.dead = set()
    assert not story.run(5.0).move


@pytest.mark.parametrize("name", ["scan", "image"])
def test_a_stale_sensor_holds_and_five_good_frames_resume(name: str) -> None:
    story = following()
    story.dead = {name}
    permission = story.run(0.5)
    assert story.mode() is Mode.HOLDING
    assert kinds(permission) == {STREAMS[name].reason}
    assert not permission.move
    story.dead = set()
    assert story.run(0.2).max_speed == 0.0
    assert story.run(0.1) == Permission(True, inf)


def test_by_the_legs_alone_the_robot_crawls_for_two_seconds() -> None:
    story = following()
    story.by_legs = True
    crawling = story.run(1.9)
    assert story.mode() is Mode.FOLLOWING
    assert (crawling.move, crawling.max_speed) == (True, 0.3)
    assert "by the legs alone" in str(crawling.reasons[0])
    held = story.run(0.2)
    assert story.mode() is Mode.HOLDING
    assert held.max_speed == 0.0


def test_what_the_legs_alone_show_never_starts_a_standing_robot() -> None:
    story = following()
    story.dead = {"image"}
    story.run(0.5)
    story.dead, story.by_legs = set(), True
    assert story.run(3.0).max_speed == 0.0
    story.by_legs = False
    assert story.run(0.3) == Permission(True, inf)


def test_an_excused_stream_may_be_older_but_not_for_arming_or_at_full_speed() -> None:
    freshness = Freshness()
    for k in range(30):
        for name in STREAMS:
            freshness.saw(name, 0.1 * k, 0.1 * k)
    for stamp in (3.0, 3.3, 3.5):
        freshness.saw("scan", stamp, stamp)
        freshness.saw("odometry", stamp, stamp)
    assert [reason.device for reason in freshness.stale(3.5)] == ["image"]
    freshness.excuse("image", 2.0)
    assert freshness.stale(3.5) == ()
    assert [reason.device for reason in freshness.ageing(0.7, 3.5)] == ["image"]
    assert freshness.good_until() == pytest.approx(3.5 + STREAMS["odometry"].stale_after)
    freshness.excuse("image", 0.0)
    assert freshness.good_until() == pytest.approx(3.2)
    assert freshness.fresh_for(3.5) == 0.0


def test_nobody_waits_for_a_stream_that_is_not_watched() -> None:
    freshness = Freshness({"image": 0.1}, watched={"scan", "odometry"})
    freshness.saw("scan", 1.0, 1.0)
    freshness.saw("odometry", 1.0, 1.0)
    freshness.saw("image", 0.2, 1.0)
    freshness.excuse("image", 1.0)
    assert freshness.stale(1.1) == ()
    assert freshness.good_until() == pytest.approx(1.0 + STREAMS["odometry"].stale_after)


def test_a_failed_device_is_a_fault_until_it_is_back_and_armed_again() -> None:
    story = following()
    story.modes.fault(Fault(story.now, "laser", StopReason.LINK_LOST, "unplugged"), story.now)
    assert story.mode() is Mode.FAULT
    assert not story.run(0.1).move
    assert "device lost (laser): unplugged" in story.do(Action.ARM)
    assert "laser" in story.do(Action.CLEAR)
    recovered = Fault(story.now, "laser", StopReason.LINK_LOST, recovered=True)
    story.modes.fault(recovered, story.now)
    assert not story.run(5.0).move
    assert story.do(Action.CLEAR) == ""
    assert story.mode() is Mode.DISARMED
    assert story.do(Action.ARM) == ""


def test_a_fault_while_disarmed_refuses_arming() -> None:
    story = Story()
    story.run(2.5)
    story.do(Action.ENROL, Action.CONFIRM)
    story.modes.fault(Fault(story.now, "base", StopReason.DEVICE_REFUSED), story.now)
    assert story.mode() is Mode.DISARMED
    assert "device refuses" in story.do(Action.ARM)


def test_the_emergency_stop_latches_until_it_is_cleared_and_armed() -> None:
    story = following()
    assert story.do(Action.STOP) == ""
    assert kinds(story.run(3.0)) == {StopReason.ESTOP}
    assert "cannot arm while estop" in story.do(Action.ARM)
    assert "cannot enrol while estop" in story.do(Action.ENROL)
    assert story.do(Action.CLEAR) == ""
    assert story.mode() is Mode.DISARMED
    assert not story.run(3.0).move


def test_holding_by_the_operator_lasts_until_armed_again() -> None:
    story = following()
    story.do(Action.HOLD)
    assert kinds(story.run(5.0)) == {StopReason.HOLD}
    story.phase = TrackPhase.LOST
    story.run(2.0)
    assert story.mode() is Mode.HOLDING
    story.phase = TrackPhase.CONFIRMED
    assert story.do(Action.ARM) == ""
    story.run(0.5)
    assert story.mode() is Mode.FOLLOWING


def test_disarming_and_enrolling_somebody_else_end_the_armed_time() -> None:
    story = following()
    story.do(Action.DISARM)
    assert kinds(story.run(0.1)) == {StopReason.DISARMED}
    story = following()
    story.do(Action.ENROL)
    assert kinds(story.run(0.1)) == {StopReason.NOT_CONFIRMED}


def test_doubt_stops_the_wheels_within_a_third_of_a_second_but_lets_it_turn() -> None:
    story = following()
    story.confidence = 0.1
    permission = story.run(0.3)
    assert story.mode() is Mode.HOLDING
    assert permission.move
    assert permission.max_speed == 0.0
    assert kinds(permission) == {StopReason.TARGET_UNSURE}


@pytest.mark.parametrize(
    ("phase", "confidence", "speed"),
    [(TrackPhase.CONFIRMED, 0.1, 0.4), (TrackPhase.TENTATIVE, 0.9, 0.0)],
)
def test_one_doubtful_frame_slows_and_the_next_good_one_goes_on(
    phase: TrackPhase, confidence: float, speed: float
) -> None:
    story = following()
    story.phase, story.confidence = phase, confidence
    permission = story.run(0.05)
    assert permission.max_speed == speed
    assert not permission.reasons[0].full_stop
    story.phase, story.confidence = TrackPhase.CONFIRMED, 0.9
    assert story.run(0.05) == Permission(True, inf)


def test_four_good_frames_do_not_resume_and_five_do() -> None:
    story = following()
    story.confidence = 0.1
    story.run(0.5)
    story.confidence = 0.9
    assert story.run(0.2).max_speed == 0.0
    assert story.run(0.05).max_speed == inf


def test_an_occluded_person_is_followed_slowly_for_five_seconds() -> None:
    story = following()
    story.phase = TrackPhase.OCCLUDED
    assert story.run(0.5).max_speed == 0.4
    assert story.run(4.0).max_speed == 0.4
    assert story.run(0.7).max_speed == 0.0


def test_an_occluded_person_of_unknown_place_is_a_doubt() -> None:
    story = following()
    story.phase, story.sigma = TrackPhase.OCCLUDED, 0.6
    assert story.run(0.3).max_speed == 0.0
    assert story.mode() is Mode.HOLDING


def test_a_lost_person_is_coasted_to_ever_more_slowly_then_searched() -> None:
    story = following()
    story.phase = TrackPhase.LOST
    speeds = [story.run(0.05).max_speed for _ in range(10)]
    assert speeds == sorted(speeds, reverse=True)
    assert 0.0 < speeds[0] <= 0.4
    permission = story.run(0.1)
    assert story.mode() is Mode.SEARCHING
    assert permission.max_speed == 0.0
    assert kinds(permission) == {StopReason.TARGET_LOST}


@pytest.mark.parametrize(("bearing", "sign"), [(0.3, 1.0), (-0.3, -1.0)])
def test_the_search_turns_toward_the_side_last_seen(bearing: float, sign: float) -> None:
    story = following()
    story.bearing = bearing
    story.run(0.2)
    story.phase, story.bearing = TrackPhase.TENTATIVE, -bearing  # it may be on anything
    story.run(0.2)
    story.phase = TrackPhase.LOST
    permission = story.run(0.7)
    assert permission.search * sign > 0
    assert abs(permission.search) <= radians(28.7)


def test_the_search_ends_after_ten_seconds_and_only_arming_goes_on() -> None:
    story = following()
    story.phase = TrackPhase.LOST
    assert story.run(10.3).move
    assert kinds(story.run(0.5)) == {StopReason.TARGET_LOST}
    assert story.mode() is Mode.IDLE
    story.phase = TrackPhase.CONFIRMED
    assert not story.run(3.0).move
    assert story.do(Action.ARM) == ""
    story.run(0.5)
    assert story.mode() is Mode.FOLLOWING


def test_somebody_found_in_the_search_is_looked_at_and_followed_once_sure() -> None:
    story = following()
    story.phase = TrackPhase.LOST
    story.run(2.0)
    story.phase = TrackPhase.TENTATIVE
    assert story.run(0.3).search == 0.0
    story.phase = TrackPhase.CONFIRMED
    story.run(0.3)
    assert story.mode() is Mode.FOLLOWING


def test_without_coasting_a_lost_person_stops_at_once() -> None:
    story = following()
    story.modes.settings = ModeSettings(coast_s=0.0)
    story.phase = TrackPhase.LOST
    assert story.run(0.05).max_speed == 0.0


def test_the_table_knows_every_mode_and_never_arms_by_itself() -> None:
    assert set(TRANSITIONS.values()) == set(Mode)
    for (mode, trigger), goal in TRANSITIONS.items():
        if mode not in ARMED and goal in ARMED:
            assert trigger in (Action.ARM, Action.MANUAL)
        if isinstance(trigger, Signal):
            assert mode in ARMED
    assert all(TRANSITIONS[mode, Action.STOP] is Mode.ESTOP for mode in Mode)
    assert [trigger for mode, trigger in TRANSITIONS if mode is Mode.ESTOP] == [
        Action.STOP,
        Action.CLEAR,
    ]


def by_session(session: str, *actions: Action) -> Story:
    """Fresh data, a person enrolled and confirmed, then what a session asks for."""
    story = Story()
    story.run(2.5)
    story.do(Action.ENROL, Action.CONFIRM)
    for action in actions:
        assert not story.modes.operate(action, story.now, session)
    return story


def test_following_ends_within_a_second_of_the_session_that_armed() -> None:
    story = by_session("page 1", Action.ARM)
    for _ in range(10):
        story.run(0.25)
        story.modes.present("page 1", story.now, here=True)
    assert story.mode() is Mode.FOLLOWING
    permission = story.run(0.9)
    assert not permission.move
    assert story.mode() is Mode.DISARMED
    assert permission.reasons[0].stop is StopReason.OPERATOR_GONE


def test_a_session_that_says_goodbye_ends_at_once_what_it_armed() -> None:
    story = by_session("page 1", Action.ARM)
    story.run(0.5)
    story.modes.present("page 2", story.now, here=False)
    assert story.mode() is Mode.FOLLOWING
    story.modes.present("page 1", story.now, here=False)
    assert story.mode() is Mode.DISARMED


def test_what_nobodys_session_armed_needs_no_session() -> None:
    assert following().run(5.0).move


def test_a_hand_drives_only_as_long_as_it_asks() -> None:
    story = by_session("page 1", Action.MANUAL)
    assert not story.run(0.05).move
    story.modes.drive(Twist(0.3, 0.1), "page 1", story.now)
    permission = story.run(0.05)
    assert permission.drive == Twist(0.3, 0.1)
    assert permission.max_speed == ModeSettings().manual_speed_mps
    assert not story.run(0.15).move
    assert story.mode() is Mode.MANUAL


def test_what_the_hand_asked_for_before_is_forgotten_when_it_takes_over_again() -> None:
    story = by_session("page 1", Action.MANUAL)
    story.modes.drive(Twist(0.3, 0.0), "page 1", story.now)
    assert not story.do(Action.DISARM)
    assert not story.modes.operate(Action.MANUAL, story.now, "page 1")
    assert not story.modes.permission(story.now).move


def test_only_the_hand_that_took_over_drives() -> None:
    story = by_session("page 1", Action.MANUAL)
    story.modes.drive(Twist(0.3, 0.0), "page 2", story.now)
    assert not story.run(0.05).move


def test_a_hand_needs_no_person_but_fresh_sensors() -> None:
    story = Story()
    assert "waiting" in story.do(Action.MANUAL) or "too old" in story.do(Action.MANUAL)
    story.run(2.5)
    assert not story.do(Action.MANUAL)
    assert story.mode() is Mode.MANUAL


def test_from_driving_by_hand_following_is_armed_as_usual() -> None:
    story = Story()
    story.run(2.5)
    story.do(Action.MANUAL)
    assert "no person" in story.do(Action.ARM)
    story.do(Action.ENROL, Action.CONFIRM, Action.ARM)
    story.run(1.0)
    assert story.mode() is Mode.FOLLOWING


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("trigger", [*Action, *Signal])
def test_the_modes_do_what_the_table_says_and_nothing_else(
    mode: Mode, trigger: Action | Signal
) -> None:
    story = Story()
    story.run(2.5)
    story.do(Action.ENROL, Action.CONFIRM)
    story.modes.mode = mode
    if isinstance(trigger, Action):
        refused = story.do(trigger)
        assert bool(refused) is ((mode, trigger) not in TRANSITIONS)
    else:
        story.modes._go(trigger, story.now)
    assert story.mode() is TRANSITIONS.get((mode, trigger), mode)


def test_every_armed_mode_that_waits_gives_up_after_a_bounded_time() -> None:
    waiting = {mode for mode, trigger in TRANSITIONS if trigger is Signal.SURE}
    assert set(LONGEST) == waiting
    for mode, name in LONGEST.items():
        assert TRANSITIONS[mode, Signal.GIVE_UP] is Mode.IDLE
        assert 0.0 < getattr(ModeSettings(), name) <= 60.0


@pytest.mark.parametrize("phase", [TrackPhase.TENTATIVE, TrackPhase.OCCLUDED])
def test_who_is_doubted_for_a_minute_must_be_armed_for_again(phase: TrackPhase) -> None:
    story = following()
    story.phase, story.confidence, story.sigma = phase, 0.1, 9.0
    story.run(59.0)
    assert story.mode() is Mode.HOLDING
    permission = story.run(2.0)
    assert story.mode() is Mode.IDLE
    assert kinds(permission) == {StopReason.TARGET_LOST}
    story.phase, story.confidence = TrackPhase.CONFIRMED, 0.9
    assert not story.run(3.0).move


def test_what_the_operator_holds_waits_for_ever() -> None:
    story = following()
    story.do(Action.HOLD)
    story.run(70.0)
    assert story.mode() is Mode.HOLDING


@pytest.mark.parametrize(
    ("seconds", "mode"), [(0.3, Mode.HOLDING), (1.0, Mode.HOLDING), (1.1, Mode.DISARMED)]
)
def test_a_held_up_loop_holds_and_a_suspend_disarms(seconds: float, mode: Mode) -> None:
    story = following()
    story.modes.late(seconds, story.now)
    assert story.mode() is mode
    assert story.run(0.2).max_speed == 0.0
    story.run(0.2)
    assert (story.mode() is Mode.FOLLOWING) is (mode is Mode.HOLDING)


def test_a_place_on_the_map_that_jumped_holds_until_five_good_frames() -> None:
    story = following()
    story.modes.jumped(0.8, story.now)
    assert story.mode() is Mode.HOLDING
    assert story.run(0.2).max_speed == 0.0
    story.run(0.1)
    assert story.mode() is Mode.FOLLOWING


def test_what_is_seen_to_come_is_waited_for_and_no_longer_than_that() -> None:
    freshness = Freshness({"scan": 0.26}, under_way={"scan": 0.09})
    for name in STREAMS:
        freshness.saw(name, 1.0, 1.0)
    assert [reason.device for reason in freshness.stale(1.27)] == ["scan"]
    freshness.coming("scan")
    assert freshness.stale(1.27) == ()
    assert [reason.device for reason in freshness.stale(1.36)][:1] == ["scan"]
    freshness.saw("scan", 1.2, 1.3)
    assert [reason.device for reason in freshness.stale(1.47)][:1] == ["scan"]
    freshness.coming("nothing that is watched")
