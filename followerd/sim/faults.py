"""Faults of a twin's line: what happens to the bytes that leave a device, for a while.

The names follow PX4's failure injection (see FAILSAFES). A fault knows bursts (what a twin sends
at one moment, usually one telegram) but not their meaning: who builds the line passes the function
that mends a burst's checksums, so that `wrong` reaches the checks behind them.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from followerd.errors import UsageError

DEVICES = ("robot", "laser", "camera", "ptz")
ALIASES = {"base": "robot"}  # as the config calls it
LATE = 0.3  # s, how much later `delay` and `slow` deliver
SLOWER = 4  # `slow` lets one burst of this many through
PAUSE = 0.03  # s, longest gap between the pieces of `split`
RUN = 16  # bytes, longest run that `wrong` changes

Mend = Callable[[bytes], bytes]  # the burst with its telegrams' checksums made right
Pieces = list[tuple[float, bytes]]  # (s, when it may leave; bytes)


class FaultKind(Enum):
    """What goes wrong."""

    OFF = "off"  # silent and deaf, and then goes on as if nothing had been
    STUCK = "stuck"  # says the same for ever
    GARBAGE = "garbage"  # random bytes
    WRONG = "wrong"  # says something else, with valid checksums
    SLOW = "slow"  # few bursts, and late
    DROP = "drop"  # some bytes missing
    FLIP = "flip"  # one bit turned
    DUPLICATE = "duplicate"  # a burst twice
    SPLIT = "split"  # a burst in pieces, with pauses
    DELAY = "delay"  # everything late
    DISCONNECT = "disconnect"  # cable pulled
    REBOOT = "reboot"  # no power, and then it starts anew


DEAF = (FaultKind.OFF, FaultKind.REBOOT)
PULLS = (FaultKind.DISCONNECT, FaultKind.REBOOT)
SOMETIMES = dict.fromkeys(
    (FaultKind.WRONG, FaultKind.DROP, FaultKind.FLIP, FaultKind.DUPLICATE), 0.2
)  # share of bursts that are hurt; all others hurt every one
PATTERN = re.compile(
    r"(?P<device>[a-z_]+):(?P<name>[a-z]+)"
    r"(?:@(?P<start>\d+(?:\.\d+)?)s?)?\+(?P<length>\d+(?:\.\d+)?)s?"
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of one device, over a time window counted from the start of its line."""

    device: str
    kind: FaultKind
    start: float  # s
    length: float  # s
    share: float | None = None  # of bursts that are hurt; None = what is usual

    @classmethod
    def parse(cls, text: str, now: float | None = None) -> "Fault":
        """From `DEVICE:NAME@STARTs+LENGTHs`; raises UsageError.

        Without a start it begins `now`, where there is one.
        """
        match = PATTERN.fullmatch(text)
        if match is None or (match["start"] is None and now is None):
            raise UsageError(
                f"fault {text!r}: expected DEVICE:NAME@STARTs+LENGTHs, e.g. laser:off@10s+5s"
                + ("" if now is None else ", or laser:off+5s for now")
            )
        kinds = [kind.value for kind in FaultKind]
        if match["name"] not in kinds:
            known = ", ".join(kinds)
            raise UsageError(f"fault {text!r}: no fault {match['name']!r}; there are {known}")
        device = ALIASES.get(match["device"], match["device"])
        if device not in DEVICES:
            known = ", ".join(DEVICES)
            raise UsageError(f"fault {text!r}: no device {device!r}; there are {known}")
        start = now if match["start"] is None else float(match["start"])
        return cls(device, FaultKind(match["name"]), start or 0.0, float(match["length"]))

    @property
    def end(self) -> float:
        """When it is over, s."""
        return self.start + self.length

    def active(self, elapsed: float) -> bool:
        """Whether it holds `elapsed` seconds after the start."""
        return self.start <= elapsed < self.end

    @property
    def events(self) -> list[tuple[float, FaultKind]]:
        """When (s) it pulls and puts back the cable or the power."""
        return [(time, self.kind) for time in (self.start, self.end) if self.kind in PULLS]

    @property
    def hit(self) -> float:
        """Share of bursts that are hurt."""
        return SOMETIMES.get(self.kind, 1.0) if self.share is None else self.share


class Damage:
    """Does `faults` to the bursts of one device; pure but for its generator and memory."""

    def __init__(
        self, faults: tuple[Fault, ...], rng: np.random.Generator, mend: Mend = bytes
    ) -> None:
        self._faults = list(faults)
        self._rng = rng
        self._mend = mend
        self._last = b""  # the newest burst before a fault began
        self._count = 0

    def add(self, fault: Fault) -> None:
        """One more fault."""
        self._faults.append(fault)

    def is_deaf(self, elapsed: float) -> bool:
        """Whether the device hears nothing now."""
        return any(f.kind in DEAF and f.active(elapsed) for f in self._faults)

    def is_cut(self, elapsed: float) -> bool:
        """Whether the cable is out now."""
        return any(f.kind is FaultKind.DISCONNECT and f.active(elapsed) for f in self._faults)

    def apply(self, burst: bytes, elapsed: float) -> Pieces:
        """What leaves instead of `burst`, in order; times count like `elapsed`."""
        pieces = [(elapsed, burst)]
        active = [f for f in self._faults if f.active(elapsed)]
        if not active:
            self._last = burst
        self._count += 1
        for fault in active:
            if fault.hit == 1.0 or self._rng.random() < fault.hit:
                pieces = [hurt for piece in pieces for hurt in self._hurt(fault.kind, *piece)]
        return pieces

    def _hurt(self, kind: FaultKind, time: float, data: bytes) -> Pieces:
        if not data:  # another fault took all
            return []
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
            case FaultKind.DUPLICATE:
                return [(time, data), (time, data)]
            case FaultKind.DROP:
                return [(time, self._shortened(data))]
            case FaultKind.FLIP:
                return [(time, self._flipped(data))]
            case FaultKind.WRONG:
                return [(time, self._mend(self._changed(data)))]

    def _shortened(self, data: bytes) -> bytes:
        first = int(self._rng.integers(len(data)))
        return data[:first] + data[int(self._rng.integers(first, len(data))) + 1 :]

    def _flipped(self, data: bytes) -> bytes:
        bit = int(self._rng.integers(8 * len(data)))
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        return bytes(flipped)

    def _changed(self, data: bytes) -> bytes:
        """With a run of bytes that are anything, zero, or all ones."""
        first = int(self._rng.integers(len(data)))
        count = min(int(self._rng.integers(1, RUN + 1)), len(data) - first)
        instead = (self._rng.bytes(count), bytes(count), b"\xff" * count)
        return data[:first] + instead[int(self._rng.integers(3))] + data[first + count :]

    def _split(self, time: float, data: bytes) -> Pieces:
        cuts = sorted(int(c) for c in self._rng.integers(0, len(data) + 1, 2))
        pauses = np.cumsum(self._rng.uniform(0.0, PAUSE, 2))
        pieces = (data[: cuts[0]], data[cuts[0] : cuts[1]], data[cuts[1] :])
        times = (time, time + float(pauses[0]), time + float(pauses[1]))
        return [(t, piece) for t, piece in zip(times, pieces, strict=True) if piece]
