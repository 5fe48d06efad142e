"""What a driver is to the rest of the daemon."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from followerd.messages import Chassis, Command, Measurement

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

    @property
    def chassis(self) -> Chassis | None:
        """Of the base connected now, or last; None: not known yet."""

    def drive(self, command: Command) -> None:
        """Take over `command` at once: the newest overwrites; it is dropped while not connected.

        The base stops by itself when `command.expires` passes without a newer one.
        """

    def enable_motors(self, on: bool) -> None:
        """Ask for motors on (sent once the base is seen standing) or off (sent at once)."""


class PanTilt(Sensor, Protocol):
    """A camera's head: its sensor is where it points (PtzState); it moves only when asked.

    Each call overwrites a pending one; all are dropped while not connected.
    """

    def look(self, pan: float, tilt: float, rate: float | None = None) -> None:
        """Turn to `pan` (rad, left positive) and `tilt` (rad, up positive), or as far as it goes.

        Both count from the head's home position. With a `rate` (rad/s, left positive) the goal
        moves: where the head can, it keeps pace until it is told anew.
        """

    def zoom(self, factor: float) -> None:
        """Zoom to `factor` times the widest focal length, or as far as it goes."""


@runtime_checkable
class Herald(Protocol):
    """A sensor on a slow line: it tells when the first bytes of a measurement are here."""

    on_begun: Callable[[str], None]  # called with the stream's name


@runtime_checkable
class CountsErrors(Protocol):
    """A sensor that knows how often something came broken, or not at all."""

    @property
    def errors(self) -> int:
        """Telegrams, packets, answers or frames, since the driver was made."""


@runtime_checkable
class ExposureLock(Protocol):
    """A camera, or its stream, that can be kept from adjusting itself."""

    def lock_exposure(self, locked: bool = True) -> None:
        """Hold exposure, gain and white balance as they are, or free them; returns at once."""
