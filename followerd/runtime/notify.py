"""What systemd is told: READY, a watchdog that the living loop feeds, STATUS, STOPPING."""

import os
import socket
from contextlib import suppress

from followerd import clock
from followerd.messages import Decision, Mode
from followerd.runtime.daemon import Daemon

LATE = 0.2  # s that a loop may be late and still count as alive
PERIOD = 0.5  # s between two signs of life, or half of what systemd asks for


class Notify:
    """Speaks to the socket in NOTIFY_SOCKET, if there is one (sd_notify(3))."""

    def __init__(self) -> None:
        self._address = os.environ.get("NOTIFY_SOCKET", "")
        microseconds = int(os.environ.get("WATCHDOG_USEC", "0") or 0)
        self._period = min(PERIOD, 0.5e-6 * microseconds) if microseconds else PERIOD
        self._mode: Mode | None = None

    async def run(self, daemon: Daemon) -> None:
        """Until cancelled; READY once the daemon decides, that is: listens and can be stopped."""
        if not self._address:
            await clock.forever()
        daemon.decision_watchers.append(self._look)
        try:
            while daemon.decision is None:
                await clock.sleep(0.05)
            self.say("READY=1")
            while True:
                due = clock.now() + self._period
                await clock.sleep_until(due)
                if clock.now() - due <= LATE:
                    self.say("WATCHDOG=1")
        finally:
            daemon.decision_watchers.remove(self._look)
            self.say("STOPPING=1")

    def say(self, text: str) -> None:
        """One datagram; a manager that does not listen is none of our business."""
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
            channel.setblocking(False)
            channel.sendto(text.encode(), address)

    def _look(self, decision: Decision) -> None:
        if decision.mode is not self._mode:
            self._mode = decision.mode
            why = "; ".join(str(reason) for reason in decision.reasons)
            self.say(f"STATUS={decision.mode.value}" + (f": {why}" if why else ""))
