"""A person on a map, hidden behind a board; a robot that is lost, or finds itself elsewhere."""

from functools import cache
from math import hypot

import numpy as np
import pytest

from followerd.control.mode import ModeSettings
from followerd.errors import ConfigError, UsageError
from followerd.geometry import Array, Camera, Pose2
from followerd.maps.floor import FloorMap, OccupancyGrid
from followerd.maps.plan import from_segments
from followerd.messages import Box, Image, RobotPose, Scan, TrackPhase, TrackState
from followerd.trackers.beliefs import Profile
from followerd.trackers.interfaces import Foreseeing, MapTracker
from followerd.trackers.stream_field import StreamFieldTracker, StreamFieldTrackerSettings
from tests.laser_scenes import legs, scan_of

PERIOD = 0.1  # s
MAP_FROM_ODOM = Pose2(1.0, 2.0, 0.5)
HERE = Pose2(1.0, 3.0, 0.0)  # of the robot on the map
BOARD = ((3.5, 2.6), (3.5, 3.6))
CORNERS = [(0.0, 0.0), (8.0, 0.0), (8.0, 6.0), (0.0, 6.0)]
WALLS: Array = np.array([*zip(CORNERS, [*CORNERS[1:], CORNERS[0]], strict=True), BOARD])


@cache
def floor() -> FloorMap:
    return from_segments(WALLS)


class Stage:
    """A robot that stands, and a person who walks along x = 4.2 behind the board."""

    def __init__(self, profile: Profile = "default") -> None:
        settings = StreamFieldTrackerSettings(profile=profile)
        self.tracker = StreamFieldTracker(settings, np.random.default_rng(3))
        self.tracker.enter(floor())
        self.rng = np.random.default_rng(5)
        self.ego = ~MAP_FROM_ODOM @ HERE
        self.stamp = 0.0
        self.person = (4.2, 5.0)
        self.heading = -1.57  # rad
        self.map_from_odom: Pose2 | None = MAP_FROM_ODOM
        self.others: list[tuple[float, float]] = []

    def pose(self) -> RobotPose | None:
        if self.map_from_odom is None:
            return None
        there = self.map_from_odom @ self.ego
        return RobotPose(self.stamp, there, self.map_from_odom, np.diag([1e-4, 1e-4, 1e-5]))

    def enrol(self) -> TrackState:
        self.tracker.locate(self.pose(), self.ego)
        point = (~HERE).apply_point(*self.person)
        return self.tracker.enrol(self.scan(0.0), point, self.ego)

    def walk(self, seconds: float, speed: float = -0.6) -> TrackState:
        """The person goes along y."""
        state: TrackState | None = None
        for _ in range(round(seconds / PERIOD)):
            self.stamp += PERIOD
            self.person = (self.person[0], self.person[1] + speed * PERIOD)
            self.tracker.locate(self.pose(), self.ego)
            state = self.tracker.step(self.scan(abs(speed) * self.stamp), self.ego)
        assert state is not None
        return state

    def off(self, state: TrackState) -> float:
        """Of the track's place in `odom` from the truth, m."""
        assert state.position is not None
        x, y = (~MAP_FROM_ODOM).apply_point(*self.person)
        return hypot(state.position[0] - x, state.position[1] - y)

    def scan(self, walked: float) -> Scan:
        people = [legs(at, self.heading, walked) for at in (self.person, *self.others)]
        circles, walls = np.vstack(people), WALLS.reshape(-1, 4)
        return scan_of(circles, self.stamp, walls=walls, pose=HERE, rng=self.rng)


def test_it_is_one_of_the_trackers_on_a_map() -> None:
    tracker = StreamFieldTracker(StreamFieldTrackerSettings(), np.random.default_rng(0))
    assert isinstance(tracker, MapTracker)
    assert isinstance(tracker, Foreseeing)
    assert not tracker.courses().size  # nobody is enrolled


@pytest.mark.parametrize(
    "profile",
    ["default", "paper"]
    + [pytest.param(name, marks=pytest.mark.slow) for name in ("kf_cv", "sir_pf", "pf_sf")],
)
def test_a_person_is_followed_behind_a_board_and_out_again(profile: Profile) -> None:
    stage = Stage(profile)
    assert stage.enrol().phase is TrackPhase.TENTATIVE
    seen = stage.walk(1.2)
    assert seen.phase is TrackPhase.CONFIRMED
    assert stage.off(seen) < 0.15
    hidden = stage.walk(1.8)
    assert hidden.phase is TrackPhase.OCCLUDED
    assert hidden.range_sigma is not None
    assert seen.range_sigma is not None
    assert hidden.range_sigma > 2.0 * seen.range_sigma
    assert hidden.confidence < seen.confidence
    assert stage.off(hidden) < 0.6
    assert hidden.position is not None
    courses = stage.tracker.courses()
    if profile in ("default", "paper", "pf_sf"):
        assert np.hypot(*(courses[:, 0] - hidden.position).T) == pytest.approx(0.0, abs=0.3)
        assert np.hypot(*(courses[:, -1] - courses[:, 0]).T).max() > 0.5
    else:
        assert courses.shape == (0, 0, 2)
    back = stage.walk(2.6)
    assert back.phase is TrackPhase.CONFIRMED
    assert stage.off(back) < 0.15
    assert back.velocity is not None
    assert hypot(*back.velocity) == pytest.approx(0.6, abs=0.3)


def test_a_stranger_who_comes_while_the_person_is_hidden_is_not_taken_for_them() -> None:
    stage = Stage()
    stage.others = [(2.2, 4.6)]
    stage.enrol()
    stage.walk(2.6)
    for _ in range(10):
        stage.others = [(stage.others[0][0], stage.others[0][1] - 0.06)]
        state = stage.walk(PERIOD, 0.0)
        assert stage.off(state) < 1.0


@pytest.mark.slow
def test_who_stays_away_is_lost_without_a_place_and_found_when_they_step_up() -> None:
    stage = Stage()
    stage.enrol()
    stage.walk(2.8)
    lost = stage.walk(9.0, 0.0)
    assert lost.phase is TrackPhase.LOST
    assert lost.position is None
    stage.person, stage.heading = (3.0, 3.0), 0.0
    assert stage.walk(0.3, 0.0).phase is TrackPhase.LOST
    stage.person = (1.9, 3.0)
    again = stage.walk(3.0, 0.0)
    assert again.phase is TrackPhase.CONFIRMED
    assert again.confidence < ModeSettings().min_confidence  # whoever steps up may be anybody
    assert stage.off(again) < 0.15


def test_who_stands_there_after_a_blind_time_is_nobody_known() -> None:
    stage = Stage()
    stage.enrol()
    assert stage.walk(1.2).phase is TrackPhase.CONFIRMED
    stage.stamp += 2.5  # the base says nothing, then does again
    assert stage.walk(2 * PERIOD, 0.0).phase is TrackPhase.LOST
    again = stage.walk(3.0, 0.0)
    assert again.confidence < ModeSettings().min_confidence


def test_a_robot_that_is_lost_follows_on_by_its_odometry() -> None:
    stage = Stage()
    stage.enrol()
    stage.walk(0.5, 0.0)
    stage.map_from_odom = None
    state = stage.walk(3.0, 0.0)
    assert state.phase is TrackPhase.CONFIRMED
    assert stage.off(state) < 0.15
    stage.map_from_odom = MAP_FROM_ODOM
    assert stage.walk(0.5, 0.0).phase is TrackPhase.CONFIRMED


def test_a_jump_on_the_map_leaves_the_person_in_odom_and_makes_them_unsure() -> None:
    """FAILSAFES F17."""
    stage = Stage()
    stage.enrol()
    stage.walk(0.5, 0.0)
    stage.map_from_odom = Pose2(0.7, 0.0, 0.0) @ MAP_FROM_ODOM
    stage.stamp += PERIOD
    stage.tracker.locate(stage.pose(), stage.ego)
    state = stage.tracker.step(stage.scan(0.0), stage.ego)
    assert state is not None
    assert state.phase is TrackPhase.TENTATIVE
    assert stage.off(state) < 0.25


def test_what_cannot_be_followed_is_refused() -> None:
    stage = Stage()
    scan = stage.scan(0.0)
    with pytest.raises(UsageError, match="does not know yet"):
        stage.tracker.enrol(scan, (3.0, 1.0), stage.ego)
    stage.tracker.locate(stage.pose(), stage.ego)
    with pytest.raises(UsageError, match="nothing stands"):
        stage.tracker.enrol(scan, (0.7, 0.0), stage.ego)
    image = Image(0, 0.0, 0.0, np.zeros((4, 4), np.uint8), Camera.from_hfov(4, 4, 0.8))
    with pytest.raises(UsageError, match="not a box"):
        stage.tracker.enrol(image, Box(0, 0, 2, 2), stage.ego)
    assert stage.tracker.step(scan, stage.ego) is None
    off_map = StreamFieldTracker(StreamFieldTrackerSettings(), stage.rng)
    with pytest.raises(UsageError, match="needs a map"):
        off_map.enrol(scan, (3.0, 1.0), stage.ego)
    nowhere = np.zeros((20, 20), np.bool_)
    with pytest.raises(ConfigError, match="no free floor"):
        off_map.enter(FloorMap(OccupancyGrid(~nowhere, nowhere, 0.1, (0.0, 0.0)), WALLS))
