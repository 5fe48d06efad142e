"""The camera's twin: exposes at its rate, delivers each frame after the time that readout takes."""

import asyncio
from math import ceil
from typing import Protocol

import numpy as np

from followerd import clock
from followerd.errors import LinkLost, OpenError, UsageError
from followerd.geometry import Camera
from followerd.hw.camera.protocol import Frame, RingLayout
from followerd.hw.camera.source import FrameSource
from followerd.hw.inbox import Inbox
from followerd.sim.faults import HIT, LATE, SLOWER, Fault, FaultKind
from followerd.sim.interfaces import Scene

READOUT = 0.020  # s from the middle of the exposure to the frame in the host's memory

UNPLUGGED = (FaultKind.DISCONNECT,)
DARK = (FaultKind.OFF, FaultKind.REBOOT)
FRAME_FAULTS = (
    *UNPLUGGED,
    *DARK,
    FaultKind.STUCK,
    FaultKind.GARBAGE,
    FaultKind.SLOW,
    FaultKind.DROP,
    FaultKind.DELAY,
)


class FramePort(Protocol):
    """A host's end of the camera's cable."""

    def deliver(self, frame: Frame) -> None:
        """Take a frame that is complete."""

    def unplug(self) -> None:
        """The cable is pulled."""

    def replug(self) -> None:
        """The cable is back."""


class CameraTwin:
    """Renders `scene` at `rate` (Hz) for every port; `link` is one in memory."""

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        rate: float,
        rng: np.random.Generator,
        faults: tuple[Fault, ...] = (),
    ) -> None:
        for fault in faults:
            if fault.kind not in FRAME_FAULTS:
                known = ", ".join(kind.value for kind in FRAME_FAULTS)
                raise UsageError(f"a camera has no fault {fault.kind.value!r}; it has {known}")
        self.ports: list[FramePort] = []
        self.plugged = True
        self._scene = scene
        self._camera = camera
        self._period = 1.0 / rate
        self._rng = rng
        self._faults = faults
        self._is_cut = False  # by a fault
        self._next_id = 0
        self._delivered = -1
        self._last: Frame | None = None  # the newest before a fault
        self.link: FrameSource = MemoryCamera(self)

    @property
    def layout(self) -> RingLayout:
        """Shape of its frames."""
        return RingLayout(self._camera.width, self._camera.height)

    async def run(self) -> None:
        """Expose for ever; an exposure whose time passed while another was rendered is skipped."""
        loop = asyncio.get_running_loop()
        start, count = clock.now(), 0
        while True:
            await clock.sleep_until(start + count * self._period)
            now = clock.now()
            active = {fault.kind for fault in self._faults if fault.active(now - start)}
            if self._is_cut is active.isdisjoint(UNPLUGGED):
                self._is_cut = not self._is_cut
                self._plug(not self._is_cut)
            if self.plugged and active.isdisjoint(DARK):
                self._expose(loop, now, count, active)
            count = max(count + 1, ceil((clock.now() - start) / self._period))

    def unplug(self) -> None:
        """Pull the cable: the host notices at once."""
        self._plug(False)

    def replug(self) -> None:
        """Put the cable back; the host may open the camera again."""
        self._plug(True)

    def _plug(self, plugged: bool) -> None:
        if plugged != self.plugged:
            self.plugged = plugged
            for port in list(self.ports):
                if plugged:
                    port.replug()
                else:
                    port.unplug()

    def _expose(
        self, loop: asyncio.AbstractEventLoop, now: float, count: int, active: set[FaultKind]
    ) -> None:
        if FaultKind.SLOW in active and count % SLOWER:
            return
        self._scene.advance(now)
        frame = Frame(self._next_id, now, self._scene.render(self._camera))
        self._next_id += 1
        if FaultKind.STUCK in active and self._last is not None:
            frame = frame._replace(pixels=self._last.pixels)
        if FaultKind.GARBAGE in active:
            noise = self._rng.integers(0, 256, frame.pixels.shape, np.uint8)
            frame = frame._replace(pixels=noise)
        if not active:
            self._last = frame
        if FaultKind.DROP not in active or self._rng.random() >= HIT:
            late = 0.0 if active.isdisjoint({FaultKind.SLOW, FaultKind.DELAY}) else LATE
            loop.call_at(now + READOUT + late, self._deliver, frame)

    def _deliver(self, frame: Frame) -> None:
        if self.plugged and frame.id > self._delivered:  # a late one may have been overtaken
            self._delivered = frame.id
            for port in list(self.ports):
                port.deliver(frame)


class MemoryCamera:
    """A camera twin in the same process, as a frame source."""

    name = "sim:camera"

    def __init__(self, twin: CameraTwin) -> None:
        self._twin = twin

    async def open(self, device: str) -> "MemoryFrames":
        """Open it; raises OpenError while it is unplugged."""
        if not self._twin.plugged:
            raise OpenError(device, f"{self.name} does not exist", "plug the cable in")
        frames = MemoryFrames(device, self._twin)
        self._twin.ports.append(frames)
        return frames


class MemoryFrames:
    """The open host end, in memory."""

    def __init__(self, device: str, twin: CameraTwin) -> None:
        self._device = device
        self._twin = twin
        self._inbox: Inbox[Frame] = Inbox(1)

    async def read(self) -> Frame:
        """The newest frame; raises LinkLost when unplugged or closed."""
        return await self._inbox.get()

    def close(self) -> None:
        """Close; idempotent."""
        self._end("closed")

    def deliver(self, frame: Frame) -> None:
        """Take a frame that is complete."""
        self._inbox.put(frame)

    def unplug(self) -> None:
        """The cable is pulled."""
        self._end("unplugged")

    def replug(self) -> None:
        """An unplugged stream stays lost; the source must be opened anew."""

    def _end(self, problem: str) -> None:
        self._inbox.fail(LinkLost(self._device, problem))
        if self in self._twin.ports:
            self._twin.ports.remove(self)
