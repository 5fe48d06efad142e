"""Records a running daemon: a bounded queue before a thread of its own, which may fail alone.

What is to be written waits until an image was decided upon and the command has gone out: then the
next image is farthest away.

Recording is the first to give way (FAILSAFES F16): images when the disk cannot keep up, then
everything when the disk fills. The loop never waits for it.
"""

import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol

import structlog

from followerd.messages import Decision, Image, Measurement, TrackState
from followerd.record.journal import Entry
from followerd.record.settings import RecordSettings
from followerd.record.tape import DiskFull

log = structlog.get_logger()

Write = Callable[[], None]
PATIENCE = 0.1  # s, without a new track


class Writing(Protocol):
    """A Tape, here or in another process; any call may raise DiskFull, OSError or RuntimeError."""

    path: Path | None
    settings: RecordSettings

    def image(self, image: Image) -> None:
        """See Tape."""

    def entry(self, entry: Entry, number: int) -> None:
        """See Tape."""

    def decision(self, decision: Decision) -> None:
        """See Tape."""

    def heard(self, device: str, data: bytes, now: float) -> None:
        """See Tape."""

    def hand_over(self) -> None:
        """See Tape."""

    def close(self) -> None:
        """See Tape."""


class Recorder:
    """What a daemon's watchers call; `threaded` False writes in place, for virtual time."""

    def __init__(self, tape: Writing, *, threaded: bool = True) -> None:
        self.tape = tape
        self.stopped = ""  # why nothing is recorded any more
        self.dropped_images = 0
        self.dropped = 0  # records other than images: a replay goes no further
        self._entries = 0
        self._waiting: deque[Write] = deque()  # whose ends need no lock
        self._room = threading.Semaphore(tape.settings.queued_images)
        self._due = threading.Event()
        self._track: TrackState | None = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._work, name="recorder") if threaded else None
        if self._thread is not None:
            self._thread.start()

    def measured(self, measurement: Measurement) -> None:
        """Watches measurements: the images among them."""
        if isinstance(measurement, Image) and not self.stopped:
            if not self._room.acquire(blocking=False):
                self.dropped_images += 1
            elif not self._put(partial(self._image, measurement)):
                self._room.release()

    def consumed(self, entry: Entry) -> None:
        """Watches what the daemon consumes."""
        self._entries += 1
        self._put(partial(self.tape.entry, entry, self._entries))

    def decided(self, decision: Decision) -> None:
        """Watches decisions."""
        self._put(partial(self.tape.decision, decision))
        if decision.track is not self._track:
            self._track = decision.track
            self._due.set()

    def heard(self, device: str, data: bytes, now: float) -> None:
        """Watches a device's line."""
        self._put(partial(self.tape.heard, device, data, now))

    def close(self) -> None:
        """Write what waits, and finish the file."""
        self._ending.set()
        self._due.set()
        if self._thread is not None:
            self._thread.join()
        elif not self.stopped:
            self.tape.close()

    def _put(self, write: Write) -> bool:
        if self.stopped:
            return False
        if self._thread is None:
            self._try(write)
            return True
        if len(self._waiting) >= self.tape.settings.queue:
            self.dropped += 1
            return False
        self._waiting.append(write)
        return True

    def _image(self, image: Image) -> None:
        self._room.release()
        self.tape.image(image)

    def _work(self) -> None:
        while not self.stopped:
            ends = self._ending.is_set()
            self._write_all()
            if ends:
                break
            self._due.wait(PATIENCE)
            self._due.clear()
        if not self.stopped:
            self.tape.close()

    def _write_all(self) -> None:
        while self._waiting and not self.stopped:
            self._try(self._waiting.popleft())
        if not self.stopped:
            self._try(self.tape.hand_over)

    def _try(self, write: Write) -> None:
        try:
            write()
        except (DiskFull, OSError, RuntimeError) as error:
            self.stopped = f"recording stopped: {error}"
            log.warning("recording stopped", reason=str(error), file=str(self.tape.path))
            self.tape.close()
