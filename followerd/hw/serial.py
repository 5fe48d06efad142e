"""Links to real ports: serial devices, ptys, TCP sockets. Foreign exceptions are mapped here only.

pyserial opens and configures; reading and writing is a thin non-blocking transport on the port's
file descriptor, because pyserial hides a hang-up and its asyncio companions add latency.
"""

import asyncio
import fcntl
import os
import socket
import termios
from contextlib import suppress
from typing import Protocol
from urllib.parse import urlsplit

import serial

from followerd import clock
from followerd.errors import ConfigError, LinkLost, OpenError, SetupError
from followerd.hw.inbox import CHUNKS, ByteInbox
from followerd.hw.port_errors import explained
from followerd.hw.stream import Link, Received

READ_SIZE = 4096  # bytes
OUT_QUEUE = 4096  # bytes that wait for a port before it counts as stuck
CONNECT_TIME = 3.0  # s
PTY_MAJORS = range(136, 144)  # Linux, admin-guide/devices.txt
FOREIGN = (OSError, ValueError, termios.error, serial.SerialException)


def open_link(text: str) -> Link:
    """The link `/dev/ttyUSB0` (any path of a tty) or `socket://HOST:PORT`; raises ConfigError."""
    if "://" not in text:
        return TtyLink(text)
    try:
        parts = urlsplit(text)
        scheme, host, port = parts.scheme, parts.hostname, parts.port
    except ValueError:
        scheme, host, port = "", None, None
    if scheme != "socket" or host is None or port is None:
        raise ConfigError(f"link {text!r}: expected /dev/NAME or socket://HOST:PORT")
    return SocketLink(host, port)


class Port(Protocol):
    """What the transport needs of an open port."""

    def fileno(self) -> int:
        """The non-blocking file descriptor."""

    def set_baud(self, baud: int) -> None:
        """Change the line rate."""

    def close(self) -> None:
        """Close."""


class PortStream:
    """A ByteStream over a port's file descriptor."""

    def __init__(self, device: str, name: str, port: Port) -> None:
        self._device = device
        self._name = name
        self._port = port
        self._inbox = ByteInbox(CHUNKS)
        self._queue = bytearray()
        self._taken = asyncio.Event()  # the queue is empty, or the port lost
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(port.fileno(), self._on_readable)
        self._open = True

    def fileno(self) -> int:
        """The port's file descriptor."""
        return self._port.fileno()

    @property
    def queued(self) -> int:
        """Bytes written that the port has not taken yet."""
        return len(self._queue)

    async def read(self, at_least: int = 1) -> Received:
        """The next bytes that came, stamped on arrival; raises LinkLost."""
        return await self._inbox.take(at_least)

    def write(self, data: bytes) -> None:
        """Hand over what the port takes, queue the rest; raises LinkLost."""
        self._inbox.check()
        if not self._queue:
            data = data[self._send(data) :]
            self._inbox.check()
            if data:
                self._taken.clear()
                self._loop.add_writer(self._port.fileno(), self._on_writable)
        self._queue += data
        if len(self._queue) > OUT_QUEUE:
            self._lose("takes no more bytes")
            self._inbox.check()

    async def drain(self) -> None:
        """Wait until the port has taken everything; raises LinkLost."""
        while self._queue:
            self._inbox.check()
            await self._taken.wait()
        self._inbox.check()

    def set_baud(self, baud: int) -> None:
        """Change the line rate once what the port holds has left (ms, at set-up only)."""
        self._inbox.check()
        try:
            self._port.set_baud(baud)
        except FOREIGN as error:
            raise SetupError(
                self._device, f"{self._name} cannot do {baud} baud ({error})", "use another adapter"
            ) from error

    def discard_input(self) -> None:
        """Forget what came but was not read."""
        self._inbox.clear()

    def close(self) -> None:
        """Close; idempotent."""
        if self._open:
            self._lose("closed")
            self._open = False
            with suppress(*FOREIGN):
                self._port.close()

    def _on_readable(self) -> None:
        try:
            data = os.read(self._port.fileno(), READ_SIZE)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._lose(error.strerror or "failed")
            return
        if data:
            self._inbox.put(Received(data, clock.now()))
        else:
            self._lose("hung up")

    def _on_writable(self) -> None:
        del self._queue[: self._send(bytes(self._queue))]
        if not self._queue:
            self._stop_writing()

    def _send(self, data: bytes) -> int:
        try:
            return os.write(self._port.fileno(), data)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError as error:
            self._lose(error.strerror or "failed")
            return 0

    def _lose(self, problem: str) -> None:
        """Stop listening at once: a descriptor that hung up stays ready and would spin."""
        if self._open:
            self._loop.remove_reader(self._port.fileno())
        self._queue.clear()
        self._stop_writing()
        remedy = "" if problem == "closed" else "check plug and power"
        self._inbox.fail(LinkLost(self._device, f"{self._name} {problem}", remedy))

    def _stop_writing(self) -> None:
        if self._open:
            self._loop.remove_writer(self._port.fileno())
        self._taken.set()


class TtyLink:
    """A serial device or pty, by path; symlinks are followed."""

    def __init__(self, path: str) -> None:
        self.name = path

    async def open(self, device: str, baud: int) -> PortStream:
        """Open exclusively, 8N1, low latency where there is such a mode; raises OpenError.

        DTR, which powers a Pioneer's laser, comes up with the first opening and then stays.
        """
        try:
            port = _Tty(self.name, baud)
        except FOREIGN as error:
            raise explained(device, self.name, error) from error
        return PortStream(device, self.name, port)


class _Tty:
    def __init__(self, path: str, baud: int) -> None:
        self._serial = serial.Serial(
            path,
            baud,
            timeout=0,
            write_timeout=0,
            inter_byte_timeout=0,  # VMIN 1: an empty read is a hang-up, never just no bytes
            exclusive=True,  # flock, which keeps other users of pyserial out
        )
        with suppress(*FOREIGN):
            _keep_dtr(self.fileno())
        with suppress(*FOREIGN):
            _keep_others_out(self.fileno())
        with suppress(*FOREIGN, NotImplementedError):
            self._serial.set_low_latency_mode(True)

    def fileno(self) -> int:
        return int(self._serial.fileno())

    def set_baud(self, baud: int) -> None:
        termios.tcdrain(self.fileno())
        self._serial.baudrate = baud

    def close(self) -> None:
        with suppress(*FOREIGN):
            _let_others_in(self.fileno())
        self._serial.close()


def _keep_dtr(fd: int) -> None:
    """Without HUPCL the last to close the port, or the kernel after a kill, leaves DTR up.

    A drop would cut the laser's power, and it takes up to a minute to boot.
    """
    mode = termios.tcgetattr(fd)
    mode[2] &= ~termios.HUPCL
    termios.tcsetattr(fd, termios.TCSANOW, mode)


def _keep_others_out(fd: int) -> None:
    """Let nobody else open the port, whether he knows of flock or not.

    Ptys are left out: they would still be barred after their user was killed.
    """
    if os.major(os.fstat(fd).st_rdev) not in PTY_MAJORS:
        fcntl.ioctl(fd, termios.TIOCEXCL)


def _let_others_in(fd: int) -> None:
    """Lock and mark would stay as long as the last resort keeps its copy of the descriptor."""
    fcntl.flock(fd, fcntl.LOCK_UN)
    if os.major(os.fstat(fd).st_rdev) not in PTY_MAJORS:
        fcntl.ioctl(fd, termios.TIOCNXCL)


class SocketLink:
    """A TCP socket that carries a device's bytes."""

    def __init__(self, host: str, port: int) -> None:
        self.name = f"socket://{host}:{port}"
        self._address = (host, port)

    async def open(self, device: str, baud: int) -> PortStream:
        """Connect; the line rate is the far end's matter. Raises OpenError."""
        del baud
        try:
            stream = await clock.within(CONNECT_TIME, self._connect(device))
        except OSError as error:
            number = error.errno or 0
            reason = os.strerror(number) if number > 0 else error.strerror  # < 0: name look-up
            problem = f"{self.name}: {reason}"
            raise OpenError(device, problem, "is it running there, at this port?") from error
        if stream is None:
            raise OpenError(device, f"{self.name} does not answer", "check the network")
        return stream

    async def _connect(self, device: str) -> PortStream:
        loop = asyncio.get_running_loop()
        host, port = self._address
        family, kind, protocol, _, address = (
            await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        )[0]
        connection = socket.socket(family, kind, protocol)
        try:
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            await loop.sock_connect(connection, address)
        except BaseException:
            connection.close()
            raise
        return PortStream(device, self.name, _Socket(connection))


class _Socket:
    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def fileno(self) -> int:
        return self._connection.fileno()

    def set_baud(self, baud: int) -> None:
        """Nothing: a socket has no line rate."""

    def close(self) -> None:
        with suppress(OSError):  # the far end is told, whoever keeps a copy
            self._connection.shutdown(socket.SHUT_RDWR)
        self._connection.close()
