"""The image tracker's work: off the loop, always on the newest frame, one result at a time."""

import asyncio
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TypeVar

import structlog

from followerd import clock
from followerd.events import Tracked
from followerd.messages import Box, Image, TrackState
from followerd.record.journal import Dropped, Enrolled, Looked
from followerd.trackers.looking import Looking

T = TypeVar("T")
log = structlog.get_logger()
STUCK = 3  # repetitions in a row that are worth a word
KEPT = 100_000  # durations; a daemon runs for weeks


class Vision:
    """Feeds images to a tracker. In real time the work is done in one thread; in virtual time it
    is done in place, at the end of the `work` seconds that it is taken to last."""

    def __init__(
        self,
        looking: Looking,
        deliver: Callable[[Tracked], object],
        consumed: Callable[[Looked | Enrolled | Dropped], None],
        work: float,
    ) -> None:
        self._looking = looking
        self._deliver = deliver
        self._consumed = consumed
        self._work = work
        self._waiting: Image | None = None
        self._arrived = asyncio.Event()
        self._busy = asyncio.Lock()
        self._executor = ThreadPoolExecutor(1, "vision")
        self.develop: Callable[[], None] = lambda: None  # before pixels are looked at
        self._repeated = 0  # pictures that were the same, in a row
        self.dropped = 0
        self.step_times: deque[float] = deque(maxlen=KEPT)  # s

    def offer(self, image: Image) -> None:
        """Take the newest frame; one that was still waiting is dropped and counted."""
        if self._waiting is not None:
            self.dropped += 1
            self._consumed(Dropped(clock.now(), self._waiting.id))
        self._waiting = image
        self._arrived.set()

    async def run(self) -> None:
        """Track for ever."""
        try:
            while True:
                await self._arrived.wait()
                self._arrived.clear()
                image, self._waiting = self._waiting, None
                if image is not None:
                    await self._track(image)
        finally:
            self._executor.shutdown(wait=True)

    async def enrol(
        self, region: Box | tuple[float, float], frame_id: int | None = None
    ) -> TrackState:
        """Enrol the person in `region` of frame `frame_id` (None: the newest one).

        Raises UsageError when that frame is gone or shows nothing to learn.
        """
        async with self._busy:
            seen = self._looking.find(frame_id)
            self._consumed(Enrolled(clock.now(), seen[0].id, region))
            steps = 1 + len(self._looking.later(seen[0].id))
            image, state = await self._call(partial(self._looking.enrol, seen, region), steps)
        self._deliver(Tracked(image.stamp, image.received, image.id, state))
        return state

    @property
    def newest(self) -> Image | None:
        """The newest frame that was given to the tracker."""
        self.develop()
        return self._looking.newest

    def frame(self, frame_id: int | None) -> Image:
        """The frame of that id, None: the newest. Raises UsageError when it is gone."""
        self.develop()
        return self._looking.find(frame_id)[0]

    async def _track(self, image: Image) -> None:
        async with self._busy:
            seen = self._looking.take(image)
            self._consumed(Looked(clock.now(), image.id, *seen[1:]))
            if not self._looking.tracks:
                return
            new, track = await self._call(partial(self._looking.step, seen))
        self._repeated = 0 if new else self._repeated + 1
        if new:
            self._deliver(Tracked(image.stamp, image.received, image.id, track))
        elif self._repeated == STUCK:
            log.warning("the camera repeats itself", frame=image.id)

    async def _call(self, work: Callable[[], T], steps: int = 1) -> T:
        if clock.is_virtual():
            await clock.sleep(steps * self._work)
            self.develop()
            return work()
        began = clock.now()
        result = await asyncio.get_running_loop().run_in_executor(self._executor, work)
        self.step_times.append(clock.now() - began)
        return result
