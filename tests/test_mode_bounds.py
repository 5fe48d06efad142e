"""The modes' smaller promises, each of which a changed sign or number would break unseen."""

from math import inf, radians

import pytest

from followerd.control.freshness import Freshness
from followerd.control.mode import Modes, ModeSettings, Permission
from followerd.control.transitions import Action
from followerd.geometry import Pose2
from followerd.messages import (
    BatteryLevel,
    Fault,
    Mode,
    StopReason,
    TrackPhase,
    TrackState,
    Twist,
)
from tests.test_mode import Story, following, kinds

FRAME = 0.05  # s, of a story


def softly(permission: Permission) -> bool:
    """Whether it may move on, straight ahead, though there is a reason to be slow."""
    stops = any(reason.full_stop for reason in permission.reasons)
    return permission.move and permission.search == 0.0 and bool(permission.reasons) and not stops


def test_nothing_is_allowed_by_default_and_nobody_is_confirmed() -> None:
    assert Permission() == Permission(False, 0.0, 0.0, (), None)
    modes = Modes(ModeSettings(), Freshness())
    assert (modes.enrolled, modes.confirmed) == (False, False)


def test_arming_asks_for_five_new_good_frames() -> None:
    story = Story()
    story.run(2.5)
    story.do(Action.ENROL, Action.CONFIRM)
    story.run(1.0)
    assert story.do(Action.ARM) == ""
    story.run(4 * FRAME)
    assert story.mode() is Mode.READY
    story.run(FRAME)
    assert story.mode() is Mode.FOLLOWING


@pytest.mark.parametrize("what", ["late", "jumped"])
def test_a_late_loop_or_a_jump_on_the_map_asks_for_five_good_frames(what: str) -> None:
    story = following()
    getattr(story.modes, what)(0.6, story.now)
    assert story.mode() is Mode.HOLDING
    story.run(4 * FRAME)
    assert story.mode() is Mode.HOLDING
    story.run(FRAME)
    assert story.mode() is Mode.FOLLOWING


def test_a_loop_that_was_away_as_long_as_a_suspend_disarms() -> None:
    story = following()
    story.modes.late(1.5, story.now)
    assert story.mode() is Mode.DISARMED


def test_a_hand_does_not_go_on_behind_a_late_loop() -> None:
    story = following()
    assert story.do(Action.MANUAL) == ""
    story.modes.drive(Twist(0.2, 0.0), "", story.now)
    permission = story.modes.permission(story.now)
    assert (permission.move, permission.drive) == (True, Twist(0.2, 0.0))
    story.modes.late(0.3, story.now)
    permission = story.modes.permission(story.now)
    assert (permission.move, permission.drive) == (False, None)


def test_while_holding_it_turns_to_the_person_and_does_not_search() -> None:
    story = following()
    story.phase = TrackPhase.TENTATIVE
    permission = story.run(0.5)
    assert story.mode() is Mode.HOLDING
    assert (permission.move, permission.max_speed, permission.search) == (True, 0.0, 0.0)


def test_coasting_slows_down_evenly_and_straight_ahead() -> None:
    story = following()
    story.phase = TrackPhase.LOST
    story.run(FRAME)  # from here on it counts
    for frames in range(1, 9):
        permission = story.run(FRAME)
        assert softly(permission)
        assert permission.max_speed == pytest.approx(
            0.4 * (1.0 - frames * FRAME / ModeSettings().coast_s)
        )


@pytest.mark.parametrize(("by_legs", "speed"), [(True, 0.3), (False, 0.4)])
def test_what_is_followed_slowly_is_followed(by_legs: bool, speed: float) -> None:
    story = following()
    story.phase = TrackPhase.CONFIRMED if by_legs else TrackPhase.OCCLUDED
    story.by_legs = by_legs
    permission = story.run(1.0)
    assert softly(permission)
    assert permission.max_speed == speed


@pytest.mark.parametrize("level", [BatteryLevel.LOW, BatteryLevel.WEAK])
def test_a_drained_battery_is_no_stop(level: BatteryLevel) -> None:
    story = following()
    story.battery = level
    permission = story.run(0.5)
    assert kinds(permission) == {StopReason.LOW_BATTERY}
    assert softly(permission)


def test_in_a_fault_the_person_can_be_shown_before_it_is_mended() -> None:
    story = following()
    story.modes.fault(Fault(story.now, "laser", StopReason.LINK_LOST), story.now)
    assert story.mode() is Mode.FAULT
    assert story.do(Action.ENROL, Action.CONFIRM) == ""
    assert "laser" in story.do(Action.CLEAR)
    assert story.do(Action.STOP) == ""
    assert story.do(Action.CLEAR) == ""
    assert story.mode() is Mode.DISARMED


def search(*seen: float | None) -> float:
    """The turn after the person was seen at these bearings and is lost without one."""
    story = following()
    for bearing in seen:
        track = TrackState(story.now, TrackPhase.CONFIRMED, 0.9, bearing=bearing)
        story.modes.track(track, 0.1, story.now)
    story.dead = {"image"}
    story.freshness.excuse("image", 20.0)
    story.modes.track(TrackState(story.now, TrackPhase.LOST, 0.0), 0.1, story.now)
    story.modes.base(story.odometry(), story.now)
    permission = story.run(1.0)
    assert story.mode() is Mode.SEARCHING
    return permission.search


def test_the_search_begins_toward_the_side_where_the_person_was_seen_last() -> None:
    assert search(0.3, -0.3) == pytest.approx(radians(-25.0))
    assert search(-0.3, 0.3) == pytest.approx(radians(25.0))


def test_who_was_never_seen_in_a_direction_is_searched_for_to_the_left() -> None:
    story = Story()
    lost = TrackState(0.0, TrackPhase.LOST, 0.0)
    seen = TrackState(0.0, TrackPhase.CONFIRMED, 0.9)
    for actions in ((), (Action.ENROL, Action.CONFIRM), (Action.ARM,), ()):
        assert story.do(*actions) == ""
        for _ in range(50):
            story.now += FRAME
            for name in ("scan", "odometry", "image"):
                story.freshness.saw(name, story.now, story.now)
            story.modes.base(story.odometry(), story.now)
            last = not actions and story.modes.confirmed
            story.modes.track(lost if last else seen, 0.1, story.now)
            permission = story.modes.permission(story.now)
    assert story.mode() is Mode.SEARCHING
    assert permission.search == pytest.approx(radians(25.0))
    assert Pose2() == story.odometry().pose


EXACT = ModeSettings(  # times and shares that a computer knows exactly
    fresh_before_arming_s=2.0, motors_on_within_s=2.0, min_confidence=0.5, unsure_grace_s=0.125,
    coast_s=0.25, search_s=8.0, occluded_sigma_m=0.5, suspended_s=1.0, operator_gone_s=0.5,
    hand_s=0.125,
)  # fmt: skip
START = 16.0  # s


class Exactly(Story):
    """Follows since START by EXACT bounds; nothing happens but what is told."""

    def __init__(self) -> None:
        earlier = following()
        vars(self).update(vars(earlier))
        self.modes.settings = EXACT
        for step in range(-32, 1):
            self.after(0.125 * step)
            self.see(TrackPhase.CONFIRMED)

    def after(self, seconds: float) -> Permission:
        """So long after START, with all data fresh."""
        self.now = START + seconds
        for name in ("scan", "odometry", "image"):
            self.freshness.saw(name, self.now, self.now)
        return self.modes.permission(self.now)

    def see(self, phase: TrackPhase, confidence: float = 0.9, sigma: float = 0.1) -> None:
        """The track of now."""
        self.modes.track(TrackState(self.now, phase, confidence, bearing=0.1), sigma, self.now)


def test_a_person_at_the_least_confidence_is_followed() -> None:
    story = Exactly()
    story.see(TrackPhase.CONFIRMED, confidence=0.5)
    assert story.after(1.0) == Permission(True, inf)


@pytest.mark.parametrize("sigma", [0.5, 0.6])
def test_a_prediction_too_uncertain_to_follow_is_doubted_at_once(sigma: float) -> None:
    story = Exactly()
    story.see(TrackPhase.OCCLUDED, sigma=sigma)
    story.after(0.125)
    assert story.mode() is Mode.HOLDING


def test_doubt_coasting_and_search_end_when_their_time_is_up() -> None:
    story = Exactly()
    story.see(TrackPhase.TENTATIVE)
    story.after(0.1)
    assert story.mode() is Mode.FOLLOWING
    story.after(0.125)
    assert story.mode() is Mode.HOLDING
    story = Exactly()
    story.see(TrackPhase.LOST)
    story.after(0.2)
    assert story.mode() is Mode.FOLLOWING
    story.after(0.25)
    assert story.mode() is Mode.SEARCHING
    story.after(8.2)
    assert story.mode() is Mode.SEARCHING
    story.after(8.25)
    assert story.mode() is Mode.IDLE


def test_a_hand_and_a_session_are_good_for_as_long_as_is_said() -> None:
    story = Exactly()
    assert story.modes.operate(Action.MANUAL, story.now, "page") == ""
    story.modes.drive(Twist(0.2, 0.0), "page", story.now)
    assert story.after(0.125).move
    assert not story.after(0.126).move
    story.after(0.5)
    assert story.mode() is Mode.MANUAL
    story.after(0.51)
    assert story.mode() is Mode.DISARMED


def test_motors_have_their_time_to_come_on() -> None:
    story = Exactly()
    story.motors = False
    assert story.do(Action.HOLD, Action.ARM) == ""
    for seconds, mode in [(2.0, Mode.READY), (2.01, Mode.DISARMED)]:
        story.after(seconds)
        story.modes.base(story.odometry(), story.now)
        assert story.mode() is mode


def test_motors_have_their_time_to_come_on_for_a_hand_too() -> None:
    story = Exactly()
    story.motors = False
    assert story.do(Action.MANUAL) == ""
    for seconds, mode in [(2.0, Mode.MANUAL), (2.01, Mode.DISARMED)]:
        story.after(seconds)
        story.modes.base(story.odometry(), story.now)
        assert story.mode() is mode


def test_who_was_away_for_just_as_long_as_is_allowed_is_not_disarmed() -> None:
    story = Exactly()
    story.modes.late(1.0, story.now)
    assert story.mode() is Mode.HOLDING


def test_two_seconds_of_fresh_data_are_enough_to_arm() -> None:
    story = Exactly()
    story.do(Action.DISARM)
    story.freshness = story.modes.freshness = Freshness()
    story.after(0.0)
    for step in range(1, 16):
        story.after(0.125 * step)
        assert "waiting" in story.do(Action.ARM)
    story.after(2.0)
    assert story.do(Action.ARM) == ""


def test_a_fault_may_be_disarmed_and_a_hand_may_let_it_follow() -> None:
    story = following()
    story.modes.fault(Fault(story.now, "laser", StopReason.LINK_LOST), story.now)
    assert story.do(Action.DISARM) == ""
    assert story.mode() is Mode.DISARMED
    story = following()
    assert story.do(Action.MANUAL, Action.ARM) == ""
    assert story.mode() is Mode.READY


def test_who_is_lost_while_it_was_unsure_is_searched_for() -> None:
    story = following()
    story.phase = TrackPhase.TENTATIVE
    story.run(0.5)
    assert story.mode() is Mode.HOLDING
    story.phase = TrackPhase.LOST
    story.run(0.5)
    assert story.mode() is Mode.SEARCHING
