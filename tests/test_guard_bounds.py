"""The guard's smaller promises, each of which a changed sign or number would break unseen."""

from dataclasses import replace
from math import degrees, radians

import pytest

from followerd.control.guard import _since_report
from followerd.geometry import Pose2
from followerd.messages import Odometry, StopReason, TurnBy, Twist, WheelSpeeds
from tests.test_guard import NOW, REAR, bench, kinds, post, seen, turned_round, twist


def test_gaining_speed_is_no_stop() -> None:
    b = bench()
    command = b.guard.check(Twist(0.7, 0.0), b.situation, NOW)
    (reason,) = command.reasons
    assert reason.stop is StopReason.LIMIT
    assert not reason.full_stop


def test_wheel_speeds_turn_by_their_difference_over_the_track() -> None:
    b = bench()
    meant = b.guard._twist(WheelSpeeds(0.1, 0.2), 0.0)
    assert (meant.v, meant.omega) == pytest.approx((0.15, 0.1 / b.settings.track_m))


def test_turning_toward_a_near_person_is_free() -> None:
    b = bench()
    b.situation = replace(b.situation, target=(0.9, 0.0))
    command = b.check(Twist(0.0, 0.3))
    assert command.motion == Twist(0.0, 0.3)
    assert command.reasons == ()


def test_who_walks_beside_and_behind_is_led_however_near() -> None:
    b = bench()
    b.situation = replace(b.situation, target=(-0.5, 0.75))
    assert twist(b.check(Twist(0.3, 0.0))).v == 0.3


@pytest.mark.parametrize("bearing", [-35, 35])
def test_somebody_near_slows_on_either_side(bearing: float) -> None:
    command = bench().sees(seen((bearing, 3, 1.1))).check(Twist(0.7, 0.0))
    assert twist(command).v == 0.3
    assert kinds(command) == {StopReason.PERSON_TOO_CLOSE}


def test_a_target_of_one_beam_is_not_another_person() -> None:
    b = bench().sees(post(1.19, 0.0))
    b.situation = replace(b.situation, claimed=(slice(90, 91),), target=(1.19, 0.0))
    assert twist(b.check(Twist(0.7, 0.0))).v == pytest.approx(0.38)


def test_whoever_shares_a_beam_with_the_target_is_not_another_person() -> None:
    b = bench().sees(seen((0, 3, 1.15)))
    view = b.situation.view
    assert view is not None
    ((first, last),) = zip(view.clusters.first.tolist(), view.clusters.last.tolist(), strict=True)
    for beams, is_other in [
        (slice(last, last + 3), False),
        (slice(last + 1, last + 3), True),
        (slice(first - 3, first + 1), False),
        (slice(first - 3, first), True),
    ]:
        b.situation = replace(b.situation, claimed=(beams,), target=(1.9, 0.0))
        command = b.check(Twist(0.7, 0.0))
        assert ("someone else" in str(command.reasons)) is is_other


def test_whoever_stands_right_beside_the_targets_legs_is_another_person() -> None:
    b = bench().sees(seen((-2.5, 2.5, 1.3), (2.0, 1.5, 1.1)))
    view = b.situation.view
    assert view is not None
    ahead = sorted(zip(view.clusters.first.tolist(), view.clusters.last.tolist(), strict=True))
    assert len(ahead) == 2
    assert ahead[1][0] == ahead[0][1] + 1
    beams = slice(ahead[0][0], ahead[0][1] + 1)
    b.situation = replace(b.situation, claimed=(beams,), target=(1.3, 0.0))
    assert "someone else" in str(b.check(Twist(0.7, 0.0)).reasons)


def test_as_many_sonar_discs_as_are_asked_for_suffice_and_one_fewer_does_not() -> None:
    heard = 0
    for asked in range(1, 10):
        b = bench(rear_discs=asked)
        b.guard.sense(Odometry(NOW - 0.1, NOW - 0.1, Pose2(), Twist(), sonar=REAR))
        heard = heard or len(b.guard._echoes.along(-0.1, NOW))
        assert b.check(Twist(-0.1, 0.0)).stops is (asked > heard)
    assert 0 < heard < 9


def test_what_is_left_of_a_turn_ends_before_it_touches() -> None:
    """The base has turned 20 degrees of 60 since its report; a post lets it turn some 30 more."""
    b = bench().sees(post(0.05, 0.30))
    reported = Odometry(NOW - 0.05, NOW - 0.04, Pose2(theta=radians(-20.0)), Twist())
    free = b.guard.check(TurnBy(radians(170.0)), b.situation, NOW).motion
    assert isinstance(free, TurnBy)
    b.situation = replace(b.situation, odometry=reported)
    wished = free.angle + radians(10.0)  # from the report: 10 degrees less than is free from now
    assert b.guard.check(TurnBy(wished), b.situation, NOW).motion == TurnBy(wished)
    wished = free.angle + radians(40.0)
    command = b.guard.check(TurnBy(wished), b.situation, NOW)
    assert isinstance(command.motion, TurnBy)
    assert degrees(command.motion.angle) == pytest.approx(degrees(free.angle) + 20.0)
    touches = [reason for reason in command.reasons if reason.stop is StopReason.OBSTACLE]
    assert touches
    assert not any(reason.full_stop for reason in touches)


def test_a_standing_robot_does_not_creep_up_to_its_margin() -> None:
    b = bench().sees(seen((0, 60, 0.21 + 0.70 + 0.02)))
    assert twist(b.check(Twist(0.7, 0.0))).v == 0.0


def test_a_robot_that_drives_is_slowed_before_it_is_stopped() -> None:
    """Room for 6 cm/s: too little to set off, enough to roll out."""
    b = bench().sees(seen((0, 60, 0.97)))
    b.guard._approved, b.guard._approved_at = Twist(0.3, 0.0), NOW - 0.05
    assert 0.0 < twist(b.guard.check(Twist(0.3, 0.0), b.situation, NOW)).v < 0.1


def test_an_arc_toward_a_wall_is_slowed_and_not_given_up() -> None:
    assert 0.2 < twist(bench().sees(seen((0, 60, 1.5))).check(Twist(0.7, 0.2))).v < 0.65
    b = bench().sees(seen((0, 60, 1.5)))
    b.guard._approved, b.guard._approved_at = Twist(0.7, 0.2), NOW - 0.05
    assert 0.2 < twist(b.guard.check(Twist(0.7, 0.2), b.situation, NOW)).v < 0.65


def test_no_report_is_no_turn() -> None:
    assert _since_report(Pose2(theta=0.3), None) == 0.0


def test_a_turn_by_nothing_that_is_too_fast_becomes_a_speed() -> None:
    assert bench().check(TurnBy(0.0, 2.0)).motion == Twist(0.7, 0.0)


BESIDE = (0.2, 0.27)  # m, a post that leaves room to turn left at 7 degrees/s


def test_a_standing_robot_does_not_creep_into_the_margin_of_its_turn() -> None:
    b = bench().sees(post(*BESIDE))
    command = b.guard.check(Twist(0.0, 0.9), b.situation, NOW)
    assert command.stops
    assert kinds(command) == {StopReason.OBSTACLE}
    assert twist(b.check(Twist(0.0, -0.9))).omega == -0.9


def test_a_robot_that_turns_is_slowed_before_it_is_stopped() -> None:
    b = bench().sees(post(*BESIDE))
    b.guard._approved, b.guard._approved_at = Twist(0.0, 0.5), NOW - 0.05
    slowed = twist(b.guard.check(Twist(0.0, 0.9), b.situation, NOW)).omega
    assert 5.0 < degrees(slowed) < 9.0
    assert b.guard.check(Twist(0.0, 0.9), b.situation, NOW + 0.05).stops


def test_who_drives_on_past_a_post_may_steer() -> None:
    b = bench().sees(post(*BESIDE))
    b.guard._approved, b.guard._approved_at = Twist(0.3, 0.0), NOW - 0.05
    assert twist(b.guard.check(Twist(0.3, 0.05), b.situation, NOW)) == Twist(0.3, 0.05)
    b.guard._approved, b.guard._approved_at = Twist(-0.1, 0.0), NOW - 0.05
    b.guard.sense(Odometry(NOW - 0.1, NOW - 0.1, Pose2(), Twist(), sonar=REAR))
    assert twist(b.guard.check(Twist(-0.1, 0.05), b.situation, NOW)).omega == 0.05


@pytest.mark.parametrize(("x", "free"), [(0.21, False), (0.225, True)])
def test_what_a_turn_would_miss_by_less_than_the_laser_can_tell_is_in_its_way(
    x: float, free: bool
) -> None:
    """A post within the margin of the corner; the bare corner passes both."""
    assert bench().sees(post(x, 0.238)).check(Twist(0.0, 0.9)).stops is not free


def test_who_sets_off_needs_room_from_the_first_command_on() -> None:
    b = bench().sees(seen((0, 4, 0.21 + 0.70 + 0.02)))  # room for 4 cm/s
    assert b.guard.check(Twist(0.7, 0.0), b.situation, NOW).stops


def test_one_metre_a_second_and_one_radian_a_second_are_speeds_like_any_other() -> None:
    b = bench(max_speed_mps=1.0, blind_distance_m=2.0).sees(seen((0, 60, 1.5)))
    b.guard._approved, b.guard._approved_at = Twist(1.0, 0.0), NOW - 0.05
    assert 0.2 < twist(b.guard.check(Twist(1.0, 0.0), b.situation, NOW)).v < 0.7
    assert turned_round(seen()).check(Twist(1.0, 0.0)).stops
    b = bench(max_turn_degps=90.0).sees(post(*BESIDE))
    b.guard._approved, b.guard._approved_at = Twist(0.0, 1.0), NOW - 0.05
    assert 0.0 < twist(b.guard.check(Twist(0.0, 1.0), b.situation, NOW)).omega < 0.2
    b = bench(max_turn_degps=90.0).sees(post(0.0, 0.4))
    b.guard._approved, b.guard._approved_at = Twist(0.15, 1.0), NOW - 0.05
    eased = twist(b.guard.check(Twist(0.7, 1.0), b.situation, NOW))
    assert (eased.v, eased.omega) == pytest.approx((0.175, 0.25))


def test_the_arc_of_a_start_is_the_one_that_is_meant() -> None:
    """A post beside the robot forbids the tight arc, one on the right going straight ahead."""
    b = bench().sees(seen((72, 0.1, 0.316), (-21, 0.1, 0.75)))
    b.guard._approved_at = NOW - 0.05
    started = twist(b.guard.check(Twist(0.7, 0.6), b.situation, NOW))
    assert (started.v, started.omega) == pytest.approx((0.025, 0.025 * 0.0873 / 0.7), rel=0.01)
