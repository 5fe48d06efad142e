"""How old each stream's newest measurement is, counted from when it was measured."""

from collections.abc import Mapping
from math import inf
from typing import Literal

from followerd.messages import Reason
from followerd.streams import STREAMS, OnStale

StreamName = Literal["scan", "image", "odometry"]


class Freshness:
    """The newest stamp of every stream and since when the stream has been fresh."""

    def __init__(self, stale_after: Mapping[StreamName, float] | None = None) -> None:
        """`stale_after`: s by stream; only lower values than the table's count."""
        self.stale_after = {name: stream.stale_after for name, stream in STREAMS.items()}
        for name, limit in (stale_after or {}).items():
            self.stale_after[name] = min(limit, self.stale_after[name])
        self.newest = dict.fromkeys(STREAMS, -inf)
        self._fresh_since = dict.fromkeys(STREAMS, inf)

    def saw(self, stream: str, stamp: float, now: float) -> None:
        """A measurement of `stream` from `stamp` arrived."""
        if self._is_stale(stream, now) or self._fresh_since[stream] == inf:
            self._fresh_since[stream] = now
        self.newest[stream] = max(self.newest[stream], stamp)

    def stale(self, now: float) -> tuple[Reason, ...]:
        """Why the robot must stand: every stream that is too old, with its age."""
        late = [name for name in STREAMS if self._is_stale(name, now)]
        return tuple([Reason(STREAMS[name].reason, name, self._age(name, now)) for name in late])

    def ageing(self, share: float, now: float) -> tuple[Reason, ...]:
        """Why the robot should go slowly: streams older than `share` of their limit."""
        return tuple(
            [
                Reason(STREAMS[name].reason, name, self._age(name, now), full_stop=False)
                for name, limit in self.stale_after.items()
                if now - self.newest[name] > share * limit
            ]
        )

    def disarms(self, now: float) -> bool:
        """Whether a stale stream asks for arming again."""
        return any(
            stream.on_stale is OnStale.DISARM and self._is_stale(name, now)
            for name, stream in STREAMS.items()
        )

    def fresh_for(self, now: float) -> float:
        """Seconds since when all streams have been fresh without a break."""
        if self.stale(now):
            return 0.0
        return now - max(self._fresh_since.values())

    def good_until(self) -> float:
        """Loop time at which the first stream goes stale."""
        return min([self.newest[name] + limit for name, limit in self.stale_after.items()])

    def _is_stale(self, name: str, now: float) -> bool:
        # written so that a NaN is stale
        return not now - self.newest[name] <= self.stale_after[name]

    def _age(self, name: str, now: float) -> str:
        age = now - self.newest[name]
        return f"{age:.2f} s old" if age < inf else "nothing yet"
