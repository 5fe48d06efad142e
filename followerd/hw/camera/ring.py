"""Reader's side of a frame ring in a file, with a FIFO beside it that tells of new frames."""

import asyncio
import mmap
import os
from contextlib import suppress
from pathlib import Path

from followerd.errors import LinkLost, OpenError
from followerd.hw.camera.protocol import ALIGN, Frame, Ring, RingLayout, wake_path
from followerd.hw.inbox import Inbox


class RingSource:
    """A frame ring by its path."""

    def __init__(self, path: str) -> None:
        self.name = path

    async def open(self, device: str) -> "RingStream":
        """Map the ring; raises OpenError when it is missing, no ring, or nobody writes to it."""
        path = Path(self.name)
        try:
            ring = _mapped(path)
            wake = os.open(wake_path(path), os.O_RDONLY | os.O_NONBLOCK)
        except FileNotFoundError as error:
            remedy = "start the simulation that serves it, or choose another camera link"
            raise OpenError(device, f"{error.filename} does not exist", remedy) from error
        except (OSError, ValueError) as error:
            raise OpenError(device, f"{self.name}: {error}", "choose another link") from error
        if not _has_writer(wake):
            os.close(wake)
            raise OpenError(device, f"nobody writes to {self.name}", "start the simulation again")
        return RingStream(device, self.name, ring, wake)


class RingStream:
    """An open ring."""

    def __init__(self, device: str, name: str, ring: Ring, wake: int) -> None:
        self._device = device
        self._name = name
        self._ring = ring
        self._wake = wake
        self._last = -1
        self._inbox: Inbox[Frame] = Inbox(1)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(wake, self._on_wake)

    async def read(self) -> Frame:
        """The newest frame; raises LinkLost when the writer is gone."""
        return await self._inbox.get()

    def close(self) -> None:
        """Close; idempotent."""
        self._lose("closed", "")

    def _on_wake(self) -> None:
        try:
            told = os.read(self._wake, 4096)
        except BlockingIOError:
            return
        if not told:
            self._lose(f"the writer of {self._name} is gone", "start the simulation again")
        elif (frame := self._ring.newest(self._last)) is not None:
            self._last = frame.id
            self._inbox.put(frame)

    def _lose(self, problem: str, remedy: str) -> None:
        if self._wake >= 0:
            self._loop.remove_reader(self._wake)
            os.close(self._wake)
            self._wake = -1
        self._inbox.fail(LinkLost(self._device, problem, remedy))


def _mapped(path: Path) -> Ring:
    with path.open("rb") as file:
        layout = RingLayout.from_header(file.read(ALIGN))
        return Ring(layout, memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)))


def _has_writer(fifo: int) -> bool:
    """Whether somebody holds the writing end of a FIFO; forgets what stands in it."""
    with suppress(BlockingIOError):
        while os.read(fifo, 4096):
            pass
        return False
    return True
