"""The frame ring: camera frames handed from one process to another through shared memory.

One writer, any number of readers, nobody waits. A ring is a header and `slots` slots; frame n
goes to slot n mod `slots`. A slot's `sequence` is 2 n + 1 while frame n is written and 2 n + 2
when it is whole (a sequence lock); then the header's `written` becomes n + 1. A reader copies
the newest frame and keeps the copy only if `sequence` was the same before and after. This relies
on stores being seen in order (x86; between interpreter steps elsewhere).

Stamps are CLOCK_MONOTONIC seconds, comparable between the processes of one computer.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

MAGIC = b"FLWDRING"
VERSION = 1
SLOTS = 4  # at least 3: one read, one newest, one being written
ALIGN = 64  # bytes, a cache line
TRIES = 3  # of a reader that the writer overtakes

HEADER = np.dtype(
    [
        ("magic", "S8"),
        ("version", "<u4"),
        ("slots", "<u4"),
        ("width", "<u4"),
        ("height", "<u4"),
        ("channels", "<u4"),
        ("depth", "<u4"),
        ("written", "<u8"),
    ]
)
SLOT = np.dtype([("sequence", "<u8"), ("id", "<u8"), ("stamp", "<f8")])


class Frame(NamedTuple):
    """What a camera delivers."""

    id: int  # counts the camera's frames from 0
    stamp: float  # s, middle of the exposure
    pixels: npt.NDArray[np.uint8]  # (H, W, 3) BGR or (H, W)
    depth: npt.NDArray[np.float32] | None = None  # (H, W) m, nan = unknown
    jpeg: bytes | None = None  # what `pixels` were decoded from, where the camera sends MJPG


@dataclass(frozen=True, slots=True)
class RingLayout:
    """Shape of a ring's frames, and where everything lies."""

    width: int  # px
    height: int  # px
    channels: int = 3  # 3 BGR, 1 grey
    depth: bool = False
    slots: int = SLOTS

    @property
    def pixel_bytes(self) -> int:
        """Size of a frame's pixels."""
        return self.width * self.height * self.channels

    @property
    def slot_bytes(self) -> int:
        """Size of a slot."""
        depth = self.width * self.height * 4 if self.depth else 0
        return ALIGN + _aligned(self.pixel_bytes) + _aligned(depth)

    @property
    def size(self) -> int:
        """Size of the whole ring, bytes."""
        return ALIGN + self.slots * self.slot_bytes

    def header(self) -> bytes:
        """The header of an empty ring."""
        fields = (self.slots, self.width, self.height, self.channels, int(self.depth))
        return np.array([(MAGIC, VERSION, *fields, 0)], HEADER).tobytes()

    @classmethod
    def from_header(cls, raw: bytes) -> "RingLayout":
        """From a ring's first bytes; raises ValueError when they are no ring of this version."""
        if len(raw) < HEADER.itemsize or not raw.startswith(MAGIC):
            raise ValueError("no frame ring")
        header = np.frombuffer(raw, HEADER, 1)[0]
        if header["version"] != VERSION:
            raise ValueError(f"frame ring of version {header['version']}, expected {VERSION}")
        layout = cls(
            int(header["width"]),
            int(header["height"]),
            int(header["channels"]),
            bool(header["depth"]),
            int(header["slots"]),
        )
        if layout.channels not in (1, 3) or layout.slots < 3 or not layout.pixel_bytes:
            raise ValueError(f"frame ring with impossible {layout}")
        return layout


class Ring:
    """A ring's frames in memory that other processes may see too."""

    def __init__(self, layout: RingLayout, memory: memoryview) -> None:
        if len(memory) < layout.size:
            raise ValueError(f"frame ring of {len(memory)} bytes, its header says {layout.size}")
        self.layout = layout
        self._header = np.frombuffer(memory, HEADER, 1)
        shape = (layout.height, layout.width)
        colour = shape if layout.channels == 1 else (*shape, layout.channels)
        self._slots: list[tuple[npt.NDArray[np.void], npt.NDArray[np.uint8]]] = []
        self._depths: list[npt.NDArray[np.float32]] = []
        for n in range(layout.slots):
            start = ALIGN + n * layout.slot_bytes
            pixels: npt.NDArray[np.uint8] = np.ndarray(colour, np.uint8, memory, start + ALIGN)
            self._slots.append((np.frombuffer(memory, SLOT, 1, start), pixels))
            if layout.depth:
                at = start + ALIGN + _aligned(layout.pixel_bytes)
                self._depths.append(np.ndarray(shape, np.float32, memory, at))

    def write(self, frame: Frame) -> None:
        """Make `frame` the newest; ids must rise. Raises ValueError for another shape."""
        index = frame.id % self.layout.slots
        slot, pixels = self._slots[index]
        if frame.pixels.shape != pixels.shape or (frame.depth is not None) != self.layout.depth:
            raise ValueError(f"frame of shape {frame.pixels.shape} into {self.layout}")
        slot["sequence"] = 2 * frame.id + 1
        slot["id"], slot["stamp"] = frame.id, frame.stamp
        pixels[...] = frame.pixels
        if frame.depth is not None:
            self._depths[index][...] = frame.depth
        slot["sequence"] = 2 * frame.id + 2
        self._header["written"] = frame.id + 1

    def newest(self, after: int = -1) -> Frame | None:
        """A copy of the newest whole frame, None when there is none with an id above `after`."""
        for _ in range(TRIES):
            written = int(self._header["written"][0])
            if written <= after + 1:
                return None
            index = (written - 1) % self.layout.slots
            slot, pixels = self._slots[index]
            sequence = int(slot["sequence"][0])
            depth = self._depths[index].copy() if self.layout.depth else None
            frame = Frame(written - 1, float(slot["stamp"][0]), pixels.copy(), depth)
            if sequence == 2 * written == int(slot["sequence"][0]):
                return frame
        return None


def wake_path(ring: Path) -> Path:
    """The FIFO of a ring: the writer puts a byte in for every frame, and holds it open."""
    return ring.with_name(ring.name + ".wake")


def _aligned(size: int) -> int:
    return -(-size // ALIGN) * ALIGN
