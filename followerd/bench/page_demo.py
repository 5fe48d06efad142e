"""A demonstration in real time, beside which something is switched on and off by turns.

What a machine does in its slow phases falls on both sides alike: only so can a cost of a tenth of a
millisecond be seen.
"""

import asyncio
import json
import os
import re
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager, suppress
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path

import numpy as np

from followerd import clock
from followerd.errors import UsageError
from followerd.geometry import Array

CAMERA = "640x480@30"
PIECES = 3.0, 5.0, 4.0, 6.0  # s, in turn: uneven, lest one side fall on what the person repeats
BEGINS = 5.0  # s that a demonstration needs until it follows
LONGEST = 3600.0  # s that a demonstration may take
SETTLES = 1.5  # s after a switch that count for neither side
TICK = os.sysconf("SC_CLK_TCK")  # 1/s

Beside = Callable[[str], AbstractAsyncContextManager[None]]  # given the page's address


@dataclass
class Side:
    """All pieces without, or all pieces with."""

    pieces: list[tuple[float, float]] = field(default_factory=list)  # loop time, s
    cpu: float = 0.0  # s
    late: dict[str, Array] = field(default_factory=dict)  # ms, by what was late

    def percentile(self, name: str, share: float) -> float:
        """Of what was late, ms."""
        return float(np.percentile(self.late[name], share))

    @property
    def cpu_percent(self) -> float:
        """Of a core."""
        return 100.0 * self.cpu / sum(end - begin for begin, end in self.pieces)


async def by_turns(
    folder: Path, seconds: float, beside: Beside, *arguments: str
) -> tuple[Side, Side]:
    """Without and with `beside`, for `seconds` each."""
    file, sides = folder / "timings.json", (Side(), Side())
    async with demo("--timings", str(file), *arguments, state=folder) as (process, address):
        await clock.sleep(BEGINS)
        lengths = cycle(PIECES)
        while sum(end - begin for begin, end in sides[1].pieces) < seconds:
            length = next(lengths)
            await _piece(process, sides[0], length)
            async with beside(address):
                await _piece(process, sides[1], length)
        process.terminate()
        await process.wait()
    for name, pairs in json.loads(file.read_text()).items():
        when, late = np.array(pairs, float).reshape(-1, 2).T
        for side in sides:
            inside = [(begin <= when) & (when < end) for begin, end in side.pieces]
            side.late[name] = 1000.0 * late[np.any(inside, axis=0)]
    return sides


async def _piece(process: Process, side: Side, length: float) -> None:
    await clock.sleep(SETTLES)
    begin, used = clock.now(), _cpu(process.pid)
    await clock.sleep(length)
    side.pieces.append((begin, clock.now()))
    side.cpu += _cpu(process.pid) - used


@asynccontextmanager
async def demo(*arguments: str, state: Path) -> AsyncIterator[tuple[Process, str]]:
    """A demonstration, and the address of its page; it records into the folder `state`."""
    command = [sys.executable, "-m", "followerd", "demo", "--camera", CAMERA]
    command += ["--duration", str(LONGEST), *arguments]
    surroundings = {**os.environ, "STATE_DIRECTORY": str(state)}
    process = await asyncio.create_subprocess_exec(
        *command, stdout=PIPE, stderr=PIPE, env=surroundings
    )
    assert process.stdout is not None
    assert process.stderr is not None
    drain = asyncio.create_task(process.stderr.read())
    try:
        address = ""
        while line := (await process.stdout.readline()).decode():
            if found := re.match(r"page: (\S+)", line):
                address = found[1]
                break
        if not address:
            raise UsageError(f"the demonstration did not start: {(await drain).decode()[-300:]}")
        yield process, address
    finally:
        with suppress(ProcessLookupError):
            process.terminate()
        await process.wait()
        drain.cancel()


def _cpu(process: int) -> float:
    """Of a demonstration's daemon and its helpers, not of its simulation, s."""
    return sum(map(_own_cpu, (process, *_helpers(process))))


def _helpers(process: int) -> Iterator[int]:
    for tasks in Path(f"/proc/{process}/task").glob("*/children"):
        for child in map(int, tasks.read_text().split()):
            if b"followerd\0sim\0" not in Path(f"/proc/{child}/cmdline").read_bytes():
                yield child


def _own_cpu(process: int) -> float:
    used = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]
    return sum(map(int, used)) / TICK
