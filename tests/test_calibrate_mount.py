"""`followerd calibrate mount`: a person who walks about tells where the camera sits."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from math import cos, degrees, radians, sin
from pathlib import Path

import numpy as np
import pytest
import yaml

from followerd import app, clock
from followerd.__main__ import call
from followerd.cli.calibrate_mount import as_yaml
from followerd.config import Config, load
from followerd.errors import LinkLost
from followerd.estimation.mount import LEG_RADIUS, SOLE, TOES, Pair, find_mount
from followerd.geometry import Camera, Pose2
from followerd.hw.camera.settings import CameraMount
from followerd.messages import Pixels, Scan
from followerd.perception.movers import Silhouette, StillImage, StillScan
from followerd.pytest_plugin import Simulation
from followerd.runtime import logs
from followerd.runtime.mount_session import MountSession
from followerd.sim.faults import Fault

WALKABOUT = """
name: walkabout
task: watch
walls: [{points_m: [[-3.0, 3.0], [8.0, 3.0], [8.0, -3.0], [-3.0, -3.0], [-3.0, 3.0]]}]
people:
  - name: walker
    target: true
    loop: true
    start_after_s: 1.0
    path:
      - {x_m: 2.0, y_m: 0.0, speed_mps: 0.6}
      - {x_m: [2.8, 3.2], y_m: 0.9, speed_mps: 0.6}
      - {x_m: [4.3, 4.7], y_m: 1.2, speed_mps: 0.6}
      - {x_m: 5.0, y_m: [-1.3, -1.1], speed_mps: 0.7}
      - {x_m: [3.0, 3.4], y_m: -0.9, speed_mps: 0.6}
      - {x_m: 2.4, y_m: [0.2, 0.5], speed_mps: 0.6}
      - {x_m: 3.5, y_m: 0.3, speed_mps: 0.5}
      - {x_m: 1.9, y_m: -0.3, speed_mps: 0.6}
    outfits:
      - {upper: {colour: "#2f6d3c"}, lower: {colour: "#232427"}}
      - {upper: {colour: "#a03028"}, lower: {colour: "#2c3e63"}}
      - {upper: {colour: "#c7851f"}, lower: {colour: "#5a5348"}, shoes: "#c8c4bc"}
"""

GUESS = {"z_m": 0.65, "yaw_deg": 0.0, "elevation_deg": -5.0}


def config_of(folder: Path, seed: int = 0, *, place: dict[str, float]) -> Config:
    """A robot whose camera sits as `place` says, and a person who walks about before it."""
    world = folder / "walkabout.yaml"
    world.write_text(WALKABOUT, encoding="utf-8")
    changes = {
        "sim.scenario": str(world), "seed": seed, "laser.baud": 38400, "laser.resolution_deg": 1,
        "camera.rate_hz": 5, "camera.hfov_deg": 57,
        "camera.mount": {"x_m": 0.1, "y_m": 0.02, **place},
    }  # fmt: skip
    return load("hpf-sim", changes)


def seen_by(
    true: Config, assumed: Config, seconds: float, *faults: Fault
) -> tuple[list[Pair], Camera]:
    """What a session of a wrongly configured robot sees, and the camera as configured."""
    logs.configure("error")

    async def main() -> MountSession:
        rig = app.rig(true, faults)
        session = MountSession(*app.laser_and_camera(assumed, app.in_memory(rig)))
        going = asyncio.create_task(rig.run())
        await session.watch(seconds, lambda _: None)
        going.cancel()
        return session

    session = clock.run_virtual(main())
    return session.pairs(), session.images[0].camera


MOUNTS = (
    {"yaw_deg": 3.0, "elevation_deg": -7.0, "z_m": 0.72},
    {"yaw_deg": -2.0, "elevation_deg": -3.0, "z_m": 0.60},
    {"yaw_deg": 0.5, "elevation_deg": -10.0, "z_m": 0.90},
)


def check(mount: dict[str, float], seed: int, folder: Path, seconds: float) -> None:
    true, assumed = config_of(folder, seed, place=mount), config_of(folder, seed, place=GUESS)
    pairs, camera = seen_by(true, assumed, seconds)
    found = find_mount(pairs, camera)
    assert found is not None
    assert found.kept == ()
    errors = {
        "yaw": found.camera.yaw - radians(mount["yaw_deg"]),
        "elevation": found.camera.elevation - radians(mount["elevation_deg"]),
        "z": found.camera.z - mount["z_m"],
    }
    assert abs(degrees(errors["yaw"])) < 0.3
    assert abs(degrees(errors["elevation"])) < 0.5
    assert abs(errors["z"]) < 0.03
    assert all(abs(errors[name]) < 3 * found.sigma[name] for name in errors)
    assert (found.camera.x, found.camera.y) == (0.1, 0.02)
    assert found.outliers < found.used / 4


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("mount", MOUNTS)
def test_a_person_in_the_simulation_tells_where_the_camera_sits(
    mount: dict[str, float], seed: int, tmp_path: Path
) -> None:
    check(mount, seed, tmp_path, 60.0)


@pytest.mark.slow
@pytest.mark.realtime
def test_a_live_session_writes_the_mount_that_a_config_takes(
    simulation: Callable[..., Simulation], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, out = tmp_path / "robot.yaml", tmp_path / "mount.yaml"
    robot = config_of(tmp_path, 1, place=MOUNTS[0])
    fine = robot.laser.model_copy(update={"baud": 500000, "resolution_deg": 0.5})
    robot = robot.model_copy(update={"laser": fine})
    config.write_text(yaml.safe_dump(robot.model_dump(mode="json")), encoding="utf-8")
    twins = simulation(str(tmp_path / "walkabout.yaml"), "--config", str(config), "--seed", "1")
    options = ["--links", str(twins.links), "--seconds", "24", "--out", str(out)]
    assert call(["calibrate", "mount", str(config), *options]) == 0
    said = capsys.readouterr().out
    assert "walk about, near and far" in said
    assert "x_m, y_m and the laser's mount cannot be told" in said
    found = CameraMount.model_validate(yaml.safe_load(out.read_text(encoding="utf-8"))["mount"])
    assert found.yaw_deg == pytest.approx(3.0, abs=1.0)
    assert found.elevation_deg == pytest.approx(-7.0, abs=1.5)
    assert found.z_m == pytest.approx(0.72, abs=0.1)


@pytest.mark.slow
def test_without_a_person_the_session_says_what_is_missing(
    simulation: Callable[..., Simulation], capsys: pytest.CaptureFixture[str]
) -> None:
    twins = simulation("static-ball")
    options = ["--links", str(twins.links), "--seconds", "2"]
    assert call(["calibrate", "mount", "hpf-sim", *options]) == 4
    assert "alone in the laser, was seen 0 times" in capsys.readouterr().err


TRUE = Camera.from_hfov(320, 240, radians(57), x=0.1, z=0.7, yaw=0.04, elevation=-0.11)
ASSUMED = replace(TRUE, z=0.6, yaw=0.0, elevation=-0.05)


def walk(
    rng: np.random.Generator,
    count: int = 200,
    near: float = 1.6,
    far: float = 5.0,
    aside: float = 0.3,
) -> list[Pair]:
    """Pairs as the model has them, with a walk's noise."""
    pairs = []
    for _ in range(count):
        r, bearing, approach = (
            rng.uniform(near, far),
            rng.uniform(-aside, aside),
            rng.uniform(-1, 1),
        )
        sole = r - SOLE - TOES * approach + rng.normal(0.0, 0.03)
        body = np.array([[r * cos(bearing), r * sin(bearing), 0.9]])
        foot = np.array([[sole * cos(bearing), sole * sin(bearing), 0.0]])
        column, row, _ = TRUE.project(body)[0] + rng.normal(0.0, 1.0, 3)
        visible = (r - LEG_RADIUS) * cos(bearing), (r - LEG_RADIUS) * sin(bearing)
        pairs.append(Pair(visible, visible, column, row, TRUE.project(foot)[0][1], approach))
    return pairs


def test_the_mount_is_found_with_the_error_it_tells() -> None:
    found = find_mount(walk(np.random.default_rng(1)), ASSUMED)
    assert found is not None
    assert found.camera.yaw == pytest.approx(TRUE.yaw, abs=0.002)
    assert found.camera.elevation == pytest.approx(TRUE.elevation, abs=0.004)
    assert found.camera.z == pytest.approx(TRUE.z, abs=0.015)
    assert set(found.sigma) == {"yaw", "elevation", "z"}
    assert found.sigma["yaw"] < 0.002
    assert found.sigma["z"] < 0.02


def test_outliers_do_not_move_it() -> None:
    rng = np.random.default_rng(2)
    pairs = walk(rng)
    clean = find_mount(pairs, ASSUMED)
    spoiled = [
        replace(pair, foot=pair.foot - 60, column=pair.column + 80) if i % 8 == 0 else pair
        for i, pair in enumerate(pairs)
    ]
    found = find_mount(spoiled, ASSUMED)
    assert clean is not None
    assert found is not None
    assert found.outliers >= 40
    assert found.camera.yaw == pytest.approx(clean.camera.yaw, abs=0.002)
    assert found.camera.z == pytest.approx(clean.camera.z, abs=0.02)


def test_at_one_distance_height_is_not_told_and_keeps_its_value() -> None:
    found = find_mount(walk(np.random.default_rng(3), near=2.95, far=3.05, aside=0.05), ASSUMED)
    assert found is not None
    assert found.kept == ("z",)
    assert found.camera.z == ASSUMED.z
    assert "z_m: 0.600 # not told by the data" in as_yaml(found)
    assert found.camera.yaw == pytest.approx(TRUE.yaw, abs=0.003)


def test_too_few_pairs_tell_nothing() -> None:
    pairs = walk(np.random.default_rng(4), 19)
    assert find_mount(pairs, ASSUMED) is None
    assert find_mount([replace(pair, middle=None) for pair in pairs * 4], ASSUMED) is None


ROOM = np.full((120, 160, 3), (120, 125, 130), np.uint8)


def with_person(left: int, foot: int) -> Pixels:
    """The room with someone 12 px wide and 60 px tall in it, and his shadow beside him."""
    image = ROOM.copy()
    image[foot - 10 : foot + 6, left + 12 : left + 40] = 0.75 * ROOM[0, 0]
    image[foot - 59 : foot + 1, left : left + 12] = (30, 60, 160)
    return image


def test_a_silhouette_has_no_shadow_and_its_foot_is_the_lowest_edge() -> None:
    still = StillImage([ROOM] * 3)
    seen = still.silhouette(with_person(50, 100))
    assert seen == Silhouette(55.5, 70.5, 100.5)
    assert still.silhouette(ROOM) is None


@pytest.mark.parametrize(("left", "foot"), [(0, 100), (148, 100), (50, 119)])
def test_who_is_cut_off_by_the_border_is_not_used(left: int, foot: int) -> None:
    assert StillImage([ROOM] * 3).silhouette(with_person(left, foot)) is None


def scan_of(*legs: tuple[float, float]) -> Scan:
    """A round room of 6 m with legs (x, y) in it, 1° apart."""
    angles = np.radians(np.arange(-90.0, 91.0))
    ranges = np.full(angles.size, 6.0)
    for x, y in legs:
        hit = np.abs(angles - np.arctan2(y, x)) < 0.065 / np.hypot(x, y)
        ranges[hit] = np.hypot(x, y)
    return Scan(0.0, 0.0, float(angles[0]), radians(1.0), ranges, 8.0, 0.0 * angles, Pose2())


def test_legs_are_those_of_one_person_who_moves() -> None:
    still = StillScan([scan_of((3.0, 2.0))] * 3)  # a pillar
    assert still.legs(scan_of((3.0, 2.0))) is None
    one = still.legs(scan_of((3.0, 2.0), (2.0, 0.1), (2.2, -0.2)))
    assert one is not None
    assert one.count == 2
    assert one.nearest == pytest.approx((2.0, 0.1), abs=0.03)
    assert one.middle == pytest.approx((2.1, -0.05), abs=0.03)
    assert still.legs(scan_of((2.0, 0.1), (4.0, -1.5))) is None  # two persons


def test_a_sensor_that_fails_ends_the_session(tmp_path: Path) -> None:
    robot = config_of(tmp_path, place=GUESS)
    with pytest.raises(LinkLost):
        seen_by(robot, robot, 20.0, Fault.parse("camera:disconnect@3s+9s"))
