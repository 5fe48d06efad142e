"""What comes of a driver on a bad line: supervised as in the daemon, in virtual time."""

import asyncio
from dataclasses import dataclass, field
from math import inf

from followerd import clock
from followerd.errors import DeviceError
from followerd.messages import Fault, Measurement
from followerd.runtime.supervisor import supervise
from tests.specimens import SPECIMENS, BadLine, is_excused


@dataclass
class Outcome:
    """What came of a driver on a bad line."""

    length: float  # s, of the fault
    untrue: list[str] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)  # when measurements came, s
    reports: list[Fault] = field(default_factory=list)
    began: float = inf  # s, the fault
    moved_since_report: float = 0.0  # s spent moving later than the base's own watchdog allows

    @property
    def ended(self) -> float:
        return self.began + self.length

    @property
    def back(self) -> float:
        """Seconds from the fault's end until it measures again."""
        return min((t for t in self.stamps if t > self.ended), default=inf) - self.ended

    def rate(self, first: float, last: float) -> float:
        """Measurements a second between two times."""
        return sum(first < t <= last for t in self.stamps) / (last - first)


WATCHDOG = 2.0 + 0.6  # s, of the base, and the time to brake
STEP = 0.05  # s
UP = 20.0  # s, most that a device takes to be found


async def live_through(
    device: str, line: BadLine, seed: int, length: float, after: float
) -> Outcome:
    """Run a device, let its line be bad for a while, and see what comes of it."""
    specimen, outcome = SPECIMENS[device](line, seed), Outcome(length)

    def sink(measured: Measurement) -> None:
        outcome.stamps.append(clock.now())
        problem = specimen.untrue(measured, line)
        if problem and not (is_excused(device, line) and clock.now() > outcome.began):
            outcome.untrue.append(f"{clock.now():.2f} s: {problem}")

    async def story() -> bool:
        while not outcome.stamps:
            await clock.sleep(STEP)
        await goes_on(2.0 + seed * 0.37 % 1.0)
        outcome.began = clock.now()
        if line.kind is not None:
            specimen.fails(line.kind, length)
        specimen.set_bad(True)
        await goes_on(length)
        specimen.set_bad(False)
        await goes_on(after)
        return True

    async def goes_on(seconds: float) -> None:
        until = clock.now() + seconds
        while clock.now() < until - 1e-6:
            specimen.use(armed=not outcome.reports)
            lost = outcome.reports[0].stamp if outcome.reports else inf
            if clock.now() > lost + WATCHDOG and not specimen.at_rest():
                outcome.moved_since_report += STEP
            await clock.sleep(STEP)

    carrying = asyncio.create_task(specimen.runs())
    watching = asyncio.create_task(supervise(specimen.sensor, sink, outcome.reports.append))
    telling = asyncio.create_task(clock.within(UP + length + after, story()))
    await asyncio.wait([carrying, watching, telling], return_when=asyncio.FIRST_COMPLETED)
    for task in (carrying, watching):
        if task.done():
            task.result()
    assert await telling, "it never worked"
    watching.cancel()
    await asyncio.wait([watching])
    carrying.cancel()
    return outcome


def outcome_of(
    device: str, line: BadLine, seed: int = 0, length: float = 3.0, after: float = 6.0
) -> Outcome:
    """`live_through` in virtual time: a fault of `length` seconds, and `after` that."""
    return clock.run_virtual(live_through(device, line, seed, length, after))


RESTART = 0.5  # s


async def start_up(device: str, line: BadLine, seed: int, share: float, count: int) -> list[float]:
    """When the first `count` measurements come where the line is bad from the start.

    A share of the telegrams is hurt; a driver that gives up is started again.
    """
    specimen, stamps = SPECIMENS[device](line, seed), list[float]()
    enough = asyncio.Event()

    def sink(measured: Measurement) -> None:
        assert not specimen.untrue(measured, line)
        stamps.append(clock.now())
        if len(stamps) == count:
            enough.set()

    async def keep_running() -> None:
        while True:
            try:
                await specimen.sensor.run(sink)
            except DeviceError:
                await clock.sleep(RESTART)

    specimen.set_bad(True)
    carrying = asyncio.create_task(specimen.runs())
    await clock.sleep(0)
    if line.kind is not None:
        specimen.fails(line.kind, inf, share)
    running = asyncio.create_task(keep_running())
    came = asyncio.create_task(clock.within(10 * UP, enough.wait()))
    await asyncio.wait([running, came], return_when=asyncio.FIRST_COMPLETED)
    if running.done():
        running.result()
    running.cancel()
    await asyncio.wait([running])
    carrying.cancel()
    assert await came, "it never worked"
    return stamps
