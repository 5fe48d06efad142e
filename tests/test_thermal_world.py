"""Motai's simulated scenes: a target that turns back, hot things, gain that jumps."""

from math import atan2

import numpy as np
import pytest
from pydantic import ValidationError

from followerd.bench.closed_loop import simulate, staged
from followerd.config import load
from followerd.geometry import Camera
from followerd.runtime import logs
from followerd.sim.gain import Gain
from followerd.sim.people import Walker
from followerd.sim.scenarios import AutoGain, Ball
from followerd.sim.scenarios import load as scenario
from tests.scenes import world

ARC = {"radius_m": 2.0, "rate_dps": [30, 55], "accel_dps2": 500, "reversal_s": [0.6, 1.4]}
CAMERA = Camera.from_hfov(160, 120, 0.87, z=0.6)


def ball(**changes: object) -> Ball:
    return Ball.model_validate({"name": "b", "target": True, "start_after_s": 1.0} | changes)


def test_a_target_on_an_arc_keeps_its_limits_and_turns_back() -> None:
    walker = Walker(ball(arc=ARC), np.random.default_rng(3))
    motions = [walker.at(t) for t in np.arange(0.0, 20.0, 0.02).tolist()]
    angles = np.degrees(np.unwrap([atan2(m.y, m.x) for m in motions]))
    assert np.hypot([m.x for m in motions], [m.y for m in motions]) == pytest.approx(2.0)
    assert np.ptp(angles[:50]) == 0.0
    rates = np.diff(angles) / 0.02
    assert np.abs(rates).max() < 55.5
    assert np.abs(np.diff(rates)).max() < 500 * 0.02 * 1.01
    turns = np.flatnonzero(np.diff(np.sign(rates[60:])) != 0)
    assert 8 < turns.size < 40


def test_a_way_is_either_a_path_or_an_arc() -> None:
    for changes in ({}, {"arc": ARC, "path": [{"x_m": 1, "y_m": 0}]}):
        with pytest.raises(ValidationError, match="either a path or an arc"):
            ball(**changes)


def test_hot_things_are_bright_in_a_thermal_image_only() -> None:
    box = {"x_m": 3, "y_m": 0, "length_m": 0.1, "width_m": 0.8, "height_m": 0.8}
    cold, hot = (
        world(boxes=[box | {"heat": heat}], seed=2).thermal(CAMERA).astype(int)
        for heat in (60, 220)
    )
    assert (hot - cold).max() > 120
    assert np.mean(hot - cold > 100) > 0.02
    plain = world(boxes=[box], seed=2).render(CAMERA)
    assert np.array_equal(plain, world(boxes=[box | {"heat": 220}], seed=2).render(CAMERA))


def test_the_gain_jumps_and_rests_between() -> None:
    gain = Gain(AutoGain(jumps_s=3.0, gain=(0.7, 0.8), offset=10.0), np.random.default_rng(1))
    picture = np.tile(np.arange(40, 200, dtype=np.uint8), (4, 1))
    levels = [gain.applied(picture, t) for t in (0.0, 2.9, 3.1, 5.9, 6.1)]
    assert np.array_equal(levels[0], picture)
    assert np.array_equal(levels[1], picture)
    assert np.array_equal(levels[2], levels[3])
    assert not np.array_equal(levels[3], levels[4])
    contrast = float(np.ptp(levels[2].astype(int)) / np.ptp(picture.astype(int)))
    assert 0.69 < contrast < 0.81


def test_the_shipped_thermal_scenes_are_there() -> None:
    for name in ("thermal-spot", "thermal-person", "thermal-noisy", "thermal-walk"):
        assert scenario(name).name == name


@pytest.mark.slow
@pytest.mark.parametrize("name", ["thermal-person", "thermal-noisy"])
def test_the_robot_keeps_its_camera_on_a_warm_person(name: str) -> None:
    """By head and base together, in rendered thermal images with jumping gain."""
    logs.configure("error")
    config = load("ofkf-sim", {"sim.scenario": name, "seed": 21})
    follow = simulate(staged(config), 15.0)["follow"]
    assert follow["tracking_rate"] > 0.85
    assert follow["lost_count"] == 0
    assert follow["bearing_rmse_deg"] < 3.0
    assert follow["collision_count"] == 0
