"""Coverage-guided fuzzing of every decoder: nothing but what is documented is ever raised."""

import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import pytest

from followerd.hw.camera import protocol as ring
from followerd.hw.lms200 import flags, scans, telegrams
from followerd.hw.lms200 import protocol as lms200
from followerd.hw.lms200.telegrams import FACTORY_CONFIG, BadTelegram, Command, Reply
from followerd.hw.lms200.variant import VARIANTS
from followerd.hw.p2os import commands, config, packets, sip
from followerd.hw.p2os import protocol as p2os
from followerd.hw.vcc50i import commands as canon_commands
from followerd.hw.vcc50i import protocol as canon
from followerd.sim.rig import mended_telegram
from tests.fuzzing import Mend, Target, fuzz

PIECE = 7  # bytes, of the pieces that must decode to the same


def in_pieces(feed: Callable[[bytes], Sequence[object]], data: bytes) -> list[object]:
    """What comes of data fed in pieces."""
    pieces = (data[i : i + PIECE] for i in range(0, len(data), PIECE))
    return [found for piece in pieces for found in feed(piece)]


def robot_says(data: bytes) -> None:
    """Packets of the base, and their values."""
    decoder = p2os.PacketDecoder(config.is_config_with_wrong_checksum)
    found = decoder.feed(data)
    split = p2os.PacketDecoder(config.is_config_with_wrong_checksum)
    assert in_pieces(split.feed, data) == found
    for packet in (*found, *decoder.settle()):
        value = packets.parse(packet.payload)
        if isinstance(value, sip.Sip):
            assert value.volts >= 0.0
        config.Identity.parse(packet.payload)


def robot_hears(data: bytes) -> None:
    """Commands, as the base's twin takes them."""
    for packet in p2os.PacketDecoder().feed(data):
        request = commands.Request.parse(packet.payload)
        assert isinstance(request.integer, int)
        assert isinstance(request.string, bytes)


def laser_says(data: bytes) -> None:
    """Telegrams of the laser, and their contents."""
    decoder = lms200.TelegramDecoder()
    found = decoder.feed(data)
    assert in_pieces(lms200.TelegramDecoder().feed, data) == found
    for event in (*found, *decoder.give_up()):
        if isinstance(event, lms200.Telegram):
            read(event)


def read(telegram: lms200.Telegram) -> None:
    """Whatever a laser's telegram can hold."""
    with suppress(BadTelegram):
        scan = scans.ScanTelegram.from_payload(telegram.payload)
        with suppress(BadTelegram):
            ranges = scans.ranges_of(scan.words, 0, scan.unit)
            assert not (ranges < 0).any()
        flags.fields_of(scan.words, 0)
        flags.reflection_of(scan.words, 1)
    for parse in (
        telegrams.Status.from_data,
        telegrams.Config,
        telegrams.written_config,
        telegrams.VariantAnswer.from_data,
        telegrams.errors_of,
    ):
        with suppress(BadTelegram):
            parse(telegram.data)


def laser_hears(data: bytes) -> None:
    """Requests, as the laser's twin takes them."""
    for event in lms200.TelegramDecoder(from_device=False).feed(data):
        if isinstance(event, lms200.Telegram):
            with suppress(BadTelegram):
                telegrams.variant_of(event.data)


def head_says(data: bytes) -> None:
    """Answers of the camera's head, and commands to it."""
    decoder = canon.FrameDecoder()
    found = decoder.feed(data)
    assert in_pieces(canon.FrameDecoder().feed, data) == found
    for frame in found:
        answer = canon.Answer.parse(frame)
        if answer is not None:
            canon_commands.position_of(answer.data)
    for frame in canon.FrameDecoder(canon.FROM_HOST).feed(data):
        canon.Request.parse(frame)


def ring_holds(data: bytes) -> None:
    """A frame ring that anybody may have written."""
    with suppress(ValueError):
        layout = ring.RingLayout.from_header(data[: ring.ALIGN])
        ring.Ring(layout, memoryview(bytearray(data))).newest()


def a_scan(reply: Reply, indices: tuple[int, int] | None = None) -> bytes:
    words = np.arange(41, dtype=np.uint16) * 160
    scan = scans.ScanTelegram(words=words, unit=scans.Unit.CM, reply=reply, indices=indices)
    return lms200.Telegram(0x80, scan.to_payload()).to_bytes()


def a_ring() -> bytes:
    layout = ring.RingLayout(4, 3, slots=3)
    memory = bytearray(layout.header().ljust(layout.size, b"\0"))
    pixels = np.zeros((3, 4, 3), np.uint8)
    ring.Ring(layout, memoryview(memory)).write(ring.Frame(0, 1.0, pixels))
    return bytes(memory)


@dataclass(frozen=True)
class Case:
    """A decoder, what it is fed first, and how its checksums are made right."""

    target: Target
    modules: tuple[ModuleType, ...]
    seeds: list[bytes]
    runs: int
    mend: Mend = bytes


CASES = {
    "robot says": Case(
        robot_says,
        (p2os, packets, sip, config),
        [
            p2os.frame(bytes([kind, *range(40)]))
            for kind in (0x32, 0x33, 0x20, 0x90, 0x98, 0xB0, 0xE0, 0xF0, 0xF8, 0xFA, 0xFE)
        ],
        20_000,
        p2os.with_checksum,
    ),
    "robot hears": Case(
        robot_hears,
        (p2os, commands),
        [commands.command(n, a) for n, a in ((0, None), (11, -150), (43, 6), (42, b"\xff00"))],
        10_000,
        p2os.with_checksum,
    ),
    "laser says": Case(
        laser_says,
        (lms200, scans, telegrams, flags),
        [
            telegrams.answer(Reply.MODE, b"\0").to_bytes(),
            telegrams.answer(Reply.VARIANT, b"\1" + telegrams.variant_data(VARIANTS[0])).to_bytes(),
            telegrams.answer(Reply.READ_CONFIG, FACTORY_CONFIG.raw).to_bytes(),
            *(a_scan(r) for r in (Reply.SCAN, Reply.MEAN, Reply.SUBRANGE, Reply.MEAN_SUBRANGE)),
            a_scan(Reply.SCAN, (7, 8)),
            b"\x06\x15",
        ],
        12_000,
        mended_telegram,
    ),
    "laser hears": Case(
        laser_hears,
        (lms200, telegrams),
        [telegrams.request(Command.VARIANT, telegrams.variant_data(VARIANTS[1])).to_bytes()],
        10_000,
        mended_telegram,
    ),
    "head says": Case(
        head_says,
        (canon, canon_commands),
        [
            canon.Answer(data=canon_commands.position_data(12, -7)).to_bytes(),
            canon.Answer(canon.Errors.MODE | canon.Errors.BUSY).to_bytes(),
            canon_commands.move(100, -50).to_bytes(),
        ],
        20_000,
    ),
    "ring holds": Case(ring_holds, (ring,), [a_ring()], 10_000),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_whatever_comes_a_decoder_raises_only_what_it_says(name: str) -> None:
    case = CASES[name]
    rng = np.random.default_rng(len(name))
    found = fuzz(case.target, case.modules, case.seeds, case.runs, rng, case.mend)
    sys.stdout.write(
        f"{name}: {found.runs} inputs, {found.at_first} -> {found.edges} edges,"
        f" {len(found.corpus)} kept\n"
    )
    assert found.edges > found.at_first


@pytest.mark.parametrize(
    ("decoder", "hostile"),
    [
        (p2os.PacketDecoder(), b"\xfa\xfb\xff"),  # ever new headers of the longest packets
        (p2os.PacketDecoder(), b"\xfa"),
        (lms200.TelegramDecoder(), b"\x02\x80\x28\x03\xb0\x91\x01"),
        (lms200.TelegramDecoder(from_device=False), b"\x02\x00\x28\x03"),
        (canon.FrameDecoder(), b"\xfe0000"),
        (canon.FrameDecoder(), b"0"),
    ],
)
def test_a_stream_that_always_seems_to_begin_something_is_not_hoarded(
    decoder: p2os.PacketDecoder | lms200.TelegramDecoder | canon.FrameDecoder, hostile: bytes
) -> None:
    chunk = (hostile * 62)[:62]
    for _ in range(100):
        assert not decoder.feed(chunk)
        held = [part for part in vars(decoder).values() if isinstance(part, bytes | bytearray)]
        assert held
        assert sum(map(len, held)) <= lms200.LONGEST_PAYLOAD + lms200.OVERHEAD


def test_fuzzing_finds_what_a_random_input_would_not() -> None:
    def picky(data: bytes) -> None:
        if data[:1] != b"\xfa":
            return
        if data[1:2] != b"\xfb":
            return
        if data[2:3] == b"\x80":
            raise ValueError("found")

    with pytest.raises(ValueError, match="found") as caught:
        fuzz(picky, [sys.modules[__name__]], [b"start"], 5_000, np.random.default_rng(1))
    assert caught.value.__notes__[0].startswith("input: fafb80")
