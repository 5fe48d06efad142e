"""What the LMS200 driver makes of each way of streaming, and of a laser that misbehaves."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import structlog
from pydantic import ValidationError

from followerd import clock
from followerd.errors import LinkLost
from followerd.geometry import Pose2
from followerd.hw.lms200.complaints import complaint_of, dirtiest
from followerd.hw.lms200.protocol import Telegram, with_checksum
from followerd.hw.lms200.scans import Unit
from followerd.hw.lms200.settings import Lms200Settings, Mount, delivered_period, stale_after
from followerd.hw.lms200.telegrams import FACTORY_CONFIG, ErrorEntry, Status
from followerd.hw.lms200.variant import ROTATION, VARIANTS
from followerd.sim.faults import Fault, FaultKind
from followerd.sim.twins.lms200 import Lms200Twin
from tests.lms200_bench import Rig, Round, rig, streams, twin


def watched(device: Lms200Twin, *steps: tuple[float, Callable[[], None]], **settings: Any) -> Rig:
    """A driver, while things happen to its laser at times counted from its first scan."""

    async def story() -> Rig:
        async with rig(device, **settings) as it:
            await it.gets(1, 4.0)
            begun = clock.now()
            for when, happens in steps:
                await clock.sleep_until(begun + when)
                happens()
        return it

    return clock.run_virtual(story())


def nothing() -> None:
    """Time passes."""


# -- ways of streaming ----------------------------------------------------------------------

WAYS: list[dict[str, Any]] = [
    {"stream": "turns"},
    {"stream": "turns", "baud": 38400},
    {"stream": "turns", "field_deg": 100, "resolution_deg": 0.25},
    {"stream": "turns", "resolution_deg": 1, "baud": 38400},
    {"stream": "means", "mean_of": 5},
    {"sector_deg": (-60, 30)},
    {"sector_deg": (-60, 60), "baud": 38400, "resolution_deg": 1},
    {"sector_deg": (-20, 45), "stream": "means", "mean_of": 3},
    {"sector_deg": (-60, 30), "mount": Mount(upside_down=True)},
    {"stream": "turns", "mount": Mount(upside_down=True)},
]


@pytest.mark.parametrize("settings", WAYS, ids=str)
def test_scans_are_stamped_and_aimed_however_they_are_streamed(settings: dict[str, Any]) -> None:
    scene = Round()
    mount = settings.get("mount", Mount())
    it = streams(twin(scene, upside_down=mount.upside_down), 8, 8.0, **settings)
    order = -1 if mount.upside_down else 1
    for scan, (bearings, times) in zip(it.scans, scene.measured, strict=False):
        assert scan.angles == pytest.approx(bearings[::order])
        assert scan.stamp + scan.beam_times == pytest.approx(times[::order], abs=2e-3)
        assert scan.beam_times.min() == 0.0
    stamps = np.array([scan.stamp for scan in it.scans])
    period = delivered_period(Lms200Settings(**settings))
    assert np.diff(stamps) == pytest.approx(period, abs=1e-3)
    assert it.driver.counters.unusable_scans == 0


def test_turns_come_as_fast_as_the_mirror_turns_each_half_a_degree_further() -> None:
    settings = Lms200Settings(stream="turns")
    assert delivered_period(settings) == pytest.approx(ROTATION)
    firsts = [np.degrees(scan.angle_min) for scan in streams(twin(), 4, stream="turns").scans]
    assert sorted(firsts[:2]) == pytest.approx([-90, -89.5])
    assert firsts[2:4] == pytest.approx(firsts[:2])


def test_a_sector_is_delivered_faster_over_a_slow_line() -> None:
    whole = Lms200Settings(baud=38400, resolution_deg=1)
    ahead = Lms200Settings(baud=38400, resolution_deg=1, sector_deg=(-45, 45))
    assert delivered_period(ahead) < 0.6 * delivered_period(whole)
    assert stale_after(ahead) < stale_after(whole)


@pytest.mark.parametrize(
    "settings",
    [
        {"sector_deg": (30, -30)},
        {"sector_deg": (-95, 0)},
        {"sector_deg": (-60, 0), "field_deg": 100},
        {"sector_deg": (0, 5)},
        {"sector_deg": (-30, 30), "stream": "turns"},
        {"stream": "means", "mean_of": 1},
        {"measuring_mode": 0x3F},
    ],
    ids=str,
)
def test_streams_that_the_device_cannot_send_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Lms200Settings.model_validate(settings)


@pytest.mark.parametrize(
    ("mode", "reach"),
    [(0, 8.182), (1, 8.182), (2, 8.182), (3, 16.374), (4, 16.374), (5, 32.758), (15, 32.758)],
)
def test_every_measuring_mode_measures_as_far_as_its_words_say(mode: int, reach: float) -> None:
    it = streams(twin(Round(0.9 * min(reach, 20.0))), measuring_mode=mode)
    for scan in it.scans:
        assert scan.range_max == pytest.approx(reach)
        assert np.nanmedian(scan.ranges) == pytest.approx(0.9 * min(reach, 20.0), abs=0.03)
        assert (scan.reflection is None) == (mode not in (1, 3, 5))


class Reflecting(Lms200Twin):
    """Sees a reflector to its left, in beams 300 to 310."""

    def step(self, now: float) -> bytes:
        frame = bytearray(super().step(now))
        if len(frame) > 700:
            for beam in range(300, 311):
                frame[8 + 2 * beam] |= 0xE0
            return with_checksum(bytes(frame))
        return bytes(frame)


@pytest.mark.parametrize("upside_down", [False, True])
def test_reflectors_are_told_with_the_beams_that_see_them(upside_down: bool) -> None:
    device = Reflecting(Round(), np.random.default_rng(0), Pose2(), upside_down=upside_down)
    it = streams(device, measuring_mode=1, mount=Mount(upside_down=upside_down))
    bright = it.scans[0].reflection
    assert bright is not None
    first = 50 if upside_down else 300
    assert np.flatnonzero(bright == 1.0).tolist() == list(range(first, first + 11))
    assert np.count_nonzero(bright) == 11
    assert np.nanmax(np.abs(it.scans[0].ranges[np.isfinite(it.scans[0].ranges)] - 3.0)) < 0.1


# -- lost and repeated ----------------------------------------------------------------------


def test_numbered_scans_tell_how_many_were_lost_on_the_line() -> None:
    device = twin()
    losses = Fault("laser", FaultKind.DROP, 1.5, 2.0)

    async def story() -> Rig:
        async with rig(device, losses, number_scans=True) as it:
            await clock.sleep(4.0)
        return it

    it = clock.run_virtual(story())
    assert device.config.has_indices
    counters = it.driver.counters
    stamps = np.array([scan.stamp for scan in it.scans])
    gaps = np.rint(np.diff(stamps) / (2 * ROTATION)) - 1
    assert counters.lost_telegrams == gaps.sum() > 5
    assert counters.missed_scans == counters.lost_telegrams


def test_at_a_slow_rate_the_scans_measured_meanwhile_are_counted_too() -> None:
    it = streams(twin(), 5, number_scans=True, baud=38400)
    counters = it.driver.counters
    assert counters.lost_telegrams == 0
    assert counters.missed_scans == 7 * (counters.scans - 1)


def test_numbering_is_switched_off_when_asked_to() -> None:
    device = twin(config=FACTORY_CONFIG.with_indices(True))
    streams(device)
    assert device.config.has_indices, "left as it is unless set"
    streams(device, number_scans=False)
    assert not device.config.has_indices


class Stammering(Lms200Twin):
    """Sends every telegram twice."""

    def step(self, now: float) -> bytes:
        return 2 * super().step(now)


@pytest.mark.parametrize("number_scans", [False, True])
def test_a_telegram_that_comes_twice_is_one_scan(number_scans: bool) -> None:
    device = Stammering(Round(), np.random.default_rng(0), Pose2())
    it = streams(device, 20, number_scans=number_scans, resolution_deg=1)
    assert it.driver.counters.repeated_scans == pytest.approx(len(it.scans), abs=1)
    assert len({scan.ranges.tobytes() for scan in it.scans}) == len(it.scans)


def test_a_laser_that_freezes_is_no_longer_believed() -> None:
    stuck = Fault("laser", FaultKind.STUCK, 2.0, 9.0)

    async def story() -> Rig:
        async with rig(twin(), stuck) as it:
            await clock.sleep(2.1)
            before = len(it.scans)
            await clock.sleep(3.0)
            assert len(it.scans) == before
        return it

    with structlog.testing.capture_logs() as logs:
        clock.run_virtual(story())
    assert any("same scan again" in str(log.get("problem")) for log in logs)


class Raving(Lms200Twin):
    """Every third scan is random, with the right checksum."""

    sent = 0

    def step(self, now: float) -> bytes:
        frame = super().step(now)
        if len(frame) < 700:
            return frame
        self.sent += 1
        words = np.random.default_rng(self.sent).integers(0, 0x1FF7, 361).astype("<u2")
        return frame if self.sent % 3 else with_checksum(frame[:7] + words.tobytes() + frame[-3:])


def test_scans_of_nothing_but_noise_are_counted_and_passed_over() -> None:
    it = streams(Raving(Round(), np.random.default_rng(0), Pose2()), 20)
    assert it.driver.counters.implausible_scans == pytest.approx(10, abs=1)
    for scan in it.scans:
        assert np.abs(scan.ranges[np.isfinite(scan.ranges)] - 3.0).max() < 0.1
        assert np.isnan(scan.ranges).mean() < 0.01


# -- a laser that was changed ---------------------------------------------------------------


def in_centimetres(device: Lms200Twin) -> None:
    device.config = FACTORY_CONFIG.with_values(0, Unit.CM)


def another_field(device: Lms200Twin) -> None:
    device.variant = VARIANTS[2]


@pytest.mark.parametrize("change", [in_centimetres, another_field])
def test_a_laser_set_up_by_someone_else_is_set_up_again_at_once(
    change: Callable[[Lms200Twin], None],
) -> None:
    device = twin(Round(3.0))
    it = watched(device, (0.5, lambda: change(device)), (1.2, nothing))
    assert not it.problems
    assert np.diff([scan.stamp for scan in it.scans]).max() < 0.8
    for scan in it.scans:
        assert np.nanmedian(scan.ranges) == pytest.approx(3.0, abs=0.02)


class CutOff(Lms200Twin):
    """When its power fails for a moment, the telegram under way stays unfinished."""

    fails = False

    def step(self, now: float) -> bytes:
        frame = super().step(now)
        if self.fails and len(frame) > 700:
            self.fails = False
            self.reboot(now + 0.02)
            return frame[:300]
        return frame

    def fail(self) -> None:
        self.fails = True


def test_a_reboot_behind_a_cut_telegram_is_noticed_at_once_and_says_nothing_false() -> None:
    device = CutOff(Round(), np.random.default_rng(0), Pose2(), power_on_baud=500000)
    with structlog.testing.capture_logs() as logs:
        it = watched(device, (0.5, device.fail), (1.5, nothing))
    assert [log["event"] for log in logs].count("laser has rebooted") == 1
    assert not it.problems
    gaps = np.diff([scan.stamp for scan in it.scans])
    assert 0.1 < gaps.max() < 0.8
    assert (gaps > 0.1).sum() == 1
    for scan in it.scans:
        assert scan.ranges.size == 361
        assert np.nanmedian(scan.ranges) == pytest.approx(3.0, abs=0.02)


@pytest.mark.parametrize("boot_time", [5.0, 35.0])
def test_after_a_power_cut_it_streams_three_seconds_after_its_boot(boot_time: float) -> None:
    device = twin(boot_time=boot_time)

    async def story() -> None:
        async with rig(device) as it:
            await it.gets(5, boot_time + 4.0)
            device.reboot(clock.now())
            await clock.sleep(0.1)
            before = len(it.scans)
            await clock.sleep(boot_time - 0.1)
            assert len(it.scans) == before
            await it.gets(5, 3.2)

    clock.run_virtual(story())


# -- what it complains about ----------------------------------------------------------------


def test_dazzled_beams_are_not_measured() -> None:
    device = twin()
    device.scanner.dazzled = (np.radians(-10), np.radians(5))
    for scan in streams(device).scans:
        degrees = np.degrees(scan.angles)
        blind = np.isnan(scan.ranges)
        assert blind[(degrees >= -10) & (degrees <= 5)].all()
        assert not blind[(degrees < -10.1) | (degrees > 5.1)].any()


@pytest.mark.parametrize(
    ("status", "errors", "problem", "remedy"),
    [
        (0x12, (), "warns (status 0x12)", "window"),
        (0x13, (), "reports an error (status 0x13)", "switch it off and on"),
        (0x13, (ErrorEntry(3, 24),), "reports an error (status 0x13, error 24)", "off and on"),
        (0x14, (), "reports a fatal error (status 0x14)", "have it serviced"),
        (0x10, (ErrorEntry(4, 5),), "fatal error (status 0x10, fatal error 5)", "serviced"),
        (0x90, (), "reports a dirty window (status 0x90)", "soft damp cloth"),
        (0x93, (), "reports a dirty window (status 0x93)", "soft damp cloth"),
        (0x50, (), "its own measurements implausible (status 0x50)", "sunlight"),
    ],
)
def test_a_complaint_comes_with_its_remedy(
    status: int, errors: tuple[ErrorEntry, ...], problem: str, remedy: str
) -> None:
    complaint = complaint_of(status, errors)
    assert complaint is not None
    assert problem in complaint.problem
    assert remedy in complaint.remedy


@pytest.mark.parametrize("status", [0x10, 0x11, 0x18])
def test_a_laser_without_complaint_is_left_in_peace(status: int) -> None:
    assert complaint_of(status) is None


def test_the_errors_in_its_memory_are_named_when_the_laser_fails() -> None:
    device = twin()

    def breaks() -> None:
        device.status = 0x14
        device.errors = (ErrorEntry(4, 24), ErrorEntry(1, 7))

    it = watched(device, (0.5, breaks), (4.0, nothing))
    problem = it.problems[0]
    assert isinstance(problem, LinkLost)
    assert "fatal error 24, information 7" in problem.problem
    assert problem.remedy == "it is defective: have it serviced"


def report(pollution: tuple[int, ...], clean: tuple[int, ...]) -> Status:
    status = Status.from_data(bytes(152))
    return replace(status, pollution=pollution, pollution_calibration=clean)


def test_the_dirtiest_part_of_the_window_is_told() -> None:
    assert dirtiest(report((100, 90, 55, 100, 100, 100, 100, 100), (100,) * 8)) == (3, 0.55)
    assert dirtiest(report((7,) * 8, (0,) * 8)) is None


def test_a_warning_is_said_once() -> None:
    with structlog.testing.capture_logs() as logs:
        assert len(streams(twin(polluted=True), 20).scans) >= 20
    said = [log["event"] for log in logs]
    assert said.count("laser warns, clean its window") == 1
    (window,) = (log for log in logs if log["event"] == "laser window")
    assert window["clear_percent"] == 60


def test_a_defect_that_the_laser_tells_of_is_said() -> None:
    class Defective(Lms200Twin):
        @property
        def _status_report(self) -> Status:
            return replace(super()._status_report, defective=True)

    with structlog.testing.capture_logs() as logs:
        streams(Defective(Round(), np.random.default_rng(0), Pose2()))
    assert any("defective" in str(log["event"]) and log["defective"] for log in logs)


def test_a_telegram_is_not_taken_from_another_device_on_the_line() -> None:
    class Two(Lms200Twin):
        def step(self, now: float) -> bytes:
            frame = super().step(now)
            if len(frame) < 700:
                return frame
            other = Telegram(0x85, frame[4:-2]).to_bytes()
            return other if now > 1.5 else frame

    device = Two(Round(), np.random.default_rng(0), Pose2())
    it = watched(device, (1.0, nothing))
    assert it.driver.counters.unusable_scans > 0
    assert max(scan.stamp for scan in it.scans) < 1.5
