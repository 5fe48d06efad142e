"""Damaged LMS200 telegrams: what the checksum lets through, and what comes out as a scan (F7)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
import pytest

from followerd.hw.lms200.assembler import Assembler, Counters
from followerd.hw.lms200.protocol import LONGEST_PAYLOAD, OVERHEAD, Telegram, TelegramDecoder
from followerd.hw.lms200.scans import ScanTelegram, Unit
from followerd.hw.lms200.settings import Lms200Settings
from followerd.hw.lms200.telegrams import Reply, answer
from followerd.messages import Scan

Wires = npt.NDArray[np.uint8]  # (N, length), a telegram a row

SETTINGS = Lms200Settings(resolution_deg=1, sector_deg=(-5, 5))  # 11 values: short telegrams
VALUES = 11
LENGTH = 8 + 2 * VALUES + OVERHEAD
MILLION = 1_000_000
BATCH = 2_000
PERIOD = 1 / 75
OFF = 0.25  # m; a wrong range that is nearer to the truth is plausible
BURSTS = range(2, 7)  # bytes


def checksums(wires: Wires) -> npt.NDArray[np.uint16]:
    """The manual's shift register, for all rows at once."""
    crc = np.zeros(len(wires), np.uint16)
    previous = np.zeros_like(crc)
    for column in range(wires.shape[1]):
        byte = wires[:, column].astype(np.uint16)
        crc = np.where(crc >> 15, crc << 1 ^ 0x8005, crc << 1) ^ (previous << 8 | byte)
        crc = crc.astype(np.uint16)
        previous = byte
    return crc


def rows(wires: Wires) -> list[bytes]:
    """The telegrams."""
    whole, length = wires.tobytes(), wires.shape[1]
    return [whole[i : i + length] for i in range(0, len(whole), length)]


def walls(rng: np.random.Generator, count: int) -> Wires:
    """Telegrams of scans across slanted walls, with the noise of the device."""
    first = ScanTelegram(
        np.zeros(VALUES, np.uint16), Unit.MM, Reply.SUBRANGE, first=SETTINGS.sweeps[0].first
    )
    wires = np.tile(
        np.frombuffer(Telegram(0x80, first.to_payload()).to_bytes(), np.uint8), (count, 1)
    )
    distance, slope = rng.uniform(800, 7000, (count, 1)), rng.uniform(-30, 30, (count, 1))
    noise = rng.normal(0, 5, (count, VALUES))
    words = np.rint(distance + slope * np.arange(VALUES) + noise).astype("<u2")
    wires[:, 11 : 11 + 2 * VALUES] = words.view(np.uint8)
    wires[:, -2:] = checksums(wires[:, :-2]).astype("<u2")[:, None].view(np.uint8)
    return wires


def one_bit_turned(rng: np.random.Generator, wires: Wires) -> list[bytes]:
    bits = rng.integers(0, 8 * LENGTH, len(wires))
    wires = wires.copy()
    wires[np.arange(len(wires)), bits // 8] ^= (1 << bits % 8).astype(np.uint8)
    return rows(wires)


def cut_off(rng: np.random.Generator, wires: Wires) -> list[bytes]:
    ends = rng.integers(0, LENGTH, len(wires))
    return [wire[:end] for wire, end in zip(rows(wires), ends.tolist(), strict=True)]


def some_bytes_missing(rng: np.random.Generator, wires: Wires) -> list[bytes]:
    begins = rng.integers(0, LENGTH, len(wires))
    ends = begins + rng.integers(1, 4, len(wires))
    return [
        wire[:begin] + wire[end:]
        for wire, begin, end in zip(rows(wires), begins.tolist(), ends.tolist(), strict=True)
    ]


def some_bytes_twice(rng: np.random.Generator, wires: Wires) -> list[bytes]:
    begins = rng.integers(0, LENGTH, len(wires))
    ends = begins + rng.integers(1, 4, len(wires))
    return [
        wire[:end] + wire[begin:]
        for wire, begin, end in zip(rows(wires), begins.tolist(), ends.tolist(), strict=True)
    ]


def a_short_burst(rng: np.random.Generator, wires: Wires) -> list[bytes]:
    lengths = rng.integers(BURSTS.start, BURSTS.stop, len(wires))
    begins = rng.integers(0, LENGTH - lengths + 1)
    column = np.arange(LENGTH)
    hit = (begins[:, None] <= column) & (column < (begins + lengths)[:, None])
    return rows(np.where(hit, rng.integers(0, 256, wires.shape, np.uint8), wires))


def all_random_behind_the_header(rng: np.random.Generator, wires: Wires) -> list[bytes]:
    wires = wires.copy()
    wires[:, 11:] = rng.integers(0, 256, (len(wires), LENGTH - 11))
    return rows(wires)


class Receiver:
    """What stands between the line and the rest of the daemon."""

    asked: ClassVar[Telegram] = answer(Reply.MODE, b"\0")

    def __init__(self) -> None:
        self.decoder = TelegramDecoder()
        self.telegrams = 0  # decoded that were not sent so
        self.scans: list[tuple[Scan, Scan]] = []  # what came of those, and what was measured

    def hears(self, wire: bytes, damaged: bytes) -> None:
        """A damaged telegram and then silence, after the scan that it was made of."""
        events = self.decoder.feed(damaged)
        assert self.decoder.missing <= LONGEST_PAYLOAD + OVERHEAD
        for event in events + self.decoder.give_up():
            if isinstance(event, Telegram) and event.to_bytes() != wire:
                self.telegrams += 1
                assembler = Assembler(SETTINGS, self.asked, Counters())
                sent = Telegram(wire[1], wire[4:-2])
                assembler.scan(sent, 0.0, 0.0)  # the first is checked against nothing
                (true,) = [assembler.scan(Telegram(wire[1], nudged(wire)), PERIOD, 0.0)]
                assert true is not None
                scan = assembler.scan(event, 2 * PERIOD, 0.0)
                if scan is not None:
                    self.scans.append((scan, true))

    @property
    def wrong_ranges(self) -> list[float]:
        """How far off the ranges are that came out and are implausible, m; no echo is no range."""
        return [
            float(error)
            for scan, true in self.scans
            for error in np.abs(scan.ranges - true.ranges)
            if OFF < error < np.inf
        ]


def nudged(wire: bytes) -> bytes:
    """The payload of the same scan a moment later: the last bit of its first value differs."""
    return wire[4:11] + bytes((wire[11] ^ 1,)) + wire[12:-2]


@dataclass(frozen=True)
class Class:
    """A way of damaging telegrams, and which share the decoder may let through."""

    damage: Callable[[np.random.Generator, Wires], list[bytes]]
    share: float


CLASSES = {
    "one bit turned": Class(one_bit_turned, 0.0),
    "cut off": Class(cut_off, 0.0),
    "bytes missing": Class(some_bytes_missing, 0.0),
    "bytes twice": Class(some_bytes_twice, 2**-15),
    "a burst of 2 to 6 bytes": Class(
        a_short_burst, 1.2 * 2.0**-7 * sum(2.0**-n for n in BURSTS) / len(BURSTS)
    ),
    "all random behind the header": Class(all_random_behind_the_header, 2**-15),
}


def fuzzed(name: str, count: int, seed: int) -> Receiver:
    rng = np.random.default_rng(seed)
    receiver = Receiver()
    for _ in range(count // BATCH):
        wires = walls(rng, BATCH)
        for wire, damaged in zip(rows(wires), CLASSES[name].damage(rng, wires), strict=True):
            receiver.hears(wire, damaged)
    return receiver


@pytest.mark.parametrize("name", CLASSES)
def test_damaged_telegrams_are_rejected(name: str) -> None:
    receiver = fuzzed(name, BATCH, 1)
    # of so few, a share of 2**-15 may by chance be four times as many
    assert receiver.telegrams <= max(4 * CLASSES[name].share * BATCH, 2 * (CLASSES[name].share > 0))
    assert not receiver.wrong_ranges


@pytest.mark.slow
@pytest.mark.parametrize("name", CLASSES)
def test_of_a_million_damaged_telegrams_no_wrong_range_comes_out(name: str) -> None:
    receiver = fuzzed(name, MILLION, 2)
    assert receiver.telegrams <= CLASSES[name].share * MILLION
    assert not receiver.wrong_ranges
