"""What a follow law is to the pipeline, and what it is told."""

from dataclasses import dataclass
from typing import Protocol

from followerd.messages import Wish


@dataclass(frozen=True, slots=True)
class Target:
    """The followed person, seen from `base` now."""

    bearing: float  # rad, left positive
    range: float | None = None  # m; None = unknown
    velocity: tuple[float, float] = (0.0, 0.0)  # m/s over the ground, along the axes of `base`


class Controller(Protocol):
    """A follow law: it only wishes; the modes and the guard decide."""

    def wish(self, target: Target) -> Wish:
        """The motion that follows `target`."""
