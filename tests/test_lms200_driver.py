"""The LMS200 driver finds the laser in any state, keeps it streaming, and stamps its scans."""

import asyncio
from collections.abc import Callable
from math import inf
from typing import Any

import numpy as np
import pytest
import structlog
from pydantic import ValidationError

from followerd import clock
from followerd.errors import LinkLost, SetupError
from followerd.geometry import Array, Pose2
from followerd.hw.lms200.driver import Lms200
from followerd.hw.lms200.protocol import Telegram, TelegramDecoder
from followerd.hw.lms200.scans import Unit
from followerd.hw.lms200.settings import Lms200Settings, Mount, delivered_period
from followerd.hw.lms200.telegrams import (
    BAUD_CODES,
    FACTORY_CONFIG,
    Command,
    Config,
    Mode,
)
from followerd.hw.lms200.variant import Variant
from followerd.hw.stream import ByteStream
from followerd.messages import Measurement
from followerd.sim.faults import Fault, FaultKind
from followerd.sim.line import Line, MemoryStream
from followerd.sim.twins.lms200 import Lms200Twin
from tests.lms200_bench import Bench, Rig, Round, fails, rig, streams, twin

# -- no laser, a strange laser ---------------------------------------------------------------


def test_a_silent_port_is_an_error_after_a_minute() -> None:
    error, when = fails(twin(boot_time=inf))
    assert isinstance(error, SetupError)
    assert 65.0 < when < 70.0
    assert "laser: no answer within 65 s at 9600, 19200, 38400, 500000 baud" in str(error)
    assert "24 V" in str(error)


class Babbler(Lms200Twin):
    """Some other device."""

    def __init__(self) -> None:
        super().__init__(Round(), np.random.default_rng(0), Pose2())
        self._noise = np.random.default_rng(1)
        self._next = 0.0

    def receive(self, data: bytes, now: float) -> None:
        """Deaf."""

    def step(self, now: float) -> bytes:
        self._next = now + 0.1
        return self._noise.bytes(40)

    def wake_at(self) -> float:
        return self._next


def test_a_port_that_talks_something_else_is_an_error() -> None:
    error, when = fails(Babbler())
    assert isinstance(error, SetupError)
    assert when < 30.0
    assert "no LMS2xx telegram" in str(error)


class HardOfHearing(Lms200Twin):
    """Hears every other request damaged."""

    heard = 0

    def receive(self, data: bytes, now: float) -> None:
        self.heard += 1
        if self.heard % 2:
            data = data[:-1] + bytes((data[-1] ^ 1,))
        super().receive(data, now)


def test_what_is_refused_by_nak_is_said_again() -> None:
    device = HardOfHearing(Round(), np.random.default_rng(0), Pose2())
    it = streams(device, 1)
    assert it.scans[0].received < 3.0


def test_a_laser_with_an_address_of_its_own_is_heard() -> None:
    assert streams(twin(address=1)).scans


class SocketLike:
    """The twin's bytes over a socket: the host has no line rate."""

    def __init__(self, line: Line) -> None:
        self.name = "socket"
        self._line = line

    async def open(self, device: str, baud: int) -> MemoryStream:
        class Stream(MemoryStream):
            def set_baud(self, baud: int) -> None:
                """No effect."""

        stream = Stream(self._line, device, baud)
        stream.baud = None
        self._line.ports.append(stream)
        return stream


def test_over_a_socket_the_laser_still_streams_at_the_configured_rate() -> None:
    async def story() -> list[Measurement]:
        device = twin()
        line = Line(device, np.random.default_rng(5), "laser")
        scans: list[Measurement] = []
        driver = Lms200(Lms200Settings(baud=500000), SocketLike(line))
        async with asyncio.TaskGroup() as tasks:
            carrying = tasks.create_task(line.run())
            running = tasks.create_task(driver.run(scans.append))
            await clock.sleep(1.2)
            assert device.baud == 500000
            running.cancel()
            await asyncio.wait([running])
            carrying.cancel()
        return scans

    assert len(clock.run_virtual(story())) > 5


class SlowAdapter:
    """A port that cannot do 500000 baud."""

    def __init__(self, line: Line) -> None:
        self.name = "adapter"
        self._line = line

    async def open(self, device: str, baud: int) -> ByteStream:
        class Stream(MemoryStream):
            def set_baud(self, baud: int) -> None:
                if baud == 500000:
                    raise SetupError(device, "cannot do 500000 baud")
                super().set_baud(baud)

        stream = Stream(self._line, device, baud)
        self._line.ports.append(stream)
        return stream


@pytest.mark.parametrize(("baud", "works"), [(38400, True), (500000, False)])
def test_an_adapter_without_500000_serves_the_other_rates(baud: int, works: bool) -> None:
    async def story() -> int:
        device = twin()
        Bench(device).set_mode(BAUD_CODES[19200])  # found last
        line = Line(device, np.random.default_rng(5), "laser")
        it = Rig(Lms200(Lms200Settings.model_validate({"baud": baud}), SlowAdapter(line)), line)
        carrying = asyncio.create_task(line.run())
        running = asyncio.create_task(it.driver.run(it.sink))
        await clock.sleep(4.0)
        if not works:
            with pytest.raises(SetupError, match="cannot do 500000 baud"):
                running.result()
        running.cancel()
        await asyncio.wait([running])
        carrying.cancel()
        return len(it.scans)

    assert bool(clock.run_virtual(story())) == works


# -- set-up ---------------------------------------------------------------------------------


class Listening(Lms200Twin):
    """Remembers what it was asked."""

    def __init__(self, config: Config = FACTORY_CONFIG) -> None:
        super().__init__(Round(), np.random.default_rng(0), Pose2(), config=config)
        self.asked: list[int] = []
        self._ear = TelegramDecoder(from_device=False)

    def receive(self, data: bytes, now: float) -> None:
        events = self._ear.feed(data)
        self.asked += [e.command for e in events if isinstance(e, Telegram)]
        super().receive(data, now)


def test_the_configuration_is_written_only_if_it_differs() -> None:
    device = Listening(FACTORY_CONFIG.with_values(2, Unit.CM))

    async def story() -> Rig:
        async with rig(device) as it:
            await it.gets(1, 4.0)
        assert device.asked.count(Command.WRITE_CONFIG) == 1
        device.asked.clear()
        async with rig(device) as again:
            await again.gets(1, 4.0)
        assert device.asked.count(Command.READ_CONFIG) == 1
        assert Command.WRITE_CONFIG not in device.asked
        return it

    it = clock.run_virtual(story())
    assert device.config == FACTORY_CONFIG.with_values(0, Unit.MM)
    assert it.scans[0].range_max == pytest.approx(8.182)


def test_other_bytes_of_the_configuration_are_left_as_they_are() -> None:
    device = Listening(Config(bytes(range(34))[:4] + b"\2\1\0" + bytes(range(7, 34))))
    it = streams(device, unit="cm")
    assert device.config.raw == bytes(range(34))[:4] + b"\2\0\0" + bytes(range(7, 34))
    assert it.scans[0].range_max == pytest.approx(81.82)
    assert it.driver.counters.unusable_scans == 0, "real-time indices are understood"


class Stubborn(Lms200Twin):
    """Refuses one kind of request."""

    def __init__(self, refusal: str) -> None:
        super().__init__(Round(), np.random.default_rng(0), Pose2())
        self._refusal = refusal
        if refusal == "variant":
            self.variant = Variant(100, 100)

    def _change_variant(self, data: bytes) -> bytes | None:
        if self._refusal == "variant":
            return super()._change_variant(b"\xb4\0\x19\0")
        return None if self._refusal == "3B" else super()._change_variant(data)

    def _change_config(self, data: bytes) -> bytes:
        return super()._change_config(data[:5] + b"\x0d" + data[6:])

    def _change_mode(self, request: Telegram, now: float) -> None:
        if self._refusal == "stream" and request.data == bytes((Mode.STREAM,)):
            request = Telegram(0, request.payload + b"\0")  # no parameter is allowed there
        super()._change_mode(request, now)

    def _set_baud(self, baud: int) -> None:
        super()._set_baud(19200 if self._refusal == "rate" else baud)

    @property
    def _type(self) -> bytes:
        return b"LD-OEM1000;123456789 " if self._refusal == "type" else super()._type


@pytest.mark.parametrize(
    ("refusal", "settings", "says"),
    [
        ("variant", {}, "does not take field_deg 180 with resolution_deg 0.5; choose another"),
        ("3B", {}, "does not allow VARIANT"),
        ("config", {"unit": "cm"}, "does not take unit cm"),
        ("stream", {}, "refuses mode 0x24"),
        ("rate", {}, "is silent at 500000 baud, though it accepts that rate; 500000 needs RS-422"),
        ("type", {}, "is a 'LD-OEM1000;123456789', not an LMS2xx"),
    ],
)
def test_a_refused_set_up_is_named_with_its_remedy(
    refusal: str, settings: dict[str, Any], says: str
) -> None:
    error, when = fails(Stubborn(refusal), **settings)
    assert isinstance(error, SetupError)
    assert when < 10.0
    assert says in str(error)


# -- scans ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "settings",
    [
        {"baud": 9600},
        {"baud": 38400},
        {"baud": 500000},
        {"baud": 38400, "resolution_deg": 1},
        {"baud": 500000, "resolution_deg": 1},
        {"baud": 500000, "field_deg": 100, "resolution_deg": 0.25},
    ],
    ids=str,
)
def test_scans_come_at_the_delivered_rate_stamped_when_they_were_measured(
    settings: dict[str, Any],
) -> None:
    scene = Round()
    it = streams(twin(scene), 4, 8.0, **settings)
    stamps = np.array([scan.stamp for scan in it.scans])
    period = delivered_period(it.driver.Settings(**settings))
    assert np.diff(stamps) == pytest.approx(period, abs=1e-3)
    for scan, (bearings, times) in zip(it.scans, scene.measured, strict=False):
        assert scan.angles == pytest.approx(bearings)
        assert scan.stamp + scan.beam_times == pytest.approx(times, abs=2e-3)
        assert scan.received - scan.stamp > it.driver.Settings(**settings).variant.age


class Contradicting(Lms200Twin):
    """After its first scans, sends some that are whole and wrong."""

    sent = 0
    wrong: Callable[[bytes], bytes]

    def step(self, now: float) -> bytes:
        frame = super().step(now)
        if len(frame) < 700:
            return frame
        self.sent += 1
        return frame if self.sent % 3 else Telegram(0x80, self.wrong(frame[4:-2])).to_bytes()


def in_another_unit(payload: bytes) -> bytes:
    return payload[:2] + bytes((payload[2] & 0x3F,)) + payload[3:]


def a_smaller_field(payload: bytes) -> bytes:
    return payload[:1] + b"\xb5\x40" + payload[3 : 3 + 2 * 181] + payload[-1:]


def part_of_a_scan(payload: bytes) -> bytes:
    return payload[:2] + bytes((payload[2] | 0x20,)) + payload[3:]


def implausible(payload: bytes) -> bytes:
    return payload[:-1] + b"\x50"


@pytest.mark.parametrize("wrong", [in_another_unit, a_smaller_field, part_of_a_scan, implausible])
def test_whole_telegrams_with_wrong_content_are_counted_and_passed_over(
    wrong: Callable[[bytes], bytes],
) -> None:
    device = Contradicting(Round(), np.random.default_rng(0), Pose2())
    device.wrong = wrong
    it = streams(device, 20)
    assert it.driver.counters.unusable_scans == pytest.approx(10, abs=1)
    for scan in it.scans:
        assert scan.ranges.size == 361
        assert np.nanmedian(scan.ranges) == pytest.approx(3.0, abs=0.02)


class Post(Round):
    """A post to the left, at 30 degrees; nothing else."""

    def ranges(self, base_from_laser: Pose2, bearings: Array, ages: Array) -> Array:
        super().ranges(base_from_laser, bearings, ages)
        return np.where(np.abs(bearings - np.radians(30)) < 0.03, 2.0, inf)


@pytest.mark.parametrize("upside_down", [False, True])
def test_bearings_count_from_ahead_to_the_left_however_it_is_mounted(upside_down: bool) -> None:
    mount = Mount(x_m=0.1, yaw_deg=90, upside_down=upside_down)
    it = streams(twin(Post(), upside_down=upside_down), mount=mount)
    scan = it.scans[0]
    seen = np.isfinite(scan.ranges)
    assert np.degrees(scan.angles[seen]).mean() == pytest.approx(30, abs=0.6)
    assert np.isposinf(scan.ranges[~seen]).all()
    x, y = np.nanmean(scan.points(), axis=0)
    assert (x, y) == pytest.approx((0.1 - 2 * np.sin(np.pi / 6), 2 * np.cos(np.pi / 6)), abs=0.05)
    assert scan.beam_times[-1 if upside_down else 0] == 0.0


def test_a_dirty_window_degrades_the_scans() -> None:
    assert all(scan.degraded for scan in streams(twin(polluted=True)).scans)
    assert not any(scan.degraded for scan in streams(twin()).scans)


def test_scans_of_a_laser_in_error_are_not_used() -> None:
    async def story() -> Rig:
        device = twin()
        async with rig(device) as it:
            await it.gets(5, 2.0)
            device.status = 0x13
            await clock.sleep(0.1)
            before = len(it.scans)
            await clock.sleep(2.0)
            assert len(it.scans) == before
            assert it.driver.counters.unusable_scans > 10
            device.status = 0x10
            await it.gets(5, 3.0)
        return it

    it = clock.run_virtual(story())
    assert "reports an error (status 0x13); switch it off and on" in str(it.problems[0])


# -- weather --------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [FaultKind.FLIP, FaultKind.DROP, FaultKind.SPLIT])
def test_damaged_telegrams_are_passed_over(kind: FaultKind) -> None:
    async def story() -> Rig:
        async with rig(twin(), Fault("laser", kind, 1.0, 4.0)) as it:
            await clock.sleep(5.0)
        return it

    it = clock.run_virtual(story())
    assert not it.problems
    assert np.diff([scan.stamp for scan in it.scans]).max() < 0.3
    for scan in it.scans:
        finite = scan.ranges[np.isfinite(scan.ranges)]
        assert np.abs(finite - 3.0).max() < 0.1


def test_a_pulled_cable_is_noticed_at_once_and_the_stream_resumed_when_it_is_back() -> None:
    async def story() -> None:
        async with rig(twin()) as it:
            await it.gets(5, 2.0)
            it.line.unplug()
            await clock.sleep(0.01)
            assert isinstance(it.problems[0], LinkLost)
            await clock.sleep(2.0)
            it.line.replug()
            await it.gets(5, 3.5)

    clock.run_virtual(story())


def test_a_laser_that_falls_silent_is_lost_within_three_seconds() -> None:
    async def story() -> Rig:
        async with rig(twin(), Fault("laser", FaultKind.OFF, 2.0, 6.0)) as it:
            await clock.sleep(5.0)
            assert len(it.problems) == 1
            await clock.sleep(3.0)
            await it.gets(5, 3.5)
        return it

    it = clock.run_virtual(story())
    (problem,) = it.problems
    assert isinstance(problem, LinkLost)
    assert "24 V supply" in str(problem)


@pytest.mark.parametrize("power_on_baud", [9600, 500000])
def test_after_a_reboot_in_mid_stream_it_is_set_up_again(power_on_baud: int) -> None:
    async def story() -> None:
        device = twin(boot_time=1.0, power_on_baud=power_on_baud)
        async with rig(device) as it:
            await it.gets(5, 5.0)
            device.reboot(clock.now())
            await clock.sleep(0.1)
            await it.gets(5, 6.0)

    clock.run_virtual(story())


def test_a_quick_reboot_is_noticed_by_what_the_laser_says() -> None:
    async def story() -> Rig:
        device = twin(boot_time=0.2, power_on_baud=500000)
        async with rig(device) as it:
            await it.gets(5, 3.0)
            device.reboot(clock.now())
            await clock.sleep(0.1)
            await it.gets(5, 1.0)
        return it

    with structlog.testing.capture_logs() as logs:
        it = clock.run_virtual(story())
    assert not it.problems
    assert "laser has rebooted" in [log["event"] for log in logs]


def test_a_laser_whose_boot_rate_was_changed_keeps_its_rate() -> None:
    device = twin(power_on_baud=500000)
    streams(device)
    assert device.baud == 500000
    assert device.mode is Mode.ON_REQUEST


# -- settings -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "settings",
    [
        {"resolution_deg": 0.25},
        {"resolution_deg": 0.3},
        {"field_deg": 90},
        {"baud": 115200},
        {"unit": "m"},
        {"mount": {"yaw_deg": 200}},
    ],
    ids=str,
)
def test_settings_that_the_device_cannot_have_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Lms200Settings.model_validate(settings)


def test_a_refused_combination_names_the_possible_ones() -> None:
    with pytest.raises(ValidationError, match=r"180/0\.5, 180/1, 100/1, 100/0\.5, 100/0\.25"):
        Lms200Settings(field_deg=180, resolution_deg=0.25)


def test_the_delivered_period_follows_from_the_settings() -> None:
    assert 1 / delivered_period(Lms200Settings()) == pytest.approx(37.5)
    slow = Lms200Settings(baud=38400, resolution_deg=1)
    assert 1 / delivered_period(slow) == pytest.approx(9.375)
