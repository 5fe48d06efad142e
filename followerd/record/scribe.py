"""A process of its own that writes a recording: JSON and compression there hold nobody up here.

The daemon only pickles its nouns: a third of the time, and little of it with the interpreter held.
When the daemon is killed the scribe still finishes the file. Run as a script by `Scribe`.
"""

import os
import pickle
import socket
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from subprocess import DEVNULL, Popen

from followerd.errors import UsageError
from followerd.messages import Decision, Image
from followerd.record.journal import Entry
from followerd.record.settings import RecordSettings
from followerd.record.tape import DiskFull, Tape

READY = b"ready"
LATER = 10  # added to the process's niceness: the robot comes first
BUFFER = 1 << 17  # bytes
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
        pickle.dump((path, settings, dict(about), epoch), self._out, pickle.HIGHEST_PROTOCOL)
        self._out.flush()

    def wait(self) -> None:
        """Until it writes, half a second. Raises UsageError when it cannot."""
        said = self._ours.recv(LONGEST)
        if said != READY:
            self.close()
            raise UsageError(said.decode() or "the process that records does not start")

    def image(self, image: Image) -> None:
        """See Tape."""
        self._tell("image", image)

    def entry(self, entry: Entry, number: int) -> None:
        """See Tape."""
        self._tell("entry", entry, number)

    def decision(self, decision: Decision) -> None:
        """See Tape."""
        self._tell("decision", decision)

    def heard(self, device: str, data: bytes, now: float) -> None:
        """See Tape."""
        self._tell("heard", device, data, now)

    def hand_over(self) -> None:
        """Let it write what was gathered so far."""
        try:
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
            pickle.dump((call, values), self._out, pickle.HIGHEST_PROTOCOL)
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
    with socket.socket(fileno=number) as channel, channel.makefile("rb", BUFFER) as told:
        try:
            tape = Tape(*pickle.load(told))  # our own parent's
            channel.sendall(READY)
            try:
                while True:
                    call, values = pickle.load(told)
                    getattr(tape, call)(*values)
            except (EOFError, pickle.UnpicklingError):  # closed, or killed in the middle of a word
                pass
            finally:
                tape.close()
        except (DiskFull, OSError, RuntimeError, UsageError) as error:
            with suppress(OSError):
                channel.sendall(str(error).encode()[:LONGEST])


if __name__ == "__main__":
    main(int(sys.argv[1]))
