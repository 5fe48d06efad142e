"""How far the person is, from feet, legs, or nothing."""

from dataclasses import replace
from math import atan2, hypot, inf, radians

import numpy as np
import pytest

from followerd.estimation.ranging import Person, Ranging
from followerd.geometry import Array, Pose2
from followerd.messages import Clusters, TrackPhase, TrackState

HERE = Pose2()


def track(
    stamp: float, x: float, y: float, sigma: float | None = 0.3, *, ranged: bool = True
) -> TrackState:
    return TrackState(
        stamp, TrackPhase.CONFIRMED, 0.9, bearing=atan2(y, x),
        range=hypot(x, y) if ranged else None, range_sigma=sigma if ranged else None,
    )  # fmt: skip


def clusters(stamp: float, *places: tuple[float, float], wide: tuple[int, ...] = ()) -> Clusters:
    """Legs at the places, each of five beams; those named in `wide` are walls."""
    centre: Array = np.array(places, float).reshape(-1, 2)
    k = np.arange(len(places))
    away = np.hypot(centre[:, 0], centre[:, 1])
    return Clusters(
        stamp, 10 * k, 10 * k + 4, np.full(k.size, 5), centre,
        np.arctan2(centre[:, 1], centre[:, 0]), away, away, np.full(k.size, 0.1),
        ~np.isin(k, wide),
    )  # fmt: skip


def known(ranging: Ranging, stamp: float) -> Person:
    person = ranging.person(stamp)
    assert person is not None
    return person


def test_before_anything_nothing_is_known() -> None:
    ranging = Ranging()
    assert ranging.person(1.0) is None
    assert ranging.bearing(HERE) is None
    ranging.scan(clusters(1.0, (2.0, 0.0)), HERE)
    assert ranging.claimed == ()


def test_feet_alone_give_position_and_its_uncertainty() -> None:
    ranging = Ranging()
    ranging.see(track(1.0, 2.0, 0.5), HERE)
    person = known(ranging, 1.0)
    assert person.position == pytest.approx((2.0, 0.5))
    assert person.sigma == pytest.approx(0.3, abs=0.01)


def test_positions_are_in_odom() -> None:
    ranging = Ranging()
    base = Pose2(1.0, 2.0, radians(90))
    ranging.see(track(1.0, 2.0, 0.0), base)
    assert known(ranging, 1.0).position == pytest.approx((1.0, 4.0))
    assert known(ranging, 1.0).seen_from(base) == pytest.approx((2.0, 0.0))


def test_legs_in_the_cone_sharpen_the_feet_and_are_claimed() -> None:
    ranging = Ranging()
    ranging.see(track(1.0, 2.3, 0.0), HERE)
    ranging.scan(clusters(1.02, (3.5, 1.8), (1.95, 0.1), (1.95, -0.1)), HERE)
    person = known(ranging, 1.02)
    assert person.position == pytest.approx((2.02, 0.0), abs=0.04)
    assert person.sigma < 0.1
    assert sorted(beams.start for beams in ranging.claimed) == [10, 20]


def test_without_feet_the_nearest_legs_in_the_cone_give_the_range() -> None:
    ranging = Ranging()
    ranging.see(track(1.0, 2.0, 0.0, ranged=False), HERE)
    assert ranging.person(1.0) is None
    ranging.scan(clusters(1.02, (1.95, 0.05), (3.5, 0.1), (1.0, 1.5)), HERE)
    distance, _ = known(ranging, 1.02).seen_from(HERE)
    assert distance == pytest.approx(2.0, abs=0.03)


def test_without_feet_and_legs_there_is_a_bearing_and_no_range() -> None:
    ranging = Ranging()
    seen = track(1.0, 2.0, 0.4, ranged=False)
    ranging.see(seen, HERE)
    ranging.scan(clusters(1.02, (2.0, 0.0), wide=(0,)), HERE)
    assert ranging.person(1.02) is None
    located = ranging.located(seen, Pose2(theta=0.1), 1.02)
    assert located.range is None
    assert located.position is None
    assert located.bearing == pytest.approx(atan2(0.4, 2.0) - 0.1)


@pytest.mark.parametrize(
    "place",
    [(4.0, 0.0), (0.9, 0.1), (1.5, 1.5)],
    ids=["the wall behind", "somebody nearer", "somebody beside"],
)
def test_what_cannot_be_the_person_is_not_claimed(place: tuple[float, float]) -> None:
    ranging = Ranging()
    ranging.see(track(1.0, 2.2, 0.0, 0.15), HERE)
    ranging.scan(clusters(1.02, place), HERE)
    assert ranging.claimed == ()
    assert known(ranging, 1.02).position == pytest.approx((2.2, 0.0), abs=0.01)


@pytest.mark.parametrize("phase", [TrackPhase.OCCLUDED, TrackPhase.LOST, TrackPhase.TENTATIVE])
def test_only_a_confirmed_track_claims_legs(phase: TrackPhase) -> None:
    ranging = Ranging()
    ranging.see(track(1.0, 2.0, 0.0), HERE)
    ranging.scan(clusters(1.02, (2.0, 0.0)), HERE)
    assert ranging.claimed
    ranging.see(replace(track(1.1, 2.0, 0.0), phase=phase), HERE)
    assert ranging.claimed == ()
    ranging.scan(clusters(1.12, (2.0, 0.0)), HERE)
    assert ranging.claimed == ()


def test_an_old_track_claims_no_legs() -> None:
    ranging = Ranging()
    ranging.see(track(1.0, 2.0, 0.0), HERE)
    ranging.scan(clusters(1.5, (2.0, 0.0)), HERE)
    assert ranging.claimed == ()


def test_an_occluded_person_is_predicted_ever_less_surely_until_unknown() -> None:
    ranging = Ranging()
    for k in range(40):
        ranging.see(track(0.1 * k, 2.0 + 0.05 * k, 0.0, 0.1), HERE)
    ranging.see(TrackState(4.0, TrackPhase.OCCLUDED, 0.5), HERE)
    soon, later = known(ranging, 4.0), known(ranging, 4.4)
    assert later.position[0] - soon.position[0] == pytest.approx(0.2, abs=0.05)
    assert later.sigma > soon.sigma
    assert ranging.person(8.0) is None


def test_a_lost_track_has_no_place() -> None:
    ranging = Ranging()
    ranging.see(track(1.0, 2.0, 0.0), HERE)
    lost = TrackState(1.1, TrackPhase.LOST, 0.0)
    ranging.see(lost, HERE)
    assert ranging.located(lost, HERE, 1.1) is lost
    assert ranging.bearing(HERE) is None


def test_a_walking_person_has_a_velocity_also_between_images() -> None:
    ranging, rng = Ranging(), np.random.default_rng(4)
    for k in range(150):
        stamp = k / 37.5
        x = 2.0 + 0.6 * stamp
        if k % 3 == 0:
            ranging.see(track(stamp, x + rng.normal(0, 0.1), 0.0), HERE)
        legs = [(x - 0.05, 0.1 + rng.normal(0, 0.01)), (x - 0.05, -0.1)]
        ranging.scan(clusters(stamp, *legs), HERE)
    person = known(ranging, 4.0)
    assert person.velocity == pytest.approx((0.6, 0.0), abs=0.1)
    assert person.position == pytest.approx((4.4, 0.0), abs=0.05)
    assert person.velocity_in(Pose2(theta=radians(90))) == pytest.approx((0.0, -0.6), abs=0.1)


def test_an_image_that_took_longer_than_the_scan_after_it_still_counts() -> None:
    ranging = Ranging()
    ranging.see(track(1.0, 2.0, 0.0), HERE)
    ranging.scan(clusters(1.06, (1.95, 0.1), (1.95, -0.1)), HERE)
    before = known(ranging, 1.06).sigma
    ranging.see(track(1.05, 2.0, 0.0, 0.05), HERE)
    assert known(ranging, 1.06).sigma < before


def test_one_wild_range_is_refused_and_many_are_a_new_place() -> None:
    ranging = Ranging()
    for k in range(10):
        ranging.see(track(0.1 * k, 2.0, 0.0, 0.1), HERE)
    ranging.see(track(1.0, 6.0, 0.0, 0.1), HERE)
    assert known(ranging, 1.0).position[0] == pytest.approx(2.0, abs=0.1)
    for k in range(8):
        ranging.see(track(1.1 + 0.1 * k, 6.0, 0.0, 0.1), HERE)
    assert known(ranging, 1.9).position[0] == pytest.approx(6.0, abs=0.2)


def test_a_track_too_sure_of_its_range_does_not_outweigh_the_legs() -> None:
    ranging = Ranging()
    for k in range(30):
        stamp = k / 15
        ranging.see(track(stamp, 2.0 - 0.01 * k, 0.0, 0.01), HERE)
        ranging.scan(clusters(stamp + 0.01, (1.95, 0.1), (1.95, -0.1)), HERE)
    assert known(ranging, 2.0).position[0] == pytest.approx(2.0, abs=0.12)


def test_forgetting_leaves_nothing() -> None:
    ranging = Ranging()
    ranging.see(track(1.0, 2.0, 0.0), HERE)
    ranging.forget()
    assert ranging.person(1.0) is None
    assert ranging.located(track(1.0, 2.0, 0.0), HERE, 1.0).range is None


def test_a_located_track_stands_on_the_stamp_it_is_given() -> None:
    ranging = Ranging()
    seen = track(1.0, 2.0, 0.0)
    ranging.see(seen, HERE)
    located = ranging.located(seen, Pose2(0.5, 0.0, 0.0), 1.1)
    assert located.stamp == 1.1
    assert located.range == pytest.approx(1.5)
    assert located.range_sigma is not None
    assert located.range_sigma < inf
    assert located.position == pytest.approx((2.0, 0.0))
    assert located.velocity == pytest.approx((0.0, 0.0))


def followed() -> Ranging:
    """A person who stands at (2, 0), seen by camera and laser until 1 s."""
    ranging = Ranging()
    for k in range(20):
        stamp = 0.05 * (k + 1)
        ranging.see(track(stamp, 2.0, 0.0), HERE)
        ranging.scan(clusters(stamp, (1.95, 0.12), (1.95, -0.12)), HERE)
    return ranging


def test_behind_somebodys_legs_the_person_is_foreseen_for_a_while() -> None:
    ranging = followed()
    seen = ranging.measured(HERE, 1.0)
    assert seen is not None
    assert seen.seen
    ranging.scan(clusters(1.05, (1.2, 0.05)), HERE)
    hidden = ranging.measured(HERE, 1.6)
    assert hidden is not None
    assert not hidden.seen
    assert hidden.sigma > seen.sigma
    assert (hidden.distance, hidden.bearing) == pytest.approx((2.0, 0.0), abs=0.05)
    assert ranging.measured(HERE, 2.1) is None


def test_the_box_of_whoever_hides_the_person_does_not_move_them() -> None:
    ranging = followed()
    for k in range(12):
        ranging.scan(clusters(1.05 + 0.05 * k, (1.2, 0.05 + 0.01 * k)), HERE)
        ranging.see(track(1.05 + 0.05 * k, 1.2, 0.3 + 0.05 * k), HERE)
    assert known(ranging, 1.6).position == pytest.approx((2.0, 0.0), abs=0.1)
    ranging.scan(clusters(2.2, (1.2, 0.3)), HERE)
    for k in range(8):
        ranging.see(track(2.2 + 0.05 * k, 2.0, 0.3), HERE)
    assert known(ranging, 2.6).position[1] > 0.1  # hidden for too long: the camera is believed


def test_legs_that_come_in_from_outside_stay_somebody_elses() -> None:
    """Somebody crosses 0.25 m before the person, whose far leg alone stays in view."""
    ranging = followed()
    for k in range(40):
        stamp, y = 1.0 + 0.025 * (k + 1), -1.0 + 0.05 * k
        ranging.see(track(stamp, 2.0, 0.0), HERE)
        ranging.scan(clusters(stamp, (1.7, y), (1.95, 0.12)), HERE)
        assert not any(beams.start == 0 for beams in ranging.claimed)
    assert known(ranging, 2.0).position == pytest.approx((2.0, 0.06), abs=0.08)


def test_a_cluster_of_the_persons_leg_and_anothers_is_nobodys() -> None:
    ranging = followed()
    ranging.scan(clusters(1.025, (1.7, -0.65), (1.95, 0.12), (1.95, -0.12)), HERE)
    touching = replace(clusters(1.05, (1.8, -0.4), (1.95, 0.12)), width=np.array([0.33, 0.1]))
    ranging.scan(touching, HERE)
    assert [beams.start for beams in ranging.claimed] == [10]
