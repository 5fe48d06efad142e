"""Scan telegrams: B0 (whole or partial), B6 (mean), B7 (sub-range), BF (mean of a sub-range).

And what a value word means as a range; its upper bits are in `flags`.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from struct import Struct, error

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.hw.lms200.protocol import COUNT_AT, COUNT_MASK
from followerd.hw.lms200.telegrams import HEALTHY, BadTelegram, Reply

Words = npt.NDArray[np.uint16]

PARTIAL = 0x2000
RASTER_SHIFT = 11
UNIT_SHIFT = 14
RANGE_BITS = {0x00: 13, 0x01: 13, 0x02: 13, 0x03: 14, 0x04: 14, 0x05: 15, 0x06: 15, 0x0F: 15}
DAZZLED_BIT = 0x8000  # in measuring mode 00
# what the words from the top of the range downwards stand for: inf = no echo, nan = not measured
NO_ECHO, DAZZLED, BEYOND_MAXIMUM = 0, 1, 8
SPECIAL = (
    np.inf,  # no valid echo
    np.nan,  # dazzled
    np.nan,  # overflow
    np.nan,  # reserved
    np.inf,  # signal too weak
    np.nan,  # channel error
    np.nan,  # reserved
    np.nan,  # reserved
    np.inf,  # beyond the maximum
)


class Unit(IntEnum):
    """Unit of the values."""

    CM = 0
    MM = 1
    DM = 2  # old devices

    @property
    def metres(self) -> float:
        """The unit in m."""
        return (0.01, 0.001, 0.1)[self]


HEADERS = {
    Reply.SCAN: Struct("<"),
    Reply.MEAN: Struct("<B"),
    Reply.SUBRANGE: Struct("<HH"),
    Reply.MEAN_SUBRANGE: Struct("<BHH"),
}
COUNT = Struct("<H")


@dataclass(frozen=True, slots=True, eq=False)
class ScanTelegram:
    """One scan as it is sent; the words still carry the flags of the measuring mode."""

    words: Words  # (N,)
    unit: Unit
    reply: Reply = Reply.SCAN
    partial: bool = False
    raster: int = 0  # start offset in quarter degrees
    samples: int = 1  # scans in a mean
    first: int = 1  # number of the first value in the whole scan, from 1
    indices: tuple[int, int] | None = None  # of the scan and of the telegram, modulo 256
    status: int = HEALTHY

    def to_payload(self) -> bytes:
        """The payload, status included."""
        n = len(self.words)
        header = {
            Reply.SCAN: (),
            Reply.MEAN: (self.samples,),
            Reply.SUBRANGE: (self.first, self.first + n - 1),
            Reply.MEAN_SUBRANGE: (self.samples, self.first, self.first + n - 1),
        }[self.reply]
        count = n | self.raster << RASTER_SHIFT | self.partial * PARTIAL | self.unit << UNIT_SHIFT
        return b"".join(
            (
                bytes((self.reply,)),
                HEADERS[self.reply].pack(*header),
                COUNT.pack(count),
                self.words.astype("<u2", copy=False).tobytes(),
                bytes(self.indices or ()),
                bytes((self.status,)),
            )
        )

    @classmethod
    def from_payload(cls, payload: bytes) -> "ScanTelegram":
        """Raises BadTelegram when it is no scan or its lengths contradict each other."""
        try:
            reply = Reply(payload[0])
            fields = HEADERS[reply].unpack_from(payload, 1)
            (count,) = COUNT.unpack_from(payload, COUNT_AT[reply])
            unit = Unit(count >> UNIT_SHIFT)
        except (KeyError, ValueError, error) as reason:
            raise BadTelegram(f"not a scan: {payload[:8].hex(' ')}") from reason
        n, start = count & COUNT_MASK, COUNT_AT[reply] + COUNT.size
        tail = payload[start + 2 * n : -1]
        if len(payload) < start + 2 * n + 1 or len(tail) not in (0, 2):
            raise BadTelegram(f"{n} values do not fit {len(payload)} bytes")
        is_subrange = reply in (Reply.SUBRANGE, Reply.MEAN_SUBRANGE)
        if is_subrange and fields[-1] - fields[-2] + 1 != n:
            raise BadTelegram(f"{n} values do not fit the sub-range {fields[-2:]}")
        return cls(
            words=np.frombuffer(payload, "<u2", n, start),
            unit=unit,
            reply=reply,
            partial=bool(count & PARTIAL),
            raster=count >> RASTER_SHIFT & 3,
            samples=fields[0] if reply in (Reply.MEAN, Reply.MEAN_SUBRANGE) else 1,
            first=fields[-2] if is_subrange else 1,
            indices=(tail[0], tail[1]) if tail else None,
            status=payload[-1],
        )


@cache
def _ranges_by_word(measuring_mode: int, unit: Unit) -> Array:
    """The meaning of each of the 65536 words in m."""
    top = (1 << RANGE_BITS[measuring_mode]) - 1
    words = np.arange(1 << 16)
    raw = words & top
    meaning: Array = np.append(raw[: top + 1 - len(SPECIAL)] * unit.metres, SPECIAL[::-1])[raw]
    if measuring_mode == 0:
        meaning[words & DAZZLED_BIT != 0] = np.nan
    return meaning


def ranges_of(words: Words, measuring_mode: int, unit: Unit) -> Array:
    """Ranges (N,) in m: inf = no echo, nan = not measured. KeyError: the mode gives no ranges."""
    ranges: Array = _ranges_by_word(measuring_mode, unit)[words]
    return ranges


def longest_range(measuring_mode: int, unit: Unit) -> float:
    """The largest range in m that a word can say."""
    return ((1 << RANGE_BITS[measuring_mode]) - 1 - len(SPECIAL)) * unit.metres


def words_of(ranges: Array, measuring_mode: int, unit: Unit) -> Words:
    """Words (N,) without flags for ranges in m (inverse of `ranges_of`, rounded to the unit)."""
    top = (1 << RANGE_BITS[measuring_mode]) - 1
    beyond = top - BEYOND_MAXIMUM
    words: Array = np.rint(np.fmax(np.fmin(ranges / unit.metres, beyond), 0.0))
    words[np.isposinf(ranges)] = top - NO_ECHO
    words[np.isnan(ranges)] = top - DAZZLED
    return words.astype(np.uint16)
