"""The simulated robot is built as the config says."""

from dataclasses import replace

import pytest

from followerd import app
from followerd.config import load
from followerd.hw.p2os.models import MODELS
from followerd.sim.rig import Rig
from tests.scenes import scene


@pytest.mark.parametrize("model", ["p3dx-sh", "p3at-sh", "amigo-sh"])
def test_the_robot_turns_on_the_wheel_track_of_its_model(model: str) -> None:
    equipment = replace(app.equipment(load("hpf-sim")), base_model=model)
    track = Rig(scene(), equipment, 0).world.scenario.robot.track_m
    assert track == pytest.approx(2 / 1000 / MODELS[model].difference)


def test_a_scenario_may_give_the_robot_a_track_of_its_own() -> None:
    rig = Rig(scene(robot={"track_m": 0.4}), app.equipment(load("hpf-sim")), 0)
    assert rig.world.scenario.robot.track_m == 0.4
