"""Whatever state the LMS200 was left in, the driver brings it to streaming by itself."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
import structlog

from followerd.geometry import Pose2
from followerd.hw.lms200.scans import Unit
from followerd.hw.lms200.telegrams import (
    BAUD_CODES,
    FACTORY_CONFIG,
    PASSWORD,
    POLLUTED,
    Command,
    Mode,
    variant_data,
)
from followerd.hw.lms200.variant import VARIANTS, Variant
from followerd.sim.twins.lms200 import Lms200Twin
from tests.lms200_bench import Bench, Round, TwinOptions, streams, twin

Deed = Callable[[Bench], None]


def at(baud: int, *then: Deed) -> Deed:
    """Somebody has set its rate, and what else."""

    def deed(device: Bench) -> None:
        assert device.set_mode(BAUD_CODES[baud])
        for further in then:
            further(device)

    return deed


def in_mode(mode: Mode, parameters: bytes = b"") -> Deed:
    def deed(device: Bench) -> None:
        assert device.set_mode(mode, parameters)

    return deed


def as_variant(field_deg: int, resolution: int) -> Deed:
    def deed(device: Bench) -> None:
        device.told(Command.VARIANT, variant_data(Variant(field_deg, resolution)))

    return deed


def cut_in_mid_telegram(device: Bench) -> None:
    """A program ended in the middle of its request."""
    device.twin.receive(b"\x02\x00\x0a\x00\x20\x00SI", device.now)


@dataclass(frozen=True)
class State:
    """How a laser is found."""

    deed: Deed = lambda _: None
    made: TwinOptions = field(default_factory=TwinOptions)


STREAM, PARTS = in_mode(Mode.STREAM), in_mode(Mode.STREAM_PARTIAL)
MEANS, SECTOR = in_mode(Mode.STREAM_MEAN, b"\5"), in_mode(Mode.STREAM_SUBRANGE, b"\1\0\xb5\0")
LONG_MEANS = in_mode(Mode.STREAM_MEAN, b"\xfa")  # one in 6.7 s
SECTOR_MEANS = in_mode(Mode.STREAM_MEAN_SUBRANGE, b"\5\x0b\0\x3c\0")
STATES = {
    "fresh": State(),
    **{f"idle at {baud}": State(at(baud)) for baud in BAUD_CODES},
    **{f"streaming at {baud}": State(at(baud, STREAM)) for baud in BAUD_CODES},
    **{f"parts at {baud}": State(at(baud, PARTS)) for baud in BAUD_CODES},
    **{f"means at {baud}": State(at(baud, MEANS)) for baud in BAUD_CODES},
    "long means at 500000": State(at(500000, LONG_MEANS)),
    "a sector at 38400": State(at(38400, SECTOR)),
    "means of a sector at 19200": State(at(19200, SECTOR_MEANS)),
    "boots at 38400": State(made={"power_on_baud": 38400}),
    "boots at 500000, streaming": State(STREAM, {"power_on_baud": 500000}),
    "in installation mode": State(in_mode(Mode.INSTALLATION, PASSWORD)),
    "in installation mode at 500000": State(at(500000, in_mode(Mode.INSTALLATION, PASSWORD))),
    "cut in mid-telegram": State(at(38400, cut_in_mid_telegram)),
    "address 1": State(made={"address": 1}),
    "address 1, streaming": State(at(38400, STREAM), {"address": 1}),
    "variant 100/0.25": State(as_variant(100, 25)),
    "variant 100/1, streaming": State(at(500000, as_variant(100, 100), STREAM)),
    "in cm": State(STREAM, {"config": FACTORY_CONFIG.with_values(0, Unit.CM)}),
    "up to 32 m": State(made={"config": FACTORY_CONFIG.with_values(5, Unit.MM)}),
    "with numbered scans": State(STREAM, {"config": FACTORY_CONFIG.with_indices(True)}),
    "dirty": State(made={"polluted": True}),
}


OTHER_RATES = [pytest.param(baud, marks=pytest.mark.slow) for baud in (9600, 38400)]


@pytest.mark.parametrize("baud", [500000, *OTHER_RATES])
@pytest.mark.parametrize("state", STATES)
def test_the_first_scan_comes_within_three_seconds_of_any_start(state: str, baud: int) -> None:
    device = twin(**STATES[state].made)
    bench = Bench(device)
    STATES[state].deed(bench)
    it = streams(device, 1, begin=bench.now, baud=baud)
    scan = it.scans[0]
    assert scan.stamp - bench.now < 3.0
    assert scan.ranges.size == 361
    assert np.nanmedian(scan.ranges) == pytest.approx(3.0, abs=0.03)
    assert scan.range_max == pytest.approx(8.182)
    assert scan.degraded == bool(device.status & POLLUTED)
    assert device.mode is Mode.ON_REQUEST, "taking leave stops the stream"
    assert device.baud == (baud if "power_on_baud" in STATES[state].made else 9600)


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: f"{v.field}/{v.resolution}")
@pytest.mark.parametrize("unit", ["mm", "cm"])
def test_every_variant_streams_in_either_unit(variant: Variant, unit: str) -> None:
    resolution = variant.resolution / 100
    it = streams(twin(Round(4.0)), field_deg=variant.field, resolution_deg=resolution, unit=unit)
    for scan in it.scans:
        assert scan.angles == pytest.approx(variant.bearings)
        assert np.nanmedian(scan.ranges) == pytest.approx(4.0, abs=0.03)
    assert it.driver.counters.unusable_scans == 0


@pytest.mark.parametrize("at", [20.0, 21.3, 59.5])
@pytest.mark.parametrize("power_on_baud", BAUD_CODES)
def test_a_booting_laser_is_waited_for_and_streams_three_seconds_later(
    at: float, power_on_baud: int
) -> None:
    with structlog.testing.capture_logs() as logs:
        it = streams(twin(boot_time=at, power_on_baud=power_on_baud), 1, at + 4.0)
    assert it.scans[0].received < at + 3.0
    said = [log["event"] for log in logs]
    assert said.count("laser still booting, waiting") == 1
    assert said.index("laser still booting, waiting") < said.index("laser set up")


class HardOfHearing(Lms200Twin):
    """Hears some requests damaged, and says so."""

    def __init__(self, every: int) -> None:
        super().__init__(Round(), np.random.default_rng(0), Pose2())
        self._every = every
        self._heard = 0

    def receive(self, data: bytes, now: float) -> None:
        self._heard += 1
        if self._heard % self._every == 0:
            data = data[:-1] + bytes((data[-1] ^ 1,))
        super().receive(data, now)


@pytest.mark.parametrize("every", [2, 3, 4])
def test_what_is_refused_by_nak_is_said_again(every: int) -> None:
    it = streams(HardOfHearing(every), 1)
    assert it.scans[0].received < 3.0
