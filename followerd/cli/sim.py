"""`followerd sim`: the twins alone, for this daemon or for anybody's program."""

import os
import signal
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import cv2
from cyclopts import Parameter

from followerd import app, clock
from followerd.config import load
from followerd.runtime import logs
from followerd.sim.faults import Fault
from followerd.sim.rig import Rig
from followerd.sim.serve import on_pty, on_ring, on_tcp
from followerd.sim.truth_log import to_line

FLUSH = 0.1  # s, between writes of the truth


def sim(
    scenario: str,
    *,
    links: Annotated[Path, Parameter(help="folder for the ptys `robot`, `laser` and `camera`")],
    robot_tcp: Annotated[int | None, Parameter(help="also the base's bytes on this port")] = None,
    laser_tcp: Annotated[int | None, Parameter(help="also the laser's bytes on this port")] = None,
    fault: Annotated[tuple[str, ...], Parameter(help="DEVICE:NAME@START+LENGTH, in s")] = (),
    config: Annotated[str, Parameter(help="what stands on the robot: a config or its name")] = (
        "hpf-sim"
    ),
    seed: int = 0,
    truth: Annotated[Path | None, Parameter(help="write what really happens, JSON lines")] = None,
) -> None:
    """Offer a simulated robot's serial lines and camera until interrupted.

    `followerd run hpf-sim --links DIR` follows against them; so does any program for real devices.
    """
    settings = load(config, {"sim.scenario": scenario, "seed": seed})
    logs.configure(settings.log_level)
    cv2.setNumThreads(1)
    rig = app.rig(settings, [Fault.parse(text) for text in fault])
    rig.world.render(app.equipment(settings).camera)  # textures are painted for the first picture
    clock.run(_serve(rig, links, robot_tcp, laser_tcp, truth))


async def _serve(
    rig: Rig, links: Path, robot_tcp: int | None, laser_tcp: int | None, truth: Path | None
) -> None:
    with ExitStack() as offers:
        offers.enter_context(on_pty(rig.robot, links / "robot"))
        offers.enter_context(on_pty(rig.laser, links / "laser"))
        offers.enter_context(on_ring(rig.camera, links / "camera"))
        for line, port in ((rig.robot, robot_tcp), (rig.laser, laser_tcp)):
            if port is not None:
                print(f"{line.name}: tcp port {offers.enter_context(on_tcp(line, port))}")
        print(f"robot, laser and camera are in {links}", flush=True)
        await clock.until_signal(clock.together(rig.run(), _tell(rig, truth)), *ENDS)


ENDS = (signal.SIGTERM, signal.SIGINT)


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
