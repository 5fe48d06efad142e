"""The tracker `legs`: who it follows, whom it does not, and when it says that it has lost them."""

from collections.abc import Iterator
from math import cos, pi, sin

import numpy as np
import pytest

from followerd.control.mode import ModeSettings
from followerd.errors import UsageError
from followerd.estimation.walker import Walker, WalkerSettings
from followerd.geometry import Array, Camera, Pose2
from followerd.messages import Box, Image, Odometry, TrackPhase, TrackState, Twist
from followerd.trackers.legs import Legs, LegsSettings
from tests.laser_scenes import legs, scan_of

NOBODY = np.empty((0, 3))
ROOM = np.array([[-2, -4, 6, -4], [6, -4, 6, 4], [6, 4, -2, 4], [-2, 4, -2, -4]], float)
CHAIRS = np.array([[x + dx, y + dy, 0.02] for x, y in ((3.0, 1.5), (2.5, -1.8), (4.5, 0.6))
                   for dx in (0.0, 0.45) for dy in (0.0, 0.45)])  # fmt: skip
RATE = 10.0  # Hz


def tracker(seed: int = 0) -> Legs:
    return Legs(LegsSettings(), np.random.default_rng(seed))


def place(state: TrackState) -> Array:
    assert state.range is not None
    assert state.bearing is not None
    return np.array([state.range * cos(state.bearing), state.range * sin(state.bearing)])


class Stage:
    """A tracker before circles that move; remembers what it said."""

    def __init__(self, rate: float = RATE, step_deg: float = 0.5, seed: int = 0) -> None:
        self.rate, self.step_deg = rate, step_deg
        self.tracker = tracker(seed)
        self.rng = np.random.default_rng(seed + 100)
        self.stamp = 0.0
        self.state: TrackState | None = None

    def enrol(self, at: tuple[float, float], ego: Pose2 | None = None) -> TrackState:
        scan = scan_of(legs(at, 0.0), self.stamp, step_deg=self.step_deg, rng=self.rng)
        self.state = self.tracker.enrol(scan, at, ego)
        return self.state

    def shows(self, circles: Array, ego: Pose2 | None = None) -> TrackState:
        """The state after one more scan; `circles` are in `odom` where there is an `ego`."""
        self.stamp += 1.0 / self.rate
        scan = scan_of(
            circles, self.stamp, walls=ROOM, step_deg=self.step_deg, pose=ego, rng=self.rng
        )
        state = self.tracker.step(scan, ego)
        assert state is not None
        self.state = state
        return state

    def shows_for(self, seconds: float, circles: Array) -> TrackState:
        """The state after the same has been seen for a while."""
        for _ in range(round(seconds * self.rate)):
            state = self.shows(circles)
        return state


def stroll(seconds: float, rate: float) -> Iterator[tuple[tuple[float, float], Array]]:
    """A walk round an ellipse among chairs, 0.9 m/s: the place, and all circles."""
    for step in range(1, round(seconds * rate) + 1):
        t = step / rate
        angle = pi + 0.7 * t
        at = (2.8 + 1.3 * cos(angle), 1.0 * sin(angle))
        heading = angle + pi / 2
        yield at, np.concatenate([legs(at, heading, 0.9 * t), CHAIRS])


@pytest.mark.parametrize(("rate", "step_deg"), [(10.0, 0.35), (7.5, 0.5), (37.5, 1.0), (5.0, 1.0)])
def test_a_walker_among_chairs_is_followed_by_every_scanner(rate: float, step_deg: float) -> None:
    stage = Stage(rate, step_deg)
    stage.enrol((1.5, 0.0))
    errors = []
    for at, circles in stroll(4.0, rate):
        state = stage.shows(circles)
        errors.append(np.hypot(*(place(state) - at)) if state.range else np.inf)
    assert np.mean(np.array(errors) < 0.5) > 0.98
    assert np.median(errors) < 0.12


def test_with_odometry_the_person_is_in_odom_while_the_robot_turns() -> None:
    stage = Stage()
    stage.enrol((1.5, 0.0), Pose2())
    for number, (at, circles) in enumerate(stroll(4.0, RATE)):
        ego = Pose2(0.01 * number, 0.0, 0.3 * sin(0.2 * number))
        state = stage.shows(circles, ego)
        assert state.position == pytest.approx(at, abs=0.35)
        assert ego.apply(place(state)[None])[0] == pytest.approx(state.position)
    assert state.velocity is not None
    assert np.hypot(*state.velocity) == pytest.approx(0.9, abs=0.5)


def test_a_robot_that_turns_fast_without_odometry_keeps_them() -> None:
    stage = Stage()
    stage.enrol((2.0, 0.0))
    for number in range(1, 31):
        at = (2.0 * cos(turn := 0.8 * sin(0.2 * number)), 2.0 * sin(turn))
        state = stage.shows(legs(at, turn))
    assert place(state) == pytest.approx(at, abs=0.3)


def test_somebody_who_crosses_in_front_does_not_take_the_track_along() -> None:
    for seed in range(2):
        stage = Stage(seed=seed)
        person = legs((2.0, 0.0), 0.0)
        stage.enrol((2.0, 0.0))
        stage.shows_for(0.5, person)
        for step in range(30):
            y = -1.8 + 0.12 * step
            state = stage.shows(np.concatenate([person, legs((1.4, y), pi / 2, y)]))
            assert state.range is None or place(state) == pytest.approx((2.0, 0.0), abs=0.5)
        assert state.phase is TrackPhase.CONFIRMED


def test_lost_is_said_within_a_second_and_has_no_place() -> None:
    stage = Stage()
    stage.enrol((2.0, 0.0))
    assert stage.shows_for(1.0, legs((2.0, 0.0), 0.0)).phase is TrackPhase.CONFIRMED
    hidden = stage.shows_for(0.3, NOBODY)
    assert hidden.phase is TrackPhase.OCCLUDED
    lost = stage.shows_for(0.7, NOBODY)
    assert (lost.phase, lost.confidence) == (TrackPhase.LOST, 0.0)
    assert [lost.range, lost.bearing, lost.position, lost.velocity] == [None] * 4


def gone() -> Stage:
    """A person at 2 m, lost for a second."""
    stage = Stage()
    stage.enrol((2.0, 0.0))
    stage.shows_for(1.0, legs((2.0, 0.0), 0.0))
    stage.shows_for(1.0, NOBODY)
    return stage


def test_who_comes_back_soon_and_near_is_the_person() -> None:
    assert place(gone().shows_for(0.5, legs((2.4, 0.8), 0.0))) == pytest.approx((2.4, 0.8), abs=0.2)


def test_who_comes_soon_but_far_off_is_not() -> None:
    assert gone().shows_for(1.0, legs((3.5, -2.5), 0.0)).phase is TrackPhase.LOST


def test_a_few_seconds_later_it_is_who_stands_alone_in_view() -> None:
    stage = gone()
    stage.shows_for(4.0, NOBODY)
    assert stage.shows_for(0.8, legs((2.0, 0.0), 0.0)).phase is TrackPhase.CONFIRMED


def test_long_after_only_who_steps_up_is_the_person() -> None:
    stage = gone()
    stage.stamp += 30.0
    assert stage.shows_for(3.0, legs((2.0, 0.0), 0.0)).phase is TrackPhase.LOST
    assert stage.shows_for(0.8, legs((0.85, 0.1), 0.0)).phase is TrackPhase.CONFIRMED


@pytest.mark.parametrize(("later", "at"), [(4.0, (2.0, 0.0)), (30.0, (0.85, 0.1))])
def test_who_stepped_up_may_be_anybody_and_is_not_followed_until_enrolled(
    later: float, at: tuple[float, float]
) -> None:
    """FAILSAFES F9: nobody else is ever adopted; back soon, they are still themselves."""
    least, stage = ModeSettings().min_confidence, gone()
    stage.stamp += later
    back = stage.shows_for(1.0, legs(at, 0.0))
    assert back.phase is TrackPhase.CONFIRMED
    assert back.confidence < least
    assert gone().shows_for(1.0, legs((2.0, 0.0), 0.0)).confidence > least
    stage.enrol(at)
    assert stage.shows_for(0.5, legs(at, 0.0)).confidence > least


def test_who_stands_near_when_it_looks_again_after_a_while_is_not_the_person() -> None:
    """Without odometry a robot may have been blind for seconds."""
    stage = Stage()
    stage.enrol((1.6, -0.2))
    stage.shows_for(2.0, legs((1.6, -0.2), 0.0))
    stage.stamp += 5.0
    two = np.concatenate([legs((1.1, -1.4), 0.0), legs((3.6, -0.4), 0.0)])
    assert stage.shows_for(1.0, two).confidence < ModeSettings().min_confidence


@pytest.mark.parametrize("later", [4.0, 30.0])
def test_of_two_who_step_up_it_is_neither(later: float) -> None:
    stage = gone()
    stage.stamp += later
    two = np.concatenate([legs((0.85, 0.1), 0.0), legs((1.2, -0.9), 0.0)])
    assert stage.shows_for(2.0, two).phase is TrackPhase.LOST


def test_who_stood_beside_the_person_is_not_taken_for_them() -> None:
    stage = Stage()
    other = legs((2.2, 1.0), 0.0)
    stage.enrol((2.0, 0.0))
    stage.shows_for(1.5, np.concatenate([legs((2.0, 0.0), 0.0), other]))
    assert stage.shows_for(5.0, other).phase is TrackPhase.LOST


def test_speckle_in_the_sun_keeps_no_track_alive() -> None:
    stage = Stage(step_deg=0.35)
    stage.enrol((2.0, 0.0))
    for step in range(60):
        spots = stage.rng.uniform((0.8, -2.0, 0.002), (5.0, 2.0, 0.012), (25, 3))
        person = legs((2.0, 0.0), 0.0) if step < 20 else NOBODY
        state = stage.shows(np.concatenate([spots, person]))
        if step == 19:
            assert state.phase is TrackPhase.CONFIRMED
    assert state.phase is TrackPhase.LOST


def test_confidence_falls_while_hidden_and_returns() -> None:
    stage = Stage()
    stage.enrol((2.0, 0.0))
    seen = stage.shows_for(2.0, legs((2.0, 0.0), 0.0)).confidence
    hidden = stage.shows_for(0.5, NOBODY).confidence
    again = stage.shows_for(2.0, legs((2.0, 0.0), 0.0)).confidence
    assert hidden < 0.5 < 0.9 < min(seen, again)


def test_what_is_no_scan_or_comes_late_says_nothing() -> None:
    follower = tracker()
    scan = scan_of(legs((2.0, 0.0), 0.0), 1.0)
    assert follower.step(scan, None) is None
    follower.enrol(scan, (2.0, 0.0), None)
    assert follower.step(scan, None) is None
    assert follower.step(Odometry(2.0, 2.0, Pose2(), Twist()), None) is None
    assert follower.step(scan_of(NOBODY, 1.1), None) is not None
    follower.forget()
    assert follower.step(scan_of(NOBODY, 1.2), None) is None


def test_a_scan_without_a_pose_is_passed_over_once_there_was_odometry() -> None:
    follower = tracker()
    follower.enrol(scan_of(legs((2.0, 0.0), 0.0)), (2.0, 0.0), Pose2(1.0, 0.0))
    assert follower.step(scan_of(legs((2.0, 0.0), 0.0), 0.1), None) is None


def test_it_is_enrolled_by_a_point_in_a_scan_where_something_stands() -> None:
    scan = scan_of(legs((2.0, 0.0), 0.0))
    image = Image(0, 0.0, 0.0, np.zeros((4, 4, 3), np.uint8), Camera.from_hfov(4, 4, 0.8))
    with pytest.raises(UsageError, match="a point"):
        tracker().enrol(image, (2.0, 2.0), None)
    with pytest.raises(UsageError, match="a point"):
        tracker().enrol(scan, Box(1, 1, 2, 2), None)
    with pytest.raises(UsageError, match="nothing stands within"):
        tracker().enrol(scan, (4.0, 1.0), None)


def test_a_cloud_with_no_candidate_only_grows() -> None:
    walker = Walker((1.0, 2.0), WalkerSettings(), np.random.default_rng(5))
    none = np.empty((0, 2)), np.empty(0, np.bool_), np.empty(0)
    walker.predict(0.1, False)
    walker.update(*none)
    before = walker.spread
    walker.predict(0.1, False)
    walker.update(*none)
    assert walker.spread > before
    assert walker.support == 0.0


@pytest.mark.parametrize("company", [False, True])
def test_after_a_blind_time_whoever_is_near_is_the_person_if_nobody_else_was(company: bool) -> None:
    stage = Stage()
    stage.enrol((2.0, 0.0))
    other = legs((2.2, 1.5), 0.0) if company else NOBODY
    assert stage.shows_for(1.0, np.vstack([legs((2.0, 0.0), 0.0), other])).confidence > 0.9
    stage.stamp += 1.5
    again = stage.shows_for(2.0, legs((2.2, 0.4), 0.0))
    assert (again.confidence > ModeSettings().min_confidence) is not company
