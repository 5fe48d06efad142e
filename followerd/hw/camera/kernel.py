"""What a video device needs of the kernel: the five calls that a test replaces."""

import ctypes
import fcntl
import mmap
import os
import select
from typing import Protocol


class VideoKernel(Protocol):
    """System calls on one video device; each raises OSError."""

    def open(self, path: str) -> int:
        """A descriptor that does not block."""

    def ioctl(self, fd: int, request: int, argument: ctypes.Structure) -> None:
        """Ask `request`; the answer overwrites `argument`."""

    def map(self, fd: int, length: int, offset: int) -> memoryview:
        """A buffer's memory."""

    def wait(self, fd: int, timeout: float) -> bool:
        """Whether a frame came, or the device failed, within `timeout` s."""

    def close(self, fd: int) -> None:
        """Close."""


class Kernel:
    """The running one."""

    def open(self, path: str) -> int:
        """See VideoKernel."""
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def ioctl(self, fd: int, request: int, argument: ctypes.Structure) -> None:
        """See VideoKernel."""
        fcntl.ioctl(fd, request, argument, True)

    def map(self, fd: int, length: int, offset: int) -> memoryview:
        """See VideoKernel."""
        return memoryview(mmap.mmap(fd, length, offset=offset))

    def wait(self, fd: int, timeout: float) -> bool:
        """See VideoKernel."""
        poll = select.poll()
        poll.register(fd, select.POLLIN)
        return bool(poll.poll(1000.0 * timeout))

    def close(self, fd: int) -> None:
        """See VideoKernel."""
        os.close(fd)
