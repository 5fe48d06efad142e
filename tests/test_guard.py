"""What the guard owes: never too fast, never on stale data, never without a reason."""

from dataclasses import dataclass, replace
from math import cos, degrees, hypot, inf, isfinite, nan, pi, radians, sin

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from followerd.control.freshness import Freshness
from followerd.control.guard import BEHIND, Guard, Situation, _since_report
from followerd.control.interfaces import View
from followerd.control.limits import GuardSettings
from followerd.control.mode import Permission
from followerd.control.plausible import is_finite_wish, is_plausible_odometry, is_plausible_pose
from followerd.geometry import Array, Pose2
from followerd.messages import (
    Chassis,
    Clusters,
    Command,
    Odometry,
    Reason,
    Scan,
    Sonar,
    StopReason,
    TurnBy,
    Twist,
    WheelSpeeds,
    Wish,
)
from followerd.perception.clusters import ClusterSettings, find_clusters
from followerd.streams import STREAMS

NOW = 100.0
VALID = GuardSettings().valid_s
GO = Permission(move=True, max_speed=inf)
ANGLES = np.radians(np.arange(-90, 91))
REAR = tuple(Sonar(8 + k, Pose2(-0.2, 0.0, radians(120 + 15 * k)), 3.0) for k in range(8))


def seen(*things: tuple[float, float, float]) -> Array:
    """Ranges of 181 beams from the origin; things are (bearing deg, half width deg, range m)."""
    ranges = np.full(181, inf)
    for bearing, half, at in things:
        beams = np.abs(np.degrees(ANGLES) - bearing) <= half
        ranges[beams] = np.minimum(ranges[beams], at)
    return ranges


def walls(left: float, right: float) -> Array:
    """Ranges of 181 beams between two endless walls, m aside."""
    with np.errstate(divide="ignore"):
        aside = np.where(ANGLES > 0, left, right) / np.abs(np.sin(ANGLES))
    return np.where(aside < 8.0, aside, inf)


def post(x: float, y: float) -> Array:
    """Ranges with a thin post at (x, y): one beam."""
    return seen((round(np.degrees(np.arctan2(y, x))), 0.1, hypot(x, y)))


def view_of(ranges: Array) -> View:
    scan = Scan(NOW - 0.05, NOW - 0.04, -pi / 2, radians(1), ranges, 8.0, np.zeros(181), Pose2())
    points = scan.points()
    clusters: Clusters = find_clusters(scan, points, ClusterSettings())
    return View(scan, points, clusters, Pose2())


@dataclass
class Bench:
    """A guard with fresh data, a target 3 m ahead and nothing else in sight."""

    settings: GuardSettings

    def __post_init__(self) -> None:
        self.freshness = Freshness()
        self.guard = Guard(self.settings, self.freshness)
        for name in STREAMS:
            self.freshness.saw(name, NOW - 0.05, NOW)
        self.situation = Situation(
            GO, Pose2(), Odometry(NOW - 0.05, NOW - 0.04, Pose2(), Twist()),
            view_of(seen()), (3.0, 0.0),
        )  # fmt: skip

    def sees(self, ranges: Array) -> "Bench":
        self.situation = replace(self.situation, view=view_of(ranges))
        return self

    def check(self, wish: Wish | None, now: float = NOW) -> Command:
        """The steady answer: ramps have had their time."""
        for _ in range(10):
            command = self.guard.check(wish, self.situation, now)
            self.guard._approved_at = now - 0.2  # time passes, the data stays fresh
        return command


def bench(**changes: object) -> Bench:
    return Bench(GuardSettings.model_validate(changes))


def twist(command: Command) -> Twist:
    assert command.motion is None or isinstance(command.motion, Twist)
    return command.motion or Twist()


def kinds(command: Command) -> set[StopReason]:
    return {reason.stop for reason in command.reasons}


def test_a_free_wish_passes_unchanged_and_without_a_reason() -> None:
    wish = Twist(0.4, 0.2)
    command = bench().check(wish)
    assert command.motion == wish
    assert command.reasons == ()
    assert not command.stops


def test_no_wish_is_a_stop_without_a_reason() -> None:
    command = bench().check(None)
    assert command.stops
    assert command.reasons == ()


# --- what forbids everything


def test_without_permission_nothing_moves_and_the_reason_is_the_modes() -> None:
    b = bench()
    b.situation = replace(b.situation, permission=Permission(reasons=(Reason(StopReason.HOLD),)))
    command = b.check(Twist(0.4, 0.2))
    assert command.stops
    assert kinds(command) == {StopReason.HOLD}


def test_without_permission_and_without_a_reason_it_is_not_armed() -> None:
    b = bench()
    b.situation = replace(b.situation, permission=Permission())
    assert kinds(b.check(Twist(0.4, 0.2))) == {StopReason.DISARMED}


def test_an_emergency_stop_asks_for_the_hardest_braking() -> None:
    b = bench()
    b.situation = replace(b.situation, permission=Permission(reasons=(Reason(StopReason.ESTOP),)))
    assert b.check(Twist(0.4, 0.2)).emergency
    assert not bench().check(Twist(0.4, 0.2)).emergency


@pytest.mark.parametrize("name", list(STREAMS))
@pytest.mark.parametrize("wish", [Twist(0.4, 0.0), Twist(0.0, 0.4), Twist(-0.1, 0.0)])
def test_each_stale_stream_stops_every_motion_and_is_named(name: str, wish: Twist) -> None:
    b = bench()
    b.freshness.newest[name] = NOW - STREAMS[name].stale_after - 0.01
    command = b.check(wish)
    assert command.stops
    assert [(r.stop, r.device) for r in command.reasons] == [(STREAMS[name].reason, name)]
    assert "old" in command.reasons[0].detail


@pytest.mark.parametrize("name", list(STREAMS))
def test_a_stamp_that_is_no_number_or_in_the_future_stops(name: str) -> None:
    for stamp in (nan, NOW + 1.0):
        b = bench()
        b.freshness.newest[name] = stamp
        assert b.check(Twist(0.4, 0.0)).stops


@pytest.mark.parametrize(
    "wish",
    [Twist(nan, 0.0), Twist(0.1, inf), WheelSpeeds(nan, 0.1), TurnBy(nan), TurnBy(0.1, -inf)],
)
def test_a_wish_that_is_no_number_stops(wish: Wish) -> None:
    command = bench().check(wish)
    assert command.stops
    assert kinds(command) == {StopReason.ABSURD_DATA}


@pytest.mark.parametrize(
    "odometry",
    [
        Odometry(NOW, NOW, Pose2(nan, 0, 0), Twist()),
        Odometry(NOW, NOW, Pose2(), Twist(inf, 0)),
        Odometry(NOW, NOW, Pose2(), Twist(4.0, 0)),
        Odometry(NOW, NOW, Pose2(), Twist(0, -12.0)),
    ],
)
def test_implausible_odometry_stops(odometry: Odometry) -> None:
    b = bench()
    b.situation = replace(b.situation, odometry=odometry)
    assert kinds(b.check(Twist(0.4, 0.0))) == {StopReason.ABSURD_DATA}


@pytest.mark.parametrize(
    "ranges",
    [np.where(np.arange(181) < 60, nan, 3.0), np.full(181, -0.1), np.full(181, nan)],
)
def test_an_implausible_scan_stops(ranges: Array) -> None:
    assert kinds(bench().sees(ranges).check(Twist(0.4, 0.0))) == {StopReason.ABSURD_DATA}


def test_some_dazzled_beams_do_not_stop() -> None:
    assert not bench().sees(np.where(np.arange(181) < 40, nan, inf)).check(Twist(0.4, 0.0)).stops


def test_what_is_not_known_stops() -> None:
    b = bench()
    for situation, reason in (
        (replace(b.situation, base=None), StopReason.ODOMETRY_STALE),
        (replace(b.situation, odometry=None), StopReason.ODOMETRY_STALE),
        (replace(b.situation, view=None), StopReason.SCAN_STALE),
    ):
        b.situation = situation
        assert kinds(b.check(Twist(0.4, 0.0))) == {reason}


# --- caps


@pytest.mark.parametrize(
    ("changes", "wish", "limit"),
    [
        ({}, Twist(5.0, 0.0), Twist(0.7, 0.0)),
        ({"max_speed_mps": 0.5}, Twist(5.0, 0.0), Twist(0.5, 0.0)),
        ({"max_speed_mps": 2.0, "watchdog_s": 4.0}, Twist(5.0, 0.0), Twist(0.35, 0.0)),
        ({"max_turn_degps": 30.0}, Twist(0.0, 5.0), Twist(0.0, radians(30))),
        ({"max_turn_degps": 30.0}, Twist(0.0, -5.0), Twist(0.0, -radians(30))),
    ],
)
def test_speeds_are_capped_with_a_reason(
    changes: dict[str, float], wish: Twist, limit: Twist
) -> None:
    command = bench(**changes).check(wish)
    assert twist(command) == limit
    assert kinds(command) == {StopReason.LIMIT}
    assert not any(reason.full_stop for reason in command.reasons)


def test_the_permission_caps_with_its_own_reason() -> None:
    b = bench()
    doubt = Reason(StopReason.TARGET_UNSURE, full_stop=False)
    b.situation = replace(b.situation, permission=Permission(True, 0.25, 0.0, (doubt,)))
    command = b.check(Twist(0.6, 0.0))
    assert twist(command).v == 0.25
    assert kinds(command) == {StopReason.TARGET_UNSURE}


def test_a_permission_to_turn_only_stops_the_wheels_going_forward() -> None:
    b = bench()
    b.situation = replace(b.situation, permission=Permission(True, 0.0))
    command = b.check(Twist(0.6, 0.3))
    assert twist(command) == Twist(0.0, 0.3)
    assert any(reason.full_stop for reason in command.reasons)


def test_a_permission_that_is_no_number_is_none() -> None:
    b = bench()
    b.situation = replace(b.situation, permission=Permission(True, nan))
    assert b.check(Twist(0.6, 0.0)).stops


def test_speed_grows_no_faster_than_the_acceleration() -> None:
    b = bench(accel_mps2=0.5)
    before = 0.0
    for k in range(20):
        now = NOW + 0.01 * k
        for name in STREAMS:
            b.freshness.saw(name, now, now)
        v = twist(b.guard.check(Twist(0.6, 0.0), b.situation, now)).v
        assert v <= before + 0.5 * (0.25 if k == 0 else 0.01) + 1e-9
        before = v
    assert before > 0.1


def test_turning_the_other_way_starts_from_standstill() -> None:
    b = bench()
    b.check(Twist(0.0, 0.8))
    command = b.guard.check(Twist(0.0, -0.8), b.situation, NOW)
    assert -0.8 < twist(command).omega < 0.0


def test_slowing_down_is_not_delayed() -> None:
    b = bench()
    b.check(Twist(0.6, 0.0))
    assert twist(b.guard.check(Twist(0.1, 0.0), b.situation, NOW)).v == 0.1


def test_after_a_stop_the_speed_grows_from_zero() -> None:
    b = bench()
    b.check(Twist(0.6, 0.0))
    b.guard.check(None, b.situation, NOW)
    assert twist(b.guard.check(Twist(0.6, 0.0), b.situation, NOW)).v < 0.01


@pytest.mark.parametrize("name", list(STREAMS))
def test_ageing_data_slow_the_robot_before_they_stop_it(name: str) -> None:
    b = bench()
    b.freshness.newest[name] = NOW - 0.9 * STREAMS[name].stale_after
    command = b.check(Twist(0.6, 0.0))
    assert twist(command).v == 0.3
    assert [(r.stop, r.full_stop) for r in command.reasons] == [(STREAMS[name].reason, False)]


# --- the command's life


def test_a_command_lives_less_than_a_quarter_second() -> None:
    """The rest of F1's 0.25 s is for the bytes of a stop at 9600 baud."""
    assert bench().check(Twist(0.4, 0.0)).expires == pytest.approx(NOW + VALID)


@pytest.mark.parametrize("name", list(STREAMS))
def test_a_command_dies_with_the_data_it_stands_on(name: str) -> None:
    b = bench()
    b.freshness.newest[name] = NOW - 0.2
    command = b.check(Twist(0.2, 0.0))
    assert command.expires == pytest.approx(min(NOW + VALID, NOW - 0.2 + STREAMS[name].stale_after))


# --- the target


@pytest.mark.parametrize("distance", [0.2, 0.9, 1.0])
def test_no_forward_speed_below_the_least_distance(distance: float) -> None:
    b = bench()
    b.situation = replace(b.situation, target=(distance, 0.0))
    command = b.check(Twist(0.5, 0.2))
    assert twist(command) == Twist(0.0, 0.2)
    assert kinds(command) == {StopReason.PERSON_TOO_CLOSE}


def test_the_approach_to_the_target_slows_down() -> None:
    b = bench()
    b.situation = replace(b.situation, target=(1.1, 0.0))
    assert twist(b.check(Twist(0.5, 0.0))).v == pytest.approx(0.2)


@pytest.mark.parametrize("target", [None, (nan, 0.0)])
def test_an_unknown_distance_allows_turning_only(target: tuple[float, float] | None) -> None:
    b = bench()
    b.situation = replace(b.situation, target=target)
    command = b.check(Twist(0.5, 0.2))
    assert twist(command) == Twist(0.0, 0.2)


def test_a_hand_drives_without_a_person_but_not_into_things() -> None:
    b = bench()
    hand = replace(GO, max_speed=0.4, drive=Twist(0.4, 0.0))
    b.situation = replace(b.situation, target=None, permission=hand)
    assert twist(b.check(Twist(0.4, 0.0))) == Twist(0.4, 0.0)
    ranges = seen()
    ranges[80:101] = 0.9
    assert twist(b.sees(ranges).check(Twist(0.4, 0.0))).v < 0.1


def test_an_unknown_distance_is_named() -> None:
    b = bench()
    b.situation = replace(b.situation, target=None)
    assert kinds(b.check(Twist(0.5, 0.0))) == {StopReason.RANGE_UNKNOWN}


# --- obstacles


def test_a_wall_inside_the_margin_stops() -> None:
    command = bench().sees(seen((0, 40, 0.85))).check(Twist(0.5, 0.0))
    assert command.stops
    assert kinds(command) == {StopReason.OBSTACLE}
    assert command.reasons[0].full_stop


def test_the_speed_fits_the_way_to_the_margin() -> None:
    s = GuardSettings()
    v = twist(bench().sees(seen((0, 3, 1.3))).check(Twist(0.7, 0.0))).v
    assert 0.1 < v < 0.6
    way = 1.3 - s.front_m - s.margin_m
    assert v * s.reaction_s + v * v / (2 * s.deceleration_mps2) == pytest.approx(way, abs=0.01)


def test_the_targets_own_returns_are_owed_less_but_never_nothing() -> None:
    b = bench().sees(seen((0, 3, 1.0)))
    assert twist(b.check(Twist(0.5, 0.0))).v < 0.2
    b.situation = replace(b.situation, claimed=(slice(85, 97),))
    assert 0.2 < twist(b.check(Twist(0.5, 0.0))).v < 0.5
    near = bench().sees(seen((0, 3, 0.6)))
    near.situation = replace(near.situation, claimed=(slice(85, 97),))
    assert near.check(Twist(0.5, 0.0)).stops


@given(st.floats(0.3, 4.0), st.floats(0.0, 1.0), st.floats(-12, 12), st.floats(0.05, 1.5))
def test_more_clearance_never_means_less_speed(
    near: float, more: float, bearing: float, speed: float
) -> None:
    wish = Twist(speed, 0.0)
    slow = twist(bench().sees(seen((bearing, 4, near))).check(wish)).v
    # straight back along the way, not along the beam: the sideways distance stays
    x, y = near * cos(radians(bearing)) + more, near * sin(radians(bearing))
    farther = seen((np.degrees(np.arctan2(y, x)), 4 * near / hypot(x, y), hypot(x, y)))
    fast = twist(bench().sees(farther).check(wish)).v
    assert fast >= slow - 0.06  # one beam more or less on the edge


def test_old_returns_are_moved_with_the_robot() -> None:
    b = bench().sees(seen((0, 3, 1.5)))
    before = twist(b.check(Twist(0.7, 0.0))).v
    b.situation = replace(b.situation, base=Pose2(0.3, 0.0, 0.0))
    assert twist(b.check(Twist(0.7, 0.0))).v < before - 0.1


def test_a_turned_robot_looks_where_it_will_go() -> None:
    b = bench().sees(seen((0, 20, 0.9)))
    assert b.check(Twist(0.5, 0.0)).stops
    b.situation = replace(b.situation, base=Pose2(0.0, 0.0, radians(60)))
    assert twist(b.check(Twist(0.5, 0.0))).v == 0.5


@pytest.mark.parametrize("aside", [0.45, 0.40])
def test_door_posts_beside_the_way_do_not_stop(aside: float) -> None:
    for ahead in np.arange(-0.2, 1.5, 0.1):
        ranges = np.minimum(post(ahead, aside), post(ahead, -aside))
        assert twist(bench().sees(ranges).check(Twist(0.5, 0.0))).v >= 0.4


@pytest.mark.parametrize("width", [0.9, 1.2, 2.0])
def test_a_corridor_is_driven_along(width: float) -> None:
    command = bench().sees(walls(width / 2, width / 2)).check(Twist(0.5, 0.03))
    assert twist(command).v >= 0.3


def test_something_close_beside_the_way_slows_and_says_so() -> None:
    command = bench().sees(post(0.4, 0.35)).check(Twist(0.7, 0.0))
    assert 0.4 <= twist(command).v < 0.6
    assert "beside" in command.reasons[0].detail


def test_what_the_arc_hits_counts_and_not_what_lies_straight_ahead() -> None:
    ahead, aside = post(1.0, 0.0), post(0.75, 0.45)
    left = Twist(0.4, 0.5)
    assert twist(bench().sees(aside).check(left)).v < twist(bench().sees(ahead).check(left)).v


def test_an_arc_that_is_blocked_becomes_a_turn_on_the_spot() -> None:
    command = bench().sees(seen((0, 60, 0.7))).check(Twist(0.5, 0.4))
    assert twist(command) == Twist(0.0, 0.4)
    assert any(reason.stop is StopReason.OBSTACLE for reason in command.reasons)


def test_a_robot_that_starts_anew_does_not_creep_on_by_ever_tighter_arcs() -> None:
    """At 1 cm/s the least turn is an arc that ends nowhere; at walking pace it hits the box."""
    b = bench().sees(seen((0, 20, 0.75)))
    for k in range(60):
        now = NOW + 0.02 * k
        for name in STREAMS:
            b.freshness.saw(name, now, now)
        assert twist(b.guard.check(Twist(0.3, -0.07), b.situation, now)).v == 0.0


def test_arcs_that_get_worse_and_worse_end_in_a_turn_on_the_spot() -> None:
    b = bench()
    wish = Twist(0.6418, 0.5787)
    points = np.array([[0.951, 1.190], [0.780, 0.756], [1.514, -0.248], [1.494, 0.371]])
    assert b.situation.view is not None
    b.situation = replace(b.situation, view=replace(b.situation.view, points=points))
    b.guard._approved = wish
    command = b.guard.check(wish, b.situation, NOW)
    assert twist(command) == Twist(0.0, 0.5787)
    assert kinds(command) == {StopReason.OBSTACLE}


def test_a_robot_that_starts_beside_a_corner_turns_only_as_it_gains_speed() -> None:
    """The arc that is meant passes the corner; the tighter one of the first moment does not."""
    b = bench().sees(post(0.6, 0.6))
    command = b.guard.check(Twist(0.7, 0.15), b.situation, NOW)
    started = twist(command)
    assert started.v > 0.0
    assert started.omega / started.v == pytest.approx(0.15 / 0.7)
    assert twist(b.check(Twist(0.7, 0.15))) == Twist(0.7, 0.15)


def test_a_turn_on_the_spot_stops_before_a_corner_touches() -> None:
    beside = bench().sees(post(0.0, 0.28)).check(Twist(0.0, 0.9))
    assert abs(twist(beside).omega) < 0.9
    assert kinds(beside) == {StopReason.OBSTACLE}
    assert bench().sees(post(0.0, 0.45)).check(Twist(0.0, 0.9)).reasons == ()


def test_something_under_the_robot_stops_everything() -> None:
    assert bench().sees(seen((0, 5, 0.1))).check(Twist(0.3, 0.3)).stops


def test_a_sonar_echo_ahead_slows_what_the_laser_calls_free() -> None:
    b = bench()
    glass = Sonar(3, Pose2(0.17, 0.0, 0.0), 0.5)
    b.guard.sense(replace(b.situation.odometry or _none(), sonar=(glass,)))
    assert twist(b.check(Twist(0.5, 0.0))).v < 0.3


def test_a_clear_sonar_never_allows_what_the_laser_forbids() -> None:
    b = bench().sees(seen((0, 10, 0.8)))
    clear = Sonar(3, Pose2(0.17, 0.0, 0.0), 5.0)
    b.guard.sense(replace(b.situation.odometry or _none(), sonar=(clear,)))
    assert b.check(Twist(0.5, 0.0)).stops


def _none() -> Odometry:
    raise AssertionError("the bench has odometry")


# --- other people


def test_another_person_near_the_way_means_a_crawl() -> None:
    b = bench().sees(seen((35, 3, 1.1)))
    command = b.check(Twist(0.7, 0.0))
    assert twist(command).v == 0.3
    assert kinds(command) == {StopReason.PERSON_TOO_CLOSE}


def test_the_target_is_not_another_person() -> None:
    b = bench().sees(seen((35, 3, 1.1)))
    b.situation = replace(b.situation, claimed=(slice(120, 131),))
    assert twist(b.check(Twist(0.7, 0.0))).v > 0.3


def test_what_the_map_explains_is_nobody() -> None:
    b = bench().sees(seen((35, 3, 1.1)))
    view = b.situation.view
    assert view is not None
    b.situation = replace(b.situation, view=replace(view, mapped=view.clusters.leg_like))
    assert twist(b.check(Twist(0.7, 0.0))).v > 0.3
    b.situation = replace(b.situation, view=replace(view, mapped=~view.clusters.leg_like))
    assert twist(b.check(Twist(0.7, 0.0))).v == 0.3


def test_people_far_away_do_not_slow() -> None:
    assert twist(bench().sees(seen((35, 3, 2.5))).check(Twist(0.7, 0.0))).v == 0.7


def test_somebody_near_but_well_beside_the_way_does_not_slow() -> None:
    assert twist(bench().sees(seen((80, 3, 1.1))).check(Twist(0.7, 0.0))).v == 0.7


# --- backward


def reversing(*ranges: float, age: float = 0.1) -> Command:
    b = bench()
    sonar = tuple(replace(r, range=at) for r, at in zip(REAR, ranges, strict=False))
    stamp = NOW - age
    b.guard.sense(Odometry(stamp, stamp, Pose2(), Twist(), sonar=sonar))
    return b.check(Twist(-0.4, 0.0))


def test_backward_only_slowly() -> None:
    command = reversing(*[3.0] * 8)
    assert twist(command).v == -0.15
    assert kinds(command) == {StopReason.LIMIT}


@pytest.mark.parametrize(
    ("ranges", "age", "reason"),
    [
        ([], 0.1, StopReason.REAR_UNSEEN),
        ([3.0] * 2, 0.1, StopReason.REAR_UNSEEN),
        ([3.0] * 8, 0.6, StopReason.REAR_UNSEEN),
        ([3.0] * 7 + [0.3], 0.1, StopReason.OBSTACLE),
    ],
)
def test_not_backward_where_the_sonar_has_not_just_looked(
    ranges: list[float], age: float, reason: StopReason
) -> None:
    command = reversing(*ranges, age=age)
    assert command.stops
    assert kinds(command) == {reason}


# --- a laser that looks back, a camera that looks back

BACKWARD = Pose2(0.0, 0.0, pi)
FRONT = tuple(Sonar(k, Pose2(0.2, 0.0, radians(15 * k - 52)), 3.0) for k in range(8))


def turned_round(ranges: Array, target: tuple[float, float] = (-3.0, 0.0)) -> Bench:
    """The bench with its laser mounted backward."""
    b = bench().sees(ranges)
    assert b.situation.view is not None
    scan = replace(b.situation.view.scan, base_from_laser=BACKWARD)
    points = scan.points()
    view = View(scan, points, find_clusters(scan, points, ClusterSettings()), Pose2())
    b.situation = replace(b.situation, view=view, target=target)
    return b


def mirrored(command: Command) -> Twist:
    return Twist(-twist(command).v, twist(command).omega)


@pytest.mark.parametrize("v", [0.2, 0.5, 2.0])
@pytest.mark.parametrize("ranges", [seen(), seen((0, 20, 0.9)), seen((0, 20, 1.4)), post(1.2, 0.1)])
def test_where_the_laser_looks_back_the_rules_of_going_ahead_hold_behind(
    ranges: Array, v: float
) -> None:
    even = {"front_m": 0.25, "rear_m": 0.25}
    ahead = bench(**even).sees(ranges)
    back = turned_round(ranges)
    back.guard.settings = ahead.guard.settings
    back.guard._way = ahead.guard._way
    one, other = ahead.check(Twist(v, 0.0)), back.check(Twist(-v, 0.0))
    assert mirrored(other) == twist(one)
    assert kinds(other) == kinds(one)


def test_where_the_laser_looks_back_ahead_is_for_the_sonar() -> None:
    b = turned_round(seen())
    command = b.check(Twist(0.4, 0.0))
    assert command.stops
    assert kinds(command) == {StopReason.REAR_UNSEEN}
    b.guard.sense(Odometry(NOW - 0.1, NOW - 0.1, Pose2(), Twist(), sonar=FRONT))
    assert twist(b.check(Twist(0.4, 0.0))).v == 0.15


def test_where_the_laser_looks_back_nobody_is_approached_there_either() -> None:
    assert turned_round(seen(), target=(-0.9, 0.1)).check(Twist(-0.4, 0.0)).stops
    slowed = turned_round(seen((35, 3, 1.1))).check(Twist(-0.7, 0.0))
    assert twist(slowed).v == -0.3


def test_a_robot_that_leads_may_leave_a_near_person_behind() -> None:
    b = bench()
    b.situation = replace(b.situation, target=(-0.8, 0.1))
    assert b.check(Twist(0.6, 0.0)).motion == Twist(0.6, 0.0)
    b.situation = replace(b.situation, target=(-0.2, 0.8))  # beside is not behind
    assert b.check(Twist(0.6, 0.0)).stops


# --- the body

AMIGO = Chassis(0.16, 0.17, 0.14, 0.182, 0.5, radians(100.0), 2.0)
POWERBOT = Chassis(0.369, 0.542, 0.34, 0.536, 0.3, radians(60.0), 4.0)


def test_a_larger_base_is_given_more_room_and_more_time() -> None:
    b = bench().sees(seen((0, 40, 1.3)))
    before = twist(b.check(Twist(0.7, 0.0))).v
    b.guard.fit(POWERBOT)
    after = twist(b.check(Twist(0.7, 0.0))).v
    assert after < before - 0.1
    s = b.guard.settings
    assert (s.front_m, s.rear_m, s.half_width_m, s.track_m) == (0.369, 0.542, 0.34, 0.536)
    assert (s.watchdog_s, s.deceleration_mps2) == (4.0, 0.3)
    assert s.turn_deceleration_degps2 == pytest.approx(60.0)
    beside = bench().sees(post(0.0, 0.45))
    beside.guard.fit(POWERBOT)
    assert abs(twist(beside.check(Twist(0.0, 0.9))).omega) < 0.9


def test_the_config_can_make_the_robot_larger_and_never_smaller() -> None:
    b = bench(front_m=0.5, half_width_m=0.1)
    b.guard.fit(POWERBOT)
    assert (b.guard.settings.front_m, b.guard.settings.half_width_m) == (0.5, 0.34)
    b.guard.fit(AMIGO)  # another base: what counts is the config and the base, not the one before
    assert (b.guard.settings.front_m, b.guard.settings.half_width_m) == (0.5, 0.14)


def test_a_track_that_the_config_names_holds() -> None:
    for changes, track in (({}, 0.536), ({"track_m": 0.4}, 0.4)):
        b = bench(**changes)
        b.guard.fit(POWERBOT)
        assert b.guard._twist(WheelSpeeds(0.0, 0.2), 0.0).omega == pytest.approx(0.2 / track)


@pytest.mark.parametrize("value", [nan, inf, 0.0, -0.3])
def test_a_base_of_absurd_dimensions_changes_nothing(value: float) -> None:
    for name in ("front", "track", "deceleration", "watchdog"):
        b = bench()
        b.guard.fit(replace(POWERBOT, **{name: value}))
        assert b.guard.settings == GuardSettings()


# --- other wishes


def test_wheel_speeds_pass_unchanged_where_they_are_free() -> None:
    wish = WheelSpeeds(0.3, 0.4)
    assert bench().check(wish).motion == wish


def test_too_fast_wheel_speeds_come_out_as_a_twist() -> None:
    motion = bench().check(WheelSpeeds(2.0, 2.0)).motion
    assert motion == Twist(0.7, 0.0)


def test_a_turn_by_an_angle_keeps_its_angle_and_loses_speed() -> None:
    b = bench().sees(seen((0, 60, 0.7)))
    assert b.check(TurnBy(0.1, 0.5)).motion == TurnBy(0.1, 0.0)


def test_a_turn_by_an_angle_ends_before_the_body_touches_something() -> None:
    """It speeds up by itself, and goes on however late the next command comes."""
    b = bench().sees(post(0.05, 0.30))
    command = b.guard.check(TurnBy(radians(170.0)), b.situation, NOW)
    assert isinstance(command.motion, TurnBy)
    assert 0.0 < degrees(command.motion.angle) < 120.0
    assert StopReason.OBSTACLE in [reason.stop for reason in command.reasons]
    near = bench().sees(post(0.05, 0.30))
    free = near.guard.check(TurnBy(radians(2.0)), near.situation, NOW)
    assert free.motion == TurnBy(radians(2.0))


def test_a_turn_counts_from_the_report_and_is_judged_by_what_is_left_of_it() -> None:
    """The base has turned 10 degrees since: 5 more are wished, to the left."""
    b = bench()
    reported = Odometry(NOW - 0.05, NOW - 0.04, Pose2(theta=radians(-10.0)), Twist())
    b.situation = replace(b.situation, odometry=reported)
    left = b.guard._twist(TurnBy(radians(15.0)), radians(10.0))
    assert degrees(left.omega) == pytest.approx(5.0 / b.settings.valid_s)
    assert b.check(TurnBy(radians(15.0))).motion == TurnBy(radians(15.0))
    assert _since_report(Pose2(), reported) == pytest.approx(radians(10.0))


def test_a_turn_by_an_angle_that_would_touch_goes_on_only_as_slowly_as_it_can_stop() -> None:
    motion = bench().sees(post(0.0, 0.218)).check(TurnBy(0.5)).motion
    assert isinstance(motion, Twist)
    assert 0.0 < motion.omega < 0.5


# --- properties

SCAN_LIMIT, BASE_LIMIT = STREAMS["scan"].stale_after, STREAMS["odometry"].stale_after


numbers = st.floats(allow_nan=True, allow_infinity=True, width=32)
twists = st.builds(Twist, numbers, numbers)
wishes = twists | st.builds(WheelSpeeds, numbers, numbers) | st.builds(TurnBy, numbers, numbers)
scans = st.lists(
    st.tuples(st.floats(-90, 90), st.floats(0, 40), st.floats(0.05, 6)), max_size=4
).map(lambda things: seen(*things))
ages = st.floats(-0.2, 0.6)
targets = st.none() | st.tuples(st.floats(-4, 4), st.floats(-4, 4))


@given(wishes, scans, ages, ages, ages, targets, st.floats(0, 2) | st.just(nan))
@example(Twist(1.0, 0.0), seen(), 0.0, 0.0, 0.0, (-0.5, 0.0), 1.0)
def test_whatever_comes_in_what_goes_out_is_within_all_bounds(
    wish: Wish, ranges: Array, scan: float, image: float, base: float,
    target: tuple[float, float] | None, cap: float,
) -> None:  # fmt: skip
    b = bench().sees(ranges)
    b.situation = replace(b.situation, target=target, permission=Permission(True, cap))
    b.freshness.newest.update(scan=NOW - scan, image=NOW - image, odometry=NOW - base)
    command = b.guard.check(wish, b.situation, NOW)
    stale = scan > SCAN_LIMIT or image > 0.3 or base > BASE_LIMIT
    if command.motion is None:
        assert command.reasons or command.expires == NOW
        return
    assert not stale
    assert min(scan, image, base) >= -0.05
    got = b.guard._twist(command.motion, 0.0)
    assert isfinite(got.v)
    assert isfinite(got.omega)
    assert -0.15 <= got.v <= 0.7 + 1e-9
    assert got.v == 0.0 or abs(got.v) <= cap
    assert abs(got.omega) <= radians(57.0) + 1e-9
    assert NOW <= command.expires <= NOW + VALID
    assert command.expires <= NOW - max(scan - SCAN_LIMIT, image - 0.3, base - BASE_LIMIT) + 1e-9
    if got.v > 0:
        assert target is not None
        leads = target[0] < -BEHIND * hypot(*target)
        assert leads or hypot(*target) >= 1.0
    if command.motion != wish:
        assert command.reasons


@given(scans, st.floats(0.05, 0.7), st.floats(-0.9, 0.9))
def test_what_is_allowed_stops_before_anything_in_its_way(
    ranges: Array, v: float, omega: float
) -> None:
    b = bench().sees(ranges)
    got = twist(b.check(Twist(v, omega)))
    if got.v == 0.0 or b.situation.view is None:
        return
    s = b.settings
    way = got.v * s.reaction_s + got.v**2 / (2 * s.deceleration_mps2)
    points = b.situation.view.points[np.isfinite(b.situation.view.points[:, 0])]
    for travelled in np.linspace(0.0, way, 8):
        moved = (~Pose2().moved(got.v, got.omega, travelled / got.v)).apply(points)
        inside = (moved[:, 0] < s.front_m) & (moved[:, 0] > -s.rear_m)
        assert not (inside & (np.abs(moved[:, 1]) < s.half_width_m - 1e-6)).any()


huge = numbers | st.sampled_from([1e300, -1e300, 1e9, -1e9])
poses = st.builds(Pose2, huge, huge, huge)


def overlaid(runs: list[tuple[slice, float]]) -> Array:
    """Ranges of 181 beams, some runs of them anything."""
    ranges = seen()
    for beams, value in runs:
        ranges[beams] = value
    return ranges


beams = st.lists(st.tuples(st.slices(181), numbers), min_size=1, max_size=3).map(overlaid)
sonars = st.lists(st.builds(Sonar, st.integers(0, 31), poses, huge), max_size=4).map(tuple)


@given(
    wishes, poses, st.builds(Odometry, huge, huge, poses, twists, sonar=sonars), beams, poses,
    st.none() | st.tuples(huge, huge), huge, st.fixed_dictionaries(dict.fromkeys(STREAMS, huge)),
    st.sampled_from(["wish", "base", "odometry", "beams", "view", "target", "cap", "stamps"]),
)  # fmt: skip
def test_no_absurd_input_yields_a_motion(
    wish: Wish, base: Pose2, odometry: Odometry, ranges: Array, taken: Pose2,
    target: tuple[float, float] | None, cap: float, stamps: dict[str, float], what: str,
) -> None:  # fmt: skip
    """Each input in turn is anything at all; the others are as they should be."""
    b = bench()
    given_wish: Wish = Twist(0.3, 0.1)
    s = b.situation
    match what:
        case "wish":
            given_wish = wish
        case "base":
            b.situation = replace(s, base=base)
        case "odometry":
            b.guard.sense(odometry)
            b.situation = replace(s, odometry=odometry)
        case "beams":
            b.sees(ranges)
        case "view":
            assert s.view is not None
            b.situation = replace(s, view=replace(s.view, base=taken))
        case "target":
            b.situation = replace(s, target=target)
        case "cap":
            b.situation = replace(s, permission=Permission(True, cap))
        case _:
            b.freshness.newest.update(stamps)
    command = b.guard.check(given_wish, b.situation, NOW)
    if is_absurd(what, b.situation, given_wish, b):
        assert command.stops
    got = Twist() if command.motion is None else b.guard._twist(command.motion, 0.0)
    assert abs(got.v) <= 0.7
    assert abs(got.omega) <= radians(57.0) + 1e-9


def is_absurd(what: str, s: Situation, wish: Wish, b: Bench) -> bool:
    """Whether an input is not a number, not finite, or beyond what can be."""
    assert s.base is not None
    assert s.odometry is not None
    assert s.view is not None
    match what:
        case "wish":
            return not is_finite_wish(wish)
        case "base":
            return not is_plausible_pose(s.base)
        case "odometry":
            return not is_plausible_odometry(s.odometry)
        case "beams":
            return bool(np.isnan(s.view.scan.ranges).all() or (s.view.scan.ranges < 0).any())
        case "view":
            return not is_plausible_pose(s.view.base)
        case "stamps":
            return not all(NOW - 1.0 < stamp < NOW + 0.1 for stamp in b.freshness.newest.values())
        case _:
            return False


@pytest.mark.parametrize(
    "place", [Pose2(nan, 0.0, 0.0), Pose2(0.0, 1e7, 0.0), Pose2(0.0, 0.0, inf)]
)
def test_a_place_that_cannot_be_stops(place: Pose2) -> None:
    b = bench()
    assert b.situation.view is not None
    nowhere = replace(b.situation.view, base=place)
    for situation in (replace(b.situation, base=place), replace(b.situation, view=nowhere)):
        b.situation = situation
        assert kinds(b.check(Twist(0.4, 0.0))) == {StopReason.ABSURD_DATA}


def test_a_sonar_reading_that_is_no_number_tells_nothing() -> None:
    b = bench()
    odd = (replace(REAR[0], range=nan), replace(REAR[1], pose=Pose2(nan, 0.0, 0.0)))
    b.guard.sense(Odometry(NOW - 0.1, NOW - 0.1, Pose2(), Twist(), sonar=(*odd, *REAR[2:5])))
    assert kinds(b.check(Twist(-0.1, 0.0))) == {StopReason.REAR_UNSEEN}
    b.guard.sense(Odometry(NOW - 0.1, NOW - 0.1, Pose2(nan), Twist(), sonar=REAR))
    assert kinds(b.check(Twist(-0.1, 0.0))) == {StopReason.REAR_UNSEEN}
