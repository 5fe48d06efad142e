"""A tracker alone over recorded scans: rows, a CSV file and a summary."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import cos, radians, sin
from time import perf_counter

import numpy as np

from followerd.bench.laser import LaserStep
from followerd.bench.scan_logs import ScanLog
from followerd.bench.scores import score_places
from followerd.bench.track import STATUS
from followerd.errors import UsageError
from followerd.geometry import Array, Pose2
from followerd.messages import TrackState
from followerd.trackers.interfaces import Tracker

LASER_COLUMNS = ("index", "stamp", "x", "y", "vx", "vy", "status", "confidence", "frame")
Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class LaserRow:
    """One line of the CSV file; a lost row has no place."""

    index: int  # counts the source's scans from 0
    stamp: float  # s
    place: Point | None  # m, in `frame`
    velocity: Point | None  # m/s, in `frame`
    status: str  # tracked, occluded or lost
    confidence: float  # 0..1
    frame: str  # odom, or laser: that of this scan
    in_laser: Point | None  # m, the place in the laser's frame
    duration: float  # s, from the scan in memory to the track

    @classmethod
    def of(cls, step: LaserStep, track: TrackState | None, duration: float) -> "LaserRow":
        """The row that says what `track` claims in a scan."""
        index, scan, ego = step.index, step.scan, step.ego
        frame = "laser" if ego is None else "odom"
        if track is None or track.bearing is None or track.range is None:
            confidence = track.confidence if track else 0.0
            return cls(index, scan.stamp, None, None, "lost", confidence, frame, None, duration)
        laser_from_base = ~scan.base_from_laser
        x, y = track.range * cos(track.bearing), track.range * sin(track.bearing)
        in_laser = laser_from_base.apply_point(x, y)
        place, velocity = track.position, track.velocity
        if ego is None:
            place = in_laser
            velocity = velocity and Pose2(theta=laser_from_base.theta).apply_point(*velocity)
        return cls(
            index,
            scan.stamp,
            place,
            velocity,
            STATUS[track.phase],
            track.confidence,
            frame,
            in_laser,
            duration,
        )

    def cells(self) -> tuple[str, ...]:
        """The line's cells, in the order of LASER_COLUMNS."""
        place = [f"{value:.4f}" for value in self.place or ()] or ["", ""]
        velocity = [f"{value:.4f}" for value in self.velocity or ()] or ["", ""]
        confidence = f"{self.confidence:.3f}"
        stamp = f"{self.stamp:.4f}"
        return (str(self.index), stamp, *place, *velocity, self.status, confidence, self.frame)


def parse_point(text: str) -> Point:
    """`X,Y` in m; raises UsageError."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 2 or not np.isfinite(numbers).all():
        raise UsageError(f"--init {text}: give X,Y in metres, in the laser's frame")
    return numbers[0], numbers[1]


def parse_mount(text: str) -> Pose2:
    """`X,Y,YAW` in m and degrees: the laser on the robot; raises UsageError."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise UsageError(f"--laser {text}: give X,Y,YAW in metres and degrees")
    return Pose2(numbers[0], numbers[1], radians(numbers[2]))


def labelled(people: dict[int, Array], start: int, point: Point | None) -> tuple[Point, Array]:
    """Who is labelled at `point` in scan `start`: the place to begin with, and the labels (N, 2).

    Without a point only one person may be labelled there. Raises UsageError.
    """
    there = {
        name: labels[start]
        for name, labels in people.items()
        if start < len(labels) and np.isfinite(labels[start]).all()
    }
    if not there:
        raise UsageError(f"--start {start}: the truth labels nobody there; choose another scan")
    if point is None and len(there) > 1:
        raise UsageError(f"--start {start}: the truth labels {len(there)} people; give --init X,Y")
    near = next(iter(there.values())) if point is None else np.array(point)
    who = min(there, key=lambda name: float(np.hypot(*(there[name] - near))))
    x, y = near.tolist()
    return (x, y), people[who]


def follow_scans(
    tracker: Tracker, recording: ScanLog, point: Point, start: int = 0
) -> Iterator[LaserRow]:
    """Enrol who stands at `point` (m, laser) in scan `start`, then step through what follows.

    Scans are taken one at a time: a row never depends on later ones. Raises UsageError.
    """
    if recording.count <= start:
        raise UsageError(f"--start {start}: the source has only {recording.count} scans")
    for step in recording:
        if step.index < start:
            continue
        began = perf_counter()
        if step.index == start:
            in_base = step.scan.base_from_laser.apply_point(*point)
            track: TrackState | None = tracker.enrol(step.scan, in_base, step.ego)
        else:
            track = tracker.step(step.scan, step.ego)
        yield LaserRow.of(step, track, perf_counter() - began)


def summarise_scans(rows: Sequence[LaserRow], labels: Array | None) -> dict[str, object]:
    """What `--summary` holds: counts, times in ms, and scores where there are labels.

    `labels` (N, 2) are of the whole source, nan where the person is not labelled.
    """
    statuses = [row.status for row in rows]
    # the first row is the enrolment, which is not a scan's work
    times = 1e3 * np.array([row.duration for row in rows[1:]])
    p50, p99 = np.percentile(times, [50, 99]).tolist() if times.size else (None, None)
    scores = {}
    if labels is not None:
        places = np.array([row.in_laser or (np.nan, np.nan) for row in rows])
        stamps = np.array([row.stamp for row in rows])
        scores = asdict(score_places(places, labels[rows[0].index :][: len(rows)], stamps))
    return {
        "scans": len(rows),
        **{status: statuses.count(status) for status in ("tracked", "occluded", "lost")},
        "scan_ms": {"p50": p50, "p99": p99},
        **scores,
    }
