"""Keeping pace with a goal that moves: which way to run, and how fast. Pure; time is an argument.

A move to a place must be ended before another is taken, and costs all speed; the speed of a run
may be changed while it runs.
"""

from dataclasses import dataclass

from followerd.hw.vcc50i.models import SLOWEST

GAIN = 5.0  # 1/s, speed per step that it is off
REACTS = 0.02  # s from a measurement to the effect of what follows from it
CARRIED = 0.4  # s for which a goal is believed to move on
FINER = 12  # steps/s, a change of speed that is not worth telling
REST = 24  # steps/s, slower is standing: it would only creep


@dataclass(frozen=True, slots=True)
class Goal:
    """Where to pan, and how fast that moves; steps, as the camera counts them."""

    pan: int
    rate: float  # steps/s
    since: float  # s

    def at(self, now: float) -> float:
        """Where it is by now."""
        return self.pan + self.rate * min(now - self.since, CARRIED)


class Chase:
    """Speeds (steps/s, right positive) for the positions that are measured; 0 is a stop."""

    def __init__(self, fastest: int, ends: tuple[int, int]) -> None:
        self.goal: Goal | None = None
        self.told = 0  # speed it runs at
        self._fastest = fastest
        self._ends = ends
        self._last: tuple[int, float] | None = None  # position and its stamp, s

    def speed(self, pan: int, stamp: float, now: float) -> int:
        """The speed to run at from `now`, by a position measured at `stamp`."""
        assert self.goal is not None
        last, self._last = self._last, (pan, stamp)
        runs = 0.0
        if last is not None and 0.0 < stamp - last[1] < 0.5:
            runs = (pan - last[0]) / (stamp - last[1])
        later = now + REACTS
        low, high = self._ends
        goal = min(max(self.goal.at(later), low), high)
        rate = self.goal.rate if later - self.goal.since < CARRIED and low < goal < high else 0.0
        wanted = rate + GAIN * (goal - pan - runs * (later - stamp))
        wanted = min(max(wanted, -self._fastest), self._fastest)
        if abs(wanted) < REST:
            return 0
        speed = max(SLOWEST, round(abs(wanted)))
        return speed if wanted > 0 else -speed

    def turns_back(self, speed: int) -> bool:
        """Whether it runs the wrong way."""
        return speed * self.told < 0

    def is_news(self, speed: int) -> bool:
        """Whether it is worth telling."""
        turns = speed * self.told <= 0 and speed != self.told
        return turns or abs(speed - self.told) > FINER
