"""A simulated base on its line, and drivers that come and go; for tests in virtual time."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from typing import Any

import numpy as np

from followerd import clock
from followerd.errors import DeviceError
from followerd.hw.interfaces import Base
from followerd.hw.p2os.commands import Cmd, Request
from followerd.hw.p2os.driver import P2osBase, P2osSettings
from followerd.hw.p2os.protocol import PacketDecoder
from followerd.messages import Command, Measurement, Odometry, Wish
from followerd.sim.line import Line
from followerd.sim.twins.p2os import P2osTwin
from tests.p2os_body import FloorBody

HALT = [(Cmd.STOP, None), (Cmd.VEL, 0), (Cmd.RVEL, 0)]
STOPPING = {*HALT, (Cmd.E_STOP, None), (Cmd.ENABLE, 0)}

Heard = tuple[int, int | bytes | None]


class RecordingTwin(P2osTwin):
    """Keeps what reached it in readable form."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.heard: list[Heard] = []
        self.heard_at: list[float] = []
        self._ear = PacketDecoder()

    def receive(self, data: bytes, now: float) -> None:
        for packet in self._ear.feed(data):
            request = Request.parse(packet.payload)
            self.heard.append((request.number, request.argument))
            self.heard_at.append(now)
        super().receive(data, now)


class Bench:
    """A twin, its line, and drivers that come and go."""

    def __init__(self, twin: type[RecordingTwin] = RecordingTwin, **options: Any) -> None:
        self.body = FloorBody()
        self.twin = twin(self.body, np.random.default_rng(1), **options)
        self.line = Line(self.twin, np.random.default_rng(2), "robot")
        self.seen: list[Odometry] = []
        self.sent: list[tuple[Command, float]] = []
        self.base = P2osBase(P2osSettings(), self.line.link)
        self._running: asyncio.Task[None] | None = None

    @property
    def newest(self) -> Odometry:
        return self.seen[-1]

    def _see(self, measurement: Measurement) -> None:
        assert isinstance(measurement, Odometry)
        self.seen.append(measurement)

    @property
    def is_running(self) -> bool:
        """Whether a driver is at work."""
        return self._running is not None and not self._running.done()

    def start(self, settings: P2osSettings | None = None) -> asyncio.Task[None]:
        """A new driver on the same line."""
        self.base = P2osBase(settings or P2osSettings(), self.line.link)
        contract: Base = self.base
        assert contract.name == "base"
        return self.restart()

    def restart(self) -> asyncio.Task[None]:
        """The driver at hand, for the first time or once more."""
        if self._running is not None:
            assert isinstance(self._running.exception(), DeviceError)
        self.base.on_sent = lambda *sent: self.sent.append(sent)
        self._running = asyncio.create_task(self.base.run(self._see))
        return self._running

    async def connect(self, settings: P2osSettings | None = None, within: float = 15.0) -> None:
        self.start(settings)
        await self.is_up(within)

    async def is_up(self, within: float = 15.0) -> None:
        deadline = clock.now() + within
        while self.base.caps is None:
            if self._running is not None and self._running.done():
                await self._running
            assert clock.now() < deadline, "not connected in time"
            await clock.sleep(0.01)

    async def motors_on(self) -> None:
        self.base.enable_motors(True)
        await clock.sleep(0.5)
        assert self.newest.motors_enabled

    async def leave(self) -> None:
        if self._running is not None:
            self._running.cancel()
            with suppress(asyncio.CancelledError, DeviceError):
                await self._running
            self._running = None

    async def drive(self, motion: Wish, seconds: float, period: float = 0.05) -> None:
        """Fresh commands for a while, each good for 0.25 s."""
        end = clock.now() + seconds
        while clock.now() < end - 1e-9:
            self.base.drive(Command(clock.now(), motion, clock.now() + 0.25))
            await clock.sleep(period)


@asynccontextmanager
async def bench(twin: type[RecordingTwin] = RecordingTwin, **options: Any) -> AsyncIterator[Bench]:
    made = Bench(twin, **options)
    pump = asyncio.create_task(made.line.run())
    try:
        yield made
    finally:
        await made.leave()
        assert made.twin.faults == []
        pump.cancel()


def story(told: Callable[[], Awaitable[None]]) -> None:
    """Run a test in virtual time."""

    async def main() -> None:
        await told()

    clock.run_virtual(main())
