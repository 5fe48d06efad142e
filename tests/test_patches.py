"""Patches, their detector and the tracker `patches`, on RGB-D scenes made for the purpose."""

from math import hypot, radians

import cv2
import numpy as np
import pytest

from followerd.errors import UsageError
from followerd.geometry import Array, Camera, Pose2
from followerd.messages import Box, Image, Pixels, Scan, TrackPhase, TrackState
from followerd.perception.cells import Buffers, CellHistograms
from followerd.perception.colour_bins import COLOURS, GREYS, colour_bins, dithered
from followerd.perception.depth_band import modes, person_mode, torso_depth
from followerd.perception.depth_people import bodies
from followerd.perception.patch_detector import DetectorSettings, Found, PatchDetector
from followerd.perception.spot import BEHIND, Spot, in_base, in_image, levelled, row, scale
from followerd.perception.texture import FLAT, PATTERN, patterns
from followerd.trackers.patches import Patches, PatchesSettings

CAMERA = Camera.from_hfov(320, 240, radians(62.7), z=0.9)
RATE = 15.0
W, H = 0.5, 1.7  # m, of a person
SHAPE = 240, 320
RED, GREEN = (40, 40, 170), (60, 130, 40)
BLUE, BROWN = (130, 70, 40), (50, 80, 110)


def cloth(seed: int, upper: tuple[int, int, int], lower: tuple[int, int, int]) -> Array:
    """A person's picture (170, 50, 3): two colours and folds."""
    noise = np.random.default_rng(seed).standard_normal((170, 50))
    folds = 1.0 + 0.1 * np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.5)) * 3
    colours = np.empty((170, 50, 3))
    colours[:85], colours[85:] = upper, lower
    painted: Array = colours * folds[..., None]
    return painted


ANN, BOB = cloth(1, RED, BLUE), cloth(2, GREEN, BROWN)
WALL = 120.0 + 10.0 * np.random.default_rng(3).standard_normal((*SHAPE, 3))


def box_at(x: float, y: float) -> Box:
    """A person's box, standing at (x, y) of `base`."""
    left, top, depth = CAMERA.project(np.array([[x, y, H]]))[0]
    metre = CAMERA.fx / depth
    return Box(left - 0.5 * W * metre, top, W * metre, H * metre)


def image(
    number: int,
    *people: tuple[Array, float, float],
    gain: float = 1.0,
    depth: bool = True,
) -> Image:
    """A wall 4 m away and people at (x, y) of `base`, the farthest first."""
    scene, far = WALL.copy(), np.full(SHAPE, 4.0, np.float32)
    for look, x, y in people:
        b = box_at(x, y)
        left, top, right, bottom = (round(v) for v in (b.x, b.y, b.x + b.w, b.y + b.h))
        drawn = cv2.resize(look, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
        rows = slice(max(top, 0), min(bottom, SHAPE[0]))
        columns = slice(max(left, 0), max(min(right, SHAPE[1]), 0))
        if columns.stop <= columns.start:
            continue
        part = np.asarray(drawn)[rows.start - top : rows.stop - top]
        scene[rows, columns] = part[:, columns.start - left : columns.stop - left]
        far[rows, columns] = x - BEHIND
    noise = np.random.default_rng(number).standard_normal(scene.shape)
    pixels: Pixels = np.clip(gain * scene + 2.0 * noise, 0, 255).astype(np.uint8)
    stamp = number / RATE
    return Image(number, stamp, stamp, pixels, CAMERA, far if depth else None)


def enrolled(**changes: object) -> Patches:
    """A tracker that knows Ann, 2.5 m ahead."""
    settings = PatchesSettings.model_validate(changes)
    tracker = Patches(settings, np.random.default_rng(0))
    tracker.enrol(image(0, (ANN, 2.5, 0.0)), box_at(2.5, 0.0), None)
    return tracker


def stepped(tracker: Patches, seen: Image, ego: Pose2 | None = None) -> TrackState:
    state = tracker.step(seen, ego)
    assert state is not None
    return state


def off(tracker: Patches, x: float, y: float) -> float:
    """How far the track is from (x, y), m."""
    assert tracker.place is not None
    return hypot(tracker.place[0] - x, tracker.place[1] - y)


# the parts


def test_a_patterns_code_does_not_change_as_it_turns() -> None:
    for code in range(256):
        turned = ((code << 1) | (code >> 7)) & 255
        assert PATTERN[code] == PATTERN[turned]
    assert sorted(set(PATTERN.tolist())) == list(range(10))


def test_even_cloth_has_no_pattern_and_an_edge_has_one() -> None:
    grey: Pixels = np.full((6, 8), 100, np.uint8)
    grey[:, 4:] = 160
    found = patterns(grey)
    assert (found[:, :3] == FLAT).all()
    assert (found[2:4, 4] == 5).all()  # five neighbours at least as bright, in one run


def test_colours_are_told_apart_and_greys_have_only_brightness() -> None:
    picture: Pixels = np.array([[RED, GREEN, BLUE, (90, 90, 92), (90, 92, 90)]], np.uint8)
    red, green, blue, one, other = colour_bins(picture)[0].tolist()
    assert len({red, green, blue, one}) == 4
    assert one == other
    assert max(red, green, blue) < COLOURS
    assert colour_bins(np.array([[0, 255]], np.uint8)).max() < GREYS


def test_brightness_near_the_border_of_two_bins_counts_for_both() -> None:
    """So that a little more light does not make another colour of it."""

    def shares(value: int) -> Array:
        cloth = np.full((40, 40, 3), value, np.uint8)
        return np.bincount(colour_bins(dithered(cloth)).ravel(), minlength=COLOURS) / 1600

    darker, brighter = shares(93), shares(99)
    alike = darker @ brighter / np.linalg.norm(darker) / np.linalg.norm(brighter)
    assert alike > 0.9
    assert colour_bins(np.full((1, 1), 93, np.uint8)) != colour_bins(np.full((1, 1), 99, np.uint8))
    grey = np.full((40, 40), 93, np.uint8)
    assert np.array_equal(dithered(grey), dithered(np.dstack([grey] * 3))[..., 1])


def test_histograms_of_cells_are_those_counted_by_hand() -> None:
    rng = np.random.default_rng(0)
    first, second = (rng.integers(0, n, (40, 60)).astype(np.uint8) for n in (5, 3))
    mask = rng.random((40, 60)) < 0.7
    table = CellHistograms((first, second), (5, 3), mask, 4, Buffers(), left=100, top=20)
    found = table.of(np.array([[104.0, 120.0, 300.0]]), np.array([[20.0, 32.0]]))[0]
    for k, columns in enumerate((slice(4, 20), slice(20, 60))):
        inside = mask[:12, columns]
        byhand = [np.bincount(f[:12, columns][inside], minlength=n)
                  for f, n in ((first, 5), (second, 3))]  # fmt: skip
        assert found[k].tolist() == np.concatenate(byhand).tolist()


def test_the_persons_mode_is_where_they_are_expected_not_the_nearest() -> None:
    depth = np.full(SHAPE, 4.0, np.float32)
    depth[:, 100:200], depth[:, 100:130] = 2.5, 1.9
    found = modes(depth, Box(100, 0, 100, 240))
    assert [round(mode.depth, 1) for mode in found] == [1.9, 2.5]
    person = person_mode(found, 2.6, 0.4)
    assert person is not None
    assert person.depth == pytest.approx(2.5)
    assert person_mode(found, 3.2, 0.4) is None


def test_the_torso_tells_the_depth_whatever_the_legs_do() -> None:
    depth = np.full(SHAPE, 4.0, np.float32)
    depth[40:200, 120:170], depth[120:200, 120:145] = 2.5, 2.3
    box = Box(120, 40, 50, 160)
    assert torso_depth(depth, box, 2.4) == pytest.approx(2.5)
    depth[60:130, 100:190] = 1.8
    assert torso_depth(depth, box, 2.5) is None


def test_a_spot_is_the_same_place_in_the_image_and_in_base() -> None:
    tilted = Camera.from_hfov(320, 240, 1.1, x=0.1, z=0.9, yaw=0.3, elevation=-0.2)
    spot = Spot(140.0, 110.0, 2.2)
    back = in_image(tilted, in_base(tilted, spot))
    assert back is not None
    assert (back.u, back.v) == pytest.approx((140.0, 110.0))
    level = in_base(CAMERA, Spot(100.0, row(CAMERA, 2.4, 0.7), 2.4))
    assert level[2] == pytest.approx(0.7)


def test_before_a_camera_that_looks_down_an_upright_body_is_of_one_depth() -> None:
    camera = Camera.from_hfov(320, 240, 1.1, z=2.0, elevation=-0.4, yaw=0.2)
    parts = np.array([[2.5, 0.3, height] for height in (0.2, 0.9, 1.6)])
    for _, v, along in camera.project(parts).tolist():
        flat = levelled(camera, np.full(SHAPE, along, np.float32))
        assert flat[round(v), 0] == pytest.approx(2.51, abs=0.01)
    spot = in_image(camera, parts[1])
    assert spot is not None
    assert row(camera, spot.depth, 0.9) == pytest.approx(spot.v)
    ends = camera.project(parts[[1, 1]] + np.array([[0.0, 0.0, 0.05], [0.0, 0.0, -0.05]]))
    _, up = scale(camera, spot.v, spot.depth + BEHIND)
    assert (ends[1, 1] - ends[0, 1]) / 0.1 == pytest.approx(up, rel=1e-3)


def test_bodies_are_found_among_walls() -> None:
    seen = image(0, (ANN, 2.9, 0.6), (BOB, 2.0, -0.4))
    assert seen.depth is not None
    found = sorted(middle for _, middle in bodies(seen.depth, CAMERA))
    assert found == pytest.approx([1.9, 2.8], abs=0.02)


def test_feet_on_the_floor_do_not_make_a_body_as_wide_as_the_floor() -> None:
    seen = image(0, (ANN, 2.5, 0.1))
    assert seen.depth is not None
    down, _ = np.mgrid[: CAMERA.height, : CAMERA.width]
    with np.errstate(divide="ignore"):
        floor = (CAMERA.z * CAMERA.fy / (down - CAMERA.cy)).astype(np.float32)
    floor[: int(CAMERA.cy) + 1] = np.inf
    depth = np.fmin(seen.depth, floor)
    assert [middle for _, middle in bodies(depth, CAMERA)] == pytest.approx([2.4], abs=0.02)


# the tracker


def test_a_walking_person_is_placed_within_centimetres() -> None:
    tracker = enrolled()
    for k in range(1, 16):
        x, y = 2.5 + 0.02 * k, 0.03 * k
        state = stepped(tracker, image(k, (ANN, x, y)))
        assert state.phase is TrackPhase.CONFIRMED
    assert off(tracker, x, y) < 0.05
    assert tracker.place is not None
    assert tracker.place[2] == pytest.approx(0.5 * H, abs=0.05)
    assert state.patches is not None  # to be drawn: all over the person, and like them
    assert np.nanmedian(state.patches[:, 4]) > 0.9
    corners = state.patches[:, :2], state.patches[:, :2] + state.patches[:, 2:4]
    person = box_at(x, y)
    assert corners[0].min(axis=0) == pytest.approx((person.x, person.y), abs=8.0)
    assert corners[1].max(axis=0) == pytest.approx(
        (person.x + person.w, person.y + person.h), abs=8.0
    )


@pytest.mark.slow
def test_who_passes_before_the_person_is_not_followed() -> None:
    tracker = enrolled()
    phases = []
    for k in range(1, 30):
        passer = (BOB, 1.9, 1.2 - 0.09 * k)
        phases.append(stepped(tracker, image(k, (ANN, 2.5, 0.0), passer)).phase)
        assert off(tracker, 2.5, 0.0) < 0.2
    assert TrackPhase.OCCLUDED in phases
    assert phases[-1] is TrackPhase.CONFIRMED


def test_who_turned_off_while_hidden_is_seen_beside_where_they_were_expected() -> None:
    seen = image(0, (ANN, 2.5, 0.0))
    rng = np.random.default_rng(0)
    detector = PatchDetector(seen, box_at(2.5, 0.0), DetectorSettings(), paper=False)
    expected = in_image(CAMERA, np.array([2.5, 0.55, 0.5 * H]))
    assert expected is not None
    passed = image(1, (ANN, 2.5, 0.0), (BOB, 1.9, 0.6))
    sight = detector.look(passed, expected, 0.6, 0.1, rng)
    assert sight.found is Found.PERSON
    assert sight.spot is not None
    assert in_base(CAMERA, sight.spot)[:2] == pytest.approx((2.5, 0.0), abs=0.08)
    assert detector.look(passed, expected, 0.1, 0.1, rng).found is Found.HIDDEN


@pytest.mark.slow
def test_of_two_who_are_alike_the_nearer_one_is_taken_up_again() -> None:
    tracker = enrolled()
    for k in range(1, 25):
        state = stepped(tracker, image(k))
    assert state.phase is TrackPhase.LOST
    for k in range(25, 29):
        stepped(tracker, image(k, (ANN, 2.5, 0.1), (ANN, 1.8, 0.9)))
    assert off(tracker, 2.5, 0.1) < 0.1


@pytest.mark.slow
def test_a_lamp_that_goes_off_changes_nothing() -> None:
    tracker = enrolled()
    for k, gain in enumerate(np.linspace(1.0, 0.6, 12), 1):
        state = stepped(tracker, image(k, (ANN, 2.5, 0.0), gain=float(gain)))
    assert state.phase is TrackPhase.CONFIRMED


@pytest.mark.slow
def test_without_depth_the_size_tells_the_distance() -> None:
    tracker = enrolled()
    for k in range(1, 8):
        state = stepped(tracker, image(k, (ANN, 2.5, 0.02 * k), depth=False))
    assert state.phase is TrackPhase.CONFIRMED
    assert off(tracker, 2.5, 0.14) < 0.3
    assert state.range_sigma is not None
    assert state.range_sigma > 0.03


@pytest.mark.slow
def test_a_grey_camera_with_depth_is_enough() -> None:
    def grey(k: int) -> Image:
        one = image(k, (ANN, 2.5, 0.01 * k))
        pixels = np.asarray(cv2.cvtColor(one.pixels, cv2.COLOR_BGR2GRAY), np.uint8)
        return Image(k, one.stamp, one.stamp, pixels, CAMERA, one.depth)

    tracker = Patches(PatchesSettings(), np.random.default_rng(0))
    tracker.enrol(grey(0), box_at(2.5, 0.0), None)
    states = [stepped(tracker, grey(k)) for k in range(1, 15)]
    assert {state.phase for state in states} == {TrackPhase.CONFIRMED}
    assert off(tracker, 2.5, 0.14) < 0.06


@pytest.mark.slow
def test_after_a_loss_only_the_enrolled_person_is_taken_up_again() -> None:
    tracker = enrolled()
    for k in range(1, 25):
        state = stepped(tracker, image(k))
    assert state.phase is TrackPhase.LOST
    assert state.box is None
    assert state.bearing is None
    for k in range(25, 33):
        state = stepped(tracker, image(k, (BOB, 2.4, 0.3)))
    assert state.phase is TrackPhase.LOST
    for k in range(33, 36):
        state = stepped(tracker, image(k, (ANN, 2.6, 0.4)))
    assert state.phase is TrackPhase.CONFIRMED
    assert off(tracker, 2.6, 0.4) < 0.1


def test_a_click_finds_the_whole_person() -> None:
    tracker = Patches(PatchesSettings(), np.random.default_rng(0))
    state = tracker.enrol(image(0, (ANN, 2.8, 0.2)), box_at(2.8, 0.2).centre, None)
    true = box_at(2.8, 0.2)
    assert state.box is not None
    assert state.box.y == pytest.approx(true.y, abs=3.0)
    assert state.box.h == pytest.approx(true.h, abs=5.0)


def test_the_track_is_in_odom_where_there_is_odometry() -> None:
    ego = Pose2(1.0, 2.0, 0.5)
    tracker = enrolled()
    tracker.enrol(image(0, (ANN, 2.5, 0.0)), box_at(2.5, 0.0), ego)
    state = stepped(tracker, image(1, (ANN, 2.5, 0.0)), ego)
    assert state.position == pytest.approx(ego.apply_point(2.5, 0.0), abs=0.05)
    assert state.covariance is not None
    assert state.covariance.shape == (4, 4)
    assert np.linalg.eigvalsh(state.covariance).min() > 0


def test_the_paper_profile_follows_who_stands_alone() -> None:
    tracker = enrolled(profile="paper")
    for k in range(1, 8):
        stepped(tracker, image(k, (ANN, 2.5, 0.01 * k)))
    assert off(tracker, 2.5, 0.07) < 0.3


def test_scans_and_images_out_of_order_say_nothing() -> None:
    tracker = enrolled()
    assert tracker.step(image(0, (ANN, 2.5, 0.0)), None) is None
    empty = np.zeros(0)
    scan = Scan(0.0, 0.0, 0.0, 0.01, empty, 8.0, empty, Pose2())
    assert tracker.step(scan, None) is None
    with pytest.raises(UsageError, match="not in scans"):
        tracker.enrol(scan, (1.0, 0.0), None)
    tracker.forget()
    assert tracker.step(image(5), None) is None
