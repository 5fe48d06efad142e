"""Cables pulled and put back in real time, on ptys and a frame ring, under the whole daemon."""

import asyncio
import sys
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from followerd import app, clock
from followerd.config import Config, load
from followerd.control.transitions import ARMED
from followerd.messages import Decision, Image, Measurement, Odometry, PtzState, Scan, StopReason
from followerd.pytest_plugin import Simulation
from followerd.runtime import logs
from followerd.runtime.auto_operator import AutoOperator
from followerd.runtime.daemon import Daemon

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

AWAY = 2.0  # s
NOTICED, BACK = 0.35, 3.0  # s, at most
STREAMS: dict[str, tuple[str, type[Measurement]]] = {
    "robot": ("base", Odometry),
    "laser": ("laser", Scan),
    "camera": ("camera", Image),
    "ptz": ("ptz", PtzState),
}
PTZ = {"ptz.kind": "vcc50i", "ptz.link": "sim"}


@dataclass
class Log:
    """What came of a daemon, each with its time."""

    decisions: list[Decision] = field(default_factory=list)
    measured: list[tuple[float, Measurement]] = field(default_factory=list)

    def attach(self, daemon: Daemon) -> None:
        daemon.decision_watchers.append(self.decisions.append)
        daemon.measurement_watchers.append(lambda m: self.measured.append((clock.now(), m)))

    def lost(self, device: str, after: float) -> float:
        """When the daemon first said that a device is lost."""
        return next(
            d.stamp
            for d in self.decisions
            if d.stamp > after
            and any(r.stop is StopReason.LINK_LOST and r.device == device for r in d.reasons)
        )

    def back(self, kind: type[Measurement], after: float) -> float:
        """When the first measurement came again."""
        return next(t for t, m in self.measured if t > after and isinstance(m, kind))


async def until(what: Callable[[], bool], seconds: float) -> None:
    async def look() -> bool:
        while not what():
            await clock.sleep(0.02)
        return True

    assert await clock.within(seconds, look()), "it did not come to pass"


def plugged_into(twins: Simulation, device: str) -> Config:
    return app.plugged_into(load("hpf-sim", PTZ if device == "ptz" else {}), twins.links)


@pytest.mark.parametrize("device", STREAMS)
def test_an_unplugged_device_is_noticed_comes_back_and_the_robot_stands_until_armed(
    device: str, simulation: Callable[[], Simulation]
) -> None:
    name, kind = STREAMS[device]
    log = Log()
    times: dict[str, float] = {}

    async def main() -> None:
        logs.configure("error")
        twins = await asyncio.to_thread(simulation)
        config = plugged_into(twins, device)
        daemon = app.build(config, app.hardware(config))
        log.attach(daemon)
        running = asyncio.create_task(daemon.run())
        operator = asyncio.create_task(AutoOperator(daemon).run())
        await until(lambda: (truth := twins.newest()) is not None and truth.twist.v > 0.15, 20.0)
        await operator
        times["pulled"] = clock.now()
        await asyncio.to_thread(twins.fail, f"{device}:disconnect+{AWAY}s")
        await clock.sleep(AWAY + BACK)
        stood = twins.newest()
        times["noticed"] = log.lost(name, times["pulled"])
        times["back"] = log.back(kind, times["pulled"] + AWAY)
        await clock.sleep(1.0)
        assert not any(d.mode in ARMED for d in log.decisions if d.stamp >= times["noticed"])
        assert all(d.command.stops for d in log.decisions if d.stamp >= times["noticed"])
        stands = twins.newest()
        assert stood is not None
        assert stands is not None
        assert stands.pose == stood.pose
        running.cancel()

    clock.run(main())
    noticed = times["noticed"] - times["pulled"]
    back = times["back"] - times["pulled"] - AWAY
    sys.stdout.write(f"{device}: noticed after {noticed:.3f} s, back after {back:.2f} s\n")
    assert noticed <= NOTICED
    assert back <= BACK
