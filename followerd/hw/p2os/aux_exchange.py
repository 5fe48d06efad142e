"""Talking to a device behind the base: TTY2 carries bytes out, GETAUX asks for what came back.

The trap: the base answers GETAUX n only when n bytes are there, and once. Who asks for a long
reply and gets a short one, an error say, waits for ever. So the shortest reply is asked for first,
then the rest of the one expected, then byte by byte until a reply's last byte; what stays
unanswered is flushed. (ARCOS manual.)
"""

from collections.abc import Callable
from dataclasses import dataclass

from followerd.hw.p2os.commands import BAUDS, Cmd, command

STRING_MAX = 190  # bytes of one TTY command
PATIENCE = 0.6  # s for an answer: the device's own time, and until a status packet leaves room


@dataclass(frozen=True, slots=True)
class Port:
    """The commands of one AUX port."""

    write: Cmd
    fetch: Cmd
    baud: Cmd


PORTS = {
    1: Port(Cmd.TTY2, Cmd.GETAUX, Cmd.AUX1BAUD),
    2: Port(Cmd.TTY3, Cmd.GETAUX2, Cmd.AUX2BAUD),
    3: Port(Cmd.TTY4, Cmd.GETAUX3, Cmd.AUX3BAUD),
}


@dataclass(frozen=True, slots=True)
class Replies:
    """How a device's replies look: `shortest` in bytes, and the byte that `ends` each of them.

    `rest` tells how many bytes the expected reply to a request has beyond the shortest.
    """

    shortest: int
    ends: int
    rest: Callable[[bytes], int]


class AuxExchange:
    """One request and its reply at a time; what is returned is to be sent to the base, in order."""

    def __init__(self, port: int, replies: Replies) -> None:
        self._port = PORTS[port]
        self._replies = replies
        self._rest = 0  # bytes of the reply beyond the shortest, as expected
        self._asked_at: float | None = None  # s, of the GETAUX that waits for its answer

    def set_baud(self, baud: int) -> bytes:
        """Set the port's line rate (one of BAUDS), and forget what it holds."""
        self._asked_at = None
        return command(self._port.baud, BAUDS.index(baud)) + self._flush()

    def say(self, request: bytes, now: float) -> list[bytes]:
        """Send `request` to the device and ask for its reply; the last one's is given up."""
        self._rest = self._replies.rest(request)
        before = self._flush() + self._ask(self._replies.shortest, now)
        parts = [request[i : i + STRING_MAX] for i in range(0, len(request), STRING_MAX)]
        head, *tail = [command(self._port.write, part) for part in parts]
        return [before + head, *tail]

    def hear(self, data: bytes, now: float) -> bytes:
        """Bytes came from the device."""
        if self._asked_at is None:
            return b""
        self._asked_at = None
        if data[-1] == self._replies.ends:
            return b""
        rest, self._rest = self._rest or 1, 0
        return self._ask(rest, now)

    def overdue(self, now: float) -> bytes:
        """What to do about an answer that does not come."""
        if self._asked_at is None or now < self._asked_at + PATIENCE:
            return b""
        self._asked_at = None
        return self._flush()

    def wait_from(self, now: float) -> None:
        """What was asked has not left yet: patience begins now."""
        if self._asked_at is not None:
            self._asked_at = now

    def _ask(self, count: int, now: float) -> bytes:
        self._asked_at = now
        return command(self._port.fetch, count)

    def _flush(self) -> bytes:
        return command(self._port.fetch, 0)
