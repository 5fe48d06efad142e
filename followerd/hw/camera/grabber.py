"""Cameras that are read by blocking calls: each in a thread of its own, the newest frame wins."""

import asyncio
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Generic, Protocol, TypeVar

from followerd.errors import DeviceError, LinkLost
from followerd.hw.camera.protocol import Frame
from followerd.hw.inbox import Inbox

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Session:
    """What an open camera is told: whose it is, the time, and when to end."""

    device: str  # name in the config, for errors
    now: Callable[[], float]  # s, the loop's clock; from any thread
    stop: threading.Event


class Grabber(Protocol):
    """An open camera; but for `lock_exposure` all calls come from one thread."""

    def grab(self) -> Frame:
        """The next frame; waits a second at most. Raises LinkLost when there will be none."""

    def lock_exposure(self, locked: bool = True) -> None:
        """Hold exposure, gain and white balance as they are, or free them; returns at once."""

    def close(self) -> None:
        """Release the device."""


OpenGrabber = Callable[[Session], Grabber]


class GrabberSource:
    """A camera that `open_grabber` opens: it blocks, and raises OpenError or SetupError."""

    def __init__(self, name: str, open_grabber: OpenGrabber) -> None:
        self.name = name
        self.open_grabber = open_grabber
        self._last: GrabberStream | None = None

    async def open(self, device: str) -> "GrabberStream":
        """Open it, once the stream before has released the device."""
        loop = asyncio.get_running_loop()
        await self.released()
        session = Session(device, loop.time, threading.Event())
        try:
            grabber = await asyncio.to_thread(self._opened, session)
        except asyncio.CancelledError:
            session.stop.set()  # the thread is still opening it
            raise
        self._last = GrabberStream(self.name, session, grabber, loop)
        return self._last

    async def released(self) -> None:
        """Wait until the device of a stream that was closed or lost is free again."""
        if self._last is not None:
            await asyncio.to_thread(self._last.join)

    def _opened(self, session: Session) -> Grabber:
        grabber = self.open_grabber(session)
        if session.stop.is_set():
            grabber.close()
            raise LinkLost(session.device, "closed")
        return grabber


class GrabberStream:
    """The thread of an open camera."""

    def __init__(
        self, name: str, session: Session, grabber: Grabber, loop: asyncio.AbstractEventLoop
    ) -> None:
        self._name = name
        self._session = session
        self._grabber = grabber
        self._loop = loop
        self._inbox: Inbox[Frame] = Inbox(1)
        # no daemon thread: the program must not end before the device is released
        self._thread = threading.Thread(target=self._work, name=f"camera {name}")
        self._thread.start()

    async def read(self) -> Frame:
        """The newest frame; raises LinkLost when the camera is gone."""
        return await self._inbox.get()

    def lock_exposure(self, locked: bool = True) -> None:
        """See Grabber."""
        self._grabber.lock_exposure(locked)

    def close(self) -> None:
        """Close; idempotent. The thread releases the device when its frame has come."""
        self._session.stop.set()
        self._inbox.fail(LinkLost(self._session.device, "closed"))

    def join(self) -> None:
        """Wait until the device is released."""
        self._thread.join()

    def _work(self) -> None:
        device, stop = self._session.device, self._session.stop
        try:
            while not stop.is_set():
                self._in_loop(partial(self._inbox.put, self._grabber.grab()))
        except Exception as error:  # whatever ends the thread, its reader must learn of it
            self._in_loop(partial(self._inbox.fail, as_lost(error, device, self._name)))
        finally:
            self._grabber.close()

    def _in_loop(self, call: Callable[[], None]) -> None:
        try:
            self._loop.call_soon_threadsafe(call)
        except RuntimeError:  # the loop has ended without closing us
            self._session.stop.set()


def as_lost(error: Exception, device: str, name: str) -> LinkLost:
    """What ended the reading of a camera, as the driver reports it."""
    if isinstance(error, LinkLost):
        return error
    if isinstance(error, DeviceError):
        return LinkLost(device, f"{error.device}: {error.problem}", error.remedy)
    return LinkLost(device, f"{name}: {error}", "it is opened anew")


class Latest(Generic[T]):
    """A place for one item between two threads: the newest overwrites."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._item: T | None = None
        self._lost: LinkLost | None = None

    def put(self, item: T) -> None:
        """Overwrite what was not taken."""
        with self._changed:
            self._item = item
            self._changed.notify()

    def fail(self, lost: LinkLost) -> None:
        """Nothing more will come; the first report stays."""
        with self._changed:
            self._lost = self._lost or lost
            self._changed.notify()

    def take(self, timeout: float) -> T | None:
        """The item once it is there, None after `timeout` s; raises LinkLost."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is not None or self._lost, timeout)
            if self._lost is not None:
                raise self._lost
            item, self._item = self._item, None
            return item
