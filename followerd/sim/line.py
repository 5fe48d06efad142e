"""The cable between a twin's UART and the host's port: line rate, chunks, wrong baud, unplugging.

Bytes take 10 bits each. They reach the other end in chunks of at most 62 bytes, as a USB serial
adapter hands them over, each when its last byte has crossed. A burst (what a twin's `step`
returns) travels at the twin's `baud` as it stands when `step` returns. On a slow line the adapter's
latency timer makes the chunks shorter.
"""

import asyncio
from collections import deque
from math import inf
from operator import itemgetter
from typing import NamedTuple, Protocol

import numpy as np

from followerd import clock
from followerd.errors import LinkLost, OpenError
from followerd.hw.inbox import CHUNKS, ByteInbox
from followerd.hw.stream import Link, Received
from followerd.sim.faults import Damage, Fault, FaultKind, Mend
from followerd.sim.interfaces import Twin

BITS_PER_BYTE = 10  # start, 8 data, stop
LATENCY_TIMER = 0.016  # s after which an adapter hands over what it has, full or not
OUT_QUEUE = 8192  # bytes that a port and its driver hold before the link counts as stuck
RESOLUTION = 1e-9  # s; timers fire up to this early


class HostPort(Protocol):
    """The host's end of the cable."""

    @property
    def baud(self) -> int | None:
        """The rate the host has set; None = no line rate of its own (TCP)."""

    @property
    def missing(self) -> int:
        """Bytes, at least 1, that its reader waits for: fewer may be handed over later."""

    def deliver(self, data: bytes, stamp: float) -> None:
        """Take bytes that crossed the line."""

    def unplug(self) -> None:
        """The cable is pulled."""

    def replug(self) -> None:
        """The cable is back."""


class _Chunk(NamedTuple):
    due: float  # s, last byte has crossed
    data: bytes
    baud: int | None


class Line:
    """Carries bytes between `twin` and the ports plugged into it; `link` is one in memory."""

    def __init__(
        self,
        twin: Twin,
        rng: np.random.Generator,
        name: str,
        chunk: int = 62,
        faults: tuple[Fault, ...] = (),
        mend: Mend = bytes,
    ) -> None:
        self.name = name
        self._twin = twin
        self._rng = rng
        self._chunk = chunk
        self._ports: list[HostPort] = []
        self._to_host: deque[_Chunk] = deque()
        self._to_twin: deque[_Chunk] = deque()
        self._host_free = 0.0  # s, when the last byte of each queue has crossed
        self._twin_free = 0.0
        self._host_rate = twin.baud
        self._plugged = True
        self._damage = Damage(faults, rng, mend)
        self._start = 0.0  # s, when `run` began
        self._events = sorted((e for f in faults for e in f.events), key=itemgetter(0))
        self._timer: asyncio.TimerHandle | None = None
        self._failed: asyncio.Future[None] | None = None  # while it runs
        self.link: Link = MemoryLink(self)

    @property
    def plugged(self) -> bool:
        """Whether the cable is in."""
        return self._plugged

    @property
    def ports(self) -> list[HostPort]:
        """The ports plugged in now; append and remove freely."""
        return self._ports

    async def run(self) -> None:
        """Carry bytes and wake the twin, for ever."""
        self._start = clock.now()
        self._failed = asyncio.get_running_loop().create_future()
        self._set_timer()
        try:
            await self._failed
        finally:
            self._failed = None
            self._clear_timer()

    @property
    def backlog(self) -> float:
        """Bytes from the host that still wait or cross."""
        return max(0.0, self._host_free - clock.now()) * self._host_rate / BITS_PER_BYTE

    @property
    def elapsed(self) -> float:
        """Seconds since `run` began; faults count from there."""
        return clock.now() - self._start

    def inject(self, fault: Fault) -> None:
        """One more fault, while it runs."""
        self._damage.add(fault)
        self._events = sorted((*self._events, *fault.events), key=itemgetter(0))
        self._set_timer()

    def transmit(self, data: bytes, baud: int | None) -> None:
        """Bytes that the host starts to send now; whoever calls keeps `backlog` below OUT_QUEUE."""
        if self._plugged and data:
            self._host_rate = baud or self._twin.baud
            start = max(self._host_free, clock.now())
            self._host_free = self._enqueue(self._to_twin, data, start, self._host_rate, baud)
            self._set_timer()

    def unplug(self) -> None:
        """Pull the cable: bytes under way are lost, the host notices at once."""
        self.hand_over()
        self._plugged = False
        self._to_host.clear()
        self._to_twin.clear()
        for port in list(self._ports):
            port.unplug()

    def replug(self) -> None:
        """Put the cable back; the host may open the link again."""
        self._plugged = True
        for port in list(self._ports):
            port.replug()

    def _next_due(self) -> float:
        due = self._twin.wake_at()
        if self._to_twin:
            due = min(due, self._to_twin[0].due)
        if self._to_host:
            due = min(due, self._wanted_at())
        if self._events:
            due = min(due, self._start + self._events[0][0])
        return due

    def _wanted_at(self) -> float:
        """When a reader has what it waits for, or all that is under way; then it is handed over.

        A timer for each chunk would cost a tenth of a run.
        """
        missing = min((port.missing for port in self._ports), default=1)
        for chunk in self._to_host:
            missing -= len(chunk.data)
            if missing <= 0:
                return chunk.due
        return self._to_host[-1].due

    def hand_over(self) -> None:
        """Give the host what has crossed by now."""
        if not self._to_host:
            return
        horizon = clock.now() + RESOLUTION
        while self._to_host and self._to_host[0].due <= horizon:
            self._hand_to_host(self._to_host.popleft())

    def expect(self) -> None:
        """A reader begins to wait, maybe for less than the one before."""
        self._set_timer()

    def _advance(self, now: float) -> None:
        horizon = now + RESOLUTION
        while self._events and self._start + self._events[0][0] <= horizon:
            self._undergo(*self._events.pop(0), now)
        self.hand_over()
        received = False
        while self._to_twin and self._to_twin[0].due <= horizon:
            chunk = self._to_twin.popleft()
            if not self._damage.is_deaf(now - self._start):
                self._twin.receive(self._as_heard(chunk, self._twin.baud), now)
                received = True
        if received or self._twin.wake_at() <= horizon:
            self._send(self._twin.step(now), now)
            if self._twin.wake_at() <= now:
                raise RuntimeError(f"{self.name}: the twin's step at {now} s left work undone")

    def _undergo(self, elapsed: float, kind: FaultKind, now: float) -> None:
        """Cable or power go or come back."""
        if kind is FaultKind.REBOOT:
            self._twin.reboot(now)
        elif self._plugged and self._damage.is_cut(elapsed):
            self.unplug()
        elif not self._plugged and not self._damage.is_cut(elapsed):
            self.replug()

    def _send(self, burst: bytes, now: float) -> None:
        if not burst or not self._plugged:
            return
        rate = self._twin.baud
        for leaves, piece in self._damage.apply(burst, now - self._start):
            start = max(self._twin_free, self._start + leaves)
            self._twin_free = self._enqueue(self._to_host, piece, start, rate, rate)

    def _enqueue(
        self, queue: deque[_Chunk], data: bytes, start: float, rate: int, baud: int | None
    ) -> float:
        byte_time = BITS_PER_BYTE / rate
        most = min(self._chunk, max(1, int(LATENCY_TIMER / byte_time)))
        for first in range(0, len(data), most):
            piece = data[first : first + most]
            queue.append(_Chunk(start + (first + len(piece)) * byte_time, piece, baud))
        return start + len(data) * byte_time

    def _hand_to_host(self, chunk: _Chunk) -> None:
        for port in list(self._ports):
            port.deliver(self._as_heard(chunk, port.baud), chunk.due)

    def _as_heard(self, chunk: _Chunk, baud: int | None) -> bytes:
        """What a receiver at `baud` makes of a chunk: noise when the rates differ."""
        if chunk.baud is None or baud is None or chunk.baud == baud:
            return chunk.data
        return self._rng.bytes(len(chunk.data))

    def _set_timer(self) -> None:
        """Come back when something is due; a timer alone, for a task to wake would cost more."""
        due = self._next_due()
        if self._failed is None or (self._timer is not None and self._timer.when() <= due):
            return
        self._clear_timer()
        if due < inf:
            self._timer = asyncio.get_running_loop().call_at(due, self._come_due, due)

    def _come_due(self, due: float) -> None:
        self._timer = None
        try:
            self._advance(max(clock.now(), due))
        except Exception as reason:
            if self._failed is not None:
                self._failed.set_exception(reason)
            return
        self._set_timer()

    def _clear_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class MemoryLink:
    """A link to a twin in the same process."""

    def __init__(self, line: Line) -> None:
        self.name = f"sim:{line.name}"
        self._line = line
        self._stream: MemoryStream | None = None

    async def open(self, device: str, baud: int) -> "MemoryStream":
        """Open the link; raises OpenError while it is unplugged or open already."""
        if not self._line.plugged:
            raise OpenError(device, f"{self.name} does not exist", "plug the cable in")
        if self._stream is not None and self._stream in self._line.ports:
            raise OpenError(device, f"{self.name} is busy", "close the other program that uses it")
        self._stream = MemoryStream(self._line, device, baud)
        self._line.ports.append(self._stream)
        return self._stream


class MemoryStream:
    """The open host end, in memory."""

    def __init__(self, line: Line, device: str, baud: int) -> None:
        self.baud: int | None = baud
        self._line = line
        self._device = device
        self._inbox = ByteInbox(CHUNKS)

    async def read(self, at_least: int = 1) -> Received:
        """The next chunk; raises LinkLost when unplugged or closed."""
        if self._inbox.is_empty:
            self._line.hand_over()
            self._line.expect()
        return await self._inbox.take(at_least)

    @property
    def missing(self) -> int:
        """See HostPort."""
        return self._inbox.missing

    def write(self, data: bytes) -> None:
        """Start to send; raises LinkLost when unplugged, closed or stuck."""
        self._inbox.check()
        if self._line.backlog + len(data) > OUT_QUEUE:
            self._inbox.fail(LinkLost(self._device, "takes no more bytes", "check the line rate"))
            self._inbox.check()
        self._line.transmit(data, self.baud)

    async def drain(self) -> None:
        """Nothing to wait for: the port has taken everything, each byte at the rate of its time."""

    def set_baud(self, baud: int) -> None:
        """Change the line rate of bytes written from now on."""
        self._line.hand_over()
        self.baud = baud

    def discard_input(self) -> None:
        """Forget what was not read."""
        self._line.hand_over()
        self._inbox.clear()

    def close(self) -> None:
        """Close; idempotent."""
        self._end("closed")

    def deliver(self, data: bytes, stamp: float) -> None:
        """Take bytes that crossed the line."""
        self._inbox.put(Received(data, stamp))

    def unplug(self) -> None:
        """The cable is pulled."""
        self._end("unplugged")

    def replug(self) -> None:
        """An unplugged stream stays lost; the link must be opened anew."""

    def _end(self, problem: str) -> None:
        self._inbox.fail(LinkLost(self._device, problem))
        if self in self._line.ports:
            self._line.ports.remove(self)
