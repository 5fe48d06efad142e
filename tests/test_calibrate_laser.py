"""`followerd calibrate laser`: a push straight ahead tells how the laser is turned."""

import asyncio
from math import degrees, radians

import numpy as np
import pytest

from followerd import app, clock
from followerd.__main__ import call
from followerd.cli.calibrate_laser import pushed, yaw_of
from followerd.config import load
from followerd.errors import Stopped
from followerd.estimation.laser_yaw import find_yaw
from followerd.geometry import Array, Pose2
from followerd.messages import Scan
from followerd.runtime import logs
from followerd.sim import scenarios
from followerd.sim.world import World

SCANS = 18
BEAMS = np.radians(np.arange(-90.0, 91.0, 1.0))


def push(
    scenario: str, yaw_deg: float, bend: float = 0.0, way: float = 1.3, turn: float = 0.0
) -> list[Array]:
    """Scans of a robot that is pushed through a scenario; `bend` rad/m, `turn` rad in all."""
    world, rng = World(scenarios.load(scenario), np.random.default_rng(1)), np.random.default_rng(2)
    world.advance(0.0)
    mount, scans = Pose2(0.05, 0.0, radians(yaw_deg)), []
    for _ in range(SCANS):
        ranges = world.ranges(mount, BEAMS, 0.0 * BEAMS) + rng.normal(0.0, 0.005, BEAMS.size)
        seen = ranges < 8.0
        ways = np.column_stack([np.cos(BEAMS[seen]), np.sin(BEAMS[seen])])
        scans.append(ranges[seen, None] * ways)
        world.pose = world.pose.moved(way / SCANS, (bend * way + turn) / SCANS, 1.0)
    return scans


@pytest.mark.parametrize(("scenario", "yaw", "bend"), [("corridor", 3.0, 0.2)])
def test_a_push_tells_the_yaw_even_when_it_is_not_quite_straight(
    scenario: str, yaw: float, bend: float
) -> None:
    found = find_yaw(push(scenario, yaw, bend), 0.05, 0.0)
    assert found is not None
    assert degrees(found.yaw) == pytest.approx(yaw, abs=0.4)
    assert degrees(found.sigma) < 0.4
    assert found.way >= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["corridor", "office", "s3", "turns"])
@pytest.mark.parametrize("yaw", [0.0, 3.0, -8.0, 90.0, 175.0])
@pytest.mark.parametrize("bend", [0.0, -0.2])
def test_it_does_so_anywhere_and_however_it_is_turned(
    scenario: str, yaw: float, bend: float
) -> None:
    found = find_yaw(push(scenario, yaw, bend), 0.05, 0.0)
    assert found is not None
    assert degrees(found.yaw) == pytest.approx(yaw, abs=0.5)


@pytest.mark.parametrize(("way", "turn"), [(0.0, 0.8), (0.4, 0.0)])
def test_who_stands_turns_or_hardly_moves_tells_nothing(way: float, turn: float) -> None:
    assert find_yaw(push("office", 3.0, way=way, turn=turn), 0.05, 0.0) is None


def test_walls_without_any_end_tell_nothing() -> None:
    def walls() -> Array:
        x = np.arange(-1.0, 4.0, 0.05)
        return np.concatenate([np.column_stack([x, 0.0 * x + side]) for side in (-1.2, 1.2)])

    assert find_yaw([walls() for _ in range(20)], 0.05, 0.0) is None


@pytest.mark.slow
def test_the_driver_sees_the_push(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure("error")
    laser = {"x_m": 0.05, "yaw_deg": 4.0}
    changes = {"laser.baud": 38400, "laser.resolution_deg": 1, "sim.scenario": "office"}
    true = load("hpf-sim", {**changes, "laser.mount": laser})
    assumed = load("hpf-sim", {**changes, "laser.mount": {**laser, "yaw_deg": 0.0}})

    async def main() -> list[Scan]:
        rig = app.rig(true)
        sensor, _ = app.laser_and_camera(assumed, app.in_memory(rig))

        async def hands() -> None:
            while True:
                await clock.sleep(0.05)
                rig.world.pose = rig.world.pose.moved(0.01, 0.0, 1.0)

        going = [asyncio.create_task(part) for part in (rig.laser.run(), hands())]
        scans = await pushed(sensor, 7.0)
        for task in going:
            task.cancel()
        return scans

    found = yaw_of(clock.run_virtual(main()))
    assert degrees(found.yaw) == pytest.approx(4.0, abs=0.5)
    assert "push it slowly straight ahead, 0.8 m at least" in capsys.readouterr().out


def test_a_robot_that_was_not_pushed_is_an_error() -> None:
    scan = Scan(0.0, 0.0, -1.5, 0.01, np.full(300, 3.0), 8.0, np.zeros(300), Pose2())
    with pytest.raises(Stopped, match="straight ahead was seen: push farther"):
        yaw_of([scan] * 5)


def test_links_that_say_sim_need_a_simulation(capsys: pytest.CaptureFixture[str]) -> None:
    for what in ("laser", "mount"):
        assert call(["calibrate", what, "hpf-sim"]) == 2
        assert "give --links of followerd sim" in capsys.readouterr().err
