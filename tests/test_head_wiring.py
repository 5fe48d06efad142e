"""The pan-tilt head in the whole: config, simulated robot, AUX port, daemon."""

import asyncio
from math import degrees, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from followerd import app, clock
from followerd.bench.closed_loop import simulate
from followerd.config import Config, find, load
from followerd.errors import ConfigError, UsageError
from followerd.geometry import Camera
from followerd.hw.interfaces import PanTilt
from followerd.hw.p2os.driver import P2osBase, P2osSettings
from followerd.hw.serial import open_link
from followerd.hw.vcc50i.driver import Vcc50i, Vcc50iSettings
from followerd.messages import Fault as Report
from followerd.messages import Image, Measurement, PtzState
from followerd.runtime import logs
from followerd.runtime.daemon import Daemon
from followerd.runtime.supervisor import supervise
from followerd.sim.faults import Fault, FaultKind
from followerd.sim.line import Line
from followerd.sim.rig import Rig
from followerd.sim.serve import on_pty
from followerd.sim.twins.p2os import P2osTwin
from followerd.sim.twins.vcc50i import Vcc50iTwin
from tests.p2os_body import FloorBody
from tests.scenes import scene


@pytest.fixture(autouse=True)
def quiet() -> None:
    logs.configure("error")


def config(**ptz: Any) -> Config:
    """A simulated robot with a head."""
    return load("hpf-sim", {"ptz": {"kind": "vcc50i", "link": "sim", **ptz}})


def rig_of(settings: Config) -> Rig:
    """Its twins."""
    return Rig(scene(), app.equipment(settings), 0)


def seen(rig: Rig) -> float:
    """Where the simulated camera looks now, degrees to the left."""
    camera = app.equipment(load("hpf-sim")).camera
    return degrees(rig.head.aimed(camera, clock.now()).yaw)


def test_a_config_without_a_head_has_none() -> None:
    assert load("hpf-sim").ptz is None


def test_a_heads_section_is_checked_like_any_other(tmp_path: Path) -> None:
    text = find("hpf-sim").read_text() + "ptz: {kind: vcc50i, link: sim, rate_hs: 10, baud: 5}\n"
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load(tmp_path / "c.yaml")
    problems = "\n".join(caught.value.problems)
    assert "ptz.rate_hs: unknown key; did you mean rate_hz?" in problems
    assert "ptz.baud: input should be 4800, 9600" in problems


def test_a_head_that_is_a_twin_makes_the_run_a_simulation() -> None:
    places = {"base.link": "a", "laser.link": "b", "camera.link": "c"}
    head = {"kind": "vcc50i", "link": "sim"}
    assert load("hpf-sim", {**places, "ptz": head}).simulated
    assert not load("hpf-sim", {**places, "ptz": {**head, "link": "aux"}}).simulated


def test_a_running_simulation_offers_the_head_beside_the_others() -> None:
    for link, place in (("sim", "x/ptz"), ("aux", "aux"), ("/dev/ttyUSB2", "/dev/ttyUSB2")):
        ptz = app.plugged_into(config(link=link), Path("x")).ptz
        assert ptz is not None
        assert ptz.link == place
    assert app.plugged_into(load("hpf-sim"), Path("x")).ptz is None


def test_a_base_without_aux_port_is_refused_for_a_head_on_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(P2osBase, "aux_link")

    async def build() -> None:
        settings = config(link="aux")
        app.build(settings, app.in_memory(rig_of(config())))

    with pytest.raises(ConfigError, match="no AUX port"):
        clock.run_virtual(build())


def test_a_fault_of_a_head_on_the_aux_port_has_no_line_of_its_own() -> None:
    fault = Fault("ptz", FaultKind.OFF, 1.0, 1.0)
    with pytest.raises(UsageError, match="AUX"):
        Rig(scene(), app.equipment(config(link="aux")), 0, [fault])


def test_the_simulated_robot_is_the_same_with_and_without_a_head() -> None:
    """Its random numbers are its own."""
    poses = []
    for settings in (load("hpf-sim"), config()):
        rig = Rig(scene(), app.equipment(settings), 3)
        rig.world.advance(0.0)
        rig.world.drive(0.4, 0.5)
        rig.world.advance(2.0)
        poses.append(rig.world.pose)
    assert poses[0] == poses[1]


async def looks_around(rig: Rig, head: PanTilt, states: list[PtzState], rest: float) -> None:
    """Left, right, and back again."""
    while not states:
        await clock.sleep(0.05)
    for pan in (35.0, -50.0, 0.0):
        head.look(radians(pan), radians(5))
        await clock.sleep(rest)
        assert seen(rig) == pytest.approx(pan, abs=0.4)
        assert degrees(states[-1].pan) == pytest.approx(pan, abs=0.12)
        assert clock.now() - states[-1].stamp < 0.5
        assert not states[-1].moving


def test_a_head_on_the_bases_aux_port_works_as_on_its_own() -> None:
    states: list[PtzState] = []

    def note(measurement: Measurement) -> None:
        if isinstance(measurement, PtzState):
            states.append(measurement)

    async def run() -> None:
        rig = rig_of(config(link="aux"))
        assert rig.ptz is None
        base = P2osBase(P2osSettings(), rig.robot.link)
        head = Vcc50i(Vcc50iSettings(), base.aux_link())
        parts = (rig.robot.run(), base.run(note), head.run(note))
        story = looks_around(rig, head, states, 3.0)
        stories = clock.together(*parts, ended(story))
        with pytest.raises(Ended):
            await stories

    clock.run_virtual(run())
    assert np.median(np.diff([state.stamp for state in states])) < 0.25


class Ended(Exception):
    """The story is over, and with it what goes on for ever."""


async def ended(story: Any) -> None:
    """Raise Ended after the story."""
    await story
    raise Ended


def test_the_camera_model_of_an_image_follows_the_head(monkeypatch: pytest.MonkeyPatch) -> None:
    offered: list[Image] = []
    watched: list[Measurement] = []

    async def run() -> None:
        daemon = app.build(config(), app.in_memory(rig_of(config())))
        monkeypatch.setattr(daemon.vision, "offer", offered.append)
        daemon.measurement_watchers.append(watched.append)
        mounted = app.equipment(config()).camera
        picture = np.zeros((144, 192, 3), np.uint8)
        daemon.take(Image(0, 1.0, 1.02, picture, mounted))  # nobody knows where it looks
        daemon.take(PtzState(0.99, 0.3, 0.1, 1.0, moving=True))
        daemon.take(PtzState(1.05, 0.6, 0.1, 1.0, moving=True))
        daemon.take(Image(1, 1.02, 1.04, picture + 1, mounted))
        assert [image.id for image in offered] == [1]
        assert offered[0].camera.yaw == pytest.approx(mounted.yaw + 0.45)
        assert watched[-1] is offered[0]

    clock.run_virtual(run())


@pytest.mark.slow
@pytest.mark.parametrize(("link", "hold"), [("sim", 0.1), ("aux", 2.5)])
def test_the_whole_daemon_knows_where_its_camera_looks(
    link: str, hold: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a line of its own the head turns all the while, on the base's AUX port now and then."""
    wrong: list[float] = []

    async def run() -> None:
        settings = config(link=link)
        rig = rig_of(settings)
        daemon = app.build(settings, app.in_memory(rig))
        offer = daemon.vision.offer
        true: dict[float, float] = {}

        def aim(camera: Camera, now: float) -> Camera:
            turned = rig.head.aimed(camera, now)
            true[now] = turned.yaw
            return turned

        def look(image: Image) -> None:
            wrong.append(abs(degrees(image.camera.yaw - true[image.stamp])))
            offer(image)

        monkeypatch.setattr(rig.camera, "_aim", aim)
        monkeypatch.setattr(daemon.vision, "offer", look)

        async def turn() -> None:
            assert daemon.head is not None
            while clock.now() < 16:
                daemon.head.look(radians(40 * np.sin(clock.now() / 2)), 0)
                await clock.sleep(hold)

        with pytest.raises(Ended):
            await clock.together(rig.run(), daemon.run(), ended(turn()))

    clock.run_virtual(run())
    assert len(wrong) > 60
    assert np.mean(wrong) < 0.7
    assert max(wrong) < 3.5


@pytest.mark.slow
def test_the_robot_follows_while_its_head_looks_to_and_fro() -> None:
    """The person's bearing is the head's pan and the picture's column together."""
    wagging = []

    def attach(daemon: Daemon) -> None:
        async def wag() -> None:
            assert daemon.head is not None
            await clock.sleep(8.0)
            while True:
                daemon.head.look(radians(15) * np.sin(1.5 * clock.now()), 0)
                await clock.sleep(1 / 15)

        wagging.append(asyncio.get_running_loop().create_task(wag()))

    follow = simulate(config(), 25.0, attach)
    assert follow["stops"] == []
    assert follow["mode_s"]["following"] > 20
    assert follow["follow"]["tracking_rate"] == 1.0
    assert follow["follow"]["bearing_rmse_deg"] < 1.0


@pytest.mark.slow
async def test_the_head_answers_on_a_real_pty(tmp_path: Path) -> None:
    states: list[PtzState] = []

    def note(measurement: Measurement) -> None:
        assert isinstance(measurement, PtzState)
        states.append(measurement)

    rig = rig_of(config())
    assert rig.ptz is not None
    with on_pty(rig.ptz, tmp_path / "ptz"):
        head = Vcc50i(Vcc50iSettings(), open_link(str(tmp_path / "ptz")))

        async def story() -> None:
            while not states:
                await clock.sleep(0.02)
            head.look(radians(20), 0)
            while degrees(states[-1].pan) < 19.9:
                await clock.sleep(0.02)

        with pytest.raises(Ended):
            await clock.together(rig.ptz.run(), head.run(note), ended(story()))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [FaultKind.FLIP, FaultKind.DROP, FaultKind.GARBAGE])
def test_from_cold_and_over_a_bad_line_a_head_on_the_aux_port_gets_where_it_is_asked(
    kind: FaultKind,
) -> None:
    """The camera is off, knows nothing, and a tenth of the base's packets is damaged."""
    states: list[PtzState] = []

    def note(measurement: Measurement) -> None:
        if isinstance(measurement, PtzState):
            states.append(measurement)

    async def run() -> None:
        body = FloorBody()
        twin = Vcc50iTwin(np.random.default_rng(1), is_on=False)
        robot = P2osTwin(body, np.random.default_rng(2))
        robot.attach_aux(twin)
        line = Line(robot, np.random.default_rng(3), "robot")
        line_faults = Fault("robot", kind, 4.0, 20.0, 0.1)
        base = P2osBase(P2osSettings(), line.link)
        head = Vcc50i(Vcc50iSettings(), base.aux_link())

        async def story() -> None:
            line.inject(line_faults)
            while clock.now() < 34.0:
                head.look(radians(25), radians(10))
                await clock.sleep(0.5)
            camera = twin.aimed(app.equipment(load("hpf-sim")).camera, clock.now())
            assert degrees(camera.yaw) == pytest.approx(25, abs=0.4)
            assert degrees(states[-1].pan) == pytest.approx(25, abs=0.12)
            assert clock.now() - states[-1].stamp < 1.0

        reports: list[Report] = []
        devices = [supervise(device, note, reports.append) for device in (base, head)]
        with pytest.raises(Ended):
            await clock.together(line.run(), *devices, ended(story()))

    clock.run_virtual(run())
