"""A live camera of the kernel (V4L2), read in a thread of its own; the newest frame wins."""

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from followerd.errors import LinkLost, OpenError
from followerd.hw.camera.protocol import Frame
from followerd.hw.inbox import Inbox

SILENT = 0  # OpenCV's log level

_logging: Any = getattr(cv2.utils, "logging", cv2)  # it moved there in OpenCV 5


def _set_log_level(level: int) -> int:
    """Set OpenCV's log level; the one before."""
    before = int(_logging.getLogLevel())
    _logging.setLogLevel(level)
    return before


class V4l2Source:
    """A video device by its path."""

    def __init__(self, path: str, width: int, height: int, rate: float) -> None:
        self.name = path
        self._width = width
        self._height = height
        self._rate = rate

    async def open(self, device: str) -> "V4l2Stream":
        """Open and configure; raises OpenError. The driver checks the size that comes."""
        capture = await asyncio.to_thread(self._capture)
        if not capture.isOpened():
            raise self._explained(device)
        return V4l2Stream(device, self.name, capture)

    def _capture(self) -> cv2.VideoCapture:
        level = _set_log_level(SILENT)  # a failed open is told by us, in one line
        try:
            capture = cv2.VideoCapture(self.name, cv2.CAP_V4L2)
        finally:
            _set_log_level(level)
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._height)
        capture.set(cv2.CAP_PROP_FPS, self._rate)
        return capture

    def _explained(self, device: str) -> OpenError:
        if not Path(self.name).exists():
            there = ", ".join(sorted(str(path) for path in Path("/dev").glob("video*")))
            remedy = f"there are: {there}" if there else "no camera is plugged in"
            return OpenError(device, f"{self.name} does not exist", remedy)
        remedy = "close the program that uses it, or join the group video"
        return OpenError(device, f"{self.name} cannot be opened", remedy)


class V4l2Stream:
    """An open video device."""

    def __init__(self, device: str, name: str, capture: cv2.VideoCapture) -> None:
        self._device = device
        self._name = name
        self._capture = capture
        self._inbox: Inbox[Frame] = Inbox(1)
        self._loop = asyncio.get_running_loop()
        self._closed = threading.Event()
        threading.Thread(target=self._grab, name=f"camera {name}", daemon=True).start()

    async def read(self) -> Frame:
        """The newest frame; raises LinkLost when the camera is gone."""
        return await self._inbox.get()

    def close(self) -> None:
        """Close; idempotent. The thread releases the device when its frame has come."""
        self._closed.set()
        self._inbox.fail(LinkLost(self._device, "closed"))

    def _grab(self) -> None:
        count = 0
        while not self._closed.is_set():
            good, pixels = self._capture.read()
            if not good:
                lost = LinkLost(self._device, f"{self._name} sends no frames", "check the plug")
                self._in_loop(partial(self._inbox.fail, lost))
                break
            frame = Frame(count, self._stamp(), np.asarray(pixels, np.uint8))
            self._in_loop(partial(self._inbox.put, frame))
            count += 1
        self._capture.release()

    def _in_loop(self, call: Callable[[], None]) -> None:
        with suppress(RuntimeError):  # the loop has ended meanwhile
            self._loop.call_soon_threadsafe(call)

    def _stamp(self) -> float:
        """The kernel's capture time where it is CLOCK_MONOTONIC, else now."""
        now = self._loop.time()
        kernel = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
        return kernel if 0.0 <= now - kernel < 1.0 else now
