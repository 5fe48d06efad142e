"""The plausibility gate of the LMS200: what the checksum let through, and what is real."""

from math import inf, nan

import numpy as np
import pytest

from followerd.geometry import Array
from followerd.hw.lms200.spikes import SpikeGate

INCREMENT = np.radians(0.5)
PERIOD = 1 / 37.5  # s


def gate_after(*scans: Array) -> SpikeGate:
    gate = SpikeGate(float(INCREMENT))
    for number, scan in enumerate(scans):
        gate.passed(scan, number * PERIOD)
    return gate


def wall(range_: float = 3.0) -> Array:
    """A wall around, with the noise of the device."""
    return np.full(361, range_) + np.random.default_rng(0).normal(0, 0.005, 361)


def corridor() -> Array:
    """A wall on either side at 1.2 m, as far as the device sees."""
    bearings = np.arange(-180, 181) * INCREMENT
    ranges = 1.2 / np.maximum(np.abs(np.sin(bearings)), 1e-6)
    return np.where(ranges > 8.0, inf, ranges)


def changed(scan: Array, at: int, *ranges: float) -> Array:
    scan = scan.copy()
    scan[at : at + len(ranges)] = ranges
    return scan


@pytest.mark.parametrize("scan", [wall(), corridor(), np.full(361, inf), np.full(361, nan)])
def test_what_stays_as_it_was_passes_untouched(scan: Array) -> None:
    passed = gate_after(scan).passed(scan, PERIOD)
    assert passed is scan


@pytest.mark.parametrize("at", [0, 1, 100, 359, 360])
@pytest.mark.parametrize("range_", [0.0, 0.3, 2.5, 3.3, 8.1])
def test_a_range_out_of_the_blue_is_not_measured(at: int, range_: float) -> None:
    gate = gate_after(wall())
    passed = gate.passed(changed(wall(), at, range_), PERIOD)
    assert passed is not None
    assert np.flatnonzero(np.isnan(passed)).tolist() == [at]
    assert gate.removed == 1 + np.isnan(wall()).sum()


@pytest.mark.parametrize(
    "ranges",
    [(1.0, 1.05), (5.0, 6.0), (1.0, 5.0), (1.0, 2.0, 5.0), (6.0, 1.0, 7.0, 0.5), (1.0, 2.0, 2.5)],
)
def test_what_a_burst_leaves_side_by_side_vouches_for_nothing(ranges: tuple[float, ...]) -> None:
    passed = gate_after(wall()).passed(changed(wall(), 200, *ranges), PERIOD)
    assert passed is not None
    assert np.isnan(passed[200 : 200 + len(ranges)]).all()
    assert np.count_nonzero(np.isnan(passed)) == len(ranges)


def test_a_thing_of_three_beams_is_seen_at_once() -> None:
    scan = changed(wall(), 100, 1.5, 1.52, 1.5)
    assert gate_after(wall()).passed(scan, PERIOD) is scan


def test_a_thin_thing_is_seen_one_scan_later_and_then_stays_while_the_robot_turns() -> None:
    gate = gate_after(wall())
    for number, at in enumerate((100, 103, 106, 103), 1):
        scan = changed(wall(), at, 1.5 - 0.05 * number)
        passed = gate.passed(scan, number * PERIOD)
        assert passed is not None
        assert np.isnan(passed[at]) == (number == 1)


def test_mixed_ranges_at_an_edge_and_no_echo_pass() -> None:
    scan = np.concatenate([np.full(180, 1.5), [2.7], np.full(180, 4.0)])
    assert gate_after(np.roll(scan, 1)).passed(scan, PERIOD) is scan
    scan = np.concatenate([np.full(180, 1.5), [6.0], np.full(180, inf)])
    assert gate_after(np.roll(scan, 1)).passed(scan, PERIOD) is scan
    lonely = changed(wall(), 50, inf)
    assert gate_after(wall()).passed(lonely, PERIOD) is lonely


def test_after_a_pause_more_may_have_moved() -> None:
    """The longer ago the last scan, the farther may a thin thing have come."""
    before, after = changed(wall(), 100, 1.5), changed(wall(), 120, 1.8)
    for pause, is_known in ((PERIOD, False), (0.2, True)):
        gate = gate_after(wall(), before)
        passed = gate.passed(after, PERIOD + pause)
        assert passed is not None
        assert np.isfinite(passed[120]) == is_known


def test_a_scan_of_nothing_but_spikes_is_none_and_the_next_is_judged_by_it() -> None:
    rng = np.random.default_rng(1)
    garbage = rng.uniform(0, 8, 361)
    gate = gate_after(wall())
    assert gate.passed(garbage, PERIOD) is None
    assert gate.passed(garbage, 2 * PERIOD) is not None
