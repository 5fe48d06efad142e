"""Who stands beside a robot that is driven into faults shows it what its tracker looks for."""

import asyncio

import pytest

from followerd import app
from followerd.bench.bystander import rearm
from followerd.bench.closed_loop import simulate
from followerd.config import load
from followerd.control.transitions import Action
from followerd.messages import Box, TrackState
from followerd.runtime.daemon import Daemon
from followerd.sim.faults import Fault, FaultKind

HOLD_AT, SHOWN_AT = 5.0, 10.0  # s
HEAD = 0.15, 0.30  # m, how tall one is


def shown_to(preset: str, monkeypatch: pytest.MonkeyPatch, *faults: Fault) -> list[float]:
    """How tall whatever is shown is where the person stands, m; the robot holds from `HOLD_AT`."""
    config = load(preset, {"sim.scenario": "face-to-face", "seed": 7001})
    rig, enrol = app.rig(config, faults), Daemon.enrol
    shown: list[float] = []
    beside: list[asyncio.Task[None]] = []

    async def seen(
        daemon: Daemon, region: Box | tuple[float, float], frame_id: int | None = None
    ) -> TrackState:
        assert isinstance(region, Box)
        shown.append(region.h * rig.truths[-1].target.distance / app.equipment(config).camera.fy)
        return await enrol(daemon, region, frame_id)

    def attach(daemon: Daemon) -> None:
        asyncio.get_running_loop().call_at(HOLD_AT, daemon.act, Action.HOLD)
        heads = config.tracker.kind == "head"
        beside.append(asyncio.ensure_future(rearm(daemon, rig, heads=heads)))

    monkeypatch.setattr(Daemon, "enrol", seen)
    simulate(config, SHOWN_AT + 0.5, attach, world=rig)
    return shown


@pytest.mark.slow
def test_a_robot_in_doubt_is_shown_a_head_where_its_tracker_wants_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shown = shown_to("head-sim", monkeypatch)
    assert len(shown) == 2
    assert all(HEAD[0] < height < HEAD[1] for height in shown), shown


@pytest.mark.slow
def test_nobody_is_shown_where_a_silent_laser_last_saw_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert len(shown_to("hpf-sim", monkeypatch)) == 2
    silent = Fault("laser", FaultKind.OFF, SHOWN_AT - 0.8, 60.0)
    assert len(shown_to("hpf-sim", monkeypatch, silent)) == 1  # at the start
