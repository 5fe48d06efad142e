"""LMS2xx telegrams: golden bytes of the manual, any split, any noise, and what is refused."""

import json
from itertools import pairwise, product
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from followerd.hw.lms200.flags import fields_of, reflection_of
from followerd.hw.lms200.protocol import (
    COUNT_AT,
    LENGTHS,
    LONGEST_PAYLOAD,
    Acknowledgement,
    Event,
    Telegram,
    TelegramDecoder,
    checksum,
    with_checksum,
)
from followerd.hw.lms200.scans import (
    HEADERS,
    ScanTelegram,
    Unit,
    longest_range,
    ranges_of,
    words_of,
)
from followerd.hw.lms200.sweep import Sweep
from followerd.hw.lms200.telegrams import (
    FACTORY_CONFIG,
    PASSWORD,
    BadTelegram,
    Command,
    Config,
    ErrorEntry,
    Reply,
    Status,
    VariantAnswer,
    answer,
    errors_of,
    is_degraded,
    is_usable,
    reply_to,
    request,
    variant_data,
    variant_of,
    written_config,
)
from followerd.hw.lms200.variant import VARIANTS, Variant

TRANSCRIPTS = Path(__file__).parents[2] / "shared" / "protocols" / "transcripts"
COUNTING = np.arange(1000, 1361, dtype=np.uint16)


def scan(
    words: np.ndarray[tuple[int], np.dtype[np.uint16]], unit: Unit, indices: tuple[int, int] | None
) -> Telegram:
    return Telegram(0x80, ScanTelegram(words, unit, indices=indices).to_payload())


HOST = [
    (request(0x20, b"\x24"), "02 00 02 00 20 24 34 08"),
    (request(0x20, b"\x25"), "02 00 02 00 20 25 35 08"),
    (request(0x20, b"\x40"), "02 00 02 00 20 40 50 08"),
    (request(0x20, b"\x41"), "02 00 02 00 20 41 51 08"),
    (request(0x20, b"\x42"), "02 00 02 00 20 42 52 08"),
    (request(0x20, b"\x48"), "02 00 02 00 20 48 58 08"),
    (request(0x20, b"\0" + PASSWORD), "02 00 0A 00 20 00 53 49 43 4B 5F 4C 4D 53 BE C5"),
    (request(0x30, b"\x01"), "02 00 02 00 30 01 31 18"),
    (request(0x31), "02 00 01 00 31 15 12"),
    (request(0x32), "02 00 01 00 32 16 12"),
    (request(0x3A), "02 00 01 00 3A 1E 12"),
    (request(0x74), "02 00 01 00 74 50 12"),
    (request(0x10), "02 00 01 00 10 34 12"),
    (request(0x3B, variant_data(Variant(100, 100))), "02 00 05 00 3B 64 00 64 00 1D 0F"),
    (request(0x3B, variant_data(Variant(100, 50))), "02 00 05 00 3B 64 00 32 00 B1 59"),
    (request(0x3B, variant_data(Variant(100, 25))), "02 00 05 00 3B 64 00 19 00 E7 72"),
    (request(0x3B, variant_data(Variant(180, 100))), "02 00 05 00 3B B4 00 64 00 97 49"),
    (request(0x3B, variant_data(Variant(180, 50))), "02 00 05 00 3B B4 00 32 00 3B 1F"),
    (
        request(0x77, FACTORY_CONFIG.raw),
        "02 00 23 00 77 00 00 46 00 00 00 01 00 00 02 02" + " 00" * 23 + " C9 65",
    ),
]
DEVICE = [
    (answer(0xA0, b"\0"), "02 80 03 00 A0 00 10 16 0A"),
    (answer(0xA0, b"\1"), "02 80 03 00 A0 01 10 14 0B"),
    (answer(0xA0, b"\0", address=1), "02 81 03 00 A0 00 10 36 1A"),
    (answer(0x91), "02 80 02 00 91 10 79 30"),
    (answer(0x92), "02 80 02 00 92 10 7F 33"),
    (answer(0xB2), "02 80 02 00 B2 10 3F 13"),
    (
        answer(0xBB, VariantAnswer(True, Variant(180, 50)).to_data()),
        "02 80 07 00 BB 01 B4 00 32 00 10 03 9D",
    ),
    (
        answer(0xBB, VariantAnswer(False, Variant(180, 50)).to_data()),
        "02 80 07 00 BB 00 B4 00 32 00 10 23 8D",
    ),
    (
        answer(0xBB, VariantAnswer(True, Variant(180, 100)).to_data()),
        "02 80 07 00 BB 01 B4 00 64 00 10 5B 30",
    ),
    (
        answer(0xBB, VariantAnswer(True, Variant(100, 100)).to_data()),
        "02 80 07 00 BB 01 64 00 64 00 10 4F BD",
    ),
    (
        answer(0xBB, VariantAnswer(True, Variant(100, 50)).to_data()),
        "02 80 07 00 BB 01 64 00 32 00 10 17 10",
    ),
    (
        answer(0xBB, VariantAnswer(True, Variant(100, 25)).to_data()),
        "02 80 07 00 BB 01 64 00 19 00 10 BB 46",
    ),
    (
        answer(0xBA, b"LMS200;301061;V02.10 "),
        "02 80 17 00 BA 4C 4D 53 32 30 30 3B 33 30 31 30 36 31 3B 56 30 32 2E 31 30 20 10 2D E5",
    ),
    (
        answer(0x90, b"LMS200;301063;V02.06 ", status=0x13, address=1),
        "02 81 17 00 90 4C 4D 53 32 30 30 3B 33 30 31 30 36 33 3B 56 30 32 2E 30 36 20 13 64 5A",
    ),
    (
        answer(0x90, b"LMS200;301061;V02.10 "),
        "02 80 17 00 90 4C 4D 53 32 30 30 3B 33 30 31 30 36 31 3B 56 30 32 2E 31 30 20 10 6C DA",
    ),
    (
        answer(0xF4, FACTORY_CONFIG.raw),
        "02 80 24 00 F4 00 00 46 00 00 00 01 00 00 02 02" + " 00" * 23 + " 10 89 A0",
    ),
    (
        answer(0xF7, b"\1" + FACTORY_CONFIG.raw),
        "02 80 25 00 F7 01 00 00 46 00 00 00 01 00 00 02 02" + " 00" * 23 + " 10 70 21",
    ),
    (
        scan(np.full(181, 0x1FFF, np.uint16), Unit.MM, None),
        "02 80 6E 01 B0 B5 40" + " FF 1F" * 181 + " 10 B9 E2",
    ),
    (
        scan(COUNTING, Unit.MM, None),
        "02 80 D6 02 B0 69 41" + COUNTING.tobytes().hex() + " 10 86 0C",
    ),
    (
        scan((200 + np.arange(401) % 50).astype(np.uint16), Unit.CM, None),
        "02 80 26 03 B0 91 01"
        + (200 + np.arange(401) % 50).astype("<u2").tobytes().hex()
        + " 10 D0 82",
    ),
    (
        scan(COUNTING[:181], Unit.MM, (7, 9)),
        "02 80 70 01 B0 B5 40" + COUNTING[:181].tobytes().hex() + " 07 09 10 FC 97",
    ),
]
GOLDEN = [
    *((telegram, bytes.fromhex(text), False) for telegram, text in HOST),
    *((telegram, bytes.fromhex(text), True) for telegram, text in DEVICE),
]


@pytest.mark.parametrize(("telegram", "wire", "from_device"), GOLDEN)
def test_golden_bytes_are_written_and_read(
    telegram: Telegram, wire: bytes, from_device: bool
) -> None:
    assert telegram.to_bytes() == wire
    assert telegram.is_from_device == from_device
    decoder = TelegramDecoder(from_device=from_device)
    assert decoder.feed(wire) == [telegram]
    assert [e for byte in wire for e in decoder.feed(bytes((byte,)))] == [telegram]
    assert decoder.feed(wire + b"\x00\x02") == [telegram]
    assert decoder.noise_bytes == 1
    assert decoder.is_midway


@pytest.mark.skipif(not TRANSCRIPTS.exists(), reason="../shared is not there")
@pytest.mark.parametrize("path", sorted(TRANSCRIPTS.glob("lms200_*")), ids=lambda p: p.stem)
def test_every_telegram_of_independent_clients_is_understood(path: Path) -> None:
    decoder = TelegramDecoder(from_device=False)
    for line in path.read_text().splitlines():
        wire = bytes.fromhex(json.loads(line)["hex"])
        (telegram,) = decoder.feed(wire)
        assert isinstance(telegram, Telegram)
        assert telegram.to_bytes() == wire
        assert telegram.command in set(Command)


def shift_register(data: bytes) -> int:
    """The checksum as the manual gives it, a byte at a time."""
    crc = previous = 0
    for byte in data:
        crc = (crc << 1 ^ 0x8005) & 0xFFFF if crc & 0x8000 else crc << 1
        crc ^= previous << 8 | byte
        previous = byte
    return crc


@given(st.binary(min_size=1, max_size=LONGEST_PAYLOAD + 4))
def test_the_checksum_is_the_manuals_shift_register(data: bytes) -> None:
    assert checksum(data) == shift_register(data)


telegrams = st.builds(
    lambda address, payload: Telegram(0x80 | address, payload),
    st.integers(0, 127),
    st.builds(lambda data: b"\xa0" + data, st.binary(min_size=2, max_size=2))
    | st.builds(lambda data: b"\xba" + data, st.binary(min_size=1, max_size=20))
    | st.builds(lambda data: b"\xb0\x91\x01" + data, st.binary(min_size=805, max_size=805)),
)
marks = st.sampled_from(
    [
        b"\x02", b"\x80", b"\x81", b"\x02\x80", b"\x02\x81", b"\x06", b"\x15", b"\xb0", b"\x00",
        b"\x01", b"\x03", b"\x02\x80\xd6\x02\xb0", b"\x02\x80\x2c\x03", b"\x02\x80\x2d\x03",
        b"\x02\x80\x01\x00", b"\x02\x00\x02\x00\x20", b"\x10", b"\xff\x1f", b"\x02\x80\x02\x00",
    ]
)  # fmt: skip
noise = st.lists(marks | st.binary(max_size=4), max_size=40).map(b"".join)


@given(st.lists(telegrams | noise, max_size=5), st.lists(st.integers(0, 2000), max_size=20))
def test_however_the_bytes_are_split_the_events_are_the_same(
    parts: list[Telegram | bytes], cuts: list[int]
) -> None:
    wire = b"".join(p.to_bytes() if isinstance(p, Telegram) else p for p in parts)
    edges = [0, *sorted(min(cut, len(wire)) for cut in cuts), len(wire)]
    whole, split = TelegramDecoder(), TelegramDecoder()
    pieces: list[Event] = []
    for start, end in pairwise(edges):
        pieces += split.feed(wire[start:end])
    assert pieces == whole.feed(wire)
    assert (split.noise_bytes, split.rejected_frames) == (whole.noise_bytes, whole.rejected_frames)


@given(noise, st.booleans())
def test_no_input_raises_and_the_buffer_stays_small(data: bytes, from_device: bool) -> None:
    decoder = TelegramDecoder(from_device=from_device)
    for _ in range(5):
        decoder.feed(data)
        assert len(decoder._buffer) < LONGEST_PAYLOAD + 6
    decoder.give_up()
    assert not decoder.is_midway


ALIVE = answer(Reply.MODE, b"\0")


@given(noise)
@example(b"\x02\x80\x02\x00")
@example(b"\x02\x80\x2c\x03\xb0")
def test_a_telegram_after_any_noise_arrives(data: bytes) -> None:
    events = TelegramDecoder().feed(data + ALIVE.to_bytes() + bytes(LONGEST_PAYLOAD + 6))
    assert ALIVE in events
    found = next(e for e in events if e == ALIVE)
    assert isinstance(found, Telegram)
    assert found.offset == len(data)


@given(noise)
def test_a_telegram_hidden_behind_a_false_header_is_found_when_the_line_falls_silent(
    data: bytes,
) -> None:
    decoder = TelegramDecoder()
    events = decoder.feed(data + ALIVE.to_bytes())
    events += decoder.give_up()
    assert ALIVE in events


def test_every_reply_has_its_lengths() -> None:
    assert set(LENGTHS) == set(Reply)
    assert max(longest for _, longest in LENGTHS.values()) == LONGEST_PAYLOAD
    assert set(COUNT_AT) == set(HEADERS)


@pytest.mark.parametrize(
    "payload",
    [
        b"\xa0\x00\x00\x10",  # too long for what it says it is
        b"\xa0\x10",  # too short
        b"\x24\x00\x10",  # no reply
        b"\xb0\x03\x40" + bytes(4) + b"\x10",  # a value is missing
        b"\xb0\x01\x40" + bytes(4) + b"\x10" + bytes(1),  # one byte more than indices
        b"\xb7\x01\x00\x02\x00\x03\x40" + bytes(4) + b"\x10",
    ],
)
def test_a_frame_whose_length_contradicts_its_content_is_none(payload: bytes) -> None:
    decoder = TelegramDecoder()
    wire = Telegram(0x80, payload).to_bytes()
    assert not any(isinstance(e, Telegram) for e in decoder.feed(wire + ALIVE.to_bytes())[:-1])
    assert decoder.rejected_frames == 0


def test_a_damaged_length_does_not_hold_up_what_follows() -> None:
    wire = bytearray(scan(COUNTING[:11], Unit.MM, None).to_bytes())
    wire[3] ^= 2  # 512 bytes more
    assert TelegramDecoder().feed(bytes(wire) + ALIVE.to_bytes())[-1] == ALIVE


@pytest.mark.parametrize("reply", LENGTHS)
def test_behind_a_false_header_two_good_telegrams_are_late_at_most(reply: int) -> None:
    """The longest frame that a false header can promise; nothing good is lost in it."""
    longest = LENGTHS[reply][1]
    header = bytes((2, 0x80)) + longest.to_bytes(2, "little") + bytes((reply,))
    if reply in COUNT_AT:
        count = (longest - LENGTHS[reply][0]) // 2
        header += bytes(COUNT_AT[reply] - 1) + count.to_bytes(2, "little")
    good = [scan(COUNTING[i : i + 181], Unit.MM, None) for i in range(3)]
    decoder = TelegramDecoder()
    first = decoder.feed(header + good[0].to_bytes()) + decoder.feed(good[1].to_bytes())
    assert [e for e in first + decoder.feed(good[2].to_bytes()) if isinstance(e, Telegram)] == good


def test_what_is_missing_is_known_as_soon_as_it_can_be() -> None:
    decoder = TelegramDecoder()
    wire = scan(COUNTING, Unit.MM, None).to_bytes()
    assert decoder.missing == 1
    decoder.feed(wire[:62])
    assert decoder.missing == len(wire) - 62
    assert decoder.pending == 62
    decoder.feed(wire[62:])
    assert decoder.missing == 1


@given(st.sampled_from([wire for _, wire, _ in GOLDEN]), st.data())
def test_a_telegram_damaged_on_purpose_can_be_given_its_checksum(
    wire: bytes, data: st.DataObject
) -> None:
    assert with_checksum(wire) == wire
    at = data.draw(st.integers(5, len(wire) - 1))
    hurt = with_checksum(wire[:at] + bytes((wire[at] ^ 0x55,)) + wire[at + 1 :])
    assert len(hurt) == len(wire)
    assert shift_register(hurt[:-2]) == int.from_bytes(hurt[-2:], "little")


def test_acknowledgements_stand_apart_from_telegrams() -> None:
    decoder = TelegramDecoder()
    events = decoder.feed(b"\x06" + ALIVE.to_bytes() + b"\x15")
    assert events == [Acknowledgement.ACK, ALIVE, Acknowledgement.NAK]
    assert isinstance(events[1], Telegram)
    assert events[1].offset == 1
    assert decoder.noise_bytes == 0


def test_no_single_flip_loss_or_repetition_is_accepted() -> None:
    good = scan(COUNTING[:41], Unit.MM, None)
    wire = good.to_bytes()
    damaged = [
        wire[:i] + bytes((wire[i] ^ 1 << bit,)) + wire[i + 1 :]
        for i, bit in product(range(len(wire)), range(8))
    ]
    damaged += [wire[:i] + wire[i + 1 :] for i in range(len(wire))]
    damaged += [wire[: i + 1] + wire[i:] for i in range(1, len(wire) - 1)]
    damaged += [wire[:i] for i in range(len(wire))]
    for bad in damaged:
        decoder = TelegramDecoder()
        events = decoder.feed(bad + wire + bytes(LONGEST_PAYLOAD + 6))
        received = [e for e in events if isinstance(e, Telegram)]
        # a repeated or lost byte at the very end or start may leave the telegram itself whole
        assert all(e == good for e in received)
        assert received[-1].offset == len(bad)


def test_a_devices_payload_ends_with_its_status() -> None:
    told = answer(Reply.MODE, b"\1", status=0x13)
    assert (told.command, told.data, told.status) == (0xA0, b"\1", 0x13)
    asked = request(Command.MODE, b"\x24")
    assert (asked.command, asked.data) == (0x20, b"\x24")


@pytest.mark.parametrize("length", [0, LONGEST_PAYLOAD + 1])
def test_payloads_that_no_frame_can_hold_are_refused(length: int) -> None:
    with pytest.raises(ValueError, match="1 to 813"):
        Telegram(0, bytes(length))


def test_answers_are_known_by_the_requests_code() -> None:
    assert [reply_to(c) for c in (0x10, 0x20, 0x77)] == [0x91, 0xA0, 0xF7]


@pytest.mark.parametrize(
    ("status", "usable", "degraded"),
    [
        (0x10, True, False),
        (0x11, True, False),
        (0x12, True, True),
        (0x13, False, False),
        (0x14, False, False),
        (0x50, False, False),
        (0x90, True, True),
    ],
)
def test_the_status_byte_says_whether_scans_may_be_used(
    status: int, usable: bool, degraded: bool
) -> None:
    assert (is_usable(status), is_degraded(status)) == (usable, degraded)


# -- scans ----------------------------------------------------------------------------------

SCANS = [
    ScanTelegram(COUNTING, Unit.MM),
    ScanTelegram(COUNTING, Unit.CM, indices=(255, 3), status=0x90),
    ScanTelegram(COUNTING[:100], Unit.MM, partial=True, raster=3),
    ScanTelegram(COUNTING[:181], Unit.MM, Reply.MEAN, samples=5),
    ScanTelegram(COUNTING[:50], Unit.DM, Reply.SUBRANGE, first=11, indices=(1, 2)),
    ScanTelegram(COUNTING[:50], Unit.MM, Reply.MEAN_SUBRANGE, samples=7, first=11),
]


@pytest.mark.parametrize("sent", SCANS, ids=lambda s: s.reply.name)
def test_scans_of_every_kind_come_back(sent: ScanTelegram) -> None:
    got = ScanTelegram.from_payload(sent.to_payload())
    for name in ("unit", "reply", "partial", "raster", "samples", "first", "indices", "status"):
        assert getattr(got, name) == getattr(sent, name)
    assert got.words.tolist() == sent.words.tolist()


def test_the_bits_of_a_scans_count_word() -> None:
    partial = ScanTelegram(COUNTING[:100], Unit.MM, partial=True, raster=2).to_payload()
    assert partial[1:3] == bytes.fromhex("64 70")  # 01 1 10 0 0001100100
    assert SCANS[3].to_payload()[:4] == bytes.fromhex("B6 05 B5 40")
    assert SCANS[4].to_payload()[:7] == bytes.fromhex("B7 0B 00 3C 00 32 80")
    assert SCANS[5].to_payload()[:8] == bytes.fromhex("BF 07 0B 00 3C 00 32 40")


@pytest.mark.parametrize(
    "payload",
    [
        "A0 00 10",  # no scan
        "13 00 10",  # no reply at all
        "B0 01",  # no count
        "B0 01 C0 00 00 10",  # reserved unit
        "B0 02 40 00 00 10",  # a value is missing
        "B0 02 40 00 00 00 00",  # the status is missing
        "B0 01 40 00 00 07 10",  # one index of two
        "B0 01 40 00 00 07 09 01 10",  # three
        "B7 02 00 04 00 02 40 00 00 00 00 10",  # 3 numbers, 2 values
    ],
)
def test_a_scan_that_contradicts_itself_is_refused(payload: str) -> None:
    with pytest.raises(BadTelegram):
        ScanTelegram.from_payload(bytes.fromhex(payload))


@pytest.mark.parametrize(
    ("mode", "unit", "word", "metres"),
    [
        (0, Unit.MM, 0x0000, 0.0),
        (0, Unit.MM, 0x07D4, 2.004),
        (0, Unit.CM, 0x07D4, 20.04),
        (0, Unit.DM, 0x0010, 1.6),
        (0, Unit.MM, 0x1FF6, 8.182),
        (0, Unit.MM, 0x1FF7, inf),  # beyond the maximum
        (0, Unit.MM, 0x1FF8, nan),
        (0, Unit.MM, 0x1FF9, nan),
        (0, Unit.MM, 0x1FFA, nan),  # channel error
        (0, Unit.MM, 0x1FFB, inf),  # too weak
        (0, Unit.MM, 0x1FFC, nan),
        (0, Unit.MM, 0x1FFD, nan),  # overflow
        (0, Unit.MM, 0x1FFE, nan),  # dazzled
        (0, Unit.MM, 0x1FFF, inf),  # no echo
        (0, Unit.MM, 0x67D4, 2.004),  # in fields A and B
        (0, Unit.MM, 0x87D4, nan),  # dazzled
        (1, Unit.MM, 0xE7D4, 2.004),  # reflector
        (2, Unit.MM, 0xE7D4, 2.004),  # in fields A, B, C
        (3, Unit.MM, 0xE7D4, 10.196),
        (4, Unit.MM, 0x3FF6, 16.374),
        (4, Unit.MM, 0x7FFF, inf),
        (5, Unit.MM, 0xE7D4, 26.580),
        (6, Unit.MM, 0x7FFE, nan),
        (15, Unit.MM, 0x7FF6, 32.758),
    ],
)
def test_a_value_word_by_measuring_mode(mode: int, unit: Unit, word: int, metres: float) -> None:
    (got,) = ranges_of(np.array([word], np.uint16), mode, unit)
    assert got == pytest.approx(metres, nan_ok=True)


@pytest.mark.parametrize(
    ("mode", "word", "fields", "reflection"),
    [
        (0, 0xA7D4, [True, False], None),  # dazzled, in A
        (0, 0x47D4, [False, True], None),
        (1, 0xE7D4, [], 1.0),
        (1, 0x27D4, [], 1 / 7),
        (2, 0x87D4, [False, False, True], None),
        (3, 0x87D4, [], 2 / 3),
        (4, 0x47D4, [True, False], None),
        (5, 0x87D4, [], 1.0),
        (6, 0x87D4, [True], None),
        (15, 0x87D4, [], None),
    ],
)
def test_the_flags_of_a_value_word_by_measuring_mode(
    mode: int, word: int, fields: list[bool], reflection: float | None
) -> None:
    words = np.array([word, 0], np.uint16)
    assert fields_of(words, mode).tolist() == [fields, [False] * len(fields)]
    got = reflection_of(words, mode)
    assert (None if got is None else got.tolist()) == (
        None if reflection is None else [pytest.approx(reflection), 0.0]
    )


def test_reflectivities_are_not_taken_for_ranges() -> None:
    with pytest.raises(KeyError):
        ranges_of(COUNTING, 0x3F, Unit.MM)


def test_words_say_ranges_in_steps_of_the_unit() -> None:
    ranges = np.array([0.0, -0.1, 2.0044, 8.182, 8.2, 40.0, inf, nan])
    words = words_of(ranges, 0, Unit.MM)
    assert words.tolist() == [0, 0, 2004, 0x1FF6, 0x1FF7, 0x1FF7, 0x1FFF, 0x1FFE]
    assert ranges_of(words, 0, Unit.MM) == pytest.approx(
        [0, 0, 2.004, 8.182, inf, inf, inf, nan], nan_ok=True
    )
    assert longest_range(0, Unit.MM) == pytest.approx(8.182)


# -- other contents -------------------------------------------------------------------------

REPORT = Status(
    firmware=b"V02.10 ",
    mode=0x24,
    defective=False,
    is_special=True,
    pollution=tuple(range(90, 98)),
    pollution_calibration=(100,) * 8,
    revolutions=4500,
    measuring_mode=2,
    variant=Variant(100, 25),
    restart=1,
    baud_word=0x8019,
    is_baud_permanent=True,
    address=5,
    unit=1,
    is_laser_off=False,
    boot_prom=b"V01.27 ",
)


def test_the_status_report_stands_where_others_read_it() -> None:
    payload = answer(Reply.STATUS, REPORT.to_data()).payload
    assert len(payload) == 154
    assert payload[1:8] == b"V02.10 "
    assert payload[8] == 0x24
    assert payload[18] == 1
    assert payload[19:23] == bytes.fromhex("5A 00 5B 00")
    assert payload[43:45] == bytes.fromhex("64 00")
    assert payload[67:69] == bytes.fromhex("94 11")
    assert payload[102] == 2
    assert payload[107:111] == bytes.fromhex("64 00 19 00")
    assert payload[111] == 1
    assert payload[116:118] == bytes.fromhex("19 80")
    assert payload[119:121] == bytes.fromhex("01 05")
    assert payload[122:124] == bytes.fromhex("01 00")
    assert payload[124:131] == b"V01.27 "
    assert Status.from_data(REPORT.to_data()) == REPORT


def test_a_status_report_without_the_last_counters_is_understood() -> None:
    assert Status.from_data(REPORT.to_data()[:146]) == REPORT
    with pytest.raises(BadTelegram, match="152 bytes, not 145"):
        Status.from_data(REPORT.to_data()[:145])


def test_errors_come_as_pairs() -> None:
    assert errors_of(b"") == ()
    assert errors_of(b"\x01\x05\x03\x18") == (ErrorEntry(1, 5), ErrorEntry(3, 0x18))


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: f"{v.field}/{v.resolution}")
def test_variants_come_back(variant: Variant) -> None:
    assert variant_of(variant_data(variant)) == variant
    said = VariantAnswer(True, variant)
    assert VariantAnswer.from_data(said.to_data()) == said


@pytest.mark.parametrize("data", [b"", bytes(3), bytes(6)])
def test_contents_of_the_wrong_length_are_refused(data: bytes) -> None:
    with pytest.raises(BadTelegram):
        variant_of(data)
    with pytest.raises(BadTelegram):
        VariantAnswer.from_data(data)
    with pytest.raises(BadTelegram):
        written_config(data)


def test_a_configuration_changes_only_where_asked() -> None:
    config = Config(bytes(range(34)))
    changed = config.with_values(measuring_mode=3, unit=0)
    assert (changed.measuring_mode, changed.unit) == (3, 0)
    assert changed.raw[:5] == config.raw[:5]
    assert changed.raw[7:] == config.raw[7:]
    assert config.overwritten(b"\xff" * 7).raw == b"\xff" * 7 + config.raw[7:]
    assert config.overwritten(b"\xff" * 40).raw == b"\xff" * 34
    assert Config(b"\0\0\0\0\x02".ljust(34, b"\0")).has_indices
    assert not FACTORY_CONFIG.has_indices
    assert written_config(b"\1" + config.raw) == (True, config)
    assert written_config(b"\0" + config.raw) == (False, config)


# -- timing ---------------------------------------------------------------------------------

TABLE = {  # protocols/lms200.md section 4: delivered scans a second at 9600, 19200, 38400, 500000
    (100, 100): (4.41, 8.33, 15.0, 75.0),
    (180, 100): (2.50, 5.00, 9.38, 75.0),
    (100, 50): (2.21, 4.17, 7.50, 37.5),
    (180, 50): (1.29, 2.50, 4.69, 37.5),
    (100, 25): (1.17, 2.34, 4.69, 18.75),
}


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: f"{v.field}/{v.resolution}")
def test_scans_are_delivered_in_whole_scan_times(variant: Variant) -> None:
    rates = [1 / Sweep(variant).delivered_period(baud) for baud in (9600, 19200, 38400, 500000)]
    assert rates == pytest.approx(TABLE[variant.field, variant.resolution], rel=0.005)


def test_half_degrees_are_measured_a_turn_later() -> None:
    times = VARIANTS[0].beam_times * 1e3
    assert times[[0, 1, 2, 180, 360]] == pytest.approx(
        [0, 13.333 + 0.0185, 0.037, 3.333, 6.667], abs=1e-3
    )


def test_the_middle_value_looks_ahead() -> None:
    for variant in VARIANTS:
        assert variant.bearings[variant.count // 2] == pytest.approx(0)
        assert np.degrees(variant.bearings[-1]) == pytest.approx(variant.field / 2)


def test_a_telegram_is_known_by_its_first_bytes() -> None:
    decoder = TelegramDecoder()
    decoder.feed(bytes.fromhex("00 02 80 6E 01 B0 B5 40 E8"))
    first = bytes.fromhex("02 80 6E 01 B0 B5 40")
    assert list(decoder.beginnings(0, 7)) == [(1, first)]
    assert not list(decoder.beginnings(2, 7))
    assert not list(decoder.beginnings(0, 9))
