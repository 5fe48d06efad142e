"""Whether the computer is short of time or memory: then only the tracker gets pictures (F16)."""

from collections.abc import Callable
from itertools import islice
from statistics import median

import structlog

from followerd import clock
from followerd.runtime.stats import Stats, delays, rss_mb

PERIOD = 0.5  # s
NEWEST = 50  # wake-ups that are looked at, one second
LATE = 0.025  # s, of half of them: half of what the loop may be late at worst
MOST_MB = 700.0  # of this process; the service is ended at 1 GB

log = structlog.get_logger()


class Pressure:
    """Looks at the loop's lateness and at the process's memory."""

    def __init__(self, stats: Stats, memory_mb: Callable[[], float] = rss_mb) -> None:
        self.why = ""  # recording and viewing get no pictures; empty: they do
        self._stats = stats
        self._memory_mb = memory_mb

    async def watch(self) -> None:
        """Look for ever; in virtual time there is no pressure."""
        while not clock.is_virtual():
            await clock.sleep(PERIOD)
            self.look()

    def look(self) -> None:
        """Decide anew."""
        before, self.why = self.why, self._reason()
        if self.why and not before:
            log.warning("recording and viewing get no pictures", reason=self.why)
        elif before and not self.why:
            log.info("recording and viewing get pictures again")

    def _reason(self) -> str:
        newest = delays(islice(reversed(self._stats.lags), NEWEST))
        if len(newest) == NEWEST and (late := median(newest)) > LATE:
            return f"the loop is {1000.0 * late:.0f} ms late"
        memory = self._memory_mb()
        return f"{memory:.0f} MB of memory in use" if memory > MOST_MB else ""
