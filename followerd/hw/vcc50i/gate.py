"""Whether a reported position can be true: frames carry no checksum."""

from collections.abc import Sequence
from dataclasses import dataclass

AGREE = 3

Position = tuple[int, ...]  # of each axis, in its own units


@dataclass(frozen=True, slots=True)
class _Sighting:
    position: Position
    stamp: float  # s


class PositionGate:
    """Lets a position pass that lies on the way from the last one to a goal, and not too far.

    Another is held back until as many as AGREE in a row fit each other: somebody may have turned
    the head. Only damage that does the same to all of them would pass.
    """

    def __init__(
        self, ends: tuple[tuple[int, int], ...], speeds: tuple[int, ...], slack: int
    ) -> None:
        self._ends = ends  # of each axis
        self._speeds = speeds  # at most, per second
        self._slack = slack
        self._last: _Sighting | None = None  # that passed
        self._doubtful: list[_Sighting] = []  # those since, each fitting the one before

    def passes(self, position: Position, stamp: float, goals: Sequence[Position]) -> bool:
        """Whether `position` at `stamp` may be believed of what is on its way to one of `goals`.

        Without any, it may be on its way to anywhere.
        """
        sighting = _Sighting(position, stamp)
        inside = all(
            low - self._slack <= place <= high + self._slack
            for place, (low, high) in zip(position, self._ends, strict=True)
        )
        fits = inside and self._last is not None and self._leads(self._last, sighting, goals)
        if inside and not fits:
            if self._doubtful and not self._leads(self._doubtful[-1], sighting, ()):
                self._doubtful.clear()
            self._doubtful.append(sighting)
            fits = len(self._doubtful) == AGREE
        if fits:
            self._last, self._doubtful = sighting, []
        return fits

    def forget(self) -> None:
        """It may be anywhere now."""
        self._last, self._doubtful = None, []

    def _leads(self, before: _Sighting, after: _Sighting, goals: Sequence[Position]) -> bool:
        """Whether it may have come from there to here."""
        elapsed = max(after.stamp - before.stamp, 0.0)
        for axis, speed in enumerate(self._speeds):
            here, there = after.position[axis], before.position[axis]
            if abs(here - there) > speed * elapsed + self._slack:
                return False
            ways = (there, *(goal[axis] for goal in goals))
            if goals and not min(ways) - self._slack <= here <= max(ways) + self._slack:
                return False
        return True
