"""The pipeline again over recorded inputs, single-threaded, in the order of consumption."""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from followerd.errors import UsageError
from followerd.events import Tracked
from followerd.messages import Command, Decision, Image, Scan, TrackState
from followerd.pipeline import Pipeline
from followerd.record.codec import plain, restored
from followerd.record.journal import Enrolled, Looked, Taken
from followerd.record.reading import Decided, Numbered, Record
from followerd.trackers.interfaces import Tracker
from followerd.trackers.looking import Looking
from followerd.trackers.sweeping import Sweeping

KEPT = 200  # images that wait for the tracker to take them up


@dataclass(frozen=True, slots=True)
class Pair:
    """A decision, as it was recorded and as it came out again."""

    recorded: dict[str, Any]
    replayed: Decision

    @property
    def difference(self) -> str:
        """The first thing that differs; empty where nothing does, to the last bit."""
        return _difference("decision", self.recorded, plain(self.replayed, digests=True))


@dataclass
class Replay:
    """A fresh tracker and pipeline, fed from a recording; `own` says they are the recorded ones.

    With others the robot cannot be where they would have steered it: what it was then told, and
    where it was then, are taken from the recording.
    """

    tracker: Tracker
    pipeline: Pipeline
    own: bool = True
    gaps: int = 0  # places where the recorder could not keep up
    missing: int = 0  # frames that the tracker saw and the recording has not
    _images: dict[int, Image] = field(default_factory=dict)
    _result: tuple[int | None, TrackState | None] | None = None
    _number: int = 0

    def __post_init__(self) -> None:
        by_scans = "scan" in self.tracker.needs
        ego_at, place_at = self.pipeline.ego_at, self.pipeline.place_at
        self._looking = Looking(None if by_scans else self.tracker, ego_at, place_at)
        self._sweeping = Sweeping(self.tracker, ego_at) if by_scans else None

    def run(self, records: Iterable[Record]) -> Iterator[Pair]:
        """Every decision once more."""
        decision: Decision | None = None
        for record in records:
            if isinstance(record, Image):
                self._keep(record)
            elif isinstance(record, Numbered):
                self._count(record.number)
                decision = self._consume(record) or decision
            elif isinstance(record, Decided) and decision is not None:
                if not self.own:
                    self.pipeline.ego_motion.commanded(restored(Command, record.plain["command"]))
                yield Pair(record.plain, decision)
                decision = None

    def _consume(self, record: Numbered) -> Decision | None:
        entry = record.entry
        if isinstance(entry, Looked):
            self._look(entry)
        elif isinstance(entry, Enrolled):
            self._enrol(entry)
        elif isinstance(entry, Taken):
            event = entry.event
            if isinstance(event, Tracked):
                event = replace(event, track=self._track(event))
            decision = self.pipeline.step(event, entry.now)
            if isinstance(event, Scan) and self._sweeping is not None:
                self._result = None, self._sweeping.take(event, self.pipeline.pose)
            return decision
        return None

    def _look(self, entry: Looked) -> None:
        image = self._images.pop(entry.frame_id, None)
        if image is None:
            self.missing += 1
            self._result = None
            return
        seen = self._looking.take(image)
        if self._looking.tracks:
            if not self.own:
                seen = image, entry.ego, seen[2]
            self._result = image.id, self._looking.step(seen)[1]

    def _enrol(self, entry: Enrolled) -> None:
        self._result = None
        with suppress(UsageError):
            if self._sweeping is None:
                seen = self._looking.find(entry.frame_id)
                image, state = self._looking.enrol(seen, entry.region)
                self._result = image.id, state
            else:
                in_picture = entry.frame_id is not None
                image_or_none = self._looking.find(entry.frame_id)[0] if in_picture else None
                self._result = None, self._sweeping.enrol(entry.region, image_or_none)[1]

    def _track(self, event: Tracked) -> TrackState | None:
        """The tracker's result that is due; where the image is missing, the recorded one."""
        if self._result is not None and self._result[0] == event.frame_id:
            return self._result[1]
        return event.track

    def _keep(self, image: Image) -> None:
        self._images[image.id] = image
        while len(self._images) > KEPT:
            del self._images[next(iter(self._images))]

    def _count(self, number: int) -> None:
        self.gaps += number != self._number + 1
        self._number = number


def _difference(name: str, a: Any, b: Any) -> str:
    if isinstance(a, dict) and isinstance(b, dict) and a.keys() == b.keys():
        found = (_difference(f"{name}.{key}", a[key], b[key]) for key in a)
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        found = (
            _difference(f"{name}[{i}]", *pair) for i, pair in enumerate(zip(a, b, strict=True))
        )
    else:
        return "" if a == b else f"{name}: recorded {a!r}, replayed {b!r}"
    return next((text for text in found if text), "")
