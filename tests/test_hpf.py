"""The tracker follows a painted person from a moving robot, and knows when nobody is there."""

from collections.abc import Iterator
from math import radians

import cv2
import numpy as np
import pytest

from followerd.errors import ConfigError, UsageError
from followerd.geometry import Camera, Pose2
from followerd.messages import Box, Image, Odometry, Pixels, Place, TrackPhase, TrackState, Twist
from followerd.trackers.hpf import Hpf, HpfSettings
from followerd.trackers.interfaces import Tracker
from followerd.trackers.registry import TRACKERS

CAMERA = Camera.from_hfov(192, 144, radians(48), z=0.6, elevation=radians(-5))
RATE = 15
PROFILES = pytest.mark.parametrize("profile", ["paper", "default"])


def hpf(profile: str = "default", seed: int = 0, **more: object) -> Hpf:
    settings = HpfSettings.model_validate({"profile": profile, **more})
    return Hpf(settings, np.random.default_rng(seed))


def background() -> Pixels:
    """A wide, patterned wall and floor, to be seen through a window that pans."""
    rng = np.random.default_rng(1)
    coarse = rng.integers(70, 150, (12, 60, 1), dtype=np.uint8).repeat(3, axis=2)
    return cv2.resize(coarse, (960, 144), interpolation=cv2.INTER_NEAREST).astype(np.uint8)


WALL = background()


def picture(number: int, person: Box | None, pan: int = 0) -> Image:
    """A person in blue trousers and a red shirt before the wall, which has moved `pan` px."""
    rng = np.random.default_rng(number)
    pixels = WALL[:, 300 - pan : 492 - pan].astype(float)
    if person is not None:
        left, top = round(person.x), round(person.y)
        right, bottom = round(person.x + person.w), round(person.y + person.h)
        middle = (top + bottom) // 2
        pixels[max(top, 0) : max(middle, 0), max(left, 0) : max(right, 0)] = (40, 35, 190)
        pixels[max(middle, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = (170, 60, 40)
    pixels += rng.normal(0.0, 4.0, pixels.shape)
    stamp = number / RATE
    return Image(number, stamp, stamp, np.clip(pixels, 0, 255).astype(np.uint8), CAMERA)


def walk(frames: int = 45) -> Iterator[tuple[Image, Box]]:
    """A person who wanders to the right before a camera that stands still."""
    for k in range(frames):
        person = Box(40.0 + 1.5 * k, 40.0 + 4.0 * np.sin(0.2 * k), 26.0, 62.0)
        yield picture(k, person), person


def follow(tracker: Hpf, scene: Iterator[tuple[Image, Box]]) -> list[tuple[TrackState, Box]]:
    """Enrol in the first image, then step; odometry says that the robot stands."""
    image, person = next(scene)
    states = [(tracker.enrol(image, person, Pose2()), person)]
    for image, person in scene:
        state = tracker.step(image, Pose2())
        assert state is not None
        states.append((state, person))
    return states


def apart(state: TrackState, person: Box) -> float:
    assert state.box is not None
    return float(np.hypot(*np.subtract(state.box.centre, person.centre)))


@PROFILES
def test_it_follows_a_walking_person(profile: str) -> None:
    # a red shirt over blue trousers: the paper's single colour sees the part it was taught
    scene = walk()
    if profile == "paper":
        scene = ((image, Box(p.x, p.y, p.w, 0.5 * p.h)) for image, p in scene)
    states = follow(hpf(profile), scene)
    assert max(apart(*pair) for pair in states) < 6.0
    last = states[-1][0]
    assert last.phase is TrackPhase.CONFIRMED
    assert last.confidence > 0.7
    assert last.box is not None
    assert last.box.h == pytest.approx(states[-1][1].h, rel=0.25)
    assert last.bearing == pytest.approx(CAMERA.bearing(states[-1][1].centre[0]), abs=0.03)


@PROFILES
def test_the_same_seed_gives_the_same_track(profile: str) -> None:
    one, two = ([s.box for s, _ in follow(hpf(profile, 7), walk(20))] for _ in range(2))
    assert one == two
    assert one != [s.box for s, _ in follow(hpf(profile, 8), walk(20))]


@PROFILES
def test_the_track_does_not_depend_on_frames_to_come(profile: str) -> None:
    whole = [s.box for s, _ in follow(hpf(profile), walk(30))]
    assert [s.box for s, _ in follow(hpf(profile), walk(12))] == whole[:12]


@pytest.mark.parametrize("template", [True, False])
def test_somebody_who_has_gone_is_called_lost(template: bool) -> None:
    tracker = hpf(template=template)
    follow(tracker, walk(15))
    gone = [tracker.step(picture(k, None), Pose2()) for k in range(15, 45)]
    lost = [state.phase for state in gone if state is not None][15:]
    assert set(lost) == {TrackPhase.LOST}
    last = gone[-1]
    assert last is not None
    assert (last.box, last.range, last.position) == (None, None, None)
    assert last.confidence < 0.5


def test_somebody_who_comes_back_elsewhere_is_found_again() -> None:
    tracker = hpf()
    follow(tracker, walk(15))
    for k in range(15, 45):
        tracker.step(picture(k, None), Pose2())
    person = Box(140.0, 45.0, 26.0, 62.0)
    states = [tracker.step(picture(k, person), Pose2()) for k in range(45, 60)]
    last = states[-1]
    assert last is not None
    assert last.phase is TrackPhase.CONFIRMED
    assert apart(last, person) < 6.0


def test_a_refuted_track_is_unsure_at_once_and_looks_anew() -> None:
    tracker = hpf()
    follow(tracker, walk(15))
    scene = list(walk(30))[15:]
    refuted = Place(3.0, 0.0, 2.0, seen=False, refuted=True)
    state = tracker.step(scene[0][0], Pose2(), refuted)
    assert state is not None
    assert state.phase is not TrackPhase.CONFIRMED
    after = [tracker.step(image, Pose2()) for image, _ in scene[1:]][-1]
    assert after is not None
    assert after.phase is TrackPhase.CONFIRMED
    assert apart(after, scene[-1][1]) < 6.0


def test_without_odometry_the_image_tells_how_the_camera_turns() -> None:
    tracker = hpf()
    pan = 0
    person = Box(80.0, 40.0, 26.0, 62.0)
    tracker.enrol(picture(0, person), person, None)
    for k in range(1, 40):  # the camera swings to and fro; the person stands before the wall
        pan += 6 if (k // 8) % 2 else -6
        person = Box(80.0 + pan, 40.0, 26.0, 62.0)
        state = tracker.step(picture(k, person, pan), None)
        assert state is not None
        assert apart(state, person) < 7.0


def test_odometry_tells_how_the_camera_turns() -> None:
    blue = Box(83.0, 60.0, 26.0, 40.0)
    tracker = hpf("paper")
    tracker.enrol(picture(0, blue), Box(83.0, 80.0, 26.0, 20.0), Pose2())
    bearing, heading = CAMERA.bearing(96.0), 0.0
    for k in range(1, 30):
        heading += radians(4.0) * (1 if (k // 4) % 2 else -1)
        x = CAMERA.column(bearing - heading) - 13.0
        state = tracker.step(picture(k, Box(x, 60.0, 26.0, 40.0)), Pose2(theta=heading))
        assert state is not None
        assert apart(state, Box(x, 80.0, 26.0, 20.0)) < 6.0


def standing(distance: float) -> Box:
    """How a person 1.5 m tall straight ahead looks."""
    foot, head = CAMERA.project(np.array([[distance, 0.0, 0.0], [distance, 0.0, 1.5]]))
    w = 0.5 * CAMERA.fx / foot[2]
    return Box(foot[0] - 0.5 * w + 0.5, head[1] + 0.5, w, foot[1] - head[1])


@pytest.mark.parametrize("distance", [2.0, 3.0, 4.0])
def test_the_foot_point_gives_the_range_and_its_uncertainty(distance: float) -> None:
    person = standing(distance)
    state = hpf().enrol(picture(0, person), person, Pose2(1.0, 2.0, radians(90)))
    assert state.range == pytest.approx(distance, abs=0.05)
    assert state.range_sigma is not None
    assert 0.05 < state.range_sigma < 0.15 * distance
    assert state.position == pytest.approx((1.0, 2.0 + distance), abs=0.08)


def test_without_odometry_there_is_no_position_but_a_range() -> None:
    person = standing(3.0)
    state = hpf().enrol(picture(0, person), person, None)
    assert state.range is not None
    assert state.position is None


def test_feet_out_of_view_give_no_range_by_themselves() -> None:
    state = hpf().enrol(picture(0, person := Box(80.0, 60.0, 30.0, 84.0)), person, Pose2())
    assert state.range is None
    assert state.bearing is not None


def test_a_shirt_is_not_ranged_as_if_it_stood_on_the_floor() -> None:
    # its lower edge, taken for a foot, would belong to a giant
    state = hpf().enrol(picture(0, shirt := Box(60.0, 0.0, 70.0, 60.0)), shirt, Pose2())
    assert state.range is None


def test_a_click_enrols_the_region_under_it() -> None:
    person = Box(80.0, 40.0, 26.0, 62.0)
    state = hpf().enrol(picture(0, person), (93.0, 85.0), None)
    assert state.box is not None
    assert (state.box.x, state.box.w) == pytest.approx((80.0, 26.0), abs=4.0)
    assert state.box.y > 60.0


@PROFILES
def test_a_box_outside_the_image_is_a_usage_error(profile: str) -> None:
    with pytest.raises(UsageError, match="outside the image of 192x144"):
        hpf(profile).enrol(picture(0, None), Box(500.0, 20.0, 30.0, 60.0), None)


def test_a_grey_camera_is_a_usage_error() -> None:
    image = Image(0, 0.0, 0.0, np.zeros((144, 192), np.uint8), CAMERA)
    with pytest.raises(UsageError, match="grey"):
        hpf().enrol(image, Box(10.0, 10.0, 20.0, 40.0), None)


def test_what_it_does_not_use_says_nothing() -> None:
    tracker = hpf()
    odometry = Odometry(0.0, 0.0, Pose2(), Twist())
    assert tracker.step(picture(0, None), Pose2()) is None
    image, person = next(walk())
    tracker.enrol(image, person, Pose2())
    assert tracker.step(odometry, Pose2()) is None
    assert tracker.step(image, Pose2()) is None  # not newer than the one it was enrolled in
    tracker.forget()
    assert tracker.step(picture(3, person), Pose2()) is None


@PROFILES
def test_images_of_any_size_and_gap_are_survived(profile: str) -> None:
    camera = Camera.from_hfov(641, 479, radians(48))
    rng = np.random.default_rng(2)
    tracker = hpf(profile)
    for number, stamp in enumerate((0.0, 0.04, 5.0, 5.04, 5.08, 60.0)):
        pixels = rng.integers(0, 256, (479, 641, 3), dtype=np.uint8)
        image = Image(number, stamp, stamp, pixels, camera)
        if number == 0:
            tracker.enrol(image, Box(3.0, 3.0, 500.0, 470.0), None)
        else:
            state = tracker.step(image, None)
            assert state is not None
            assert state.box is None or np.isfinite([*state.box.centre, state.box.w]).all()


@PROFILES
def test_the_number_of_particles_is_the_one_asked_for(profile: str) -> None:
    state = follow(hpf(profile, particles=40), walk(5))[-1][0]
    assert state.particles is not None
    assert state.particles.shape == (40, 2)


def test_the_registry_knows_it_by_name() -> None:
    tracker: Tracker = TRACKERS.load("hpf")(HpfSettings(), np.random.default_rng(0))
    assert tracker.needs == {"image"}
    with pytest.raises(ConfigError, match=r"known are .*hpf"):
        TRACKERS.load("hpv")


def test_a_known_distance_says_how_large_the_person_looks() -> None:
    person = standing(3.0)
    tracker = hpf()
    tracker.enrol(picture(0, person), person, Pose2())
    for k in range(1, 16):
        near = tracker.step(picture(k, person), Pose2(), Place(3.0, 0.0))
    for k in range(16, 31):  # the picture stays, the other sensor insists that they come nearer
        near = tracker.step(picture(k, person), Pose2(), Place(2.4, 0.0))
    assert near is not None
    assert near.box is not None
    assert near.box.w > 1.08 * person.w
