"""Faults of a twin's line: what happens to the bytes that leave a device, for a while.

The names follow PX4's failure injection (see FAILSAFES). These are the byte-level ones: a fault
knows bursts (what a twin sends at one moment, usually one telegram) but not their meaning, so
`wrong` cannot mend a checksum and `reboot` cannot forget the device's settings.
"""

import re
from dataclasses import dataclass
from enum import Enum

import numpy as np

from followerd.errors import UsageError

HIT = 0.2  # share of bursts hurt by drop, flip, duplicate and wrong
LATE = 0.3  # s, how much later `delay` and `slow` deliver
SLOWER = 4  # `slow` lets one burst of this many through
PAUSE = 0.03  # s, longest gap between the pieces of `split`

Pieces = list[tuple[float, bytes]]  # (s, when it may leave; bytes)


class FaultKind(Enum):
    """What goes wrong."""

    OFF = "off"  # no power: silent and deaf
    STUCK = "stuck"  # says the same for ever
    GARBAGE = "garbage"  # random bytes
    WRONG = "wrong"  # some bytes changed
    SLOW = "slow"  # few bursts, and late
    DROP = "drop"  # some bytes missing
    FLIP = "flip"  # one bit turned
    DUPLICATE = "duplicate"  # a burst twice
    SPLIT = "split"  # a burst in pieces, with pauses
    DELAY = "delay"  # everything late
    DISCONNECT = "disconnect"  # cable pulled
    REBOOT = "reboot"  # silent and deaf while it starts


CUTS_CABLE = FaultKind.DISCONNECT
DEAF = (FaultKind.OFF, FaultKind.REBOOT)


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of one device, over a time window counted from the start of its line."""

    device: str
    kind: FaultKind
    start: float  # s
    length: float  # s

    @classmethod
    def parse(cls, text: str) -> "Fault":
        """From `DEVICE:NAME@START+LENGTH` (s); raises UsageError."""
        match = re.fullmatch(r"([a-z_]+):([a-z]+)@(\d+(?:\.\d+)?)\+(\d+(?:\.\d+)?)", text)
        if match is None:
            raise UsageError(
                f"fault {text!r}: expected DEVICE:NAME@START+LENGTH in seconds, e.g. laser:off@10+5"
            )
        device, name, start, length = match.groups()
        known = [kind.value for kind in FaultKind]
        if name not in known:
            raise UsageError(f"fault {text!r}: no fault {name!r}; there are {', '.join(known)}")
        return cls(device, FaultKind(name), float(start), float(length))

    @property
    def end(self) -> float:
        """When it is over, s."""
        return self.start + self.length

    def active(self, elapsed: float) -> bool:
        """Whether it holds `elapsed` seconds after the start."""
        return self.start <= elapsed < self.end


class Damage:
    """Does `faults` to the bursts of one device; pure but for its generator and memory."""

    def __init__(self, faults: tuple[Fault, ...], rng: np.random.Generator) -> None:
        self._faults = faults
        self._rng = rng
        self._last = b""  # the newest burst before a fault began
        self._count = 0

    def is_deaf(self, elapsed: float) -> bool:
        """Whether the device hears nothing now."""
        return any(f.kind in DEAF and f.active(elapsed) for f in self._faults)

    def is_cut(self, elapsed: float) -> bool:
        """Whether the cable is out now."""
        return any(f.kind is CUTS_CABLE and f.active(elapsed) for f in self._faults)

    def cable_changes(self) -> list[float]:
        """When the cable is pulled or put back, s."""
        cuts = [f for f in self._faults if f.kind is CUTS_CABLE]
        return sorted({time for f in cuts for time in (f.start, f.end)})

    def apply(self, burst: bytes, elapsed: float) -> Pieces:
        """What leaves instead of `burst`, in order; times count like `elapsed`."""
        pieces = [(elapsed, burst)]
        active = [f.kind for f in self._faults if f.active(elapsed)]
        if not active:
            self._last = burst
        self._count += 1
        for kind in active:
            pieces = [hurt for piece in pieces for hurt in self._hurt(kind, *piece)]
        return pieces

    def _hurt(self, kind: FaultKind, time: float, data: bytes) -> Pieces:
        match kind:
            case FaultKind.OFF | FaultKind.REBOOT | FaultKind.DISCONNECT:
                return []
            case FaultKind.STUCK:
                return [(time, self._last)] if self._last else []
            case FaultKind.GARBAGE:
                return [(time, self._rng.bytes(len(data)))]
            case FaultKind.SLOW:
                return [(time + LATE, data)] if self._count % SLOWER == 0 else []
            case FaultKind.DELAY:
                return [(time + LATE, data)]
            case FaultKind.SPLIT:
                return self._split(time, data)
            case _:
                return [(time, piece) for piece in self._sometimes(kind, data)]

    def _sometimes(self, kind: FaultKind, data: bytes) -> list[bytes]:
        if not data or self._rng.random() >= HIT:
            return [data]
        first = int(self._rng.integers(len(data)))
        if kind is FaultKind.DUPLICATE:
            return [data, data]
        if kind is FaultKind.DROP:
            return [data[:first] + data[int(self._rng.integers(first, len(data))) + 1 :]]
        hurt = bytearray(data)
        if kind is FaultKind.FLIP:
            hurt[first] ^= 1 << int(self._rng.integers(8))
        else:
            hurt[first] = (hurt[first] + int(self._rng.integers(1, 256))) % 256
        return [bytes(hurt)]

    def _split(self, time: float, data: bytes) -> Pieces:
        cuts = sorted(int(c) for c in self._rng.integers(0, len(data) + 1, 2))
        pauses = np.cumsum(self._rng.uniform(0.0, PAUSE, 2))
        pieces = (data[: cuts[0]], data[cuts[0] : cuts[1]], data[cuts[1] :])
        times = (time, time + float(pauses[0]), time + float(pauses[1]))
        return [(t, piece) for t, piece in zip(times, pieces, strict=True) if piece]
