"""The simulated robot is built as the config says."""

import asyncio
import json
from dataclasses import replace
from pathlib import Path

import pytest

from followerd import app, clock
from followerd.cli.sim import answer
from followerd.config import find, load
from followerd.errors import ConfigError
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


def told(*requests: bytes) -> list[dict[str, object]]:
    """What the control socket of a simulation answers after 5 s."""

    async def main() -> list[dict[str, object]]:
        rig = Rig(scene(), app.equipment(load("hpf-sim")), 0)
        await clock.within(5.0, rig.run())
        return [await answer(rig, request) for request in requests]

    return clock.run_virtual(main())


def test_faults_are_asked_for_at_the_control_socket() -> None:
    later, now, over, unknown, senseless, nothing = told(
        *(
            json.dumps({"fault": text}).encode()
            for text in ("laser:off@9s+2s", "base:reboot+1s", "camera:off@1s+2s", "laser:dead+1s")
        ),
        b"laser:off+2s",
        b"{}",
    )
    assert later == {"ok": True, "start_s": 9.0, "end_s": 11.0}
    assert now == {"ok": True, "start_s": 5.0, "end_s": 6.0}
    assert "is over: the simulation is at 5.0 s" in str(over["error"])
    assert "no fault 'dead'" in str(unknown["error"])
    assert senseless == nothing
    assert not nothing["ok"]


def test_faults_come_from_the_config_too() -> None:
    async def main() -> list[bool]:
        rig = app.rig(load("hpf-sim", {"sim.faults": ["laser:disconnect@2s+2s"]}))
        running = asyncio.create_task(rig.run())
        plugged = []
        for _ in range(3):
            await clock.sleep(1.5)
            plugged.append(rig.laser.plugged)
        running.cancel()
        return plugged

    assert clock.run_virtual(main()) == [True, False, True]


def test_a_fault_written_wrong_in_the_config_is_said_with_its_place(tmp_path: Path) -> None:
    config = tmp_path / "robot.yaml"
    shipped_config = find("hpf-sim").read_text()
    config.write_text(shipped_config.replace("sim: {", "sim: {faults: [laser:off@1s+2s], "))
    assert load(config).sim.faults == ("laser:off@1s+2s",)
    config.write_text(shipped_config.replace("sim: {", "sim: {faults: [laser:dead@1s+2s], "))
    place = r"robot.yaml:7:16: sim.faults.0: fault 'laser:dead@1s\+2s': no fault 'dead'"
    with pytest.raises(ConfigError, match=place):
        load(config)
