"""One suite for every driver: what must hold on whatever line, with whatever device at its end."""

import gc
import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from followerd import clock
from followerd.messages import Image, Measurement, Odometry, PtzState, Scan
from followerd.runtime import logs
from followerd.sim.faults import FaultKind
from tests.conformance import outcome_of, start_up
from tests.specimens import BAD_LINES, MEMORY, SPECIMENS, BadLine, Specimen

RECOVERY = 3.0  # s, unless it must be looked for at all rates, boot, or find its home
LONGER = {
    **{("base", name): 5.0 for name in ("off", "garbage", "slow", "reboot")},
    ("laser", "reboot"): 4.5,
    ("ptz", "reboot"): 12.0,
}
HARMLESS = ("duplicate", "split", "one byte at a time", "garbage between telegrams")
SILENT = ("off", "disconnect", "reboot")
QUICK = ("disconnect", "reboot", "garbage", "garbage inside telegrams", "commands garbled")
LINES = {line.name: line for line in BAD_LINES}


@pytest.fixture(autouse=True)
def quiet() -> None:
    logs.configure("error")


def must_hold(device: str, line: BadLine, seed: int) -> None:
    """What each driver owes; anything raised but a DeviceError would have come through."""
    bound = LONGER.get((device, line.name), RECOVERY)
    outcome = outcome_of(device, line, seed, after=bound + 2.0)
    sys.stdout.write(f"{device:7}{line.name:26}{seed:3}: back after {outcome.back:.2f} s\n")
    assert not outcome.untrue, outcome.untrue[:3]
    assert outcome.back <= bound
    usual = outcome.rate(outcome.began - 1.5, outcome.began)
    assert outcome.rate(outcome.ended + bound, outcome.ended + bound + 2.0) > 0.85 * usual
    assert not outcome.moved_since_report
    for report in outcome.reports:
        assert report.device == device
    assert not outcome.reports or outcome.reports[-1].recovered
    if line.name in HARMLESS:
        assert not outcome.reports
    if line.name == "disconnect":
        assert outcome.reports[0].stamp - outcome.began < 0.11  # the camera's at the next frame
    if line.name in SILENT:
        assert outcome.rate(outcome.began + MEMORY, outcome.ended) == 0.0


@pytest.mark.parametrize("device", SPECIMENS)
@pytest.mark.parametrize("name", QUICK)
def test_a_driver_survives_a_bad_line(device: str, name: str) -> None:
    must_hold(device, LINES[name], seed=0)


@pytest.mark.slow
@pytest.mark.parametrize("device", SPECIMENS)
@pytest.mark.parametrize("name", LINES)
def test_every_driver_survives_every_bad_line(device: str, name: str) -> None:
    for seed in range(1, 6):
        must_hold(device, LINES[name], seed)


def lie(measured: Measurement) -> Measurement:
    """The measurement, but not true."""
    match measured:
        case Odometry():
            return replace(measured, twist=replace(measured.twist, v=measured.twist.v + 0.1))
        case Scan():
            return replace(measured, ranges=measured.ranges + 0.2)
        case Image():
            return replace(measured, pixels=np.invert(measured.pixels))
        case PtzState():
            return replace(measured, pan=3.0)


@pytest.mark.parametrize("device", SPECIMENS)
def test_a_lie_would_be_seen(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = SPECIMENS[device]

    def make(line: BadLine, seed: int) -> Specimen:
        specimen = made(line, seed)
        sees = specimen.untrue
        monkeypatch.setattr(specimen, "untrue", lambda m, line: sees(lie(m), line))
        return specimen

    monkeypatch.setitem(SPECIMENS, device, make)
    assert len(outcome_of(device, LINES["split"], length=0.1, after=0.5).untrue) > 5


@pytest.mark.slow
@pytest.mark.parametrize("device", ["base", "laser", "ptz"])
@pytest.mark.parametrize("kind", [FaultKind.FLIP, FaultKind.DROP, FaultKind.GARBAGE, None])
def test_a_driver_comes_up_where_a_tenth_is_hurt_both_ways(
    device: str, kind: FaultKind | None
) -> None:
    line = BadLine("bad from the start", kind, noise=kind is None, deaf=0.05, hurt=0.05)
    for seed in range(6):
        stamps = clock.run_virtual(start_up(device, line, seed, share=0.1, count=20))
        sys.stdout.write(f"{device:7}{kind}: first after {stamps[0]:.1f} s\n")
        assert stamps[-1] < 30.0


@pytest.mark.slow
@pytest.mark.parametrize("device", SPECIMENS)
def test_noise_for_a_long_time_costs_no_memory(device: str) -> None:
    def peak(length: float) -> int:
        gc.collect()
        tracemalloc.start()
        outcome_of(device, BadLine("garbage", FaultKind.GARBAGE), 0, length)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    short = peak(5.0)
    assert peak(60.0) < short + 200_000
