"""A device behind the base's AUX port, as if it were plugged into this computer."""

from collections.abc import Callable
from typing import Protocol

from followerd import clock
from followerd.errors import LinkLost, OpenError
from followerd.hw.inbox import CHUNKS, ByteInbox
from followerd.hw.p2os.aux_exchange import AuxExchange, Replies
from followerd.hw.p2os.commands import BAUDS
from followerd.hw.stream import Received

CONNECTING = 30.0  # s that a base may take to be ready
POLL = 0.02  # s
OUT_QUEUE = 2048  # bytes that may wait for the gate


class Relay(Protocol):
    """A session with the base that passes bytes on."""

    aux: "dict[int, AuxStream]"  # the streams open now, by port

    def relay(self, packet: bytes) -> None:
        """Queue commands for an AUX port behind the gate."""

    @property
    def relayed_backlog(self) -> int:
        """Bytes that still wait for the gate."""


class AuxLink:
    """Opens AUX port `port` of the base; see `followerd.hw.stream.Link`."""

    def __init__(
        self, base: str, port: int, session: Callable[[], Relay | None], replies: Replies
    ) -> None:
        self.name = f"{base}:aux{port}"
        self._base = base
        self._port = port
        self._session = session
        self._replies = replies

    async def open(self, device: str, baud: int) -> "AuxStream":
        """Wait for the base, then open; raises OpenError."""
        if baud not in BAUDS:
            rates = ", ".join(map(str, BAUDS))
            raise OpenError(device, f"{self.name} has no {baud} baud", f"choose one of {rates}")
        deadline = clock.now() + CONNECTING
        while (session := self._session()) is None:
            if clock.now() >= deadline:
                raise OpenError(device, f"{self.name}: no base is connected", "see to the base")
            await clock.sleep(POLL)
        if self._port in session.aux:
            raise OpenError(device, f"{self.name} is busy", "one device per port")
        exchange = AuxExchange(self._port, self._replies)
        stream = AuxStream(device, baud, session, exchange, self._port)
        session.aux[self._port] = stream
        return stream


class AuxStream:
    """The open port; see `followerd.hw.stream.ByteStream`."""

    def __init__(
        self, device: str, baud: int, session: Relay, exchange: AuxExchange, port: int
    ) -> None:
        self._device = device
        self._session = session
        self._exchange = exchange
        self._port = port
        self._inbox = ByteInbox(CHUNKS)
        self.set_baud(baud)

    async def read(self, at_least: int = 1) -> Received:
        """The next bytes; raises LinkLost when the base is lost or this is closed."""
        return await self._inbox.take(at_least)

    def write(self, data: bytes) -> None:
        """Queue behind the base's gate; raises LinkLost when too much waits there."""
        self._inbox.check()
        if self._session.relayed_backlog + len(data) > OUT_QUEUE:
            self.lose("takes no more bytes", "write less often")
            self._inbox.check()
        for packet in self._exchange.say(data, clock.now()) if data else ():
            self._session.relay(packet)

    async def drain(self) -> None:
        """Wait until everything has passed the gate."""
        while self._session.relayed_backlog:
            self._inbox.check()
            await clock.sleep(POLL)

    def set_baud(self, baud: int) -> None:
        """Change the line rate between base and device; one of BAUDS."""
        self._session.relay(self._exchange.set_baud(baud))

    def discard_input(self) -> None:
        """Forget what was received but not yet read."""
        self._inbox.clear()

    def close(self) -> None:
        """Close; idempotent."""
        self.lose("closed")

    def lose(self, problem: str, remedy: str = "") -> None:
        """No byte passes any more."""
        self._inbox.fail(LinkLost(self._device, problem, remedy))
        if self._session.aux.get(self._port) is self:
            del self._session.aux[self._port]

    def take(self, data: bytes, stamp: float) -> None:
        """The base passed on bytes of the device."""
        self._inbox.put(Received(data, stamp))
        self._relay(self._exchange.hear(data, clock.now()))

    def tend(self) -> None:
        """Time has passed."""
        if self._session.relayed_backlog:
            self._exchange.wait_from(clock.now())
        else:
            self._relay(self._exchange.overdue(clock.now()))

    def _relay(self, packet: bytes) -> None:
        if packet:
            self._session.relay(packet)
