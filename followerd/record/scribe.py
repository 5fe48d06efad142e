"""A process of its own that writes a recording: JSON and compression there hold nobody up here.

The daemon compresses pictures, which holds no interpreter, and pickles its nouns. They are handed
over by batches: a process that wakes thirty times a second takes twice the time for the same, for
it finds the caches full of others' things. When the daemon is killed the scribe still finishes the
file. Run as a script by `Scribe`.
"""

import os
import socket
import sys
from collections.abc import Mapping
from contextlib import closing, suppress
from math import inf
from pathlib import Path
from pickle import UnpicklingError
from subprocess import DEVNULL, Popen

from followerd.errors import UsageError
from followerd.messages import Decision, Image
from followerd.record.journal import Entry
from followerd.record.settings import RecordSettings
from followerd.record.still import kept
from followerd.record.tape import DiskFull, Tape
from followerd.record.wire import Teller, told

READY = b"ready"
LATER = 10  # added to the process's niceness: the robot comes first
BUFFER = 1 << 20  # bytes
GATHERS = 0.4  # of what may be lost when killed: that much is gathered before it is handed over
LONGEST = 4096  # bytes that the process may say of its end


class Scribe:
    """A Tape in another process. What cannot be written is told by the next call, as DiskFull."""

    def __init__(
        self, path: Path | None, settings: RecordSettings, about: Mapping[str, str], epoch: float
    ) -> None:
        self.path = path
        self.settings = settings
        self._ours, theirs = socket.socketpair()
        command = [sys.executable, "-P", "-m", "followerd.record.scribe", str(theirs.fileno())]
        search = os.pathsep.join(filter(None, sys.path))  # this program, not another one
        with theirs:
            self._process = Popen(
                command,
                stdin=DEVNULL,
                stdout=DEVNULL,
                env={**os.environ, "PYTHONPATH": search},
                pass_fds=[theirs.fileno()],
                # a Ctrl-C is the daemon's; in a session of its own niceness would count for nothing
                process_group=0,
            )
        self._out = self._ours.makefile("wb", BUFFER)
        self._teller = Teller(self._out)
        self._gathers = GATHERS * settings.flush_s
        self._newest, self._handed = 0.0, -inf  # s, loop time
        flushes = {"flush_s": settings.flush_s - self._gathers}
        self._teller.tell((path, settings.model_copy(update=flushes), dict(about), epoch))
        self._out.flush()

    def wait(self) -> None:
        """Until it writes, half a second. Raises UsageError when it cannot."""
        said = self._ours.recv(LONGEST)
        if said != READY:
            self.close()
            raise UsageError(said.decode() or "the process that records does not start")

    def image(self, image: Image) -> None:
        """See Tape."""
        self._tell("still", kept(image, self.settings))

    def entry(self, entry: Entry, number: int) -> None:
        """See Tape."""
        self._newest = entry.now
        self._tell("entry", entry, number)

    def decision(self, decision: Decision) -> None:
        """See Tape."""
        self._tell("decision", decision)

    def heard(self, device: str, data: bytes, now: float) -> None:
        """See Tape."""
        self._tell("heard", device, data, now)

    def hand_over(self) -> None:
        """Let it write what was gathered so far, once that is enough."""
        if self._newest - self._handed < self._gathers:
            return
        self._handed = self._newest
        try:
            self._teller.end_batch()
            self._out.flush()
        except OSError:
            raise DiskFull(self._reason()) from None

    def close(self) -> None:
        """Finish the file; waits until it is done."""
        with suppress(OSError):
            self._out.close()
        with suppress(OSError):
            self._ours.shutdown(socket.SHUT_WR)
        self._process.wait()
        self._ours.close()

    def _tell(self, call: str, *values: object) -> None:
        try:
            self._teller.tell((call, values))
        except OSError:
            raise DiskFull(self._reason()) from None

    def _reason(self) -> str:
        with suppress(OSError):
            said = b"".join(iter(lambda: self._ours.recv(LONGEST), b""))
            if reason := said.removeprefix(READY).decode():
                return reason
        return "the process that records has ended"


def main(number: int) -> None:
    """Write what comes through the socket of that file descriptor, until it closes."""
    with suppress(OSError):
        os.nice(LATER)
    with socket.socket(fileno=number) as channel, channel.makefile("rb", BUFFER) as source:
        try:
            # closed, or killed in the middle of a word
            with suppress(EOFError, UnpicklingError):
                calls = told(source)  # by our own parent
                with closing(Tape(*next(calls))) as tape:
                    channel.sendall(READY)
                    for call, values in calls:
                        getattr(tape, call)(*values)
        except (DiskFull, OSError, RuntimeError, UsageError) as error:
            with suppress(OSError):
                channel.sendall(str(error).encode()[:LONGEST])


if __name__ == "__main__":
    main(int(sys.argv[1]))
