"""What the simulated stereo pair makes of true depth, and the robot that follows by it."""

from dataclasses import replace
from math import radians, sin
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from followerd import app
from followerd.bench.kwolek_follow import Job, run
from followerd.config import load
from followerd.geometry import Camera
from followerd.hw.camera.rectification import Matcher, Rectification, StereoGeometry
from followerd.messages import Pixels
from followerd.resources import shipped
from followerd.sim import scenarios
from followerd.sim.stereo_pair import PairGeometry, StereoPair
from followerd.sim.world import World

Depth = npt.NDArray[np.float32]

CAMERA = replace(Camera.from_hfov(640, 480, radians(61.3)), fx=540.0, fy=540.0)
PAIR = PairGeometry(baseline=0.09)
ROUGH: Pixels = np.random.default_rng(1).integers(90, 160, (480, 640, 3), np.uint8)
BORDER = 96  # px that the right image does not reach


def wall(depth: float) -> Depth:
    return np.full((480, 640), depth, np.float32)


def seen(true: Depth, pixels: Pixels = ROUGH, seed: int = 0) -> Depth:
    return StereoPair(PAIR, np.random.default_rng(seed))(true, pixels, CAMERA)


def deviation(depth: float) -> float:
    measured = seen(wall(depth))[:, BORDER:]
    return 1.48 * float(np.nanmedian(np.abs(measured - depth)))


def test_errors_grow_with_the_square_of_the_depth() -> None:
    near, far = deviation(1.5), deviation(3.0)
    assert far / near == pytest.approx(4.0, rel=0.2)
    # z² / (f b) of 0.3 px of disparity
    assert far == pytest.approx(0.3 * 3.0**2 / (540.0 * 0.09), rel=0.15)


def test_disparities_come_in_sixteenths() -> None:
    measured = seen(wall(2.0))
    disparity = 16.0 * 0.5 * 540.0 * 0.09 / measured[np.isfinite(measured)]
    assert np.abs(disparity - np.rint(disparity)).max() < 1e-3


def test_a_bare_surface_and_the_border_have_no_depth() -> None:
    pixels = ROUGH.copy()
    pixels[:, 400:] = 120
    unknown = np.isnan(seen(wall(2.0), pixels))
    assert unknown[:, 420:].all()
    assert unknown[:, :BORDER].all()
    assert unknown[:, BORDER:380].mean() < 0.02


def test_what_only_the_left_camera_sees_has_no_depth() -> None:
    true = wall(3.0)
    true[100:400, 300:400] = 1.2
    unknown = np.isnan(seen(true))[200:300].mean(axis=0)
    # f b (1 / 1.2 m - 1 / 3 m) = 24 px to the left of what stands before the wall
    assert unknown[280:299].min() > 0.9
    assert unknown[410:].max() < 0.2
    assert unknown[306:394].max() < 0.2


def test_two_pairs_differ_and_one_repeats_itself() -> None:
    assert np.array_equal(seen(wall(2.0)), seen(wall(2.0)), equal_nan=True)
    assert not np.array_equal(seen(wall(2.0)), seen(wall(2.0), seed=1), equal_nan=True)


def test_the_shipped_pair_is_the_one_that_its_twin_is_built_as() -> None:
    config = load("head-stereo-sim")
    app.verify(config)
    equipment = app.equipment(config)
    assert equipment.camera_pair is not None
    assert equipment.camera_pair.baseline == pytest.approx(0.09)
    assert equipment.camera.fx == pytest.approx(540.0)
    assert app.equipment(load("head-sim")).camera_pair is None


@pytest.mark.slow
def test_a_matcher_that_gets_both_pictures_errs_as_the_twin_does() -> None:
    world = World(scenarios.load("face-to-face"), np.random.default_rng(3))
    world.advance(0.0)
    world.advance(6.0)
    camera = replace(CAMERA, z=1.1, elevation=radians(15.0))
    other = replace(camera, x=camera.x + 0.09 * sin(camera.yaw), y=camera.y - 0.09)
    left, true, right = world.still(camera).copy(), world.depth(camera).copy(), world.still(other)
    rng = np.random.default_rng(1)
    noisy = [
        np.clip(p + rng.normal(0.0, 4.0, p.shape), 0, 255).astype(np.uint8) for p in (left, right)
    ]
    pair = Rectification(StereoGeometry.read(shipped("cameras", "pair-9cm.yaml")), (640, 480))
    matched = Matcher("sgbm", pair, PAIR.nearest, PAIR.shrink).depth(noisy[0], noisy[1])
    modelled = StereoPair(PAIR, np.random.default_rng(2))(true, left, camera)
    middle = (true > 2.2) & (true < 4.0)
    errors, shares = [], []
    for depth in (matched, modelled):
        off = 540.0 * 0.09 * (1.0 / depth - 1.0 / true)[middle]
        errors.append(1.48 * float(np.nanmedian(np.abs(off))))
        shares.append(float(np.isfinite(off).mean()))
    assert errors[1] == pytest.approx(errors[0], rel=0.25)
    assert shares[1] == pytest.approx(shares[0], abs=0.08)


@pytest.mark.slow
def test_a_robot_with_a_stereo_pair_follows_a_face_and_knows_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    figures = run(Job("office", "head/default", 0.25, 4, 8.0))
    assert figures["lost_percent"] == 0.0
    assert figures["range_rms_m"] is not None
    assert figures["range_rms_m"] < 0.3
    assert figures["pose_error_cm"] is not None
    assert figures["pose_error_cm"] < 10.0
