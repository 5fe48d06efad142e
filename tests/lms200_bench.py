"""An LMS200 twin on the bench, in a simple room; with or without its driver."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, TypedDict, Unpack

import numpy as np
import pytest

from followerd import clock
from followerd.errors import DeviceError
from followerd.geometry import Array, Camera, Pose2
from followerd.hw.lms200.driver import Lms200
from followerd.hw.lms200.protocol import Acknowledgement, Event, Telegram, TelegramDecoder
from followerd.hw.lms200.scans import ScanTelegram
from followerd.hw.lms200.settings import Lms200Settings
from followerd.hw.lms200.telegrams import Command, Config, Reply, reply_to, request
from followerd.hw.lms200.variant import line_time
from followerd.messages import Measurement, Pixels, Scan
from followerd.sim.faults import Fault
from followerd.sim.line import Line
from followerd.sim.twins.lms200 import Lms200Twin


class TwinOptions(TypedDict, total=False):
    """See Lms200Twin."""

    upside_down: bool
    boot_time: float
    power_on_baud: int
    address: int
    polluted: bool
    config: Config


class Round:
    """A round room; remembers when and where each beam was measured."""

    def __init__(self, range_: float = 3.0) -> None:
        self.now = 0.0
        self.range = range_
        self.measured: list[tuple[Array, Array]] = []  # bearings, times
        self.asked: list[float] = []

    def advance(self, now: float) -> None:
        self.now = now

    def ranges(self, base_from_laser: Pose2, bearings: Array, ages: Array) -> Array:
        self.asked.append(self.now)
        self.measured.append((bearings, self.now - ages))
        return np.full(bearings.size, self.range)

    def render(self, camera: Camera) -> Pixels:
        raise AssertionError("a laser has no use for images")


class Bench:
    """A twin on the bench, its bytes decoded as they leave."""

    def __init__(self, twin: Lms200Twin) -> None:
        self.twin = twin
        self.now = 0.0
        self.decoder = TelegramDecoder()

    def runs(self, seconds: float) -> list[tuple[float, Event]]:
        """What leaves the twin and when it begins to."""
        end = self.now + seconds
        events: list[tuple[float, Event]] = []
        while (due := max(self.now, self.twin.wake_at())) <= end:
            self.now = due
            events += [(due, event) for event in self.decoder.feed(self.twin.step(due))]
            assert self.twin.wake_at() > due, "the step left work undone"
        self.now = end
        return events

    def asks(self, telegram: Telegram, seconds: float = 1.2) -> list[Event]:
        """What comes after a request."""
        self.twin.receive(telegram.to_bytes(), self.now)
        return [event for _, event in self.runs(seconds)]

    def told(self, command: int, data: bytes = b"") -> Telegram:
        """The answer to a request in a quiet twin, after its acknowledgement."""
        mark, telegram = self.asks(request(command, data))
        assert mark is Acknowledgement.ACK
        assert isinstance(telegram, Telegram)
        assert telegram.command == reply_to(command)
        return telegram

    def set_mode(self, mode: int, parameters: bytes = b"") -> bool:
        """Whether the twin goes into a mode."""
        self.twin.receive(request(Command.MODE, bytes((mode,)) + parameters).to_bytes(), self.now)
        events = [event for _, event in self.runs(1e-9 + 0.021 + line_time(10, self.twin.baud))]
        answers = [e for e in events if isinstance(e, Telegram) and e.command == Reply.MODE]
        return [a.data for a in answers] == [b"\0"]

    def scans(self, seconds: float) -> list[tuple[float, ScanTelegram]]:
        """The scans that leave and when they begin to."""
        return [
            (when, ScanTelegram.from_payload(event.payload))
            for when, event in self.runs(seconds)
            if isinstance(event, Telegram)
        ]


def twin(scene: Round | None = None, **options: Unpack[TwinOptions]) -> Lms200Twin:
    """A twin in a round room of 3 m."""
    return Lms200Twin(scene or Round(), np.random.default_rng(7), Pose2(), **options)


@dataclass
class Rig:
    """A driver on a line to a twin, and what came of it."""

    driver: Lms200
    line: Line
    scans: list[Scan] = field(default_factory=list, repr=False)
    problems: list[DeviceError] = field(default_factory=list)
    _came: asyncio.Event = field(default_factory=asyncio.Event)

    def sink(self, measurement: Measurement) -> None:
        assert isinstance(measurement, Scan)
        self.scans.append(measurement)
        self._came.set()

    async def gets(self, scans: int, within: float) -> None:
        """Wait for so many scans more, at most `within` seconds."""
        enough = len(self.scans) + scans
        deadline = clock.now() + within
        while len(self.scans) < enough:
            self._came.clear()
            left = deadline - clock.now()
            assert await clock.within(left, self._came.wait()), f"no {scans} scans in {within} s"

    async def keep_running(self) -> None:
        """What supervision does with a sensor."""
        while True:
            try:
                await self.driver.run(self.sink)
            except DeviceError as problem:
                self.problems.append(problem)
                await clock.sleep(0.5)


@asynccontextmanager
async def rig(device: Lms200Twin, *faults: Fault, **settings: Any) -> AsyncIterator[Rig]:
    """A driver kept running; taking leave at the end."""
    line = Line(device, np.random.default_rng(5), "laser", faults=faults)
    it = Rig(Lms200(Lms200Settings(**settings), line.link), line)
    carrying = asyncio.create_task(line.run())
    running = asyncio.create_task(it.keep_running())
    yield it
    running.cancel()
    begun = clock.now()
    with suppress(asyncio.CancelledError):
        await running
    assert clock.now() - begun < 0.5, "taking leave took too long"
    assert not carrying.done()
    carrying.cancel()


def fails(device: Lms200Twin, *faults: Fault, **settings: Any) -> tuple[DeviceError, float]:
    """How one run of the driver ends by itself, and when."""

    async def story() -> tuple[DeviceError, float]:
        line = Line(device, np.random.default_rng(5), "laser", faults=faults)
        carrying = asyncio.create_task(line.run())
        with pytest.raises(DeviceError) as caught:
            await Lms200(Lms200Settings(**settings), line.link).run(lambda _: None)
        carrying.cancel()
        return caught.value, clock.now()

    return clock.run_virtual(story())


def streams(
    device: Lms200Twin, scans: int = 5, within: float = 4.0, begin: float = 0.0, **settings: Any
) -> Rig:
    """A driver, started at `begin`, that got so many scans without any problem, and took leave."""

    async def story() -> Rig:
        await clock.sleep(begin)
        async with rig(device, **settings) as it:
            await it.gets(scans, within)
        return it

    it = clock.run_virtual(story())
    assert not it.problems
    return it
