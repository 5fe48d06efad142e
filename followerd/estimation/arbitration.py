"""Motai's choice between Kalman filter and optical flow (Motai, Jha and Kruse 2012, eq. 46-49)."""

from math import cos, hypot, radians

from followerd.estimation.direction import Look
from followerd.estimation.direction_flow import Of
from followerd.estimation.direction_kf import Kf
from followerd.estimation.pan_flow import Pair


class OfKf:
    """Eq. 46-49: the Kalman filter on straights, the flow in turns, told apart by a triangle.

    The triangle's corners are the last three directions: in pixels of a moving camera it would be
    another one. Below `floor` px between two looks its angle is noise, and the filter is taken.
    """

    def __init__(
        self,
        accel: float = radians(40.0),
        sigma: float = radians(0.7),
        straight: float = radians(160.0),
        floor: float = 8.0,
        reopen: float = 0.0,
    ) -> None:
        """`reopen`, rad/s, is added to the filter's rate in a turn (ours; 0 is the paper)."""
        self._kf, self._of = Kf(accel, sigma), Of()
        self._least, self._floor, self._reopen = cos(straight), floor, reopen * reopen
        self._path: list[Pair] = []
        self.turns = False

    def step(self, look: Look) -> None:
        """See Predictor."""
        direction = look.angles
        self._kf.take(direction, look.stamp)
        self._of.take(direction, look)
        self._path = [*self._path[-2:], direction]
        self.turns = len(self._path) == 3 and self._is_turn(look.focal)
        if self.turns and self._reopen and self._kf.axes is not None:
            for axis in self._kf.axes:
                axis.P11 += self._reopen

    def ahead(self, dt: float) -> Pair:
        """See Predictor."""
        return (self._of if self.turns else self._kf).ahead(dt)

    def _is_turn(self, focal: float) -> bool:
        (ax, ay), (bx, by), (cx, cy) = self._path
        ux, uy, wx, wy = cx - bx, cy - by, ax - bx, ay - by
        a, b = hypot(ux, uy), hypot(wx, wy)
        if min(a, b) * focal < self._floor:
            return False
        return ux * wx + uy * wy > self._least * a * b
