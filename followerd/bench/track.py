"""A tracker alone over recorded frames: rows, a CSV file and a summary."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from followerd.bench.scores import Scores, as_array, score
from followerd.errors import UsageError
from followerd.geometry import Array
from followerd.messages import Box, Image, TrackPhase, TrackState
from followerd.trackers.interfaces import Tracker

COLUMNS = ("index", "stamp", "x", "y", "w", "h", "status", "confidence")
STATUS = {
    TrackPhase.TENTATIVE: "tracked",
    TrackPhase.CONFIRMED: "tracked",
    TrackPhase.OCCLUDED: "occluded",
}
Region = Box | tuple[float, float]


@dataclass(frozen=True, slots=True)
class TrackRow:
    """One line of the CSV file; a lost row has no box."""

    index: int  # counts the source's frames from 0
    stamp: float  # s
    box: Box | None  # px, 0-based
    status: str  # tracked, occluded or lost
    confidence: float  # 0..1
    duration: float  # s, from the frame in memory to the track

    @classmethod
    def of(cls, image: Image, track: TrackState | None, duration: float) -> "TrackRow":
        """The row that says what `track` claims in `image`."""
        if track is None or track.box is None or track.phase is TrackPhase.LOST:
            confidence = track.confidence if track else 0.0
            return cls(image.id, image.stamp, None, "lost", confidence, duration)
        status = STATUS[track.phase]
        return cls(image.id, image.stamp, track.box, status, track.confidence, duration)

    def cells(self) -> tuple[str, ...]:
        """The line's cells, in the order of COLUMNS."""
        b = self.box
        place = (f"{b.x:.3f}", f"{b.y:.3f}", f"{b.w:.3f}", f"{b.h:.3f}") if b else ("",) * 4
        stamp, confidence = f"{self.stamp:.4f}", f"{self.confidence:.3f}"
        return (str(self.index), stamp, *place, self.status, confidence)


class Row(Protocol):
    """What can stand in a CSV file."""

    def cells(self) -> tuple[str, ...]:
        """The line's cells."""


R = TypeVar("R", bound=Row)


class Step(NamedTuple):
    """One frame and what the tracker made of it."""

    image: Image
    track: TrackState | None
    row: TrackRow


def parse_region(text: str) -> Region:
    """`X,Y,W,H` or `X,Y` in px; raises UsageError."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) == 2 and np.isfinite(numbers).all():
        return numbers[0], numbers[1]
    if len(numbers) == 4 and np.isfinite(numbers).all() and min(numbers[2:]) > 0:
        return Box(*numbers)
    raise UsageError(f"--init {text}: give X,Y,W,H or X,Y in pixels, the size above 0")


def region_from_truth(truth: Array, start: int) -> Box:
    """The person's box in frame `start`; raises UsageError where they are not visible."""
    if start >= len(truth) or not np.isfinite(truth[start]).all():
        raise UsageError(f"--start {start}: the truth shows nobody there; give --init or a frame")
    return Box(*(float(value) for value in truth[start]))


def check_inside(region: Region, image: Image) -> None:
    """Raises UsageError when the region's middle lies outside the image."""
    height, width = image.pixels.shape[:2]
    x, y = region.centre if isinstance(region, Box) else region
    if not (0 <= x < width and 0 <= y < height):
        raise UsageError(
            f"--init: its middle ({x:g}, {y:g}) lies outside the {width}x{height} image"
        )


def follow(
    tracker: Tracker, frames: Iterable[Image], region: Region, start: int = 0
) -> Iterator[Step]:
    """Enrol in frame `start`, then step through what follows; one step is yielded per frame.

    Frames are taken one at a time: a step never depends on later ones. Raises UsageError when
    the source ends before `start` or the region is outside the image.
    """
    seen = 0
    for image in frames:
        seen += 1
        if image.id < start:
            continue
        if image.id == start:
            check_inside(region, image)
        began = perf_counter()
        if image.id == start:
            track: TrackState | None = tracker.enrol(image, region, None)
        else:
            track = tracker.step(image, None)
        duration = perf_counter() - began
        yield Step(image, track, TrackRow.of(image, track, duration))
    if seen <= start:
        raise UsageError(f"--start {start}: the source has only {seen} frames")


def write_csv(path: Path, rows: Iterable[R], columns: Sequence[str] = COLUMNS) -> list[R]:
    """Write the rows as they come, and return them; raises UsageError."""
    done = []
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            for row in rows:
                writer.writerow(row.cells())
                done.append(row)
    except OSError as error:
        raise UsageError(f"--out {path}: cannot be written: {error.strerror}") from error
    return done


def scores_of(rows: Sequence[TrackRow], truth: Array) -> Scores:
    """Scores against the truth of the whole source, from the first tracked frame on."""
    return score(as_array([row.box for row in rows]), truth[rows[0].index :])


def summarise(rows: Sequence[TrackRow], truth: Array | None) -> dict[str, object]:
    """What `--summary` holds: counts, times in ms, and the scores where there is a truth."""
    statuses = [row.status for row in rows]
    # the first row is the enrolment, which is not a frame's work
    times = 1e3 * np.array([row.duration for row in rows[1:]])
    p50, p99 = np.percentile(times, [50, 99]).tolist() if times.size else (None, None)
    return {
        "frames": len(rows),
        **{status: statuses.count(status) for status in ("tracked", "occluded", "lost")},
        "frame_ms": {"p50": p50, "p99": p99},
        **(asdict(scores_of(rows, truth)) if truth is not None else {}),
    }
