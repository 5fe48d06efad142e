"""The pipeline again over recorded inputs, single-threaded, in the order of consumption."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from followerd.errors import UsageError
from followerd.messages import Command, Decision, Image, TrackState
from followerd.pipeline import Pipeline, Tracked
from followerd.record.codec import plain, restored
from followerd.record.journal import Enrolled, Looked, Taken
from followerd.record.reading import Decided, Numbered, Record
from followerd.trackers.interfaces import Tracker
from followerd.trackers.looking import Looking

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
    first: int | None = None  # number of the first entry; later than 1: begun under way
    missing: int = 0  # frames that the tracker saw and the recording has not
    _images: dict[int, Image] = field(default_factory=dict)
    _result: tuple[int, TrackState | None] | None = None
    _number: int = 0

    def run(self, records: Iterable[Record]) -> Iterator[Pair]:
        """Every decision once more."""
        looking = Looking(self.tracker, self.pipeline.ego_at, self.pipeline.place_at)
        decision: Decision | None = None
        for record in records:
            if isinstance(record, Image):
                self._keep(record)
            elif isinstance(record, Numbered):
                self._count(record.number)
                decision = self._consume(record, looking) or decision
            elif isinstance(record, Decided) and decision is not None:
                if not self.own:
                    self.pipeline.ego_motion.commanded(restored(Command, record.plain["command"]))
                yield Pair(record.plain, decision)
                decision = None

    def _consume(self, record: Numbered, looking: Looking) -> Decision | None:
        entry = record.entry
        if isinstance(entry, Looked):
            self._look(entry, looking)
        elif isinstance(entry, Enrolled):
            self._enrol(entry, looking)
        elif isinstance(entry, Taken):
            event = entry.event
            if isinstance(event, Tracked):
                event = replace(event, track=self._track(event))
            return self.pipeline.step(event, entry.now)
        return None

    def _look(self, entry: Looked, looking: Looking) -> None:
        image = self._images.pop(entry.frame_id, None)
        if image is None:
            self.missing += 1
            self._result = None
            return
        seen = looking.take(image)
        if not self.own:
            seen = image, entry.ego, seen[2]
        self._result = image.id, looking.step(seen)

    def _enrol(self, entry: Enrolled, looking: Looking) -> None:
        try:
            image, state = looking.enrol(looking.find(entry.frame_id), entry.region)
        except UsageError:
            self._result = None
        else:
            self._result = image.id, state

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
        if self.first is None:
            self.first = number
        elif number != self._number + 1:
            self.gaps += 1
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
