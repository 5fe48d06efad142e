"""Faults hurt bytes the way their name says, inside their window only."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.errors import UsageError
from followerd.sim.faults import LATE, SLOWER, Damage, Fault, FaultKind

bursts = st.lists(st.binary(min_size=1, max_size=80), min_size=1, max_size=30)
seeds = st.integers(0, 2**32 - 1)


def hurt(kind: FaultKind, sent: list[bytes], seed: int, start: float = 0.0) -> list[list[bytes]]:
    """What leaves for each of `sent`, one burst a second from 0 s."""
    damage = Damage((Fault("laser", kind, start, 1000.0),), np.random.default_rng(seed))
    return [[piece for _, piece in damage.apply(burst, float(t))] for t, burst in enumerate(sent)]


def test_a_fault_is_written_as_device_name_start_and_length() -> None:
    assert Fault.parse("laser:off@10+2.5") == Fault("laser", FaultKind.OFF, 10.0, 2.5)


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("laser", "expected DEVICE:NAME@START\\+LENGTH"),
        ("laser:off", "expected DEVICE:NAME@START\\+LENGTH"),
        ("laser:off@-1+2", "expected DEVICE:NAME@START\\+LENGTH"),
        ("laser:off@1+x", "expected DEVICE:NAME@START\\+LENGTH"),
        ("laser:broken@1+2", "no fault 'broken'; there are off, stuck, garbage"),
    ],
)
def test_a_fault_written_wrong_gets_one_clear_line(text: str, hint: str) -> None:
    with pytest.raises(UsageError, match=hint):
        Fault.parse(text)


@given(st.sampled_from(FaultKind), bursts, seeds)
def test_outside_its_window_a_fault_does_nothing(
    kind: FaultKind, sent: list[bytes], seed: int
) -> None:
    damage = Damage((Fault("laser", kind, 5.0, 2.0),), np.random.default_rng(seed))
    for burst in sent:
        for time in (0.0, 4.99, 7.0, 100.0):
            assert damage.apply(burst, time) == [(time, burst)]
            assert not damage.is_deaf(time)
            assert not damage.is_cut(time)


@given(st.sampled_from(FaultKind), bursts, seeds)
def test_pieces_never_leave_before_the_burst_and_keep_their_order(
    kind: FaultKind, sent: list[bytes], seed: int
) -> None:
    damage = Damage((Fault("laser", kind, 0.0, 1000.0),), np.random.default_rng(seed))
    for time, burst in enumerate(sent):
        leaves = [when for when, _ in damage.apply(burst, float(time))]
        assert leaves == sorted(leaves)
        assert all(when >= time for when in leaves)


@given(st.sampled_from(FaultKind), bursts, seeds)
def test_one_seed_gives_one_damage(kind: FaultKind, sent: list[bytes], seed: int) -> None:
    assert hurt(kind, sent, seed) == hurt(kind, sent, seed)


@pytest.mark.parametrize("kind", [FaultKind.OFF, FaultKind.REBOOT, FaultKind.DISCONNECT])
@given(sent=bursts, seed=seeds)
def test_a_device_without_power_or_cable_is_silent(
    kind: FaultKind, sent: list[bytes], seed: int
) -> None:
    assert not any(hurt(kind, sent, seed))


@given(bursts, seeds)
def test_split_and_delay_lose_nothing(sent: list[bytes], seed: int) -> None:
    for kind in (FaultKind.SPLIT, FaultKind.DELAY):
        assert [b"".join(pieces) for pieces in hurt(kind, sent, seed)] == sent


@given(bursts, seeds)
def test_flip_turns_at_most_one_bit_of_a_burst(sent: list[bytes], seed: int) -> None:
    for burst, (piece,) in zip(sent, hurt(FaultKind.FLIP, sent, seed), strict=True):
        difference = int.from_bytes(burst) ^ int.from_bytes(piece)
        assert len(piece) == len(burst)
        assert difference.bit_count() <= 1


@given(bursts, seeds)
def test_wrong_changes_at_most_one_byte_of_a_burst(sent: list[bytes], seed: int) -> None:
    for burst, (piece,) in zip(sent, hurt(FaultKind.WRONG, sent, seed), strict=True):
        assert len(piece) == len(burst)
        assert sum(a != b for a, b in zip(burst, piece, strict=True)) <= 1


@given(bursts, seeds)
def test_drop_takes_one_run_of_bytes_out(sent: list[bytes], seed: int) -> None:
    for burst, (piece,) in zip(sent, hurt(FaultKind.DROP, sent, seed), strict=True):
        lost = len(burst) - len(piece)
        assert any(burst[:i] + burst[i + lost :] == piece for i in range(len(piece) + 1))


@pytest.mark.parametrize(
    "kind", [FaultKind.WRONG, FaultKind.DROP, FaultKind.FLIP, FaultKind.DUPLICATE]
)
def test_occasional_damage_hurts_some_bursts_and_spares_others(kind: FaultKind) -> None:
    sent = [bytes(range(40))] * 400
    hit = sum(pieces != [burst] for pieces, burst in zip(hurt(kind, sent, 1), sent, strict=True))
    assert 40 < hit < 120


def test_duplicate_sends_the_same_again() -> None:
    assert [b"telegram", b"telegram"] in hurt(FaultKind.DUPLICATE, [b"telegram"] * 50, seed=0)


def test_stuck_repeats_the_last_burst_before_the_fault() -> None:
    out = hurt(FaultKind.STUCK, [b"one", b"two", b"three", b"four"], seed=0, start=2.0)
    assert out == [[b"one"], [b"two"], [b"two"], [b"two"]]


def test_garbage_keeps_the_length_and_nothing_else() -> None:
    (piece,) = hurt(FaultKind.GARBAGE, [bytes(60)], seed=0)[0]
    assert len(piece) == 60
    assert piece != bytes(60)


def test_slow_lets_few_bursts_through_and_late() -> None:
    damage = Damage((Fault("laser", FaultKind.SLOW, 0.0, 1000.0),), np.random.default_rng(0))
    out = [damage.apply(b"scan", float(t)) for t in range(8 * SLOWER)]
    through = [(t, pieces) for t, pieces in enumerate(out) if pieces]
    assert len(through) == 8
    assert all(pieces == [(t + LATE, b"scan")] for t, pieces in through)


def test_faults_at_one_time_add_up() -> None:
    faults = (
        Fault("laser", FaultKind.DELAY, 0.0, 10.0),
        Fault("laser", FaultKind.GARBAGE, 5.0, 10.0),
    )
    damage = Damage(faults, np.random.default_rng(0))
    ((when, data),) = damage.apply(bytes(50), 6.0)
    assert when == 6.0 + LATE
    assert data != bytes(50)
