"""Who may switch the motors on."""

from math import inf

RETRY = 0.5  # s


class MotorPower:
    """Asks for motors on or off until a status packet shows it; a person's switch-off stands.

    Motors that went off other than by our ENABLE 0, or while the STOP button was pressed, are
    never switched on again by us: the person presses MOTORS.
    """

    def __init__(self) -> None:
        self.is_taken = False  # a person switched them off
        self._were_on = False
        self._wish: bool | None = None  # not yet seen
        self._tried = -inf  # s

    def start_session(self) -> None:
        """The controller switches motors off at every connection."""
        self._were_on = False
        self._wish = None

    def ask(self, on: bool) -> bool:
        """Wish for power on or off; False when a person's switch-off forbids it."""
        if on and self.is_taken:
            return False
        self._wish = on
        self._tried = -inf
        return True

    def note(self, on: bool, stop_button: bool) -> None:
        """A status packet says how it is."""
        if stop_button or (self._were_on and not on and self._wish is not False):
            self.is_taken = True
        elif on:
            self.is_taken = False
        if self.is_taken and self._wish:
            self._wish = None
        self._were_on = on
        if self._wish is on:
            self._wish = None

    def due(self, now: float, is_settled: bool) -> bool | None:
        """What is to be sent now: True for ENABLE 1 (once the base is settled), False for
        ENABLE 0, None for nothing."""
        if self._wish is None or now < self._tried + RETRY or (self._wish and not is_settled):
            return None
        self._tried = now
        return self._wish
