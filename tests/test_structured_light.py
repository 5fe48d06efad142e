"""What the simulated Kinect makes of true depth, and the light that changes."""

from math import radians

import numpy as np
import numpy.typing as npt
import pytest

from followerd import app
from followerd.config import load
from followerd.geometry import Camera
from followerd.messages import Pixels
from followerd.sim.render import light_levels
from followerd.sim.scenarios import Light
from followerd.sim.structured_light import StructuredLight

CAMERA = Camera.from_hfov(640, 480, radians(62.7))
BRIGHT: Pixels = np.full((480, 640, 3), 150, np.uint8)


def wall(depth: float) -> npt.NDArray[np.float32]:
    return np.full((480, 640), depth, np.float32)


def seen(
    true: npt.NDArray[np.float32], pixels: Pixels = BRIGHT, seed: int = 0
) -> npt.NDArray[np.float32]:
    """What one unit makes of it."""
    return StructuredLight(np.random.default_rng(seed))(true, pixels, CAMERA)


@pytest.mark.parametrize(("depth", "step"), [(1.0, 0.003), (2.0, 0.012), (4.0, 0.047)])
def test_steps_grow_with_the_square_of_the_depth(depth: float, step: float) -> None:
    measured = seen(wall(depth))
    found = np.unique(measured[~np.isnan(measured)])
    assert np.diff(found).max() == pytest.approx(step, rel=0.2)
    assert np.median(found) == pytest.approx(depth, abs=2 * step)


@pytest.mark.parametrize("depth", [0.3, 7.0])
def test_beyond_its_range_it_knows_nothing(depth: float) -> None:
    assert np.isnan(seen(wall(depth))).all()


def test_what_is_near_casts_a_shadow_to_its_left() -> None:
    true = wall(3.0)
    true[100:400, 300:400] = 1.0
    unknown = np.isnan(seen(true))[200:300]
    share = unknown.mean(axis=0)
    # f b (1 / 1 m - 1 / 3 m) = 26 px; the registration is a few px off
    assert share[281:293].min() > 0.9
    assert share[412:440].max() < 0.1


def test_black_cloth_swallows_some_of_the_light() -> None:
    dark: Pixels = BRIGHT.copy()
    dark[:, :320] = 15
    unknown = np.isnan(seen(wall(2.0), dark))
    assert 0.2 < unknown[:, :300].mean() < 0.5
    assert unknown[:, 340:].mean() < 0.05


def test_two_units_differ_and_one_unit_repeats_itself() -> None:
    true = wall(2.0)
    true[:, 300:] = 3.0
    assert np.array_equal(seen(true, seed=1), seen(true, seed=1), equal_nan=True)
    assert not np.array_equal(seen(true, seed=1), seen(true, seed=2), equal_nan=True)


@pytest.mark.parametrize("seed", range(4))
def test_what_comes_in_from_beyond_the_picture_is_unknown(seed: int) -> None:
    true = wall(1.0)
    true[240:] = 3.0
    measured = seen(true, seed=seed)
    assert np.nanmax(measured[:16]) < 2.0
    assert np.nanmin(measured[-16:]) > 2.0


def test_only_a_kinects_twin_has_its_faults() -> None:
    assert app.equipment(load("patches-sim")).camera_structured_light
    assert not app.equipment(load("hpf-sim")).camera_structured_light


def test_lamps_change_the_light_when_the_scenario_says_so() -> None:
    light = Light.model_validate(
        {"level": 1.0, "changes": [{"at_s": 2.0, "over_s": 1.0, "level": 0.6}]}
    )
    times, levels = light_levels(light, np.random.default_rng(0))
    assert np.interp([1.0, 2.5, 9.0], times, levels) == pytest.approx([1.0, 0.8, 0.6])
