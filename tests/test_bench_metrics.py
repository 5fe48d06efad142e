"""The follow figures of hand-made runs."""

from collections.abc import Callable
from math import asin, atan2, hypot, inf, radians

import pytest

from followerd.bench.metrics import follow_figures
from followerd.geometry import Camera, Pose2
from followerd.messages import Command, Decision, Mode, TrackPhase, TrackState, Twist
from followerd.sim.truth import Actor, Truth

PERIOD = 0.05  # s
ORIGIN = Pose2()
CAMERA = Camera.from_hfov(192, 144, radians(48))


def truth_of(
    stamp: float,
    robot: Pose2 = ORIGIN,
    target: tuple[float, float] = (2.0, 0.0),
    others: tuple[tuple[float, float], ...] = (),
    in_sight: bool = True,
    collisions: int = 0,
) -> Truth:
    def actor(x: float, y: float) -> Actor:
        ahead, aside = (~robot).apply_point(x, y)
        distance, bearing = hypot(ahead, aside), atan2(aside, ahead)
        return Actor("", x, y, 0.0, (0.0, 0.0), distance, bearing, in_sight)

    return Truth(
        stamp,
        robot,
        Twist(),
        actor(*target),
        tuple(actor(*other) for other in others),
        collisions,
        bumped=0,
        min_person_distance=1.2,
        min_any_distance=inf,
    )


def track(
    stamp: float,
    bearing: float = 0.0,
    range_: float | None = 2.0,
    phase: TrackPhase = TrackPhase.CONFIRMED,
) -> TrackState:
    return TrackState(stamp, phase, 0.9, bearing=bearing, range=range_)


def decision(
    stamp: float, state: TrackState | None, mode: Mode = Mode.FOLLOWING, speed: float = 0.4
) -> Decision:
    return Decision(0, stamp, mode, state, None, Command(stamp, Twist(speed)))


def times(count: int) -> list[float]:
    return [PERIOD * i for i in range(count)]


def run(
    count: int,
    truth: Callable[[float], Truth],
    decided: Callable[[float], Decision],
) -> dict[str, object]:
    truths, decisions = [truth(t) for t in times(count)], [decided(t) for t in times(count)]
    return dict(follow_figures(truths, decisions, CAMERA))


def test_a_perfect_follower_has_perfect_figures() -> None:
    figures = run(20, truth_of, lambda t: decision(t, track(t)))
    assert figures == {
        "tracking_rate": 1.0,
        "target_visibility_ratio": 1.0,
        "range_rmse_m": pytest.approx(0.0, abs=1e-12),
        "bearing_rmse_deg": pytest.approx(0.0, abs=1e-12),
        "position_rmse_m": pytest.approx(0.0, abs=1e-12),
        "follow_distance_mean_m": pytest.approx(2.0),
        "follow_distance_std_m": pytest.approx(0.0),
        "lost_count": 0,
        "time_to_reacquire_s": {"p50": None, "p95": None},
        "identity_switch_count": 0,
        "wrong_follow_m": 0,
        "collision_count": 0,
        "bumped_count": 0,
        "min_person_distance_m": 1.2,
        "min_any_distance_m": None,
        "time_in_private_zone_s": 0,
    }


def test_what_an_empty_run_could_not_know_is_none() -> None:
    figures = follow_figures([], [], CAMERA)
    assert figures.pop("time_to_reacquire_s") == {"p50": None, "p95": None}
    assert set(figures.values()) == {None}


def test_without_a_track_nothing_is_said_of_tracking_but_the_world_is_known() -> None:
    figures = run(10, truth_of, lambda t: decision(t, None, Mode.READY))
    unknown = ("tracking_rate", "lost_count", "wrong_follow_m", "identity_switch_count")
    assert [figures[name] for name in unknown] == [None] * 4
    assert figures["follow_distance_mean_m"] is None
    assert (figures["collision_count"], figures["min_person_distance_m"]) == (0, 1.2)


def test_errors_are_those_of_bearing_and_range_in_the_robot_frame() -> None:
    robot = Pose2(1.0, 1.0, radians(90))  # the person at (1, 3) is 2 m straight ahead

    def truth(t: float) -> Truth:
        return truth_of(t, robot, (1.0, 3.0))

    figures = run(10, truth, lambda t: decision(t, track(t, radians(3), 2.1)))
    assert figures["range_rmse_m"] == pytest.approx(0.1)
    assert figures["bearing_rmse_deg"] == pytest.approx(3.0)
    assert figures["tracking_rate"] == 1.0


def test_a_track_is_compared_with_the_truth_at_its_own_stamp() -> None:
    turn_rate = radians(60)

    def truth(t: float) -> Truth:
        return truth_of(t, Pose2(0, 0, turn_rate * t))

    def late(t: float) -> Decision:
        seen = t - 0.075  # between two samples of the truth
        return decision(t, track(seen, -turn_rate * seen)) if seen > 0 else decision(t, None)

    assert run(30, truth, late)["bearing_rmse_deg"] == pytest.approx(0.0, abs=1e-6)


def test_position_errors_above_half_a_metre_are_not_tracking() -> None:
    figures = run(20, truth_of, lambda t: decision(t, track(t, range_=2.4 if t < 0.5 else 2.6)))
    assert figures["tracking_rate"] == pytest.approx(0.5)


def test_a_track_without_range_or_grown_old_does_not_count_as_tracked() -> None:
    known = run(10, truth_of, lambda t: decision(t, track(t, range_=None)))
    assert known["tracking_rate"] == 0.0
    assert known["range_rmse_m"] is None
    frozen = run(41, truth_of, lambda t: decision(t, track(0.0)))  # 2 s
    assert frozen["tracking_rate"] == pytest.approx(11 / 41)  # 0.5 s and the first instant


def test_a_loss_is_timed_until_the_right_position_is_back() -> None:
    def decided(t: float) -> Decision:
        if t < 0.99 or t > 2.49:
            return decision(t, track(t))
        if t < 1.99:
            return decision(t, track(t, phase=TrackPhase.LOST))
        return decision(t, track(t, range_=5.0))  # found, but not where they are

    figures = run(80, truth_of, decided)
    assert figures["lost_count"] == 1
    assert figures["time_to_reacquire_s"] == {
        "p50": pytest.approx(1.5),
        "p95": pytest.approx(1.5),
    }


def test_occlusion_is_no_loss() -> None:
    figures = run(20, truth_of, lambda t: decision(t, track(t, phase=TrackPhase.OCCLUDED)))
    assert figures["lost_count"] == 0


def test_following_another_person_is_a_switch_and_metres_of_wrong_way() -> None:
    other = (2.0, 1.5)

    def truth(t: float) -> Truth:
        return truth_of(t, Pose2(0.4 * t, 0.0, 0.0), (2.0 + 0.4 * t, 0.0), ((2.0 + 0.4 * t, 1.5),))

    def decided(t: float) -> Decision:
        bearing, range_ = atan2(1.5, 2.0), hypot(*other)
        return decision(t, track(t, bearing, range_) if t >= 0.999 else track(t))

    figures = run(41, truth, decided)  # 2 s, the second half on the other
    assert figures["identity_switch_count"] == 1
    assert figures["wrong_follow_m"] == pytest.approx(0.4)


def test_two_people_close_together_are_no_switch() -> None:
    figures = run(
        20,
        lambda t: truth_of(t, others=((2.0, 0.4),)),
        lambda t: decision(t, track(t, bearing=0.15)),  # 0.3 m off, nearer to the other
    )
    assert figures["identity_switch_count"] == 0
    assert figures["wrong_follow_m"] == 0


def test_a_bearing_alone_can_prove_a_wrong_way_but_only_while_following() -> None:
    def truth(t: float) -> Truth:
        return truth_of(t, Pose2(0.5 * t, 0.0, 0.0), (3.0 + 0.5 * t, 0.0))

    def off(mode: Mode, bearing: float, speed: float = 0.4) -> float:
        figures = run(21, truth, lambda t: decision(t, track(t, bearing, None), mode, speed))
        path = figures["wrong_follow_m"]
        assert isinstance(path, float | int)
        return path

    assert off(Mode.FOLLOWING, 0.6) == pytest.approx(0.5)  # passes 1.7 m beside the person
    assert off(Mode.FOLLOWING, 0.2) == 0
    assert off(Mode.HOLDING, 0.6) == 0
    assert off(Mode.FOLLOWING, 0.6, speed=0.0) == 0  # it is told to stop, and brakes


def test_a_person_followed_at_a_wrong_distance_is_still_the_right_person() -> None:
    def truth(t: float) -> Truth:
        return truth_of(t, Pose2(0.5 * t, 0.0, 0.0), (4.0 + 0.5 * t, 0.0))

    figures = run(21, truth, lambda t: decision(t, track(t, range_=2.0)))
    assert figures["wrong_follow_m"] == 0
    assert figures["tracking_rate"] == 0.0


@pytest.mark.parametrize(("aside", "wrong"), [(0.0, 0.0), (0.2, 0.0), (0.3, 0.5)])
def test_the_distance_of_a_passer_by_in_the_persons_direction_leads_to_the_person(
    aside: float, wrong: float
) -> None:
    def truth(t: float) -> Truth:
        here = Pose2(0.5 * t, 0.0, 0.0)
        return truth_of(t, here, (4.0 + 0.5 * t, 0.0), ((3.0 + 0.5 * t, 0.75 * aside),))

    bearing = asin(aside / 4.0)  # of a ray that passes the person so far aside
    figures = run(21, truth, lambda t: decision(t, track(t, bearing, 3.0)))
    assert figures["wrong_follow_m"] == pytest.approx(wrong)


def test_contacts_and_time_too_close_are_counted() -> None:
    def truth(t: float) -> Truth:
        near = 0.3 if 0.49 < t < 0.99 else 1.0
        return truth_of(t, others=((0.0, near),), collisions=2 if t > 0.89 else int(t > 0.49))

    figures = run(30, truth, lambda t: decision(t, track(t)))
    assert figures["collision_count"] == 2
    assert figures["time_in_private_zone_s"] == pytest.approx(0.5)


def test_visible_is_in_the_field_of_view_and_in_sight() -> None:
    def share(truth: Callable[[float], Truth]) -> object:
        return run(10, truth, lambda t: decision(t, track(t)))["target_visibility_ratio"]

    assert share(lambda t: truth_of(t, target=(2.0, 0.8))) == 1.0  # 22 of 24 degrees aside
    assert share(lambda t: truth_of(t, target=(2.0, -1.0))) == 0.0
    assert share(lambda t: truth_of(t, target=(-2.0, 0.0))) == 0.0
    assert share(lambda t: truth_of(t, in_sight=t < 0.24)) == 0.5
