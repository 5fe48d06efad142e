"""What the head was asked for, what it was told, and whether it got there."""

Goal = tuple[int, ...]
TRIES = 3  # times a goal is told again that was not reached: the command was damaged under way


class Pursuit:
    """The newest goal overwrites a pending one."""

    def __init__(self, near: int, tolerance: int) -> None:
        self.wanted: Goal | None = None
        self.told: list[Goal] = []  # what it may be on its way to, the newest last
        self._tries = 0
        self._near = near  # a goal so near the one under way waits for its end
        self._tolerance = tolerance

    def want(self, goal: Goal) -> None:
        """Go there."""
        if goal != self.wanted:
            self.wanted, self._tries = goal, 0

    def due(self, at: Goal, *, moves: bool) -> Goal | None:
        """The goal to be told now to a head that is `at` a place."""
        if self.wanted is None:
            return None
        if not self.told or self.wanted != self.told[-1]:
            waits = moves and self.told and _apart(self.wanted, self.told[-1]) <= self._near
            return None if waits else self.wanted
        missed = not moves and _apart(self.wanted, at) > self._tolerance
        return self.wanted if missed and self._tries < TRIES else None

    def tell(self, goal: Goal) -> None:
        """It was told to go there."""
        self._tries += goal in self.told[-1:]
        self.told = [*self.told[-1:], goal]

    def rest(self) -> None:
        """It stands: no older goal draws it any more."""
        self.told = self.told[-1:]

    def give_up(self) -> None:
        """Want nothing."""
        self.wanted = None


def _apart(one: Goal, other: Goal) -> int:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))
