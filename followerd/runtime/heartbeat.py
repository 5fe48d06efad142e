"""The daemon's side of the last resort: its process, the port it holds, the heartbeat."""

import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from subprocess import DEVNULL, Popen, TimeoutExpired
from typing import Protocol, runtime_checkable

import structlog

from followerd import clock
from followerd.errors import LinkLost
from followerd.hw.stream import ByteStream, Link
from followerd.runtime import last_resort

BEAT = 0.05  # s
AGAIN = 1.0  # s, before a watchdog that died is started again

log = structlog.get_logger()


@runtime_checkable
class HasDescriptor(Protocol):
    """A stream over a file descriptor."""

    def fileno(self) -> int:
        """It."""


class Heartbeat:
    """Starts the last resort, keeps it alive, and tells it that the loop runs."""

    def __init__(self, halt: bytes) -> None:
        """`halt` is what stops the base."""
        self._halt = halt
        self._stream: HasDescriptor | None = None
        self._process: Popen[bytes] | None = None
        self._channel: socket.socket | None = None

    def guarded(self, link: Link) -> Link:
        """The base's link; each stream that it opens is given to the last resort too."""
        return GuardedLink(link, self)

    def hold(self, stream: ByteStream) -> None:
        """Let the last resort hold this stream's port."""
        self._stream = stream if isinstance(stream, HasDescriptor) else None
        self._hand_over()

    async def run(self) -> None:
        """Beat for ever."""
        while True:
            with self._watching():
                while self._beats():
                    await clock.sleep(BEAT)
            log.error("last resort died; a new one is started")
            await clock.sleep(AGAIN)

    @contextmanager
    def _watching(self) -> Iterator[None]:
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.setblocking(False)
        script = str(Path(last_resort.__file__))
        with theirs:
            self._process = Popen(
                [sys.executable, "-I", "-S", script, str(theirs.fileno())],
                stdin=DEVNULL,
                stdout=DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # a Ctrl-C is the daemon's
            )
        self._hand_over()
        try:
            yield
        finally:
            self._part()

    def _part(self) -> None:
        """The base was halted in an orderly way, or the watchdog is dead: end without a stop."""
        channel, process = self._channel, self._process
        self._channel = self._process = None
        if process is not None:
            process.kill()
            with suppress(TimeoutExpired):
                process.wait(1.0)
        if channel is not None:
            channel.close()

    def _hand_over(self) -> None:
        if self._channel is not None and self._stream is not None:
            with suppress(OSError, LinkLost):
                socket.send_fds(self._channel, [self._halt], [self._stream.fileno()])

    def _beats(self) -> bool:
        """Whether somebody heard."""
        if self._channel is None or self._process is None or self._process.poll() is not None:
            return False
        try:
            self._channel.send(b".")
        except BlockingIOError:
            return True  # it has more beats to read than it needs
        except OSError:
            return False
        return True


class GuardedLink:
    """See Heartbeat.guarded."""

    def __init__(self, link: Link, heartbeat: Heartbeat) -> None:
        self.name = link.name
        self._link = link
        self._heartbeat = heartbeat

    async def open(self, device: str, baud: int) -> ByteStream:
        """See Link."""
        stream = await self._link.open(device, baud)
        self._heartbeat.hold(stream)
        return stream
