"""A process beside the daemon stops the base when the loop is blocked or gone (F5, F6)."""

import asyncio
import ctypes
import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from followerd.hw.p2os.writer import HALT
from followerd.hw.port_errors import users_of
from followerd.hw.serial import TtyLink
from followerd.runtime.heartbeat import Heartbeat

pytestmark = pytest.mark.realtime


@pytest.fixture
def line() -> Iterator[tuple[int, str]]:
    """A line: the base's end, and the path of the daemon's."""
    base, ours = pty.openpty()
    try:
        yield base, os.ttyname(ours)
    finally:
        os.close(base)
        os.close(ours)


def heard(base: int, seconds: float) -> bytes:
    """What the base has heard, and hears in so long."""
    data, end = b"", time.monotonic() + seconds
    while select.select([base], [], [], max(0.0, end - time.monotonic()))[0]:
        data += os.read(base, 4096)
    return data


EAR = """
import os, sys, time
print("up", flush=True)
data = os.read(int(sys.argv[1]), 4096)
print(time.monotonic(), data.hex(), flush=True)
"""


@contextmanager
def ear(base: int) -> Iterator[Callable[[], tuple[float, bytes]]]:
    """A process that listens while this one is blocked: when it first heard something, and what."""
    command = [sys.executable, "-c", EAR, str(base)]
    with subprocess.Popen(command, pass_fds=[base], stdout=subprocess.PIPE, text=True) as process:
        out = process.stdout
        assert out is not None
        out.readline()

        def first() -> tuple[float, bytes]:
            stamp, _, data = out.readline().partition(" ")
            return float(stamp), bytes.fromhex(data)

        try:
            yield first
        finally:
            process.kill()


def tell(what: str, seconds: float) -> None:
    sys.stdout.write(f"{what}: the last resort said STOP after {seconds:.3f} s\n")


def hold_the_interpreter(seconds: float) -> None:
    """A call into C that keeps every other thread out."""
    ctypes.PyDLL(None).usleep(round(1e6 * seconds))


@pytest.mark.parametrize(
    "block", [time.sleep, pytest.param(hold_the_interpreter, marks=pytest.mark.slow)]
)
async def test_a_blocked_loop_is_noticed_from_outside(
    line: tuple[int, str], block: Callable[[float], object]
) -> None:
    base, path = line
    heartbeat = Heartbeat(HALT)
    running = asyncio.ensure_future(heartbeat.run())
    stream = await heartbeat.guarded(TtyLink(path)).open("base", 9600)
    await asyncio.sleep(0.6)
    assert heard(base, 0.0) == b""  # a loop that lives is left alone
    with ear(base) as first:
        began = time.monotonic()
        block(1.0)
        stamp, said = first()
    assert said.startswith(HALT)
    assert stamp - began < 1.0  # while it was blocked
    tell(f"{block.__name__} in the loop", stamp - began)
    await asyncio.sleep(0.5)
    heard(base, 0.0)
    await asyncio.sleep(0.5)
    assert heard(base, 0.0) == b""  # and again
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    stream.close()
    assert heard(base, 0.2) == b""  # an orderly end needs no last resort


async def test_a_port_that_hung_up_is_let_go_and_a_closed_one_opens_again() -> None:
    heartbeat = Heartbeat(HALT)
    running = asyncio.ensure_future(heartbeat.run())
    base, ours = pty.openpty()
    path = os.ttyname(ours)
    os.close(ours)
    link = heartbeat.guarded(TtyLink(path))
    (await link.open("base", 9600)).close()
    stream = await link.open("base", 9600)  # the copy of the first is no hindrance
    await until(lambda: len(users_of(path)) == 2)
    os.close(base)
    stream.close()
    await until(lambda: not users_of(path))
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def until(holds: Callable[[], bool]) -> None:
    """Wait for it."""
    for _ in range(1000):
        if holds():
            return
        await asyncio.sleep(0.02)
    raise AssertionError("in vain")


DAEMON = """
import asyncio, sys
from followerd.hw.p2os.writer import HALT
from followerd.hw.serial import TtyLink
from followerd.runtime.heartbeat import Heartbeat
async def main():
    heartbeat = Heartbeat(HALT)
    running = asyncio.ensure_future(heartbeat.run())
    await heartbeat.guarded(TtyLink(sys.argv[1])).open("base", 9600)
    print("up", flush=True)
    await running
asyncio.run(main())
"""


@pytest.mark.slow
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_daemon_that_is_killed_or_frozen_is_outlived(
    line: tuple[int, str], end: signal.Signals
) -> None:
    base, path = line
    with subprocess.Popen([sys.executable, "-c", DAEMON, path], stdout=subprocess.PIPE) as daemon:
        assert daemon.stdout is not None
        daemon.stdout.readline()
        time.sleep(0.6)
        assert heard(base, 0.0) == b""
        with ear(base) as first:
            began = time.monotonic()
            daemon.send_signal(end)
            stamp, said = first()
        assert said.startswith(HALT)
        tell(end.name, stamp - began)
        daemon.kill()
    heard(base, 1.0)
    assert heard(base, 1.0) == b""  # nothing keeps the base's own watchdog quiet
