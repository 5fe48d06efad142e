"""The LMS200 twin behaves like the device that drivers written by others expect."""

import json
from math import inf
from pathlib import Path
from typing import Unpack

import numpy as np
import pytest

from followerd.geometry import Array
from followerd.hw.lms200.protocol import Acknowledgement, Telegram, TelegramDecoder
from followerd.hw.lms200.scans import Unit, ranges_of
from followerd.hw.lms200.sweep import Sweep
from followerd.hw.lms200.telegrams import (
    BAUD_CODES,
    FACTORY_CONFIG,
    PASSWORD,
    Command,
    Config,
    ErrorEntry,
    Mode,
    Reply,
    Status,
    VariantAnswer,
    errors_of,
    reply_to,
    request,
    variant_data,
    written_config,
)
from followerd.hw.lms200.variant import ROTATION, VARIANTS, Variant, line_time
from followerd.sim.twins.lms200_modes import STREAMING
from followerd.sim.twins.lms200_scanner import NO_RETURN, SIGMA, RangeNoise
from tests.lms200_bench import Bench, Round, TwinOptions, twin

TRANSCRIPTS = Path(__file__).parents[2] / "shared" / "protocols" / "transcripts"
ACK, NAK = Acknowledgement.ACK, Acknowledgement.NAK


def bench(scene: Round | None = None, **options: Unpack[TwinOptions]) -> Bench:
    return Bench(twin(scene, **options))


def test_a_request_is_acknowledged_and_answered() -> None:
    device = bench()
    assert device.told(Command.TYPE).data == b"LMS200;301061;V02.10 "
    assert device.told(Command.ERRORS).data == b""
    assert Config(device.told(Command.READ_CONFIG).data) == FACTORY_CONFIG
    report = Status.from_data(device.told(Command.STATUS).data)
    assert (report.mode, report.variant, report.unit) == (Mode.ON_REQUEST, Variant(180, 50), 1)
    assert (report.baud_word, report.is_baud_permanent, report.address) == (0x8067, False, 0)
    assert report.pollution == report.pollution_calibration


@pytest.mark.skipif(not TRANSCRIPTS.exists(), reason="../shared is not there")
@pytest.mark.parametrize("path", sorted(TRANSCRIPTS.glob("lms200_*")), ids=lambda p: p.stem)
def test_independent_clients_are_carried_through_their_set_up(path: Path) -> None:
    said = [json.loads(line) for line in path.read_text().splitlines()]
    device = bench()
    if "left_on" in path.stem:  # by whoever used the laser before
        assert device.set_mode(BAUD_CODES[38400])
        assert device.set_mode(Mode.STREAM)
    refused = False
    for line in said:
        (telegram,) = TelegramDecoder(from_device=False).feed(bytes.fromhex(line["hex"]))
        assert isinstance(telegram, Telegram)
        assert device.twin.baud == line["baud"], "the twin did not follow the client's line rate"
        events = device.asks(telegram, 1.0)
        answers = [e for e in events if isinstance(e, Telegram)]
        (reply,) = (a for a in answers if a.command == reply_to(telegram.command))
        assert ACK in events
        match telegram.command:
            case Command.MODE:
                refused |= reply.data != b"\0"
                if telegram.data[0] in STREAMING:
                    assert answers[-1].command in (Reply.SCAN, Reply.MEAN, Reply.SUBRANGE)
            case Command.WRITE_CONFIG:
                refused |= not written_config(reply.data)[0]
            case Command.VARIANT:
                refused |= not VariantAnswer.from_data(reply.data).done
    assert not refused


# -- line rate, framing, address ------------------------------------------------------------


@pytest.mark.parametrize("baud", [19200, 38400, 500000])
def test_a_change_of_rate_is_answered_at_the_old_rate(baud: int) -> None:
    device = bench()
    data = bytes((Mode.ON_REQUEST,)), bytes((BAUD_CODES[baud],))
    device.twin.receive(request(Command.MODE, data[1]).to_bytes(), 0.0)
    sent: list[tuple[int, bytes]] = []
    while device.twin.wake_at() < inf:
        due = max(device.now, device.twin.wake_at())
        burst = device.twin.step(due)
        sent.append((device.twin.baud, burst))
    assert sent[-1] == (baud, b"")
    assert [rate for rate, burst in sent if burst] == [9600, 9600]
    assert Status.from_data(device.told(Command.STATUS).data).baud_word != 0x8067


def test_a_damaged_request_is_answered_by_nak_alone() -> None:
    device = bench()
    wire = bytearray(request(Command.STATUS).to_bytes())
    wire[-1] ^= 1
    device.twin.receive(bytes(wire), 0.0)
    assert [event for _, event in device.runs(1.0)] == [NAK]


def test_a_request_after_an_unfinished_one_is_heard() -> None:
    device = bench()
    device.twin.receive(b"\x02\x00\x20\x00\x20", 0.0)
    device.runs(0.2)
    assert device.told(Command.TYPE)


@pytest.mark.parametrize(("own", "asked", "answers"), [(1, 0, 0x81), (1, 1, 0x81), (0, 0, 0x80)])
def test_it_answers_to_its_address_and_to_any(own: int, asked: int, answers: int) -> None:
    events = bench(address=own).asks(request(Command.TYPE, address=asked))
    assert isinstance(events[1], Telegram)
    assert events[1].address == answers


def test_requests_to_others_are_ignored() -> None:
    assert bench(address=1).asks(request(Command.TYPE, address=2)) == []


def test_an_unknown_request_is_not_allowed() -> None:
    for unknown in (request(0x66, b"\1"), request(Command.WRITE_CONFIG, bytes(34))):
        _, telegram = bench().asks(unknown)
        assert isinstance(telegram, Telegram)
        assert telegram.command == Reply.NOT_ALLOWED
        assert telegram.data == b""


# -- modes and configuration ----------------------------------------------------------------


def test_the_configuration_is_written_only_behind_the_password() -> None:
    device = bench()
    assert not device.set_mode(Mode.INSTALLATION, b"SICK_LMX")
    assert device.set_mode(Mode.INSTALLATION, PASSWORD)
    wanted = FACTORY_CONFIG.with_values(1, Unit.CM)
    assert written_config(device.told(Command.WRITE_CONFIG, wanted.raw).data) == (True, wanted)
    assert device.told(Command.TYPE).data == b"LMS200;301063;V02.10 "
    assert device.set_mode(Mode.ON_REQUEST)
    assert Config(device.told(Command.READ_CONFIG).data) == wanted


def test_a_short_configuration_replaces_the_leading_bytes() -> None:
    device = bench()
    device.set_mode(Mode.INSTALLATION, PASSWORD)
    data = bytes.fromhex("01 00 47 00 00 02 00")
    done, config = written_config(device.told(Command.WRITE_CONFIG, data).data)
    assert done
    assert config.raw == data + FACTORY_CONFIG.raw[7:]


def test_a_configuration_that_it_cannot_measure_with_is_refused() -> None:
    device = bench()
    device.set_mode(Mode.INSTALLATION, PASSWORD)
    wanted = FACTORY_CONFIG.with_values(0x0D, 1)
    answer = device.told(Command.WRITE_CONFIG, wanted.raw)
    assert written_config(answer.data) == (False, FACTORY_CONFIG)


@pytest.mark.parametrize(
    ("mode", "parameters"),
    [
        (0x24, b"\1"),
        (0x26, b"\1"),
        (0x27, b"\0\0\5\0"),
        (0x27, b"\1\0\x6a\1"),
        (0x28, b""),
        (0x28, b"\2\5\0\4\0"),
        (0x3F, b""),
        (0x10, b""),
    ],
)
def test_modes_it_does_not_have_are_refused(mode: int, parameters: bytes) -> None:
    device = bench()
    assert not device.set_mode(mode, parameters)
    assert device.twin.mode is Mode.ON_REQUEST
    assert device.told(Command.MODE).data == b"\1"


def test_only_the_devices_variants_are_taken_and_only_while_it_does_not_stream() -> None:
    device = bench()
    for variant in VARIANTS:
        said = VariantAnswer.from_data(device.told(Command.VARIANT, variant_data(variant)).data)
        assert said == (True, variant)
    said = VariantAnswer.from_data(
        device.told(Command.VARIANT, variant_data(Variant(180, 25))).data
    )
    assert said == (False, VARIANTS[-1])
    _, telegram = device.asks(request(Command.VARIANT, b"\1"))
    assert isinstance(telegram, Telegram)
    assert telegram.command == Reply.NOT_ALLOWED
    device.set_mode(Mode.STREAM)
    telegrams = [
        e
        for e in device.asks(request(Command.VARIANT, variant_data(VARIANTS[0])), 3.0)
        if isinstance(e, Telegram) and e.command == Reply.VARIANT
    ]
    assert VariantAnswer.from_data(telegrams[0].data) == (False, VARIANTS[-1])


# -- power ----------------------------------------------------------------------------------


def test_it_boots_silently_and_announces_itself() -> None:
    device = bench(boot_time=30.0, power_on_baud=38400)
    assert device.twin.wake_at() == 0.0
    assert device.runs(10.0) == []
    assert device.asks(request(Command.STATUS), 19.0) == []
    ((when, event),) = device.runs(5.0)
    assert when == pytest.approx(30.0)
    assert isinstance(event, Telegram)
    assert (event.command, event.data) == (Reply.POWER_ON, b"LMS200;301061;V02.10 ")
    assert Status.from_data(device.told(Command.STATUS).data).is_baud_permanent


def test_a_reset_forgets_all_but_the_configuration() -> None:
    device = bench(boot_time=5.0)
    device.runs(6.0)
    device.set_mode(Mode.INSTALLATION, PASSWORD)
    device.told(Command.WRITE_CONFIG, FACTORY_CONFIG.with_values(0, Unit.CM).raw)
    device.told(Command.VARIANT, variant_data(Variant(100, 100)))
    device.set_mode(BAUD_CODES[500000])
    events = device.asks(request(Command.RESET), 6.0)
    assert [getattr(e, "command", e) for e in events] == [ACK, Reply.RESET, Reply.POWER_ON]
    report = Status.from_data(device.told(Command.STATUS).data)
    assert (report.baud_word, report.mode, report.unit) == (0x8067, Mode.ON_REQUEST, Unit.CM)
    assert report.variant == Variant(180, 50)


def test_without_boot_time_a_reset_is_announced_at_once() -> None:
    events = bench().asks(request(Command.RESET))
    assert [getattr(e, "command", e) for e in events] == [ACK, Reply.RESET, Reply.POWER_ON]


# -- streams --------------------------------------------------------------------------------


@pytest.mark.parametrize("baud", [9600, 19200, 38400, 500000])
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: f"{v.field}/{v.resolution}")
def test_the_delivered_period_is_a_whole_number_of_scan_times(variant: Variant, baud: int) -> None:
    scene = Round()
    device = bench(scene, power_on_baud=baud)
    device.told(Command.VARIANT, variant_data(variant))
    device.set_mode(Mode.STREAM)
    period = Sweep(variant).delivered_period(baud)
    scans = device.scans(10 * period)
    assert {len(scan.words) for _, scan in scans} == {variant.count}
    periods = np.diff([when for when, _ in scans])
    assert periods == pytest.approx(period, abs=1e-6)
    assert len(scene.measured) == len(scans), "a scan that is not sent is not computed"


def test_the_telegram_in_flight_ends_before_a_stop_is_acknowledged() -> None:
    device = bench()
    device.set_mode(Mode.STREAM)
    ((begun, _), *_) = device.runs(0.1)
    device.twin.receive(request(Command.MODE, b"\x25").to_bytes(), device.now)
    assert device.twin.step(device.now) == b""
    (acknowledged, mark), (_, answer) = device.runs(5.0)
    assert mark is ACK
    assert isinstance(answer, Telegram)
    assert acknowledged == pytest.approx(begun + line_time(732, 9600))


def test_a_stream_stopped_before_it_began_sends_nothing() -> None:
    device = bench()
    for mode in (Mode.STREAM, Mode.ON_REQUEST):
        device.twin.receive(request(Command.MODE, bytes((mode,))).to_bytes(), 0.0)
    events = [event for _, event in device.runs(3.0)]
    assert [getattr(e, "command", e) for e in events] == [ACK, Reply.MODE, ACK, Reply.MODE]


def test_a_late_wake_up_costs_no_scan() -> None:
    device = bench(power_on_baud=500000)
    device.set_mode(Mode.STREAM)
    sent, until = 0, device.now + 2.0
    while (due := device.twin.wake_at()) < until:
        sent += bool(device.twin.step(due + 0.010))
    assert sent == pytest.approx(75, abs=1)


def test_a_single_scan_comes_on_request_only_while_it_does_not_stream() -> None:
    device = bench()
    events = device.asks(request(Command.SCAN, b"\1"), 3.0)
    assert [getattr(e, "command", e) for e in events] == [ACK, Reply.SCAN]
    _, telegram = device.asks(request(Command.SCAN, b"\5"))
    assert isinstance(telegram, Telegram)
    assert telegram.command == Reply.NOT_ALLOWED


def test_half_degrees_are_measured_one_turn_after_whole_ones() -> None:
    scene = Round()
    device = bench(scene, power_on_baud=500000)
    device.set_mode(Mode.STREAM)
    device.runs(0.1)
    bearings, times = scene.measured[0]
    assert np.degrees(bearings[[0, 180, 360]]) == pytest.approx([-90, 0, 90])
    assert np.diff(times[[0, 360]]) == pytest.approx(ROTATION / 2)
    assert times[1] - times[0] == pytest.approx(ROTATION * (1 + 0.5 / 360))
    assert scene.asked[0] - times[0] == pytest.approx(2 * ROTATION)


def test_upside_down_it_sweeps_from_left_to_right() -> None:
    scene = Round()
    device = bench(scene, upside_down=True)
    device.set_mode(Mode.STREAM)
    device.runs(0.1)
    assert np.degrees(scene.measured[0][0][[0, -1]]) == pytest.approx([90, -90])


def test_partial_scans_give_each_turn_in_order() -> None:
    scene = Round()
    device = bench(scene, power_on_baud=38400)
    device.told(Command.VARIANT, variant_data(Variant(100, 25)))
    device.set_mode(Mode.STREAM_PARTIAL)
    scans = [scan for _, scan in device.scans(0.6)][:8]
    assert [scan.raster for scan in scans] == [0, 1, 2, 3] * 2
    assert [len(scan.words) for scan in scans] == [101, 100, 100, 100] * 2
    assert all(scan.partial and scan.reply is Reply.SCAN for scan in scans)
    firsts = [np.degrees(bearings[0]) for bearings, _ in scene.measured[:4]]
    assert firsts == pytest.approx([-50, -49.75, -49.5, -49.25])
    turns = [round((times[0] - scene.measured[0][1][0]) / ROTATION) for _, times in scene.measured]
    assert [turn % 4 for turn in turns[:4]] == [0, 1, 2, 3]


def test_partial_half_degree_scans_say_their_offset_in_quarter_degrees() -> None:
    device = bench(power_on_baud=38400)
    device.set_mode(Mode.STREAM_PARTIAL)
    scans = [scan for _, scan in device.scans(0.6)]
    assert [(scan.raster, len(scan.words)) for scan in scans[:2]] == [(0, 181), (2, 180)]


def test_means_come_once_in_so_many_scans() -> None:
    device = bench(power_on_baud=500000)
    assert device.set_mode(Mode.STREAM_MEAN, b"\5")
    scans = device.scans(1.0)
    assert {(scan.reply, scan.samples) for _, scan in scans} == {(Reply.MEAN, 5)}
    assert np.diff([when for when, _ in scans]) == pytest.approx(10 * ROTATION)


def test_means_of_a_sub_range_give_both() -> None:
    device = bench(power_on_baud=500000)
    assert not device.set_mode(Mode.STREAM_MEAN_SUBRANGE, b"\1\x0b\0\x3c\0")
    assert device.set_mode(Mode.STREAM_MEAN_SUBRANGE, b"\5\x0b\0\x3c\0")
    ((_, scan), *_) = device.scans(0.3)
    assert (scan.reply, scan.samples, scan.first) == (Reply.MEAN_SUBRANGE, 5, 11)
    assert len(scan.words) == 50


def test_dazzled_beams_say_so() -> None:
    device = bench()
    device.twin.scanner.dazzled = (-0.1, 0.1)
    device.set_mode(Mode.STREAM)
    ((_, scan),) = device.scans(0.1)
    assert set(scan.words[175:186].tolist()) == {0x1FFE}
    assert 0x1FFE not in scan.words[:160]


def test_its_fault_memory_is_told_and_cleared_by_a_reset() -> None:
    device = bench()
    device.twin.errors = (ErrorEntry(3, 24), ErrorEntry(1, 5))
    assert errors_of(device.told(Command.ERRORS).data) == device.twin.errors
    device.asks(request(Command.RESET))
    assert device.told(Command.ERRORS).data == b""


def test_a_reboot_in_mid_stream_is_silence_and_then_the_power_on_telegram() -> None:
    device = bench(boot_time=10.0, power_on_baud=500000)
    device.runs(11.0)
    device.told(Command.VARIANT, variant_data(Variant(100, 100)))
    device.set_mode(Mode.STREAM)
    assert len(device.scans(1.0)) > 70
    device.twin.reboot(device.now)
    assert device.runs(5.0) == []
    assert device.asks(request(Command.STATUS), 4.0) == []
    ((_, event),) = device.runs(5.0)
    assert isinstance(event, Telegram)
    assert event.command == Reply.POWER_ON
    report = Status.from_data(device.told(Command.STATUS).data)
    assert (report.mode, report.variant) == (Mode.ON_REQUEST, Variant(180, 50))


def test_a_sub_range_gives_its_values() -> None:
    scene = Round()
    device = bench(scene)
    assert device.set_mode(Mode.STREAM_SUBRANGE, b"\x0b\x00\x3c\x00")
    ((_, scan),) = device.scans(0.1)
    assert (scan.reply, scan.first, len(scan.words)) == (Reply.SUBRANGE, 11, 50)
    assert np.degrees(scene.measured[0][0][0]) == pytest.approx(-85)


def test_indices_count_scans_and_telegrams_when_asked_for() -> None:
    raw = FACTORY_CONFIG.raw[:4] + b"\2" + FACTORY_CONFIG.raw[5:]
    device = bench(config=Config(raw), power_on_baud=38400)
    device.set_mode(Mode.STREAM)
    indices = [scan.indices for _, scan in device.scans(1.0)]
    assert all(indices)
    numbers = np.array(indices)
    assert numbers[:, 1].tolist() == list(range(len(indices)))
    assert set(np.diff(numbers[:, 0])) == {8}  # scans measured for one delivered


def test_a_dirty_window_shows_in_every_status_byte_and_in_the_report() -> None:
    device = bench(polluted=True)
    answer = device.told(Command.STATUS)
    assert answer.status == 0x90
    report = Status.from_data(answer.data)
    assert max(report.pollution) < min(report.pollution_calibration)
    device.set_mode(Mode.STREAM)
    ((_, scan),) = device.scans(0.1)
    assert scan.status == 0x90


def test_ranges_come_in_the_configured_unit() -> None:
    for unit, step in ((Unit.MM, 0.001), (Unit.CM, 0.01)):
        device = bench(Round(4.0), config=FACTORY_CONFIG.with_values(0, unit))
        device.set_mode(Mode.STREAM)
        ((_, scan),) = device.scans(0.1)
        ranges = ranges_of(scan.words, 0, scan.unit)
        assert scan.unit is unit
        assert np.median(ranges) == pytest.approx(4.0, abs=0.02)
        steps = ranges[np.isfinite(ranges)] / step
        assert steps == pytest.approx(np.rint(steps))


# -- errors of measurement ------------------------------------------------------------------

BEARINGS = VARIANTS[0].bearings


def measured(true: Array, times: int = 400, **options: int) -> Array:
    noise = RangeNoise(np.random.default_rng(3))
    return np.array([noise.added(true, BEARINGS, 0.0, **options) for _ in range(times)])


def test_ranges_scatter_by_five_millimetres_about_a_bias() -> None:
    ranges = measured(np.full(361, 3.0))
    assert np.isinf(ranges).mean() == pytest.approx(NO_RETURN, rel=0.3)
    ranges[np.isinf(ranges)] = np.nan
    assert np.nanmean(np.nanstd(ranges, axis=0)) == pytest.approx(SIGMA, rel=0.05)
    bias = np.nanmean(ranges, axis=0) - 3.0
    assert 0.001 < np.std(bias) < 0.008
    assert np.abs(bias).max() < 0.03
    quieter = measured(np.full(361, 3.0), samples=9)
    quieter[np.isinf(quieter)] = np.nan
    assert np.nanmean(np.nanstd(quieter, axis=0)) == pytest.approx(SIGMA / 3, rel=0.05)


def test_at_an_edge_some_ranges_lie_between() -> None:
    true = np.full(361, 4.0)
    true[100:] = 2.0
    ranges = measured(true)
    between = (ranges > 2.2) & (ranges < 3.8)
    assert between[:, [99, 100]].mean(axis=0).min() > 0.1
    assert not between[:, :99].any()
    assert not between[:, 101:].any()


def test_nothing_is_measured_beyond_the_reach() -> None:
    true = np.full(361, inf)
    true[:180] = 25.0
    assert np.isinf(measured(true, times=5)).all()
