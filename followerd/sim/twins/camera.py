"""The camera's twin: exposes at its rate, delivers each frame after the time that readout takes."""

import asyncio
from collections.abc import Callable
from math import ceil
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from followerd import clock
from followerd.errors import LinkLost, OpenError
from followerd.geometry import Camera
from followerd.hw.camera.protocol import Frame, RingLayout
from followerd.hw.camera.source import FrameSource
from followerd.hw.inbox import Inbox
from followerd.messages import Pixels
from followerd.sim.faults import LATE, SLOWER, Fault, FaultKind
from followerd.sim.interfaces import Scene

READOUT = 0.020  # s from the middle of the exposure to the frame in the host's memory

UNPLUGGED = (FaultKind.DISCONNECT,)
DARK = (FaultKind.OFF, FaultKind.REBOOT)
LATER = (FaultKind.SLOW, FaultKind.DELAY)


class FramePort(Protocol):
    """A host's end of the camera's cable."""

    def deliver(self, frame: Frame) -> None:
        """Take a frame that is complete."""

    def unplug(self) -> None:
        """The cable is pulled."""

    def replug(self) -> None:
        """The cable is back."""


Aim = Callable[[Camera, float], Camera]  # the camera as mounted, s -> as it then looks


def as_mounted(camera: Camera, now: float) -> Camera:
    """Nothing turns the camera."""
    del now
    return camera


Picture = tuple[Pixels, npt.NDArray[np.float32] | None]  # and depth (H, W) m, nan = nothing


class Sight(NamedTuple):
    """What a kind of camera sees of the world's now."""

    take: Callable[[Camera], Picture]
    channels: int = 3  # 3 BGR, 1 grey
    depth: bool = False


class CameraTwin:
    """Renders `scene` at `rate` (Hz) for every port; `link` is one in memory.

    Without a `sight` of its own it takes colour images.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        rate: float,
        rng: np.random.Generator,
        faults: tuple[Fault, ...] = (),
        aim: Aim = as_mounted,
        sight: Sight | None = None,
    ) -> None:
        self.ports: list[FramePort] = []
        self.plugged = True
        self.develop: Callable[[], None] = lambda: None  # completes the scene's pictures
        self.develops = True  # before it delivers; else whoever looks at a picture must
        self._scene = scene
        self._camera = camera
        self._aim = aim
        self._sight = sight or Sight(lambda camera: (scene.render(camera), None))
        self._period = 1.0 / rate
        self._rng = rng
        self._faults = list(faults)
        self._start = 0.0  # s, when `run` began
        self._is_cut = False  # by a fault
        self._next_id = 0
        self._delivered = -1
        self._last: Frame | None = None  # the newest before a fault
        self.link: FrameSource = MemoryCamera(self)

    @property
    def layout(self) -> RingLayout:
        """Shape of its frames."""
        size, sight = (self._camera.width, self._camera.height), self._sight
        return RingLayout(*size, channels=sight.channels, depth=sight.depth)

    async def run(self) -> None:
        """Expose for ever; an exposure whose time passed while another was rendered is skipped."""
        loop = asyncio.get_running_loop()
        start = self._start = clock.now()
        count = 0
        while True:
            await clock.sleep_until(start + count * self._period)
            now = clock.now()
            active = {f.kind for f in self._faults if f.active(now - start) and self._hits(f)}
            if self._is_cut is active.isdisjoint(UNPLUGGED):
                self._is_cut = not self._is_cut
                self._plug(not self._is_cut)
            if self.plugged and active.isdisjoint(DARK):
                self._expose(loop, now, count, active)
            count = max(count + 1, ceil((clock.now() - start) / self._period))

    @property
    def elapsed(self) -> float:
        """Seconds since `run` began; faults count from there."""
        return clock.now() - self._start

    def inject(self, fault: Fault) -> None:
        """One more fault, while it runs."""
        self._faults.append(fault)

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

    def _hits(self, fault: Fault) -> bool:
        return fault.hit == 1.0 or self._rng.random() < fault.hit

    def _expose(
        self, loop: asyncio.AbstractEventLoop, now: float, count: int, active: set[FaultKind]
    ) -> None:
        if FaultKind.SLOW in active and count % SLOWER:
            return
        self._scene.advance(now)
        pixels, depth = self._sight.take(self._aim(self._camera, now))
        if active:
            self.develop()
        if FaultKind.STUCK in active and self._last is not None:
            depth = self._last.depth
        frame = Frame(self._next_id, now, self._hurt(pixels, active), depth)
        self._next_id += 1
        if not active:
            self._last = frame
        if FaultKind.DROP not in active:
            late = 0.0 if active.isdisjoint(LATER) else LATE
            loop.call_at(now + READOUT + late, self._deliver, frame)
        if FaultKind.DUPLICATE in active:
            again = frame._replace(id=self._next_id)
            self._next_id += 1
            loop.call_at(now + READOUT + self._period / 2, self._deliver, again)

    def _hurt(self, pixels: Pixels, active: set[FaultKind]) -> Pixels:
        """What the host sees of a picture: line faults, in terms of pixels."""
        if FaultKind.STUCK in active and self._last is not None:
            pixels = self._last.pixels
        if FaultKind.GARBAGE in active:
            pixels = self._rng.integers(0, 256, pixels.shape, np.uint8)
        if FaultKind.WRONG in active:
            pixels = pixels[:, ::-1].copy()  # a plausible picture of something else
        if FaultKind.SPLIT in active and self._last is not None:
            cut = int(self._rng.integers(len(pixels)))
            pixels = np.concatenate((pixels[:cut], self._last.pixels[cut:]))
        if FaultKind.FLIP in active:
            place = tuple(int(self._rng.integers(size)) for size in pixels.shape)
            pixels = pixels.copy()
            pixels[place] ^= 1 << int(self._rng.integers(8))
        return pixels

    def _deliver(self, frame: Frame) -> None:
        if self.plugged and frame.id > self._delivered:  # a late one may have been overtaken
            self._delivered = frame.id
            if self.develops:
                self.develop()
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
