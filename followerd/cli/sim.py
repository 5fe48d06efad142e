"""`followerd sim`: the twins alone, for this daemon or for anybody's program; their faults."""

import asyncio
import json
import os
import signal
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

import cv2
from cyclopts import Parameter

from followerd import app, clock
from followerd.config import load
from followerd.errors import UsageError
from followerd.runtime import logs
from followerd.runtime.control_socket import ask, listen
from followerd.sim.faults import Fault
from followerd.sim.rig import Rig
from followerd.sim.serve import on_pty, on_ring, on_tcp
from followerd.sim.truth_log import to_line

CONTROL = "control"  # socket in the folder of the links
LOOK = 0.01  # s, between looks whether it is there
STDIN = 0
FLUSH = 0.1  # s, between writes of the truth


def sim(
    scenario: str,
    *,
    links: Annotated[
        Path,
        Parameter(help="folder for the ptys `robot`, `laser`, `ptz` and the frame ring `camera`"),
    ],
    robot_tcp: Annotated[int | None, Parameter(help="also the base's bytes on this port")] = None,
    laser_tcp: Annotated[int | None, Parameter(help="also the laser's bytes on this port")] = None,
    fault: Annotated[
        tuple[str, ...], Parameter(help="DEVICE:NAME@STARTs+LENGTHs, such as laser:garbage@10s+2s")
    ] = (),
    config: Annotated[str, Parameter(help="what stands on the robot: a config or its name")] = (
        "hpf-sim"
    ),
    seed: int = 0,
    truth: Annotated[Path | None, Parameter(help="write what really happens, JSON lines")] = None,
    until_eof: Annotated[
        bool, Parameter(help="end when standard input does, and so with whoever started it")
    ] = False,
) -> None:
    """Offer a simulated robot's serial lines and camera until interrupted.

    `followerd run hpf-sim --links DIR` follows against them; so does any program for real devices.
    """
    settings = load(config, {"sim.scenario": scenario, "seed": seed})
    logs.configure(settings.log_level)
    cv2.setNumThreads(1)
    rig = app.rig(settings, [Fault.parse(text) for text in fault])
    rig.world.render(app.equipment(settings).camera)  # textures are painted for the first picture
    clock.run(_serve(rig, links, robot_tcp, laser_tcp, truth, until_eof))


async def _serve(
    rig: Rig,
    links: Path,
    robot_tcp: int | None,
    laser_tcp: int | None,
    truth: Path | None,
    until_eof: bool,
) -> None:
    if until_eof:
        asyncio.get_running_loop().add_reader(STDIN, _read_to_eof)
    with ExitStack() as offers:
        ptys = [line for line in (rig.robot, rig.laser, rig.ptz) if line is not None]
        for line in ptys:
            offers.enter_context(on_pty(line, links / line.name))
        offers.enter_context(on_ring(rig.camera, links / "camera"))
        for line, port in ((rig.robot, robot_tcp), (rig.laser, laser_tcp)):
            if port is not None:
                print(f"{line.name}: tcp port {offers.enter_context(on_tcp(line, port))}")
        offered = f"{', '.join(line.name for line in ptys)} and camera are in {links}"
        control = listen(links / CONTROL, lambda line: answer(rig, line))
        ready = _announce(offered, links / CONTROL)
        parts = clock.together(rig.run(), control, _tell(rig, truth), ready)
        await clock.until_signal(parts, signal.SIGTERM, signal.SIGINT)


def _read_to_eof() -> None:
    """A pipe ends with the process that holds its other end, however that ends."""
    if not os.read(STDIN, 4096):
        asyncio.get_running_loop().remove_reader(STDIN)
        signal.raise_signal(signal.SIGTERM)


async def _announce(offered: str, control: Path) -> None:
    """Say that everything is there, once it is."""
    while not control.is_socket():
        await clock.sleep(LOOK)
    print(offered, flush=True)


async def answer(rig: Rig, line: bytes) -> dict[str, Any]:
    """What one line at the control socket gets: `{"fault": "laser:off+2s"}`."""
    try:
        text = json.loads(line)["fault"]
        begun = rig.inject(str(text))
    except (ValueError, TypeError, KeyError):
        return {"ok": False, "error": 'a request is one JSON object a line: {"fault": "..."}'}
    except UsageError as error:
        return {"ok": False, "error": str(error)}
    return {"ok": True, "start_s": round(begun.start, 3), "end_s": round(begun.end, 3)}


def fault(
    links: Annotated[Path, Parameter(help="the simulation's folder")],
    /,
    *faults: Annotated[str, Parameter(help="DEVICE:NAME+LENGTHs, or DEVICE:NAME@STARTs+LENGTHs")],
) -> None:
    """Let twins of a running `followerd sim --links LINKS` fail, now or at a time of its own.

    Devices: robot, laser, camera, ptz. Faults: off, stuck, garbage, wrong, slow, drop, flip,
    duplicate, split, delay, disconnect, reboot. `laser:off+2s` begins at once, `laser:off@10s+2s`
    when the simulation is 10 s old.
    """
    for text in faults:
        path = links / CONTROL
        answered = clock.run(ask(path, {"fault": text}, "simulation", "followerd sim"))
        if not answered["ok"]:
            raise UsageError(answered["error"])
        print(f"{text}: from {answered['start_s']} s to {answered['end_s']} s")


async def _tell(rig: Rig, path: Path | None) -> None:
    """Write the truth as it grows, and forget it."""
    file = open(path or os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123 closed below
    try:
        while True:
            await clock.sleep(FLUSH)
            for instant in rig.truths:
                file.write(to_line(instant) + "\n")
            rig.truths.clear()
            file.flush()
    finally:
        file.close()
