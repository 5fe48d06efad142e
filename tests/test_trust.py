"""Nobody else is ever adopted: what the laser has against the camera's word (FAILSAFES F8, F9)."""

from math import atan2, hypot, inf

import numpy as np
import pytest

from followerd.estimation.association import Association
from followerd.estimation.trust import Trust
from followerd.geometry import Array, Pose2
from followerd.messages import Scan, TrackPhase, TrackState
from followerd.perception.clusters import ClusterSettings, find_clusters

Leg = tuple[float, float]
HERE = Pose2()
ANGLES = np.radians(np.arange(-90.0, 91.0))
SETTINGS = ClusterSettings()


def scan(stamp: float, *legs: tuple[float, float], wall: float = 6.0) -> Scan:
    """Legs of 6 cm radius before a wall `wall` m ahead, seen once a degree."""
    ranges = np.where(np.cos(ANGLES) > 0.1, wall / np.maximum(np.cos(ANGLES), 0.1), np.inf)
    for x, y in legs:
        off = hypot(x, y) * np.sin(ANGLES - atan2(y, x))
        hit = (np.abs(off) < 0.06) & (np.cos(ANGLES - atan2(y, x)) > 0)
        ranges = np.where(hit, np.minimum(ranges, hypot(x, y) - 0.05), ranges)
    return scanned(stamp, ranges)


def scanned(stamp: float, ranges: Array) -> Scan:
    """Ranges once a degree from the right to the left."""
    times = np.zeros(ranges.size)
    return Scan(stamp, stamp, -np.pi / 2, np.radians(1.0), ranges, 30.0, times, HERE)


def person(x: float, y: float) -> tuple[tuple[float, float], ...]:
    return (x, y - 0.12), (x, y + 0.12)


def desk(x: float, right: float = -0.8, left: float = 0.8) -> tuple[tuple[float, float], ...]:
    """The front of something low, from one side to the other."""
    return tuple((x, y) for y in np.arange(right, left, 0.02).tolist())


class Run:
    """Camera and laser at the same rate, Hz."""

    def __init__(self, rate: float = 10.0) -> None:
        self.association = Association()
        self.now, self.rate = 0.0, rate

    def go(
        self,
        seconds: float,
        claim: tuple[float, float],
        *legs: tuple[float, float],
        phase: TrackPhase = TrackPhase.CONFIRMED,
        wall: float = 6.0,
        blind: bool = False,
    ) -> TrackPhase:
        """The phase that the pipeline gets at the end."""
        seen = phase
        for _ in range(round(self.rate * seconds)):
            self.now += 1.0 / self.rate
            x, y = claim
            track = TrackState(
                self.now, phase, 0.9, 1, bearing=atan2(y, x), range=hypot(x, y), range_sigma=0.15
            )
            self.association.see(track, HERE)
            seen = self.association.located(track, HERE, self.now).phase
            if blind:
                continue
            one = scan(self.now, *legs, wall=wall)
            points = one.points()
            self.association.scan(find_clusters(one, points, SETTINGS), HERE, points)
        return seen


def followed(rate: float = 10.0) -> Run:
    run = Run(rate)
    assert run.go(1.0, (2.0, 0.0), *person(2.0, 0.0)) is TrackPhase.CONFIRMED
    return run


def test_without_legs_ever_the_camera_is_believed() -> None:
    run = Run()
    assert run.go(2.0, (2.0, 0.0)) is TrackPhase.CONFIRMED
    assert run.go(1.0, (2.0, 1.5)) is TrackPhase.CONFIRMED


def test_a_track_that_stands_where_the_laser_sees_through_is_doubted_within_half_a_second() -> None:
    run = followed()
    assert run.go(0.7, (2.0, 0.0)) is TrackPhase.TENTATIVE
    assert "no legs" in run.association.trust.why
    assert run.association.claimed == ()


@pytest.mark.parametrize("rate", [5.0, 10.0])
def test_a_track_that_slides_onto_furniture_is_doubted_after_two_seconds(rate: float) -> None:
    run, chair = followed(rate), desk(1.9, -0.3, 0.3)
    assert run.go(1.5, (2.0, 0.0), *chair) is TrackPhase.CONFIRMED
    assert run.go(1.0, (2.0, 0.0), *chair) is TrackPhase.TENTATIVE


def test_far_off_too_a_track_is_doubted_that_has_had_no_legs_for_two_seconds() -> None:
    run, chair = followed(), desk(5.5, -0.3, 0.3)
    for x in np.arange(2.0, 5.6, 0.1):
        run.go(0.1, (x, 0.0), *person(x, 0.0))
    assert run.go(1.2, (5.6, 0.0), *chair) is TrackPhase.CONFIRMED
    assert run.go(1.3, (5.6, 0.0), *chair) is TrackPhase.TENTATIVE


def test_a_track_where_nothing_gives_an_echo_is_doubted_after_two_seconds() -> None:
    run, beside = followed(), (*person(2.0, 3.0), *person(2.0, -3.0))
    assert run.go(1.5, (2.0, 0.0), *beside, wall=inf) is TrackPhase.CONFIRMED
    assert run.go(1.0, (2.0, 0.0), *beside, wall=inf) is TrackPhase.TENTATIVE


def test_a_place_that_the_laser_does_not_sweep_is_not_spoken_of() -> None:
    run = followed()
    assert run.go(4.0, (2.0, 0.0), *person(2.0, 3.0), wall=inf) is TrackPhase.CONFIRMED


@pytest.mark.parametrize("ahead", [2.0, 5.4])
def test_a_track_that_slides_onto_a_bare_wall_is_doubted_within_half_a_second(ahead: float) -> None:
    run = followed()
    for x in np.arange(2.0, ahead, 0.1):
        run.go(0.1, (x, 0.0), *person(x, 0.0))
    assert run.go(0.2, (ahead, 0.0), wall=ahead + 0.1) is TrackPhase.CONFIRMED
    assert run.go(0.4, (ahead, 0.0), wall=ahead + 0.1) is TrackPhase.TENTATIVE


@pytest.mark.parametrize(("ahead", "hidden"), [(2.0, 4.5), (5.5, 4.0)])
def test_legs_behind_low_furniture_are_no_reason_to_doubt_until_it_lasts(
    ahead: float, hidden: float
) -> None:
    """Far off, legs that fell between the beams before count already."""
    run = followed()
    for x in np.arange(2.0, ahead, 0.1):
        run.go(0.1, (x, 0.0), *person(x, 0.0))
    assert run.go(hidden, (ahead, 0.0), *desk(1.2)) is TrackPhase.CONFIRMED
    assert run.go(5.5 - hidden, (ahead, 0.0), *desk(1.2)) is TrackPhase.TENTATIVE


def test_a_camera_that_led_while_the_laser_was_blind_is_believed_together_with_legs() -> None:
    run = followed()
    assert run.go(1.5, (2.0, 0.0), blind=True) is TrackPhase.CONFIRMED
    assert run.go(0.3, (2.0, 0.0), *person(2.0, 0.0)) is TrackPhase.TENTATIVE
    assert run.go(0.7, (2.0, 0.0), *person(2.0, 0.0)) is TrackPhase.CONFIRMED


def test_whoever_the_camera_has_in_company_after_a_blind_time_is_enrolled_anew() -> None:
    run = followed()
    run.go(1.5, (2.0, 0.0), blind=True)
    somebody = person(2.5, 1.0)
    assert run.go(0.2, (2.0, 0.0), *person(2.0, 0.0), *somebody) is TrackPhase.TENTATIVE
    assert run.go(2.0, (2.0, 0.0), *person(2.0, 0.0)) is TrackPhase.TENTATIVE
    run.association.forget()
    assert run.go(1.0, (2.0, 0.0), *person(2.0, 0.0), *somebody) is TrackPhase.CONFIRMED


def test_whoever_the_camera_has_after_five_blind_seconds_is_enrolled_anew() -> None:
    run = followed()
    run.go(5.5, (2.0, 0.0), blind=True)
    assert run.go(3.0, (2.0, 0.0), *person(2.0, 0.0)) is TrackPhase.TENTATIVE


def test_whom_a_camera_has_that_was_blind_before_legs_were_known_is_enrolled_anew() -> None:
    run = Run()
    run.go(0.2, (2.0, 0.0))
    run.now += 1.5
    assert run.go(2.0, (3.0, 0.6), *person(3.0, 0.6)) is TrackPhase.TENTATIVE
    assert run.association.measured(HERE, run.now) is None
    run.association.forget()
    assert run.go(1.0, (3.0, 0.6), *person(3.0, 0.6)) is TrackPhase.CONFIRMED


def test_where_no_laser_is_a_camera_that_was_blind_is_believed() -> None:
    run = Run()
    run.go(0.2, (2.0, 0.0), blind=True)
    run.now += 1.5
    assert run.go(0.2, (2.0, 0.3), blind=True) is TrackPhase.CONFIRMED


def test_nobody_is_seen_through_a_wall() -> None:
    run = followed()
    assert run.go(0.8, (2.0, 0.0), wall=1.2) is TrackPhase.CONFIRMED
    assert run.go(0.5, (2.0, 0.0), wall=1.2) is TrackPhase.TENTATIVE


def test_beside_the_end_of_a_wall_a_leg_is_seen() -> None:
    run = followed()
    leg = (2.0, -0.12)
    assert run.go(2.0, (2.0, 0.0), leg, *desk(1.2, 0.15, 4.0)) is TrackPhase.CONFIRMED
    assert run.go(1.0, (2.0, 0.0), *desk(1.2, 0.15, 4.0)) is TrackPhase.TENTATIVE


def test_a_leap_is_believed_only_with_legs_within_walking_distance() -> None:
    run = followed()
    run.go(1.0, (4.0, -3.0), *person(2.0, 0.0))
    assert not run.association.trust.given
    assert run.go(1.5, (2.0, 0.0), *person(2.0, 0.0)) is TrackPhase.CONFIRMED


def test_whoever_already_stood_there_is_not_the_person() -> None:
    run = Run()
    run.go(1.0, (2.0, 0.6), *person(2.0, 0.6), *person(2.2, -0.8))
    run.go(0.8, (2.0, 0.6), *person(2.2, -0.8))
    assert run.go(5.0, (2.2, -0.8), *person(2.2, -0.8)) is TrackPhase.TENTATIVE
    place = run.association.measured(HERE, run.now)
    assert place is not None
    assert not place.seen


def test_a_track_that_goes_over_to_somebody_who_stood_there_is_doubted_at_once() -> None:
    run = Run()
    run.go(1.0, (2.0, 0.6), *person(2.0, 0.6), *person(2.0, -0.4))
    assert run.go(0.5, (2.0, -0.4), *person(2.0, -0.4)) is TrackPhase.TENTATIVE


def test_a_track_that_slides_before_somebody_else_is_doubted_within_two_scans() -> None:
    """Far off, legs fall between the beams; where another's are seen, the person's would be."""
    run, another = Run(), person(4.5, -0.4)
    run.go(1.0, (4.0, 0.4), *person(4.0, 0.4), *another)
    for y in np.arange(0.3, 0.0, -0.1):
        assert run.go(0.1, (4.0, y), *another) is TrackPhase.CONFIRMED
    assert run.go(0.2, (4.0, -0.35), *another) is TrackPhase.TENTATIVE


def test_who_was_another_before_the_camera_was_doubted_is_not_the_person_after_all() -> None:
    run, another = Run(), person(4.4, -0.3)
    run.go(1.0, (3.0, 0.0), *person(3.0, 0.0))
    assert run.go(0.6, (3.0, 0.0), *another) is TrackPhase.TENTATIVE
    assert run.go(4.0, (4.4, -0.3), *another) is TrackPhase.TENTATIVE


def heard(trust: Trust, stamp: float, found: tuple[tuple[float, float], ...], *rest: Leg) -> None:
    """One scan in which the legs `found` are taken for the person's, and `rest` are not."""
    one = scan(stamp, *found, *rest)
    points = one.points()
    clusters = find_clusters(one, points, SETTINGS)
    off = [np.hypot(*(clusters.centre - leg).T) for leg in found]
    own = np.array([int(np.argmin(each)) for each in off], np.intp)
    trust.scan(clusters, points, HERE, None, own)


def test_a_passer_by_taken_for_a_hidden_person_does_not_make_the_person_a_stranger() -> None:
    """While nobody says who is who, whoever stands beside the legs found may be the person."""
    trust = Trust()
    for k in range(10):
        heard(trust, 0.1 * k, person(3.0, 0.0))
        trust.agree((3.0, 0.0), 0.1 * k)
    for k, y in enumerate(np.arange(0.9, -0.8, -0.15)):  # somebody steps in between
        heard(trust, 1.0 + 0.1 * k, (), *person(2.5, y))
    heard(trust, 2.3, person(2.5, -0.8), *person(3.1, 0.1))
    for k in range(8):
        heard(trust, 2.4 + 0.1 * k, person(3.1, 0.1), *person(2.5, -0.9))
        trust.agree((3.1, 0.1), 2.4 + 0.1 * k)
    assert trust.given, trust.why


def test_somebody_known_as_another_stays_that_beside_the_person() -> None:
    trust = Trust()
    for k, y in enumerate(np.arange(1.3, 0.35, -0.1)):
        heard(trust, 0.1 * k, person(3.0, 0.0), *person(2.7, y))
        trust.agree((3.0, 0.0), 0.1 * k)
    trust.doubt("lost", 1.0)
    for k in range(10):
        heard(trust, 1.0 + 0.1 * k, person(2.7, 0.4))
        trust.agree((2.7, 0.4), 1.0 + 0.1 * k)
    assert not trust.given


def test_a_camera_that_leaps_to_somebody_known_is_doubted_at_once() -> None:
    """While the person was out of the laser's sight their place is not known so well."""
    run = Run()
    run.go(1.0, (3.0, 0.5), *person(3.0, 0.5), *person(3.2, -0.8))
    run.go(0.4, (3.0, 0.5), *person(3.2, -0.8), phase=TrackPhase.OCCLUDED)
    run.go(0.1, (3.2, -0.8), *person(3.2, -0.8))
    assert not run.association.trust.given
    assert run.go(1.0, (3.2, -0.8), *person(3.2, -0.8)) is TrackPhase.TENTATIVE


def test_a_person_lost_and_found_is_believed_again_with_their_legs() -> None:
    run = followed()
    assert run.go(1.0, (2.0, 0.0), phase=TrackPhase.LOST) is TrackPhase.LOST
    run.go(0.3, (2.5, 0.9), *person(2.5, 0.9))
    assert not run.association.trust.given
    assert run.go(1.0, (2.5, 0.9), *person(2.5, 0.9)) is TrackPhase.CONFIRMED


def test_whoever_is_found_late_may_be_anybody() -> None:
    run = followed()
    run.go(4.5, (2.0, 0.0), phase=TrackPhase.LOST)
    assert run.go(1.0, (2.5, 0.9), *person(2.5, 0.9)) is TrackPhase.CONFIRMED
    run.go(5.5, (2.5, 0.9), phase=TrackPhase.LOST)
    assert run.go(2.0, (2.5, 0.9), *person(2.5, 0.9)) is TrackPhase.TENTATIVE
    run.association.forget()
    assert run.go(1.0, (2.5, 0.9), *person(2.5, 0.9)) is TrackPhase.CONFIRMED


def test_nobody_walks_faster_than_a_person() -> None:
    run = followed()
    run.go(0.2, (2.0, 0.0), phase=TrackPhase.LOST)
    assert run.go(0.9, (4.0, 2.5), *person(4.0, 2.5)) is TrackPhase.TENTATIVE


def test_a_refuted_tracker_is_told_to_look_anew() -> None:
    run = followed()
    assert run.go(0.7, (2.0, 0.0)) is TrackPhase.TENTATIVE
    told: list[bool] = []
    for _ in range(30):
        run.go(0.1, (2.0, 0.0))
        place = run.association.measured(HERE, run.now)
        told.append(place is not None and place.refuted)
    assert any(told)
    assert not all(told)


@pytest.mark.parametrize("distance", [4.0, 6.0])
def test_a_wall_seen_at_a_low_angle_is_no_leg(distance: float) -> None:
    """One beam a cluster, each as narrow as a leg."""
    run = followed()
    run.go(0.3, (2.0, 0.0), phase=TrackPhase.LOST)
    y = -1.2
    for _ in range(60):
        run.now += 0.1
        claim = (distance, y)
        track = TrackState(
            run.now, TrackPhase.CONFIRMED, 0.9, 1,
            bearing=atan2(claim[1], claim[0]), range=hypot(*claim), range_sigma=0.3,
        )  # fmt: skip
        run.association.see(track, HERE)
        angles: Array = np.minimum(ANGLES, -1e-3)
        ranges = np.where(ANGLES < -0.05, y / np.sin(angles), np.inf)
        one = scanned(run.now, ranges)
        points = one.points()
        run.association.scan(find_clusters(one, points, SETTINGS), HERE, points)
    assert not run.association.trust.given
