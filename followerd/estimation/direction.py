"""A look at a target, and what foresees where the next one will find it.

Motai, Jha and Kruse 2012, repaired where it cannot work; each predictor is told of every look and
says where the target will be `dt` later. Plain floats: a step costs microseconds.
"""

from dataclasses import dataclass
from typing import Protocol

from followerd.estimation.pan_flow import Pair, angles


@dataclass(frozen=True, slots=True)
class Look:
    """The target in one image, and how the head stood; image and angles as in pan_flow."""

    stamp: float  # s
    x: float  # px
    y: float  # px
    pan: float  # rad
    tilt: float  # rad
    focal: float  # px
    flow: Pair | None = None  # px/s, measured; None: from this look and the one before
    ahead: float = 0.0  # m/s, of the camera along its axis
    depth: float | None = None  # m, of the target

    @property
    def angles(self) -> Pair:
        """Its direction (pan, tilt), rad."""
        return angles(self.x, self.y, self.pan, self.tilt, self.focal)


class Predictor(Protocol):
    """Takes looks, foresees directions."""

    def step(self, look: Look) -> None:
        """Take the next look; later than the one before."""

    def ahead(self, dt: float) -> Pair:
        """The direction (pan, tilt), rad, `dt` s after the newest look."""
