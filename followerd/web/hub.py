"""What all viewers of the page look at: the newest of everything, worked out once for all."""

import asyncio
import json
import struct
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np

from followerd import clock
from followerd.control.interfaces import Sketched
from followerd.geometry import Pose2
from followerd.messages import Decision, Image, Measurement, Mode, Scan, TrackState
from followerd.runtime.daemon import Daemon
from followerd.streams import STREAMS
from followerd.web.views import decision_view, legs_view, lines_view, number, scan_view, track_view

HEADER = struct.Struct("<IIddd")  # kind 1, frame id; s (loop) of exposure, in memory, sent
PICTURE = 1
STATE_PERIOD = 0.1  # s, about
TRACK_PERIOD = 0.05  # s, of tracks between the images; each image has its own
LOOK = 0.012  # s that a tracker may look at an image before it is shown all the same
RATED = 40  # measurements that a rate is taken of


class Hub:
    """Looks on at a daemon; `changed` are called when there is a new picture or track."""

    def __init__(self, daemon: Daemon, jpeg_quality: int, extra: Callable[[], dict[str, Any]]):
        self.daemon = daemon
        self.image: Image | None = None
        self.viewers: set[Callable[[], None]] = set()
        self._extra = extra
        self._quality = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
        self._thread = ThreadPoolExecutor(1, "pictures")
        self._coming: Image | None = None  # the tracker looks at it
        self._timer: asyncio.TimerHandle | None = None
        self._encoding: tuple[Image, asyncio.Future[bytes]] | None = None  # the newest
        self._scan: tuple[Scan, Pose2] | None = None
        self._stamps: dict[type, deque[float]] = {}
        self._track = ""
        self._shown: TrackState | None = None
        self._shown_at = -1.0  # s
        self._state = json.dumps({"state": {"mode": "disarmed", "reasons": ["starting"]}})
        self._state_of = -1.0  # s
        self._mode: Mode | None = None  # in it

    def attach(self) -> None:
        """Begin to look."""
        self.daemon.measurement_watchers.append(self._measured)
        self.daemon.decision_watchers.append(self._decided)

    def close(self) -> None:
        """Stop to look."""
        self.daemon.measurement_watchers.remove(self._measured)
        self.daemon.decision_watchers.remove(self._decided)
        if self._timer is not None:
            self._timer.cancel()
        self._thread.shutdown(wait=False)

    def join(self, changed: Callable[[], None]) -> None:
        """One more viewer; the state that it is shown first is new."""
        self.viewers.add(changed)
        if self.daemon.decision is not None:
            self._renew(self.daemon.decision)

    async def picture(self, image: Image) -> bytes:
        """The message that shows `image`; encoded once, off the loop, for all viewers."""
        if self._encoding is None or self._encoding[0] is not image:
            loop = asyncio.get_running_loop()
            self._encoding = image, loop.run_in_executor(self._thread, self._encode, image)
        data = await asyncio.shield(self._encoding[1])  # others wait for it too
        return HEADER.pack(PICTURE, image.id, image.stamp, image.received, clock.now()) + data

    def _encode(self, image: Image) -> bytes:
        return bytes(cv2.imencode(".jpg", image.pixels, self._quality)[1])

    @property
    def track(self) -> str:
        """The newest track, as the message that shows it."""
        return self._track

    @property
    def state(self) -> str:
        """Everything that changes less often, as the message that shows it."""
        return self._state

    def _view(self, decision: Decision, now: float) -> dict[str, Any]:
        view = decision_view(decision, self.daemon.pipeline.ego_at(now)) | self._extra()
        view["devices"] = self._devices(now)
        if self._scan is not None:
            view["scan"] = scan_view(*self._scan)
        if (seen := self.daemon.pipeline.view) is not None:
            view["legs"] = legs_view(seen)
        if isinstance(law := self.daemon.pipeline.controller, Sketched):
            view["way"] = np.round(law.sketch(), 2).tolist()
            view["lines"] = lines_view(law.lines())
        if self.daemon.scanning is not None:
            view["courses"] = lines_view(self.daemon.scanning.courses())
        return view

    def _devices(self, now: float) -> list[dict[str, Any]]:
        """Streams, and what went wrong with the devices they come from."""
        freshness, stats = self.daemon.pipeline.freshness, self.daemon.stats
        streams = [
            {
                "name": name,
                "age": number(now - newest),
                "limit": number(freshness.stale_after[name]),
                "fresh": now - newest <= freshness.stale_after[name],
                "rate": self._rate(STREAMS[name].type),
            }
            for name, newest in freshness.newest.items()
        ]
        devices = [
            {
                "name": device,
                "fresh": device not in stats.down,
                "errors": errors,
                "lost": stats.losses[device],
            }
            for device, errors in self.daemon.errors().items()
        ]
        dropped = f"{self.daemon.vision.dropped} of {stats.frames}"
        return [*streams, *devices, {"name": "frames not looked at", "count": dropped}]

    def _rate(self, kind: type) -> float | None:
        """Of the newest measurements, Hz."""
        stamps = self._stamps.get(kind)
        if stamps is None or len(stamps) < 2 or stamps[-1] <= stamps[0]:
            return None
        return round((len(stamps) - 1) / (stamps[-1] - stamps[0]), 1)

    def _measured(self, measurement: Measurement) -> None:
        stamps = self._stamps.setdefault(type(measurement), deque(maxlen=RATED))
        stamps.append(measurement.stamp)
        if isinstance(measurement, Image):
            self._wait_for_tracker(measurement)
        elif isinstance(measurement, Scan):
            base = self.daemon.pipeline.ego_at(measurement.stamp)
            self._scan = None if base is None else (measurement, base)

    def _wait_for_tracker(self, image: Image) -> None:
        """An image is shown once it is decided upon: till then the processors are the tracker's."""
        if self._timer is not None:
            self._timer.cancel()
        self._coming = image
        waits = self.viewers and self.daemon.pipeline.modes.enrolled
        self._timer = asyncio.get_running_loop().call_later(LOOK if waits else 0.0, self._show)

    def _show(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self.image, self._coming, self._timer = self._coming, None, None
        self._tell()

    def _decided(self, decision: Decision) -> None:
        track, coming = decision.track, self._coming
        if coming is not None and track is not None and track.frame_id == coming.id:
            self._show()
        if not self.viewers:
            return
        if is_new := self._is_news(track, decision.stamp):
            self._shown, self._shown_at = track, decision.stamp
            self._track = json.dumps({"track": track_view(decision)}, allow_nan=False)
        if is_due := self._is_due(decision, is_new=is_new):
            self._renew(decision)
        if is_new or is_due:
            self._tell()

    def _renew(self, decision: Decision) -> None:
        self._state_of, self._mode = clock.now(), decision.mode
        state = self._view(decision, self._state_of)
        self._state = json.dumps({"state": state}, allow_nan=False)

    def _is_news(self, track: TrackState | None, now: float) -> bool:
        """Whether a track is worth a word: scans change it more often than anybody can see."""
        shown = self._shown
        if track is shown or track is None or shown is None:
            return track is not shown
        changed = (track.frame_id, track.phase) != (shown.frame_id, shown.phase)
        return changed or now - self._shown_at >= TRACK_PERIOD

    def _is_due(self, decision: Decision, *, is_new: bool) -> bool:
        """Best right after an image's decision: then the next image is farthest away."""
        waits = (0.9 if is_new else 1.4) * STATE_PERIOD
        return decision.mode is not self._mode or clock.now() - self._state_of >= waits

    def _tell(self) -> None:
        for changed in self.viewers:
            changed()
