"""Face to face with a Kinect: the head is found, a walker may go backward, the robot follows."""

from math import radians

import numpy as np
import pytest

from followerd import app
from followerd.bench.kwolek_follow import Figures, Job, at_speed, max_speed, rows, run, seeds_at
from followerd.config import load
from followerd.geometry import Camera
from followerd.messages import Image
from followerd.perception.head_outline import head_box, nearest_head
from followerd.sim import scenarios
from followerd.sim.people import legs
from followerd.sim.stereo_pair import StereoPair
from followerd.sim.structured_light import StructuredLight
from followerd.sim.world import World


def kinect(**mount: float) -> Camera:
    return Camera.from_hfov(320, 240, radians(62.7), z=1.1, elevation=radians(15), **mount)


@pytest.fixture(scope="module")
def seen() -> tuple[World, Image]:
    world = World(scenarios.load("hall-face-to-face"), np.random.default_rng(2))
    world.advance(0.0)
    return world, Image(0, 0.0, 0.0, world.render(kinect()), kinect(), world.depth(kinect()))


def test_a_head_is_found_in_the_depth_image(seen: tuple[World, Image]) -> None:
    assert_found(*seen)


def first_sight(name: str, seed: int) -> tuple[World, Image]:
    """What the depth camera of a config sees of whoever it is to follow."""
    equipment = app.equipment(load(name))
    camera, unit = equipment.camera, np.random.default_rng([seed, 1])
    world = World(scenarios.load("hall-face-to-face"), np.random.default_rng(seed))
    world.advance(0.0)
    pair = equipment.camera_pair
    take = StructuredLight(unit) if pair is None else StereoPair(pair, unit)
    pixels, depth = take.of(world)(camera)
    return world, Image(0, 0.0, 0.0, pixels, camera, depth)


# pinholes, specks, necks of no depth, breasts before their heads, and edges laid elsewhere
@pytest.mark.parametrize(("name", "seed"), [("head-stereo-sim", 0), ("head-stereo-sim", 1)])
def test_what_a_real_depth_image_lacks_does_not_mislead(name: str, seed: int) -> None:
    assert_found(*first_sight(name, seed))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["head-sim", "head-stereo-sim"])
def test_heads_are_found_whoever_stands_there(name: str) -> None:
    for seed in range(200, 206):
        assert_found(*first_sight(name, seed))


def assert_found(world: World, image: Image) -> None:
    target, height = world.truth().target, world.people[0].height
    column, row, depth = image.camera.project(np.array([[target.x, target.y, 0.935 * height]]))[
        0
    ].tolist()
    for box in (head_box(image, target.x, target.y), nearest_head(image)):
        assert box is not None
        assert box.centre[0] == pytest.approx(column, abs=8.0)
        assert box.centre[1] == pytest.approx(row, abs=18.0)
        assert box.w == pytest.approx(0.16 * image.camera.fx / depth, rel=0.2)


def test_a_wall_and_a_ceiling_are_nobody() -> None:
    camera = kinect()
    wall = np.full((240, 320), 2.0, np.float32)
    assert nearest_head(Image(0, 0.0, 0.0, np.zeros((240, 320, 3), np.uint8), camera, wall)) is None


def test_without_a_depth_a_head_is_looked_for_at_a_usual_height(seen: tuple[World, Image]) -> None:
    world, image = seen
    blind = Image(0, 0.0, 0.0, image.pixels, image.camera)
    target = world.truth().target
    assert nearest_head(blind) is None
    assert head_box(blind, target.x, target.y).centre[0] == pytest.approx(160.0, abs=25.0)


def test_a_walker_who_goes_backward_looks_where_they_come_from() -> None:
    scenario = scenarios.load("hall-face-to-face")
    person = World(scenario, np.random.default_rng(1)).people[0]
    before, after = person.at(10.0), person.at(10.1)
    assert after.x > before.x
    assert abs(before.heading) > 2.5
    assert before.velocity[0] == pytest.approx(10.0 * (after.x - before.x), rel=0.1)
    # the standing foot keeps its place
    feet = [legs(person.at(10.0 + 0.02 * k), person.height, 0.08) for k in range(12)]
    steps = np.abs(np.diff([[x for x, _ in pair] for pair in feet], axis=0))
    assert steps.min(axis=1).max() < 0.5 * steps.max(axis=1).min()


def test_the_fastest_speed_is_that_before_the_first_loss() -> None:
    good: Figures = {"lost_percent": 0.2}
    bad: Figures = {"lost_percent": 4.0}
    assert max_speed([(0.6, good), (0.2, good), (0.4, bad)]) == 0.2
    assert max_speed([(0.2, bad)]) == 0.0


def test_most_runs_are_at_one_speed_and_the_fastest_is_of_those_at_every_speed() -> None:
    numbers = seeds_at(0.6, 20)
    few = seeds_at(0.25, 20)
    assert set(few) < set(numbers)
    good: Figures = dict.fromkeys(("lost_percent", "range_rms_m", "bearing_rms_deg"), 0.0)
    runs = [(Job("E3", "head/default", 0.25, seed, 1.0), good) for seed in few]
    runs += [(Job("E3", "head/default", 0.6, seed, 1.0), good) for seed in numbers]
    runs += [(Job("E3", "head/default", 0.7, few[0], 1.0), good | {"lost_percent": 3.0})]
    found = [row for row in rows(runs) if row.metric == "max_speed_mps"]
    assert [row.value for row in found] == [0.6]
    assert [row.seeds for row in found] == [len(few)]


@pytest.mark.parametrize("name", ["head-sim", "head-leading-sim", "head-stereo-sim"])
def test_the_shipped_configs_go_together(name: str) -> None:
    app.verify(load(name))


def test_a_scenario_takes_the_speed_it_is_given() -> None:
    slower = at_speed(scenarios.load("hall-leading"), 0.1)
    assert {stop.speed_mps for stop in slower.people[0].path} == {0.1}


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["E3", "E3-leading"])
def test_it_keeps_its_distance(scenario: str) -> None:
    figures = run(Job(scenario, "head/default", 0.25, 3, 10.0))
    assert figures["lost_percent"] == 0.0
    assert figures["range_rms_m"] is not None
    assert figures["range_rms_m"] < 0.3
    assert figures["bearing_rms_deg"] is not None
    assert figures["bearing_rms_deg"] < 8.0
