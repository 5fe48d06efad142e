"""One clock: the event loop's time, real or virtual.

`run(main)` uses the ordinary loop. `run_virtual(main)` uses a loop whose time jumps to the next
timer as soon as nothing is ready: the same program, as fast as it computes, and the same to the
bit every time. There are no threads in virtual time.
"""

import asyncio
import time
from collections import deque
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor
from contextlib import suppress
from contextvars import Context
from heapq import heappop, heappush
from itertools import count
from typing import Any, TypeVar, TypeVarTuple, Unpack

T = TypeVar("T")
Ts = TypeVarTuple("Ts")


def now() -> float:
    """Seconds of the running loop's clock (CLOCK_MONOTONIC in real time)."""
    return asyncio.get_running_loop().time()


def epoch() -> float:
    """What the wall clock reads at loop time 0, s; in virtual time 0. Only for people's eyes."""
    return 0.0 if is_virtual() else time.time() - now()


async def sleep(seconds: float) -> None:
    """Wait on the loop's clock."""
    await asyncio.sleep(seconds)


async def sleep_until(stamp: float) -> None:
    """Wait until loop time `stamp`; yields once when that has passed."""
    await asyncio.sleep(max(0.0, stamp - now()))


async def forever() -> None:
    """Wait until cancelled."""
    await asyncio.Event().wait()


async def within(seconds: float, what: Coroutine[Any, Any, T]) -> T | None:
    """The result of `what`, or None when it takes longer than `seconds`."""
    try:
        async with asyncio.timeout(seconds):
            return await what
    except TimeoutError:
        return None


async def together(*parts: Coroutine[Any, Any, object]) -> None:
    """Run all parts; the first failure cancels the others and is raised as it is.

    Cancelled from outside it ends, whatever the parts then raise: a device whose line goes dead in
    that moment must not keep the rest alive. (A TaskGroup would raise what it raised instead.)
    """
    tasks = [asyncio.ensure_future(part) for part in parts]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)
        failed = [task for task in tasks if task.done() and not task.cancelled()]
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    for task in failed:
        task.result()


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


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop in virtual time, starting at 0 s.

    Instead of waiting it moves its clock; timers of one time fire in the order they were set.
    File descriptors are never looked at. asyncio's own turn of the loop would do, with a selector
    that never waits, but costs half as much again, and a run has a thousand turns a second.
    """

    def __init__(self) -> None:
        self._now = 0.0
        self._soon: deque[asyncio.Handle] = deque()
        self._timers: list[tuple[float, int, asyncio.TimerHandle]] = []
        self._count = count()
        super().__init__()

    def time(self) -> float:
        """Virtual seconds since the loop was made."""
        return self._now

    def call_soon(
        self,
        callback: Callable[[Unpack[Ts]], object],
        *args: *Ts,
        context: Context | None = None,
    ) -> asyncio.Handle:
        """See asyncio."""
        handle = asyncio.Handle(callback, args, self, context)
        self._soon.append(handle)
        return handle

    def call_at(
        self,
        when: float,
        callback: Callable[[Unpack[Ts]], object],
        *args: *Ts,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        """See asyncio."""
        handle = asyncio.TimerHandle(when, callback, args, self, context)
        heappush(self._timers, (when, next(self._count), handle))
        return handle

    def _run_once(self) -> None:
        """One turn: what is ready, or else the next timer; asyncio calls it for ever."""
        timers = self._timers
        if not self._soon:
            while timers and timers[0][2].cancelled():
                heappop(timers)
            if not timers:
                raise Deadlock("virtual time: nothing is ready and no timer is set")
            self._now = max(self._now, timers[0][0])
        while timers and timers[0][0] <= self._now:
            self._soon.append(heappop(timers)[2])
        for _ in range(len(self._soon)):
            handle = self._soon.popleft()
            if not handle.cancelled():
                handle._run()

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
