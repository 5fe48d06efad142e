"""Host ports in real time: a line offered on a pty or a TCP port, a camera on a frame ring.

A pty carries the host's line rate, so a wrong one garbles as on a wire; TCP has none. A client
that goes away is a pulled cable: the twin goes on, and the next client may connect.
"""

import asyncio
import fcntl
import mmap
import os
import pty
import select
import socket
import struct
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from followerd.errors import OpenError, UsageError
from followerd.hw.camera.protocol import MAGIC, Frame, Ring, RingLayout, wake_path
from followerd.sim.line import OUT_QUEUE, Line
from followerd.sim.twins.camera import CameraTwin

RETRY = 0.01  # s, between looks at a port that cannot be waited for
FIRST_BAUD = 9600  # of a serial port that nobody has set
TCGETS2 = 0x802C542A  # asm-generic/ioctls.h; struct termios2 ends in c_ispeed, c_ospeed
TERMIOS2 = struct.Struct("=4IB19s2I")


@contextmanager
def on_pty(line: Line, path: Path) -> Iterator[None]:
    """Offer `line` as the serial port `path`, a symlink to a pty; raises UsageError."""
    port = PtyPort(line, path)
    line.ports.append(port)
    try:
        yield
    finally:
        line.ports.remove(port)
        port.unplug()


@contextmanager
def on_tcp(line: Line, port: int, host: str = "127.0.0.1") -> Iterator[int]:
    """Offer `line` on a TCP port (0 = any), one client at a time; yields it; raises OpenError."""
    try:
        listener = socket.create_server((host, port), backlog=4)
    except OSError as error:
        problem = f"cannot listen on {host}:{port}: {error.strerror}"
        raise OpenError(line.name, problem, "choose another port") from error
    with listener:
        served = TcpPort(line, listener)
        line.ports.append(served)
        try:
            yield int(listener.getsockname()[1])
        finally:
            line.ports.remove(served)
            served.close()


@contextmanager
def on_ring(camera: CameraTwin, path: Path) -> Iterator[None]:
    """Offer `camera` as the frame ring `path`; raises UsageError."""
    port = RingPort(camera.layout, path)
    camera.ports.append(port)
    try:
        yield
    finally:
        camera.ports.remove(port)
        port.unplug()


class _Feed:
    """Hands what a file descriptor receives to the line, no faster than the line takes it."""

    def __init__(
        self, fd: int, line: Line, baud: Callable[[], int | None], gone: Callable[[], None]
    ) -> None:
        self._fd = fd
        self._line = line
        self._baud = baud
        self._gone = gone
        self._loop = asyncio.get_running_loop()
        self._retry: asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Take bytes as they come."""
        self._loop.add_reader(self._fd, self._on_readable)

    def stop(self) -> None:
        """Take no more; idempotent, to be called before the descriptor is closed."""
        self._loop.remove_reader(self._fd)
        if self._retry is not None:
            self._retry.cancel()

    def _on_readable(self) -> None:
        room = OUT_QUEUE - int(self._line.backlog)
        if room <= 0:
            self.stop()
            self._retry = self._loop.call_later(RETRY, self.start)
            return
        try:
            data = os.read(self._fd, room)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        if data:
            self._line.transmit(data, self._baud())
        else:
            self.stop()
            self._gone()


def _offer(fd: int, data: bytes) -> None:
    """Write what the reader has room for; the rest is lost, as in a UART nobody empties."""
    with suppress(OSError):
        os.write(fd, data)


class PtyPort:
    """A serial port made of a pty."""

    missing: int = 1  # whoever has it open reads bytes as they come

    def __init__(self, line: Line, path: Path) -> None:
        self._line = line
        self._path = path
        self._loop = asyncio.get_running_loop()
        self._look: asyncio.TimerHandle | None = None
        self._master = -1
        self.replug()

    @property
    def baud(self) -> int:
        """The rate the host has set."""
        raw = fcntl.ioctl(self._master, TCGETS2, bytes(TERMIOS2.size))
        return int(TERMIOS2.unpack(raw)[-1])

    def deliver(self, data: bytes, stamp: float) -> None:
        """Bytes for the host; lost when nobody has the port open."""
        del stamp
        if not self._is_unused():
            _offer(self._master, data)

    def replug(self) -> None:
        """Make the pty and its name."""
        self._master, slave = pty.openpty()
        os.set_blocking(self._master, False)
        tty.setraw(slave)
        mode = termios.tcgetattr(slave)
        mode[4] = mode[5] = getattr(termios, f"B{FIRST_BAUD}")
        termios.tcsetattr(slave, termios.TCSANOW, mode)
        self._device = os.ttyname(slave)
        os.close(slave)
        self._name()
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN)
        self._feed = _Feed(self._master, self._line, lambda: self.baud, self._await_host)
        self._await_host()

    def unplug(self) -> None:
        """The port disappears, and whoever has it open sees a hang-up; idempotent."""
        if self._master < 0:
            return
        if self._look is not None:
            self._look.cancel()
        self._feed.stop()
        # the name first: whoever sees the hang-up looks for it at once
        if self._path.is_symlink() and str(self._path.readlink()) == self._device:
            self._path.unlink()
        os.close(self._master)
        self._master = -1

    def _name(self) -> None:
        if self._path.exists() and not self._path.is_symlink():
            raise UsageError(f"{self._path} is in the way: remove it, or choose another folder")
        self._path.parent.mkdir(parents=True, exist_ok=True)
        fresh = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        fresh.symlink_to(self._device)
        fresh.replace(self._path)

    def _is_unused(self) -> bool:
        """Nobody has it open; the descriptor then is always ready and cannot be waited for."""
        return any(events & select.POLLHUP for _, events in self._poll.poll(0))

    def _await_host(self) -> None:
        """Forget what the last host did not read, then look for the next."""
        with suppress(OSError):
            slave = os.open(self._device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            termios.tcflush(slave, termios.TCIFLUSH)
            os.close(slave)
        self._look_for_host()

    def _look_for_host(self) -> None:
        if self._is_unused():
            self._look = self._loop.call_later(RETRY, self._look_for_host)
        else:
            self._feed.start()


class TcpPort:
    """A TCP port with one client at a time; further ones are turned away."""

    baud: int | None = None
    missing: int = 1

    def __init__(self, line: Line, listener: socket.socket) -> None:
        self._line = line
        self._listener = listener
        self._client: socket.socket | None = None
        self._feed: _Feed | None = None
        self._loop = asyncio.get_running_loop()
        listener.setblocking(False)
        self._loop.add_reader(listener.fileno(), self._accept)

    def deliver(self, data: bytes, stamp: float) -> None:
        """Bytes for the client, if there is one."""
        del stamp
        if self._client is not None:
            _offer(self._client.fileno(), data)

    def unplug(self) -> None:
        """The client is hung up."""
        if self._client is not None and self._feed is not None:
            self._feed.stop()
            self._client.close()
            self._client = None

    def replug(self) -> None:
        """Clients may connect again."""

    def close(self) -> None:
        """No more clients."""
        self.unplug()
        self._loop.remove_reader(self._listener.fileno())

    def _accept(self) -> None:
        try:
            client, _ = self._listener.accept()
        except OSError:
            return
        if self._client is not None or not self._line.plugged:
            client.close()
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client = client
        self._feed = _Feed(client.fileno(), self._line, lambda: None, self.unplug)
        self._feed.start()


class RingPort:
    """A frame ring in a file, for a camera twin."""

    def __init__(self, layout: RingLayout, path: Path) -> None:
        self._layout = layout
        self._path = path
        self._wake = -1
        self.replug()

    def deliver(self, frame: Frame) -> None:
        """Make `frame` the newest and tell the reader."""
        self._ring.write(frame)
        with suppress(BlockingIOError):  # full: nobody reads
            os.write(self._wake, b"\0")

    def replug(self) -> None:
        """Make the ring and its FIFO."""
        if self._path.exists() and not _is_ring(self._path):
            raise UsageError(f"{self._path} is in the way: remove it, or choose another folder")
        self._path.parent.mkdir(parents=True, exist_ok=True)
        fifo = wake_path(self._path)
        fifo.unlink(missing_ok=True)
        os.mkfifo(fifo)
        self._wake = os.open(fifo, os.O_RDWR | os.O_NONBLOCK)  # both ends: never without a reader
        fresh = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        fresh.write_bytes(self._layout.header().ljust(self._layout.size, b"\0"))
        with fresh.open("r+b") as file:
            self._ring = Ring(self._layout, memoryview(mmap.mmap(file.fileno(), 0)))
        fresh.replace(self._path)

    def unplug(self) -> None:
        """The ring disappears, and its reader is told so; idempotent."""
        if self._wake >= 0:
            os.close(self._wake)
            self._wake = -1
            for path in (self._path, wake_path(self._path)):
                path.unlink(missing_ok=True)


def _is_ring(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC
