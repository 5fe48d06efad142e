"""A localizer alone over recorded scans: rows, and a summary where the truth is known."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import hypot, sqrt
from time import perf_counter

import numpy as np

from followerd.bench.laser import LaserStep
from followerd.errors import UsageError
from followerd.estimation.localizer import Localizer
from followerd.geometry import Array, Pose2, wrap_angle
from followerd.maps.floor import FloorMap
from followerd.messages import RobotPose

COLUMNS = ("index", "stamp", "x", "y", "theta", "particles_spread")
NEAR = 0.5  # m, within which the robot counts as found


@dataclass(frozen=True, slots=True)
class PoseRow:
    """One line of the CSV file; without a pose the localizer does not know, or says it is lost."""

    index: int  # counts the log's scans from 0
    stamp: float  # s
    pose: Pose2 | None  # map_from_base
    spread: float | None  # m, standard deviation of the place
    truth: Pose2 | None  # the log's corrected pose
    duration: float  # s, of the localizer's step

    @classmethod
    def of(cls, step: LaserStep, found: RobotPose | None, duration: float) -> "PoseRow":
        """The row that says what a localizer `found` in a scan."""
        stamp, truth = step.scan.stamp, step.corrected
        if found is None or found.lost:
            return cls(step.index, stamp, None, None, truth, duration)
        spread = sqrt(max(0.0, float(found.covariance[0, 0] + found.covariance[1, 1])))
        return cls(step.index, stamp, found.map_from_base, spread, truth, duration)

    def cells(self) -> tuple[str, ...]:
        """The line's cells, in the order of COLUMNS; nan where the pose is not known."""
        stamp, p = f"{self.stamp:.4f}", self.pose
        if p is None or self.spread is None:
            return (str(self.index), stamp, *("nan",) * 4)
        pose = (f"{p.x:.4f}", f"{p.y:.4f}", f"{p.theta:.5f}")
        return (str(self.index), stamp, *pose, f"{self.spread:.4f}")


def parse_start(text: str, first: LaserStep, floor: FloorMap) -> Pose2 | None:
    """Where to begin: `truth` (the first scan's corrected pose), `global`, or `X,Y,THETA` (rad).

    Raises UsageError for what is none of them, or lies outside the map.
    """
    if text == "global":
        return None
    if text == "truth":
        if first.corrected is None:
            raise UsageError(
                "--start truth: the log has no corrected poses; use global or X,Y,THETA"
            )
        pose = first.corrected
    else:
        try:
            x, y, theta = (float(part) for part in text.split(","))
        except ValueError:
            x = y = theta = float("nan")
        if not np.isfinite((x, y, theta)).all():
            raise UsageError(f"--start {text}: give truth, global, or X,Y,THETA in m and rad")
        pose = Pose2(x, y, wrap_angle(theta))
    _check_inside(text, pose, floor)
    return pose


def _check_inside(text: str, pose: Pose2, floor: FloorMap) -> None:
    grid = floor.grid
    height, width = grid.occupied.shape
    (left, bottom), cell = grid.origin, grid.cell
    right, top = left + width * cell, bottom + height * cell
    if not (left <= pose.x < right and bottom <= pose.y < top):
        raise UsageError(
            f"--start {text}: ({pose.x:.2f}, {pose.y:.2f}) lies outside the map, which spans"
            f" x {left:.2f} to {right:.2f} and y {bottom:.2f} to {top:.2f}: is it in the log's"
            " frame?"
        )


def locate(
    localizer: Localizer, steps: Iterable[LaserStep], start: Pose2 | None
) -> Iterator[PoseRow]:
    """Begin at `start` and step through the scans; a row never depends on later ones.

    Raises UsageError where a scan has no odometry.
    """
    localizer.start(start)
    for step in steps:
        if step.ego is None:
            raise UsageError("the scans have no odometry, which localizers need")
        began = perf_counter()
        found = localizer.step(step.scan, step.ego)
        yield PoseRow.of(step, found, perf_counter() - began)


def summarise(rows: Sequence[PoseRow]) -> dict[str, object]:
    """What `--summary` holds: counts, times, and errors where there are corrected poses."""
    times = 1e3 * np.array([row.duration for row in rows])
    p50, p99 = np.percentile(times, [50, 99]).tolist() if times.size else (None, None)
    errors: dict[str, object] = {}
    known = [row for row in rows if row.truth is not None]
    if known:
        places, turns = _errors(known)
        near = np.nan_to_num(places, nan=np.inf) <= NEAR
        errors = {
            "error_cm": _spread(100.0 * places),
            "heading_error_deg": _spread(np.degrees(turns)),
            "within_0.5m": float(near.mean()),
            "scans_until_within_0.5m": int(near.argmax()) if near.any() else None,
        }
    located = sum(row.pose is not None for row in rows)
    return {"scans": len(rows), "located": located, "scan_ms": {"p50": p50, "p99": p99}, **errors}


def _errors(rows: Sequence[PoseRow]) -> tuple[Array, Array]:
    """Of the place (N,), m, and the heading (N,), rad; nan where there is no pose."""
    places, turns = np.full(len(rows), np.nan), np.full(len(rows), np.nan)
    for i, row in enumerate(rows):
        if row.pose is not None and row.truth is not None:
            places[i] = hypot(row.pose.x - row.truth.x, row.pose.y - row.truth.y)
            turns[i] = abs(wrap_angle(row.pose.theta - row.truth.theta))
    return places, turns


def _spread(values: Array) -> dict[str, float | None]:
    known = values[np.isfinite(values)]
    if not known.size:
        return dict.fromkeys(("median", "p95", "max"))
    median, p95 = np.percentile(known, [50, 95]).tolist()
    return {"median": median, "p95": p95, "max": float(known.max())}
