"""How old each stream's newest measurement is, counted from when it was measured."""

from collections.abc import Collection, Mapping
from math import inf
from typing import Literal

from followerd.messages import Reason
from followerd.streams import STREAMS, OnStale

StreamName = Literal["scan", "image", "odometry"]


class Freshness:
    """The newest stamp of every watched stream and since when the stream has been fresh."""

    def __init__(
        self,
        stale_after: Mapping[StreamName, float] | None = None,
        watched: Collection[str] = tuple(STREAMS),
        under_way: Mapping[StreamName, float] | None = None,
    ) -> None:
        """`stale_after`: s by stream; only lower values than the table's count.

        The robot does not stop for a stream that nobody `watched`. `under_way`: s by stream that
        it may be older, instead of the table's, while its next measurement is seen to come.
        """
        lower: dict[str, float] = dict((stale_after or {}).items())
        self.stale_after: dict[str, float] = {
            name: min(stream.stale_after, lower.get(name, inf))
            for name, stream in STREAMS.items()
            if name in watched
        }
        longer: dict[str, float] = dict((under_way or {}).items())
        self._under_way = {
            name: longer.get(name, STREAMS[name].under_way) for name in self.stale_after
        }
        self._coming: set[str] = set()
        self._excused: dict[str, float] = {}  # s by stream, beyond its limit
        self.newest = dict.fromkeys(self.stale_after, -inf)
        self._fresh_since = dict.fromkeys(self.stale_after, inf)
        self._limits = self.stale_after.copy()  # s by stream, with all that is granted it now

    def saw(self, stream: str, stamp: float, now: float) -> None:
        """A measurement of `stream` from `stamp` arrived."""
        if stream not in self.newest:
            return
        if self._is_stale(stream, now) or self._fresh_since[stream] == inf:
            self._fresh_since[stream] = now
        self.newest[stream] = max(self.newest[stream], stamp)
        if stream in self._coming:
            self._coming.remove(stream)
            self._set_limit(stream)

    def coming(self, stream: str) -> None:
        """The first bytes of the next measurement are here; on a slow line the rest takes long."""
        if stream in self.newest:
            self._coming.add(stream)
            self._set_limit(stream)

    def excuse(self, stream: str, seconds: float) -> None:
        """Until told otherwise `stream` may be so much older, at a low speed."""
        if stream in self.newest:
            self._excused[stream] = seconds
            self._set_limit(stream)

    def stale(self, now: float) -> tuple[Reason, ...]:
        """Why the robot must stand: every stream that is too old, with its age."""
        newest = self.newest
        # written so that a NaN is stale
        late = [name for name, limit in self._limits.items() if not now - newest[name] <= limit]
        return tuple([Reason(STREAMS[name].reason, name, self._age(name, now)) for name in late])

    def ageing(self, share: float, now: float) -> tuple[Reason, ...]:
        """Why the robot should go slowly: streams older than `share` of their limit."""
        return tuple(
            [
                Reason(STREAMS[name].reason, name, self._age(name, now), full_stop=False)
                for name, limit in self.stale_after.items()
                if now - self.newest[name] > share * (limit + self._under_way[name])
            ]
        )

    def disarms(self, now: float) -> bool:
        """Whether a stale stream asks for arming again."""
        return any(
            STREAMS[name].on_stale is OnStale.DISARM and self._is_stale(name, now)
            for name in self.stale_after
        )

    def fresh_for(self, now: float) -> float:
        """Seconds since when all streams have been fresh without a break."""
        if self.stale(now):
            return 0.0
        return now - max(self._fresh_since.values())

    def good_until(self) -> float:
        """Loop time at which the first stream goes stale."""
        newest = self.newest
        return min([newest[name] + limit for name, limit in self._limits.items()])

    def _is_stale(self, name: str, now: float) -> bool:
        # as in `stale`, whatever is excused
        return not now - self.newest[name] <= self._limit(name)

    def _limit(self, name: str) -> float:
        return self.stale_after[name] + (self._under_way[name] if name in self._coming else 0.0)

    def _set_limit(self, name: str) -> None:
        self._limits[name] = self._limit(name) + self._excused.get(name, 0.0)

    def _age(self, name: str, now: float) -> str:
        age = now - self.newest[name]
        return f"{age:.2f} s old" if age < inf else "nothing yet"
