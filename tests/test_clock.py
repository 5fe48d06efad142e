"""Virtual time jumps, is exact and refuses what would make it irreproducible."""

import asyncio
import time
from collections.abc import Callable, Coroutine

import pytest

from followerd import clock


def test_an_hour_passes_at_once() -> None:
    async def main() -> float:
        await clock.sleep(3600)
        return clock.now()

    began = time.monotonic()
    assert clock.run_virtual(main()) == pytest.approx(3600)
    assert time.monotonic() - began < 60  # an hour passes at once


def test_timers_fire_in_order_of_their_time() -> None:
    order: list[int] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        for delay in (3, 1, 2):
            loop.call_later(delay, order.append, delay)
        await clock.sleep(5)

    clock.run_virtual(main())
    assert order == [1, 2, 3]


def test_timers_of_one_time_fire_in_the_order_they_were_set() -> None:
    order: list[int] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        timers = [loop.call_at(1.0, order.append, k) for k in range(20)]
        timers[7].cancel()
        await clock.sleep(2)

    clock.run_virtual(main())
    assert order == [k for k in range(20) if k != 7]


def test_waiting_for_ever_is_an_error_not_a_hang() -> None:
    async def main() -> None:
        await asyncio.Event().wait()

    with pytest.raises(clock.Deadlock):
        clock.run_virtual(main())


def test_threads_are_refused_in_virtual_time() -> None:
    async def main() -> None:
        await asyncio.to_thread(lambda: None)

    with pytest.raises(RuntimeError, match="virtual time has no threads"):
        clock.run_virtual(main())


def test_within_gives_none_when_it_takes_too_long() -> None:
    async def main() -> tuple[float | None, float | None]:
        async def slow(seconds: float) -> float:
            await clock.sleep(seconds)
            return seconds

        return await clock.within(1.0, slow(2.0)), await clock.within(1.0, slow(0.5))

    assert clock.run_virtual(main()) == (None, 0.5)


def test_real_and_virtual_loops_are_told_apart() -> None:
    async def main() -> bool:
        return clock.is_virtual()

    assert clock.run_virtual(main())
    assert not clock.run(main())


def test_a_part_that_fails_while_it_is_cancelled_does_not_outlive_the_end() -> None:
    """As a device whose line goes dead in the moment in which the daemon ends."""
    turns: list[int] = []

    async def device() -> None:
        try:
            await clock.forever()
        finally:
            raise ConnectionError("the line went dead")

    async def supervised() -> None:
        while True:
            turns.append(1)
            try:
                await clock.together(device())
            except ConnectionError:
                await clock.sleep(0.5)

    assert clock.run_virtual(clock.within(5.0, clock.together(supervised()))) is None
    assert turns == [1]
    assert clock.run_virtual(ended_at_once(supervised)) < 0.1


async def ended_at_once(part: Callable[[], Coroutine[object, object, None]]) -> float:
    """How long a part goes on once it is cancelled, s."""
    running = asyncio.ensure_future(clock.together(part()))
    await clock.sleep(1.0)
    began = clock.now()
    running.cancel()
    done, _ = await asyncio.wait([running], timeout=5.0)
    assert done
    return clock.now() - began
