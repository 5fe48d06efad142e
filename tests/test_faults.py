"""Faults hurt bytes the way their name says, inside their window only."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.errors import UsageError
from followerd.hw.lms200.protocol import Telegram, TelegramDecoder
from followerd.hw.lms200.telegrams import Reply, answer
from followerd.hw.p2os.protocol import PacketDecoder, frame, with_checksum
from followerd.sim.faults import LATE, RUN, SLOWER, Damage, Fault, FaultKind, Mend
from followerd.sim.rig import mended_telegram

bursts = st.lists(st.binary(min_size=1, max_size=80), min_size=1, max_size=30)
seeds = st.integers(0, 2**32 - 1)


def hurt(kind: FaultKind, sent: list[bytes], seed: int, start: float = 0.0) -> list[list[bytes]]:
    """What leaves for each of `sent`, one burst a second from 0 s."""
    damage = Damage((Fault("laser", kind, start, 1000.0),), np.random.default_rng(seed))
    return [[piece for _, piece in damage.apply(burst, float(t))] for t, burst in enumerate(sent)]


def test_a_fault_is_written_as_device_name_start_and_length() -> None:
    wanted = Fault("laser", FaultKind.OFF, 10.0, 2.5)
    assert Fault.parse("laser:off@10s+2.5s") == wanted
    assert Fault.parse("laser:off@10+2.5") == wanted


def test_the_base_goes_by_both_its_names() -> None:
    assert Fault.parse("base:off@1s+2s") == Fault.parse("robot:off@1s+2s")


def test_a_fault_without_a_start_begins_now_where_there_is_a_now() -> None:
    assert Fault.parse("laser:off+2s", now=7.0) == Fault("laser", FaultKind.OFF, 7.0, 2.0)
    assert Fault.parse("laser:off@9s+2s", now=7.0) == Fault("laser", FaultKind.OFF, 9.0, 2.0)
    with pytest.raises(UsageError, match="or laser:off\\+5s for now"):
        Fault.parse("laser:off", now=7.0)


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("laser", "expected DEVICE:NAME@STARTs\\+LENGTHs"),
        ("laser:off", "expected DEVICE:NAME@STARTs\\+LENGTHs"),
        ("laser:off@-1+2", "expected DEVICE:NAME@STARTs\\+LENGTHs"),
        ("laser:off@1+x", "expected DEVICE:NAME@STARTs\\+LENGTHs"),
        ("laser:off+2", "expected DEVICE:NAME@STARTs\\+LENGTHs"),
        ("wheel:off@1+2", "no device 'wheel'; there are robot, laser"),
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
def test_wrong_changes_one_run_of_bytes_of_a_burst(sent: list[bytes], seed: int) -> None:
    for burst, (piece,) in zip(sent, hurt(FaultKind.WRONG, sent, seed), strict=True):
        assert len(piece) == len(burst)
        changed = [i for i, (a, b) in enumerate(zip(burst, piece, strict=True)) if a != b]
        assert not changed or changed[-1] - changed[0] < RUN


def test_what_is_wrong_has_its_checksums_mended() -> None:
    def mend(burst: bytes) -> bytes:
        return burst[:-1] + bytes([sum(burst[:-1]) % 256])

    fault = Fault("laser", FaultKind.WRONG, 0.0, 1000.0, share=1.0)
    damage = Damage((fault,), np.random.default_rng(0), mend)
    sent = mend(bytes(range(50)))
    pieces = [damage.apply(sent, float(t))[0][1] for t in range(50)]
    assert all(piece == mend(piece) for piece in pieces)
    assert sum(piece != sent for piece in pieces) > 45


def heard_of_base(data: bytes) -> list[bytes]:
    return [packet.payload for packet in PacketDecoder().feed(data)]


def heard_of_laser(data: bytes) -> list[bytes]:
    return [e.payload for e in TelegramDecoder().feed(data) if isinstance(e, Telegram)]


@pytest.mark.parametrize(
    ("telegram", "mend", "heard"),
    [
        (frame(bytes([0x32, *range(30)])), with_checksum, heard_of_base),
        (answer(Reply.TYPE, b"LMS200;301063;V02.10 ").to_bytes(), mended_telegram, heard_of_laser),
    ],
)
def test_a_wrong_telegram_comes_through_and_says_something_else(
    telegram: bytes, mend: Mend, heard: Callable[[bytes], list[bytes]]
) -> None:
    fault = Fault("laser", FaultKind.WRONG, 0.0, 1000.0, share=1.0)
    damage = Damage((fault,), np.random.default_rng(0), mend)
    came = [heard(damage.apply(telegram, float(t))[0][1]) for t in range(200)]
    through = [payloads[0] for payloads in came if payloads]
    assert len(through) > 80  # but where the header or the length was hit
    assert sum(payload != heard(telegram)[0] for payload in through) > 70


def test_a_wrong_acknowledgement_stays_one_byte() -> None:
    assert mended_telegram(b"\x15") == b"\x15"


@pytest.mark.parametrize(("share", "least", "most"), [(0.0, 0, 0), (0.01, 2, 30), (1.0, 990, 1000)])
def test_a_fault_can_hurt_any_share_of_the_bursts(share: float, least: int, most: int) -> None:
    fault = Fault("laser", FaultKind.GARBAGE, 0.0, 1000.0, share)
    damage = Damage((fault,), np.random.default_rng(0))
    out = [damage.apply(b"telegram", float(t))[0][1] for t in range(1000)]
    assert least <= sum(piece != b"telegram" for piece in out) <= most


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


@given(st.lists(st.sampled_from(FaultKind), min_size=2, max_size=4), bursts, seeds)
def test_any_faults_can_come_together(kinds: list[FaultKind], sent: list[bytes], seed: int) -> None:
    faults = tuple(Fault("laser", kind, 0.0, 1000.0, share=1.0) for kind in kinds)
    damage = Damage(faults, np.random.default_rng(seed))
    for time, burst in enumerate(sent):
        assert all(when >= time for when, _ in damage.apply(burst, float(time)))
