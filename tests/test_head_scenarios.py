"""Face to face with a Kinect: the head is found, a walker may go backward, the robot follows."""

from math import radians

import numpy as np
import pytest

from followerd import app
from followerd.bench.kwolek_follow import Figures, Job, at_speed, max_speed, run
from followerd.config import load
from followerd.geometry import Camera
from followerd.messages import Image
from followerd.perception.head_outline import head_box, nearest_head
from followerd.sim import scenarios
from followerd.sim.people import legs
from followerd.sim.world import World


def kinect(**mount: float) -> Camera:
    return Camera.from_hfov(320, 240, radians(62.7), z=1.1, elevation=radians(15), **mount)


@pytest.fixture(scope="module")
def seen() -> tuple[World, Image]:
    world = World(scenarios.load("hall-face-to-face"), np.random.default_rng(2))
    world.advance(0.0)
    return world, Image(0, 0.0, 0.0, world.render(kinect()), kinect(), world.depth(kinect()))


def test_a_head_is_found_in_the_depth_image(seen: tuple[World, Image]) -> None:
    world, image = seen
    target = world.truth().target
    (x, y), height = (target.x, target.y), world.people[0].height
    column, row, depth = image.camera.project(np.array([[x, y, 0.935 * height]]))[0].tolist()
    for box in (head_box(image, x, y), nearest_head(image)):
        assert box is not None
        assert box.centre[0] == pytest.approx(column, abs=6.0)
        assert box.centre[1] == pytest.approx(row, abs=10.0)
        assert box.w == pytest.approx(0.16 * image.camera.fx / depth, rel=0.2)


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
