"""Sensors without a daemon: run for a while, for what a calibration wants to see."""

import asyncio
from collections.abc import Callable, Sequence

from followerd import clock
from followerd.hw.interfaces import Sensor, Sink

LOOK = 0.05  # s
TELLS = 10.0  # s, between words to the person who waits


async def watch(
    sensors: Sequence[Sensor],
    take: Sink,
    begins: Callable[[], bool],
    seconds: float,
    tell: Callable[[float], None],
) -> None:
    """Run `sensors` into `take` for `seconds` from when it `begins`; `tell` of the seconds left.

    Raises what a driver raises: a calibration does not go on without one.
    """
    tasks = [asyncio.create_task(sensor.run(take)) for sensor in sensors]

    async def rest() -> None:
        await clock.sleep(LOOK)
        for task in tasks:
            if task.done():
                task.result()

    try:
        while not begins():
            await rest()
        end = clock.now() + seconds
        due = clock.now()
        while clock.now() < end:
            if clock.now() >= due:
                tell(end - clock.now())
                due += TELLS
            await rest()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
