"""What a driver is to the rest of the daemon."""

from collections.abc import Callable
from typing import Protocol

from followerd.messages import Command, Measurement

Sink = Callable[[Measurement], None]


class Sensor(Protocol):
    """A device that measures."""

    name: str  # in the config, e.g. "laser"

    async def run(self, sink: Sink) -> None:
        """Open, set up and stream into `sink` until cancelled; never returns by itself.

        Raises OpenError, SetupError or LinkLost; may then be run again. On cancellation it takes
        leave of the device in an orderly way within 0.5 s.
        """


class Base(Sensor, Protocol):
    """The robot base: its sensor is odometry; nothing else in the daemon moves wheels."""

    on_sent: Callable[[Command, float], None]  # called with the loop time of the last byte written

    def drive(self, command: Command) -> None:
        """Take over `command` at once: the newest overwrites; it is dropped while not connected.

        The base stops by itself when `command.expires` passes without a newer one.
        """

    def enable_motors(self, on: bool) -> None:
        """Ask for motors on (sent once the base is seen standing) or off (sent at once)."""
