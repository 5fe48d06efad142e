"""What twins need of the world, and what the line needs of a twin."""

from collections.abc import Sequence
from typing import Protocol

from followerd.geometry import Array, Camera, Pose2
from followerd.messages import Pixels


class Body(Protocol):
    """The robot's body in the world, as its base controller feels it."""

    @property
    def wheel_travel(self) -> tuple[float, float]:
        """Path rolled by the left and right wheel since the start, as the encoders say, m."""

    @property
    def blocked(self) -> tuple[bool, bool]:
        """Whether the left, right wheel is held by an obstacle."""

    @property
    def bumpers(self) -> tuple[int, int]:
        """Bit masks of pressed front and rear bumpers."""

    def advance(self, now: float) -> None:
        """Move the whole world on to `now`."""

    def drive(self, left: float, right: float) -> None:
        """Wheel surface speeds from now on, m/s."""

    def sonar(self, discs: Sequence[Pose2]) -> list[float]:
        """Range in m of each disc (`base_from_disc`), 5.0 without echo."""


class Scene(Protocol):
    """What range finders and cameras see of the world from the robot."""

    def advance(self, now: float) -> None:
        """Move the whole world on to `now`."""

    def ranges(self, base_from_laser: Pose2, bearings: Array, ages: Array) -> Array:
        """True ranges (N,) of beams measured `ages` seconds before the world's now; inf = none."""

    def render(self, camera: Camera) -> Pixels:
        """A noisy colour image (H, W, 3) BGR of the world's now."""


class Twin(Protocol):
    """A simulated serial device: pure state, moved by bytes and by time."""

    baud: int  # line rate of its UART now

    def receive(self, data: bytes, now: float) -> None:
        """Bytes from the host, at the right line rate."""

    def step(self, now: float) -> bytes:
        """Do what is due; return the bytes that start to leave the device now."""

    def wake_at(self) -> float:
        """Loop time at which `step` is due next; inf = not by itself."""

    def reboot(self, now: float) -> None:
        """Lose power and start anew: settings that are not kept, a session, a motion are gone."""
