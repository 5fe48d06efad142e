"""Looks that are not the target's: what else is warm stands still, and is seen in bursts."""

from math import exp, pi, sqrt

MOST = 4  # places that are remembered
KNOWN = 3.0  # times as probable is a false look where one was before
AGAIN = 0.4  # probability that a false look is followed by one at the same place
SAME = 4.0  # deviations, within which two looks show the same place


class FalseLooks:
    """How probable a look that is not the target's is at an angle.

    It may be anywhere, where the last false look was, or where false looks were before.
    """

    __slots__ = ("_anywhere", "_last", "_peak", "_places", "_share", "_spread")

    def __init__(self, sigma: float, share: float, field: float) -> None:
        """`sigma` of a look, rad; `share` of the looks are false, within `field`, rad."""
        self._spread = 2.0 * sigma * sigma  # variance of the difference of two looks, rad²
        self._peak = 1.0 / sqrt(2.0 * pi * self._spread)
        self._share, self._anywhere = share, share / field
        self._places: list[float] = []  # rad, the newest last
        self._last: float | None = None  # rad, of the last look if it was false

    def density(self, z: float) -> float:
        """Of a false look at `z`, rad; per rad, times the probability that a look is false."""
        density = self._anywhere
        for place in self._places:
            density += KNOWN * self._share * self._near(z - place)
        if self._last is not None:
            density += AGAIN * self._near(z - self._last)
        return density

    def take(self, z: float, *, false: bool) -> None:
        """The newest look was at `z`, rad, and seems to have been `false` or the target's."""
        self._last = z if false else None

    def learn(self, z: float) -> None:
        """What stands at `z`, rad, is not the target."""
        near = SAME * sqrt(self._spread)
        self._places = [place for place in self._places if abs(place - z) > near][1 - MOST :]
        self._places.append(z)

    def _near(self, off: float) -> float:
        return self._peak * exp(-0.5 * off * off / self._spread)
