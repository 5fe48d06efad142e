"""Keeps one device running: re-opens it with back-off after a lost link, and says so."""

from collections.abc import Callable

import structlog

from followerd import clock
from followerd.errors import DeviceError
from followerd.hw.interfaces import Sensor
from followerd.messages import Fault, Measurement, StopReason

FIRST_WAIT = 0.25  # s
LONGEST_WAIT = 4.0  # s

log = structlog.get_logger()


async def supervise(
    sensor: Sensor, sink: Callable[[Measurement], None], report: Callable[[Fault], object]
) -> None:
    """Run `sensor` for ever. Raises DeviceError only if it has never worked: that is wiring."""
    seen = False  # since the last fault
    ever = False

    def deliver(measurement: Measurement) -> None:
        nonlocal seen, ever
        if not seen:
            seen = True
            log.info("device up", device=sensor.name)
            if ever:
                report(Fault(clock.now(), sensor.name, StopReason.LINK_LOST, recovered=True))
            ever = True
        sink(measurement)

    wait = FIRST_WAIT
    while True:
        try:
            await sensor.run(deliver)
        except DeviceError as error:
            if not ever:
                raise
            log.warning("device lost", device=sensor.name, error=str(error), retry_s=wait)
            report(Fault(clock.now(), sensor.name, StopReason.LINK_LOST, str(error)))
            wait = FIRST_WAIT if seen else min(2 * wait, LONGEST_WAIT)
            seen = False
            await clock.sleep(wait)
