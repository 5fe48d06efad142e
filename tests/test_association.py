"""Where the person is, from feet, legs, or nothing; which sensor carries the track."""

from dataclasses import replace
from math import atan2, hypot, inf, pi, radians, sin

import numpy as np
import pytest

from followerd.estimation.association import Association
from followerd.estimation.ranging import Person
from followerd.geometry import Array, Pose2
from followerd.messages import Clusters, TrackPhase, TrackState

HERE = Pose2()


def track(
    stamp: float, x: float, y: float, sigma: float | None = 0.3, *, ranged: bool = True
) -> TrackState:
    return TrackState(
        stamp, TrackPhase.CONFIRMED, 0.9, 1, bearing=atan2(y, x),
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
        ~np.isin(k, wide), np.zeros(k.size, np.bool_),
    )  # fmt: skip


def known(association: Association, stamp: float) -> Person:
    person = association.person(stamp)
    assert person is not None
    return person


def test_before_anything_nothing_is_known() -> None:
    association = Association()
    assert association.person(1.0) is None
    assert association.bearing(HERE) is None
    association.scan(clusters(1.0, (2.0, 0.0)), HERE)
    assert association.claimed == ()


def test_feet_alone_give_position_and_its_uncertainty() -> None:
    association = Association()
    association.see(track(1.0, 2.0, 0.5), HERE)
    person = known(association, 1.0)
    assert person.position == pytest.approx((2.0, 0.5))
    assert person.sigma == pytest.approx(0.3, abs=0.01)


def test_positions_are_in_odom() -> None:
    association = Association()
    base = Pose2(1.0, 2.0, radians(90))
    association.see(track(1.0, 2.0, 0.0), base)
    assert known(association, 1.0).position == pytest.approx((1.0, 4.0))
    assert known(association, 1.0).seen_from(base) == pytest.approx((2.0, 0.0))


def test_legs_in_the_cone_sharpen_the_feet_and_are_claimed() -> None:
    association = Association()
    association.see(track(1.0, 2.3, 0.0), HERE)
    association.scan(clusters(1.02, (3.5, 1.8), (1.95, 0.1), (1.95, -0.1)), HERE)
    person = known(association, 1.02)
    assert person.position == pytest.approx((2.02, 0.0), abs=0.04)
    assert person.sigma < 0.1
    assert sorted(beams.start for beams in association.claimed) == [10, 20]


def test_without_feet_the_nearest_legs_in_the_cone_give_the_range() -> None:
    association = Association()
    association.see(track(1.0, 2.0, 0.0, ranged=False), HERE)
    assert association.person(1.0) is None
    association.scan(clusters(1.02, (1.95, 0.05), (3.5, 0.1), (1.0, 1.5)), HERE)
    distance, _ = known(association, 1.02).seen_from(HERE)
    assert distance == pytest.approx(2.0, abs=0.03)


def test_without_feet_and_legs_there_is_a_bearing_and_no_range() -> None:
    association = Association()
    seen = track(1.0, 2.0, 0.4, ranged=False)
    association.see(seen, HERE)
    association.scan(clusters(1.02, (2.0, 0.0), wide=(0,)), HERE)
    assert association.person(1.02) is None
    located = association.located(seen, Pose2(theta=0.1), 1.02)
    assert located.range is None
    assert located.position is None
    assert located.bearing == pytest.approx(atan2(0.4, 2.0) - 0.1)


@pytest.mark.parametrize(
    "place",
    [(4.0, 0.0), (0.9, 0.1), (1.5, 1.5)],
    ids=["the wall behind", "somebody nearer", "somebody beside"],
)
def test_what_cannot_be_the_person_is_not_claimed(place: tuple[float, float]) -> None:
    association = Association()
    association.see(track(1.0, 2.2, 0.0, 0.15), HERE)
    association.scan(clusters(1.02, place), HERE)
    assert association.claimed == ()
    assert known(association, 1.02).position == pytest.approx((2.2, 0.0), abs=0.01)


@pytest.mark.parametrize("phase", [TrackPhase.OCCLUDED, TrackPhase.LOST, TrackPhase.TENTATIVE])
def test_only_a_confirmed_track_claims_legs(phase: TrackPhase) -> None:
    association = Association()
    association.see(track(1.0, 2.0, 0.0), HERE)
    association.scan(clusters(1.02, (2.0, 0.0)), HERE)
    assert association.claimed
    association.see(replace(track(1.1, 2.0, 0.0), phase=phase), HERE)
    assert association.claimed == ()
    association.scan(clusters(1.12, (2.0, 0.0)), HERE)
    assert association.claimed == ()


def test_an_old_track_claims_no_legs() -> None:
    association = Association()
    association.see(track(1.0, 2.0, 0.0), HERE)
    association.scan(clusters(1.5, (2.0, 0.0)), HERE)
    assert association.claimed == ()


def test_an_occluded_person_is_predicted_ever_less_surely_until_unknown() -> None:
    association = Association()
    for k in range(40):
        association.see(track(0.1 * k, 2.0 + 0.05 * k, 0.0, 0.1), HERE)
    association.see(TrackState(4.0, TrackPhase.OCCLUDED, 0.5, 1), HERE)
    soon, later = known(association, 4.0), known(association, 4.4)
    assert later.position[0] - soon.position[0] == pytest.approx(0.2, abs=0.05)
    assert later.sigma > soon.sigma
    assert association.person(8.0) is None


def test_a_lost_track_has_no_place() -> None:
    association = Association()
    association.see(track(1.0, 2.0, 0.0), HERE)
    lost = TrackState(1.1, TrackPhase.LOST, 0.0, 1)
    association.see(lost, HERE)
    assert association.located(lost, HERE, 1.1) is lost
    assert association.bearing(HERE) is None


def test_a_walking_person_has_a_velocity_also_between_images() -> None:
    association, rng = Association(), np.random.default_rng(4)
    for k in range(150):
        stamp = k / 37.5
        x = 2.0 + 0.6 * stamp
        if k % 3 == 0:
            association.see(track(stamp, x + rng.normal(0, 0.1), 0.0), HERE)
        legs = [(x - 0.05, 0.1 + rng.normal(0, 0.01)), (x - 0.05, -0.1)]
        association.scan(clusters(stamp, *legs), HERE)
    person = known(association, 4.0)
    assert person.velocity == pytest.approx((0.6, 0.0), abs=0.1)
    assert person.position == pytest.approx((4.4, 0.0), abs=0.05)
    assert person.velocity_in(Pose2(theta=radians(90))) == pytest.approx((0.0, -0.6), abs=0.1)


def test_an_image_that_took_longer_than_the_scan_after_it_still_counts() -> None:
    association = Association()
    association.see(track(1.0, 2.0, 0.0), HERE)
    association.scan(clusters(1.06, (1.95, 0.1), (1.95, -0.1)), HERE)
    before = known(association, 1.06).covariance[1, 1]
    association.see(track(1.05, 2.0, 0.0, 0.05), HERE)
    assert known(association, 1.06).covariance[1, 1] < before


def test_one_wild_range_is_refused_and_many_are_a_new_place() -> None:
    association = Association()
    for k in range(10):
        association.see(track(0.1 * k, 2.0, 0.0, 0.1), HERE)
    association.see(track(1.0, 6.0, 0.0, 0.1), HERE)
    assert known(association, 1.0).position[0] == pytest.approx(2.0, abs=0.1)
    for k in range(8):
        association.see(track(1.1 + 0.1 * k, 6.0, 0.0, 0.1), HERE)
    assert known(association, 1.9).position[0] == pytest.approx(6.0, abs=0.2)


def test_a_track_too_sure_of_its_range_does_not_outweigh_the_legs() -> None:
    association = Association()
    for k in range(30):
        stamp = k / 15
        association.see(track(stamp, 2.0 - 0.01 * k, 0.0, 0.01), HERE)
        association.scan(clusters(stamp + 0.01, (1.95, 0.1), (1.95, -0.1)), HERE)
    assert known(association, 2.0).position[0] == pytest.approx(2.0, abs=0.12)


@pytest.mark.parametrize("rate", [37.5, 9.4])
def test_a_box_that_creeps_away_does_not_take_the_person_from_their_legs(rate: float) -> None:
    association, stride = Association(), 0.25
    association.see(track(0.0, 1.7, 0.0, 0.1), HERE)
    scans = [(k / rate, False) for k in range(int(4 * rate))]
    for stamp, is_image in sorted([*scans, *((0.01 + k / 15, True) for k in range(60))]):
        if is_image:
            association.see(track(stamp, 1.7 + 1.1 * stamp, 0.0, 0.15), HERE)
        else:
            swing = stride * sin(2.0 * pi * stamp)
            association.scan(clusters(stamp, (1.7 + swing, 0.1), (1.7 - swing, -0.1)), HERE)
    assert known(association, 4.0).position[0] == pytest.approx(1.75, abs=0.15)
    assert association.claimed


@pytest.mark.parametrize(("aside", "theirs"), [(0.1, True), (0.5, False)])
def test_legs_beside_where_the_camera_looks_are_not_known_for_the_persons(
    aside: float, theirs: bool
) -> None:
    association = Association()
    for k in range(20):
        stamp = 0.1 * k
        association.see(track(stamp, 2.0, 0.0), HERE)
        association.scan(clusters(stamp, (2.0, aside + 0.1), (2.0, aside - 0.1)), HERE)
    assert association.vouches(1.9) is theirs


def test_forgetting_leaves_nothing() -> None:
    association = Association()
    association.see(track(1.0, 2.0, 0.0), HERE)
    association.forget()
    assert association.person(1.0) is None
    assert association.located(track(1.0, 2.0, 0.0), HERE, 1.0).range is None


def test_a_located_track_stands_on_the_stamp_it_is_given() -> None:
    association = Association()
    seen = track(1.0, 2.0, 0.0)
    association.see(seen, HERE)
    located = association.located(seen, Pose2(0.5, 0.0, 0.0), 1.1)
    assert located.stamp == 1.1
    assert located.range == pytest.approx(1.5)
    assert located.range_sigma is not None
    assert located.range_sigma < inf
    assert located.position == pytest.approx((2.0, 0.0))
    assert located.velocity == pytest.approx((0.0, 0.0))


def followed() -> Association:
    """A person who stands at (2, 0), seen by camera and laser until 1 s."""
    association = Association()
    for k in range(20):
        stamp = 0.05 * (k + 1)
        association.see(track(stamp, 2.0, 0.0), HERE)
        association.scan(clusters(stamp, (1.95, 0.12), (1.95, -0.12)), HERE)
    return association


def test_behind_somebodys_legs_the_person_is_foreseen_for_a_while() -> None:
    association = followed()
    seen = association.measured(HERE, 1.0)
    assert seen is not None
    assert seen.seen
    association.scan(clusters(1.05, (1.2, 0.05)), HERE)
    hidden = association.measured(HERE, 1.6)
    assert hidden is not None
    assert not hidden.seen
    assert hidden.sigma > seen.sigma
    assert (hidden.distance, hidden.bearing) == pytest.approx((2.0, 0.0), abs=0.05)
    assert association.measured(HERE, 2.1) is None


def test_the_box_of_whoever_hides_the_person_does_not_move_them() -> None:
    association = followed()
    for k in range(12):
        association.scan(clusters(1.05 + 0.05 * k, (1.2, 0.05 + 0.01 * k)), HERE)
        association.see(track(1.05 + 0.05 * k, 1.2, 0.3 + 0.05 * k), HERE)
    assert known(association, 1.6).position == pytest.approx((2.0, 0.0), abs=0.1)
    association.scan(clusters(2.2, (1.2, 0.3)), HERE)
    for k in range(8):
        association.see(track(2.2 + 0.05 * k, 2.0, 0.3), HERE)
    assert known(association, 2.6).position[1] > 0.1  # hidden for too long: the camera is believed


def test_legs_that_come_in_from_outside_stay_somebody_elses() -> None:
    """Somebody crosses 0.25 m before the person, whose far leg alone stays in view."""
    association = followed()
    for k in range(40):
        stamp, y = 1.0 + 0.025 * (k + 1), -1.0 + 0.05 * k
        association.see(track(stamp, 2.0, 0.0), HERE)
        association.scan(clusters(stamp, (1.7, y), (1.95, 0.12)), HERE)
        assert not any(beams.start == 0 for beams in association.claimed)
    assert known(association, 2.0).position == pytest.approx((2.0, 0.06), abs=0.08)


def test_a_cluster_of_the_persons_leg_and_anothers_is_nobodys() -> None:
    association = followed()
    association.scan(clusters(1.025, (1.7, -0.65), (1.95, 0.12), (1.95, -0.12)), HERE)
    touching = replace(clusters(1.05, (1.8, -0.4), (1.95, 0.12)), width=np.array([0.33, 0.1]))
    association.scan(touching, HERE)
    assert [beams.start for beams in association.claimed] == [10]


OWN = (1.95, 0.12), (1.95, -0.12)  # the person's legs


def lost(stamp: float) -> TrackState:
    return TrackState(stamp, TrackPhase.LOST, 0.0, 1)


def without_the_camera(
    until: float, *others: tuple[float, float], blind: bool = False
) -> tuple[Association, float]:
    """The camera loses the person, or is `blind`, at 1 s; the laser goes on until `until`."""
    association, stamp = followed(), 1.0
    while stamp < until - 1e-9:
        stamp += 0.05
        if not blind:
            association.see(lost(stamp), HERE)
        association.scan(clusters(stamp, *OWN, *others), HERE)
    return association, stamp


@pytest.mark.parametrize("blind", [False, True], ids=["it says lost", "it says nothing"])
def test_own_legs_carry_a_track_that_the_camera_loses_within_bounds(blind: bool) -> None:
    association, stamp = without_the_camera(1.6, blind=blind)
    carried = association.carried(HERE, stamp)
    assert carried is not None
    assert carried.by_legs
    assert carried.phase is TrackPhase.CONFIRMED
    assert carried.position == pytest.approx((2.0, 0.0), abs=0.05)
    assert association.claimed == ()  # a claim is the confirmed person's, by the camera
    association, stamp = without_the_camera(3.2, blind=blind)
    carried = association.carried(HERE, stamp)
    assert carried is not None
    assert carried.phase is TrackPhase.OCCLUDED
    assert carried.range_sigma is not None
    assert carried.range_sigma < 0.1
    association, stamp = without_the_camera(6.2, blind=blind)
    assert association.carried(HERE, stamp) is None


def test_a_track_that_the_camera_leads_is_not_carried() -> None:
    association = followed()
    assert association.vouches(1.0)
    assert association.carried(HERE, 1.0) is None


@pytest.mark.parametrize("other", [(1.9, 0.45), (2.3, 0.2), (1.2, 0.05)])
def test_legs_with_anybodys_beside_or_before_them_carry_nothing(
    other: tuple[float, float],
) -> None:
    association, stamp = without_the_camera(1.3, other)
    assert association.carried(HERE, stamp) is None
    association.scan(clusters(stamp + 0.05, *OWN), HERE)
    assert association.carried(HERE, stamp + 0.05) is None  # whose they are is not known any more


def test_legs_out_of_sight_for_a_moment_are_nobodys_without_the_camera() -> None:
    association, stamp = without_the_camera(1.3)
    association.scan(clusters(stamp + 0.3, *OWN), HERE)
    assert association.carried(HERE, stamp + 0.3) is None


def test_legs_that_the_box_was_never_on_carry_nothing() -> None:
    association = Association()
    association.see(track(1.0, 2.0, 0.0), HERE)
    association.see(lost(1.05), HERE)
    association.scan(clusters(1.06, *OWN), HERE)
    assert association.carried(HERE, 1.06) is None


def test_behind_a_table_the_box_gives_the_range() -> None:
    """Its front is too wide for legs; the person walks on behind it."""
    association = followed()
    for k in range(60):
        stamp = 1.0 + 0.05 * (k + 1)
        association.see(track(stamp, 2.0 + 0.02 * k, 0.0), HERE)
        association.scan(clusters(stamp, (1.5, 0.0), wide=(0,)), HERE)
        assert association.claimed == ()
    person = known(association, 4.0)
    assert person.position == pytest.approx((3.18, 0.0), abs=0.15)
    assert 0.05 < person.sigma < 0.4


def by_laser(stamp: float, phase: TrackPhase = TrackPhase.CONFIRMED) -> TrackState:
    x = 2.0 + 0.5 * (stamp - 1.0)
    return TrackState(
        stamp, phase, 0.9, bearing=0.0, range=x, range_sigma=0.05, position=(x, 0.0),
        velocity=(0.5, 0.0), covariance=0.0025 * np.eye(2),
    )  # fmt: skip


def test_a_tracker_of_scans_is_believed_as_it_is() -> None:
    association = Association()
    association.see(by_laser(1.0), HERE)
    association.scan(clusters(1.1, (2.0, 0.1), (2.0, -0.1), (2.0, 0.9)), HERE)
    assert known(association, 1.1).position == pytest.approx((2.05, 0.0))
    assert known(association, 1.1).velocity == (0.5, 0.0)
    assert sorted(beams.start for beams in association.claimed) == [0, 10]
    association.see(by_laser(1.2, TrackPhase.OCCLUDED), HERE)
    association.scan(clusters(1.2, (2.05, 0.1)), HERE)
    assert association.claimed == ()
    association.see(TrackState(1.3, TrackPhase.LOST, 0.0), HERE)
    assert association.bearing(HERE) is None


def test_who_passes_while_the_camera_says_nothing_is_not_taken_for_the_person() -> None:
    association, stamp = followed(), 1.0
    for y in np.arange(0.95, 0.1, -0.1):
        stamp += 0.1
        association.scan(clusters(stamp, *OWN, (1.6, y + 0.1), (1.6, y - 0.1)), HERE)
    association.see(track(stamp + 0.05, 1.7, 0.1), HERE)
    association.scan(clusters(stamp + 0.1, OWN[1], (1.6, 0.15), (1.6, -0.05)), HERE)
    place = association.measured(HERE, stamp + 0.1)
    assert place is not None
    assert place.distance == pytest.approx(2.0, abs=0.1)
