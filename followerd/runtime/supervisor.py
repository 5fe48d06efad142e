"""Keeps one device running: re-opens it with back-off after a lost link, and says so."""

from collections.abc import Callable

import structlog

from followerd import clock
from followerd.errors import DeviceError
from followerd.hw.interfaces import Sensor
from followerd.messages import Fault, Measurement, StopReason

FIRST_WAIT = 0.25  # s
LONGEST_WAIT = 0.5  # s; with the time to set a device up it is back within 3 s

log = structlog.get_logger()


async def supervise(
    sensor: Sensor, sink: Callable[[Measurement], None], report: Callable[[Fault], object]
) -> None:
    """Run `sensor` for ever. Raises DeviceError only if it has never worked: that is wiring.

    A return is reported and moves nothing: after a loss the robot must be armed again.
    """
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

    wait, said = FIRST_WAIT, ""
    while True:
        try:
            await sensor.run(deliver)
        except DeviceError as error:
            if not ever:
                raise
            if seen or str(error) != said:
                said = str(error)
                log.warning("device lost", device=sensor.name, error=said)
            report(Fault(clock.now(), sensor.name, StopReason.LINK_LOST, str(error)))
            wait = FIRST_WAIT if seen else min(2 * wait, LONGEST_WAIT)
            seen = False
            await clock.sleep(wait)
