"""One clock: the event loop's time, real or virtual.

`run(main)` uses the ordinary loop. `run_virtual(main)` uses a loop whose time jumps to the next
timer as soon as nothing is ready: the same program, as fast as it computes, and the same to the
bit every time. There are no threads in virtual time.
"""

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor
from contextlib import suppress
from typing import Any, TypeVar, TypeVarTuple, Unpack

T = TypeVar("T")
Ts = TypeVarTuple("Ts")


def now() -> float:
    """Seconds of the running loop's clock (CLOCK_MONOTONIC in real time)."""
    return asyncio.get_running_loop().time()


async def sleep(seconds: float) -> None:
    """Wait on the loop's clock."""
    await asyncio.sleep(seconds)


async def sleep_until(stamp: float) -> None:
    """Wait until loop time `stamp`; yields once when that has passed."""
    await asyncio.sleep(max(0.0, stamp - now()))


async def within(seconds: float, what: Coroutine[Any, Any, T]) -> T | None:
    """The result of `what`, or None when it takes longer than `seconds`."""
    try:
        async with asyncio.timeout(seconds):
            return await what
    except TimeoutError:
        return None


async def together(*parts: Coroutine[Any, Any, object]) -> None:
    """Run all parts; the first failure cancels the others and is raised as it is."""
    try:
        async with asyncio.TaskGroup() as tasks:
            for part in parts:
                tasks.create_task(part)
    except BaseExceptionGroup as group:
        raise group.exceptions[0] from None


async def until_signal(
    what: Coroutine[Any, Any, object], *signals: int, seconds: float | None = None
) -> None:
    """Run `what` until it ends, a signal comes, or `seconds` have passed."""
    loop = asyncio.get_running_loop()
    task = asyncio.ensure_future(what)
    for number in signals:
        loop.add_signal_handler(number, task.cancel)
    timer = None if seconds is None else loop.call_later(seconds, task.cancel)
    try:
        with suppress(asyncio.CancelledError):
            await task
    finally:
        task.cancel()
        if timer is not None:
            timer.cancel()
        for number in signals:
            loop.remove_signal_handler(number)


class Deadlock(RuntimeError):
    """In virtual time nothing is ready and no timer is set: everything waits for ever."""


class _JumpingSelector(selectors.DefaultSelector):
    """Instead of waiting, moves the clock. File descriptors are never reported ready."""

    def __init__(self) -> None:
        super().__init__()
        self.time = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:
            raise Deadlock("virtual time: nothing is ready and no timer is set")
        self.time += max(0.0, timeout)
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop in virtual time, starting at 0 s."""

    def __init__(self) -> None:
        self._jumping = _JumpingSelector()
        super().__init__(self._jumping)

    def time(self) -> float:
        """Virtual seconds since the loop was made."""
        return self._jumping.time

    def run_in_executor(
        self, executor: Executor | None, func: Callable[[Unpack[Ts]], T], *args: *Ts
    ) -> "asyncio.Future[T]":
        """Refused: a thread would make the run irreproducible."""
        raise RuntimeError(
            f"virtual time has no threads: call {func} in place and delay its result"
            f" ({executor=}, {len(args)} arguments)"
        )


def is_virtual() -> bool:
    """Whether the running loop's time is virtual."""
    return isinstance(asyncio.get_running_loop(), VirtualLoop)


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` in real time."""
    return asyncio.run(main)


def run_virtual(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` in virtual time."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(main)
