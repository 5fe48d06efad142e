"""The image tracker's work: off the loop, always on the newest frame, one result at a time."""

import asyncio
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TypeVar

from followerd import clock
from followerd.errors import UsageError
from followerd.geometry import Pose2
from followerd.messages import Box, Image, Place, TrackState
from followerd.pipeline import Tracked
from followerd.trackers.interfaces import Tracker

T = TypeVar("T")
KEPT = 100_000  # durations; a daemon runs for weeks
HISTORY = 45  # frames kept so that a click on a frame seen a moment ago can be honoured

Seen = tuple[Image, Pose2 | None, Place | None]  # and where the person is then


class Vision:
    """Feeds images to a tracker. In real time the work is done in one thread; in virtual time it
    is done in place and its result delivered after `work` seconds."""

    def __init__(
        self,
        tracker: Tracker | None,
        ego_at: Callable[[float], Pose2 | None],
        place_at: Callable[[float], Place | None],
        deliver: Callable[[Tracked], object],
        work: float,
    ) -> None:
        """Without a `tracker` pictures are only kept, to be clicked on."""
        self._tracker = tracker
        self._ego_at = ego_at
        self._place_at = place_at
        self._deliver = deliver
        self._work = work
        self._waiting: Image | None = None
        self._arrived = asyncio.Event()
        self._busy = asyncio.Lock()
        self._history: deque[Seen] = deque(maxlen=HISTORY)
        self._executor = ThreadPoolExecutor(1, "vision")
        self.dropped = 0
        self.step_times: deque[float] = deque(maxlen=KEPT)  # s

    def offer(self, image: Image) -> None:
        """Take the newest frame; one that was still waiting is dropped and counted."""
        self.dropped += self._waiting is not None
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
        tracker = self._tracker
        if tracker is None:
            raise UsageError("nobody is followed in images here")
        async with self._busy:
            image, ego, _ = self._seen(frame_id)
            state = await self._call(partial(tracker.enrol, image, region, ego))
            for later in [seen for seen in self._history if seen[0].id > image.id]:
                stepped = await self._call(partial(tracker.step, *later))
                state = stepped or state
                image = later[0]
        self._deliver(Tracked(image.stamp, image.received, image.id, state))
        return state

    @property
    def newest(self) -> Image | None:
        """The newest frame that was given to the tracker."""
        return self._history[-1][0] if self._history else None

    def frame(self, frame_id: int | None) -> Image:
        """The frame of that id, None: the newest. Raises UsageError when it is gone."""
        return self._seen(frame_id)[0]

    def _seen(self, frame_id: int | None) -> Seen:
        if not self._history:
            raise UsageError("no camera image yet; wait for the camera")
        if frame_id is None:
            return self._history[-1]
        for seen in self._history:
            if seen[0].id == frame_id:
                return seen
        raise UsageError(f"frame {frame_id} is too old or unknown; click on the newest picture")

    async def _track(self, image: Image) -> None:
        async with self._busy:
            seen = image, self._ego_at(image.stamp), self._place_at(image.stamp)
            self._history.append(seen)
            if self._tracker is None:
                return
            track = await self._call(partial(self._tracker.step, *seen))
        self._deliver(Tracked(image.stamp, image.received, image.id, track))

    async def _call(self, work: Callable[[], T]) -> T:
        if clock.is_virtual():
            result = work()
            await clock.sleep(self._work)
            return result
        began = clock.now()
        result = await asyncio.get_running_loop().run_in_executor(self._executor, work)
        self.step_times.append(clock.now() - began)
        return result
