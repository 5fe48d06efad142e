"""A robot body on an endless floor and a device on its AUX port, for tests of twin and driver."""

from collections.abc import Callable, Sequence
from math import inf

from followerd.geometry import Pose2


class FloorBody:
    """Rolls as driven, unless a wheel is held."""

    def __init__(self, half_track: float = 0.001 / 0.0056) -> None:
        self.pose = Pose2()
        self.speeds = (0.0, 0.0)  # left, right, m/s
        self.blocked = (False, False)
        self.bumpers = (0, 0)
        self.echo = 5.0  # m, what every sonar disc measures
        self.wheel_travel = (0.0, 0.0)
        self._half_track = half_track
        self._now = 0.0

    @property
    def is_still(self) -> bool:
        """Whether no wheel is driven."""
        return self.speeds == (0.0, 0.0)

    @property
    def rolled(self) -> float:
        """Sum of both wheels' travel, m."""
        return sum(abs(travel) for travel in self.wheel_travel)

    def advance(self, now: float) -> None:
        """Roll on to `now`."""
        dt = max(now - self._now, 0.0)
        left, right = (
            0.0 if held else speed for held, speed in zip(self.blocked, self.speeds, strict=True)
        )
        self.wheel_travel = (self.wheel_travel[0] + left * dt, self.wheel_travel[1] + right * dt)
        turn = (right - left) / 2 / self._half_track
        self.pose = self.pose.moved((left + right) / 2, turn, dt)
        self._now = max(now, self._now)

    def drive(self, left: float, right: float) -> None:
        """Wheel speeds from now on."""
        self.speeds = (left, right)

    def sonar(self, discs: Sequence[Pose2]) -> list[float]:
        """The same from every disc."""
        return [self.echo] * len(discs)


class AuxDevice:
    """A device that answers at once what `reply` makes of the bytes it hears."""

    def __init__(self, reply: Callable[[bytes], bytes], baud: int = 9600) -> None:
        self.baud = baud
        self.heard: list[tuple[float, bytes]] = []
        self._reply = reply
        self._out = b""
        self._due = inf

    def receive(self, data: bytes, now: float) -> None:
        self.heard.append((now, data))
        self._out += self._reply(data)
        self._due = now

    def step(self, now: float) -> bytes:
        data, self._out, self._due = self._out, b"", inf
        return data

    def wake_at(self) -> float:
        return self._due

    def reboot(self, now: float) -> None:
        self._out, self._due = b"", inf
