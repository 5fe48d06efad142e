"""Pictures are metrically right, hide what is hidden, and differ only as light and noise do."""

from math import radians

import numpy as np
import pytest

from followerd.geometry import Camera, Pose2
from followerd.messages import Box
from followerd.sim.render import Renderer
from followerd.sim.scenarios import load
from followerd.sim.world import World
from tests.scenes import ROOM, STEADY, person, walker, world

WIDE = Camera.from_hfov(192, 144, radians(70), x=0.1, z=0.6, elevation=radians(3))


def box_of(one: World, camera: Camera = WIDE) -> Box:
    found = one.truth_box(camera)
    assert found is not None
    return found[0]


@pytest.mark.parametrize("camera", [WIDE, Camera.from_hfov(640, 480, radians(60), z=0.9)])
@pytest.mark.parametrize(("x", "y"), [(3.5, 0.0), (4.0, 1.0), (6.0, -2.0), (9.0, 0.5)])
@pytest.mark.parametrize("facing", [0.0, 110.0])
def test_a_person_stands_where_the_camera_model_says(
    camera: Camera, x: float, y: float, facing: float
) -> None:
    one = world(person(x, y, facing_deg=facing))
    box = box_of(one, camera)
    (column, top, depth), (_, foot, _) = camera.project(np.array([[x, y, 1.74], [x, y, 0.0]]))
    pixel = camera.fx / 137.0  # 1 px at 192 px width
    assert box.y == pytest.approx(top, abs=2 * pixel)
    assert box.foot[1] == pytest.approx(foot, abs=2 * pixel)
    assert box.centre[0] == pytest.approx(column, abs=3 * pixel)
    assert 0.3 < box.w * depth / camera.fx < 0.65  # m


def test_the_box_covers_what_a_person_changes_in_the_picture() -> None:
    here, gone = world(person(4.0, 0.3), walls=ROOM), world(person(-4.0, 0.3), walls=ROOM)
    changed = np.abs(here.render(WIDE).astype(int) - gone.render(WIDE)).max(axis=2) > 40
    rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
    box = box_of(here)
    assert (box.x, box.x + box.w) == pytest.approx((columns[0], columns[-1] + 1), abs=2)
    assert box.y == pytest.approx(rows[0], abs=2)


def test_depth_of_floor_and_wall_is_exact() -> None:
    one = world(person(-3.0, 0.0), walls=ROOM)
    depth = one.depth(WIDE)
    for row, column in ((130, 20), (110, 96), (120, 170)):
        ground = WIDE.ground_point(column, row)
        assert ground is not None
        seen = WIDE.project(np.array([[*ground, 0.0]]))[0, 2]
        assert depth[row, column] == pytest.approx(seen, rel=0.02)
    row, column = (round(float(v)) for v in WIDE.project(np.array([[8.0, 1.0, 1.0]]))[0, 1::-1])
    assert depth[row, column] == pytest.approx(7.9, rel=0.02)


@pytest.mark.parametrize("elevation", [-12.0, 0.0, 10.0])
def test_upright_edges_lie_where_the_camera_model_says(elevation: float) -> None:
    camera = Camera.from_hfov(320, 240, radians(60), z=0.6, elevation=radians(elevation))
    edge = {"points_m": [[3.0, 0.9], [3.0, 4.0]], "height_m": 2.0}
    one = world(person(-3.0, 0.0), walls=[*ROOM, edge])
    depth = one.depth(camera)
    for z in (0.2, 0.6, 1.2):
        column, row, _ = camera.project(np.array([[3.0, 0.9, z]]))[0]
        left, right = depth[round(row), round(column) - 2], depth[round(row), round(column) + 2]
        assert left < 3.4
        assert right > 4.0 or z == 0.2


def test_what_stands_in_front_hides_the_person_behind() -> None:
    cabinet = {"x_m": 3.0, "y_m": 0.0, "length_m": 0.4, "width_m": 1.6, "height_m": 0.8}
    assert world(person(5.0, 0.0)).truth_box(WIDE) == (box_of(world(person(5.0, 0.0))), 1.0)
    half = world(person(5.0, 0.0), boxes=[cabinet]).truth_box(WIDE)
    whole = world(person(5.0, 0.0), boxes=[cabinet | {"height_m": 2.2}]).truth_box(WIDE)
    assert half is not None
    assert whole is not None
    assert 0.3 < half[1] < 0.7
    assert whole[1] == 0.0
    other = world(person(5.0, 0.0), person(3.0, 0.0, name="other")).truth_box(WIDE)
    assert other is not None
    assert other[1] < 0.3


def test_a_person_behind_or_beside_the_camera_has_no_box() -> None:
    assert world(person(-3.0, 0.0)).truth_box(WIDE) is None
    assert world(person(1.0, 4.0)).truth_box(WIDE) is None


def test_a_person_nearer_than_the_image_is_high_is_cut_at_its_edge() -> None:
    box = box_of(world(person(1.2, 0.0)))
    assert (box.y, box.y + box.h) == (0.0, 144.0)


def test_depth_of_a_person_is_that_of_the_body() -> None:
    one = world(person(4.0, 0.0), walls=ROOM)
    column, row, depth = WIDE.project(np.array([[4.0, 0.0, 1.2]]))[0]
    assert one.depth(WIDE)[round(row), round(column)] == pytest.approx(depth, abs=0.2)


def test_persons_shine_in_the_thermal_picture() -> None:
    one = world(person(4.0, 0.0), walls=ROOM)
    image = one.thermal(WIDE)
    assert image.shape == (144, 192)
    column, row, _ = WIDE.project(np.array([[4.0, 0.0, 1.2]]))[0]
    assert image[round(row), round(column)] > 110
    assert np.median(image) < 80


def test_clothes_keep_their_colours() -> None:
    red = {"upper": {"colour": "#c01010"}, "lower": {"colour": "#1010c0"}}
    image = world(person(4.0, 0.0, outfits=[red])).render(WIDE)
    for z, channel in ((1.2, 2), (0.7, 0)):
        column, row, _ = WIDE.project(np.array([[4.0, 0.06, z]]))[0]
        pixel = image[round(row), round(column)].astype(int)
        assert int(np.argmax(pixel)) == channel
        assert pixel[channel] > 2 * np.delete(pixel, channel).max()


def test_without_noise_and_drift_the_same_scene_gives_the_same_picture() -> None:
    one = world(person(4.0, 0.0), walls=ROOM)
    assert np.array_equal(one.render(WIDE), one.render(WIDE))


def test_who_walks_past_a_standing_robot_leaves_no_trace() -> None:
    watched, fresh = (world(walker((2.0, -1.0), (2.0, 3.0)), walls=ROOM) for _ in range(2))
    for time in (0.0, 0.6, 1.2, 1.8):
        watched.advance(time)
        picture = watched.still(WIDE)
    fresh.advance(0.0)
    fresh.advance(1.8)
    np.testing.assert_array_equal(picture, fresh.still(WIDE))


def test_noise_has_the_given_strength_and_is_never_twice_the_same() -> None:
    noisy = world(person(-3.0, 0.0), walls=ROOM, light=STEADY | {"noise": 5.0})
    clean = world(person(-3.0, 0.0), walls=ROOM).render(WIDE).astype(int)
    first, second = noisy.render(WIDE).astype(int) - clean, noisy.render(WIDE).astype(int) - clean
    unsaturated = clean < 225
    assert first[unsaturated].std() == pytest.approx(5.0, rel=0.1)
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.05


def test_the_exposure_drifts_slowly() -> None:
    one = world(person(-3.0, 0.0), walls=ROOM, light=STEADY | {"drift": 0.1})
    levels = []
    for k in range(80):
        one.advance(0.25 * k)
        levels.append(float(one.render(WIDE).mean()))
    relative = np.array(levels) / np.mean(levels)
    assert 0.02 < relative.std() < 0.25
    assert np.abs(np.diff(relative)).std() < relative.std()


def test_turning_smears_the_picture_sideways_only() -> None:
    still = world(person(4.0, 0.0), walls=ROOM)
    turning = world(person(4.0, 0.0), walls=ROOM)
    turning.drive(-0.25, 0.25)
    turning.advance(1e-6)
    sharp, smeared = still.render(WIDE).astype(int), turning.render(WIDE).astype(int)
    across = [float(np.abs(np.diff(i, axis=1)).mean()) for i in (sharp, smeared)]
    down = [float(np.abs(np.diff(i, axis=0)).mean()) for i in (sharp, smeared)]
    assert across[1] < 0.75 * across[0]
    assert across[1] / across[0] < down[1] / down[0]


def test_the_picture_is_taken_from_where_the_robot_is() -> None:
    one = world(person(5.0, 0.0), robot={"x_m": 1.0, "y_m": 0.0, "yaw_deg": 15.0})
    same = world(person(4.0, 0.0))
    column = WIDE.column(-radians(15.0))
    assert box_of(one).centre[0] == pytest.approx(column, abs=4)
    assert box_of(one).h == pytest.approx(box_of(same).h, abs=3)


def test_pictures_of_one_seed_are_the_same_to_the_bit() -> None:
    def film(seed: int) -> list[bytes]:
        one = World(load("static-ball"), np.random.default_rng(seed))
        frames = []
        for k in range(3):
            one.advance(k / 0.7)
            one.drive(0.3, 0.35)
            frames.append(one.render(WIDE).tobytes())
        return frames

    first = film(3)
    assert first == film(3)
    assert first != film(4)


def test_textures_are_painted_only_for_those_who_look(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Renderer, "__init__", lambda *_: pytest.fail("painted"))
    one = world(walker((2, 0), (5, 0)))
    one.advance(1.0)
    one.ranges(Pose2(), np.zeros(3), np.zeros(3))
