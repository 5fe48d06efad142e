"""Scores against ground truth: of boxes in images, as in the OTB benchmark, and of places."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from followerd.errors import UsageError
from followerd.geometry import Array
from followerd.messages import Box

OVERLAPS = np.linspace(0.0, 1.0, 21)  # thresholds of the success curve
PRECISION_RADIUS = 20.0  # px
NEAR = 0.5  # m, a place this near the label is the person
ASTRAY = 1.0  # m, farther off is somebody else
LOSS = 1.0  # s of that is a loss
GONE = 3.0  # s without a label after which the person was out of view, not just not labelled


@dataclass(frozen=True, slots=True)
class Scores:
    """How well boxes fit the truth; None = the sequence cannot say."""

    auc: float | None  # area under the success curve, 0..1
    p20: float | None  # share of visible frames with a centre within 20 px
    iou: float | None  # mean overlap
    claims_when_absent: float | None  # share of frames without the person that claim them
    visible_frames: int


def read_truth(path: Path) -> Array:
    """Boxes (N, 4) x, y, w, h in 0-based px, nan where the person is not visible.

    Rows of four numbers are x, y, w, h counted from 1 (OTB), or two corners in a `gt.txt` (TLD);
    eight are a polygon's corners (VOT). Raises UsageError when the file is none of these.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        rows = [line.replace(",", " ").split() for line in lines if line.strip()]
        table = np.array([[float(value) for value in row] for row in rows])
    except (OSError, ValueError) as error:
        raise UsageError(f"--truth {path}: not readable as rows of numbers: {error}") from error
    if table.ndim != 2 or table.shape[1] not in (4, 8):
        raise UsageError(f"--truth {path}: every line must hold 4 or 8 numbers")
    if table.shape[1] == 8:
        x, y = table[:, 0::2], table[:, 1::2]
        return np.column_stack([x.min(1), y.min(1), np.ptp(x, axis=1), np.ptp(y, axis=1)])
    if path.name == "gt.txt":
        return np.hstack([table[:, :2], table[:, 2:] - table[:, :2]])
    return np.hstack([table[:, :2] - 1.0, table[:, 2:]])


def as_array(boxes: Sequence[Box | None]) -> Array:
    """Boxes as (N, 4) x, y, w, h; nan where there is none."""
    rows = [(b.x, b.y, b.w, b.h) if b else (np.nan,) * 4 for b in boxes]
    return np.array(rows, dtype=float).reshape(-1, 4)


def present(boxes: Array) -> npt.NDArray[np.bool_]:
    """Which rows (N,) hold a box (N, 4)."""
    finite: npt.NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(boxes), axis=1)
    return finite


def overlap(a: Array, b: Array) -> Array:
    """Intersection over union (N,) of two rows of boxes (N, 4)."""
    low = np.maximum(a[:, :2], b[:, :2])
    high = np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:])
    common = np.prod(np.clip(high - low, 0.0, None), axis=1)
    union = np.prod(a[:, 2:], axis=1) + np.prod(b[:, 2:], axis=1) - common
    share: Array = np.divide(common, union, out=np.zeros_like(common), where=union > 0.0)
    return share


def centre_error(a: Array, b: Array) -> Array:
    """Distance (N,) of the centres of two rows of boxes (N, 4), px."""
    apart: Array = (a[:, :2] + 0.5 * a[:, 2:]) - (b[:, :2] + 0.5 * b[:, 2:])
    return np.hypot(apart[:, 0], apart[:, 1])


def score(boxes: Array, truth: Array) -> Scores:
    """Scores of boxes (N, 4) against the truth (N, 4), both with nan where there is none.

    A frame without a box is a miss where the person is visible, and right where they are not.
    """
    n = min(len(boxes), len(truth))
    boxes, truth = boxes[:n], truth[:n]
    visible = present(truth)
    claimed = present(boxes)
    fit = np.where(claimed[visible], overlap(boxes[visible], truth[visible]), 0.0)
    error = np.where(claimed[visible], centre_error(boxes[visible], truth[visible]), np.inf)
    seen = bool(visible.any())
    return Scores(
        auc=float((fit[:, None] > OVERLAPS).mean()) if seen else None,
        p20=float((error <= PRECISION_RADIUS).mean()) if seen else None,
        iou=float(fit.mean()) if seen else None,
        claims_when_absent=None if visible.all() else float(claimed[~visible].mean()),
        visible_frames=int(visible.sum()),
    )


@dataclass(frozen=True, slots=True)
class PlaceScores:
    """How well places on the ground fit the labels; None = the recording cannot say."""

    tracking_rate: float | None  # share of labels with a place within 0.5 m
    losses: int  # spells of more than 1 s, more than 1 m off or without a place
    error_median_m: float | None  # over labels with a place
    error_p95_m: float | None
    claims_when_unlabelled: float | None  # share of scans without a label that claim the person
    lost_after_s: float | None  # longest from the last label before they are gone to "lost"
    back_after_s: float | None  # longest from the first label after that to a place within 0.5 m
    labels: int


def read_people(path: Path, count: int) -> dict[int, Array]:
    """Places (count, 2) of each labelled person, m in the laser's frame, nan without a label.

    The file has columns scan_index, id, x, y. Raises UsageError.
    """
    people: dict[int, Array] = {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                index, place = int(row["scan_index"]), (float(row["x"]), float(row["y"]))
                labels = people.setdefault(int(row["id"]), np.full((count, 2), np.nan))
                if 0 <= index < count:
                    labels[index] = place
    except (OSError, ValueError, KeyError, TypeError) as error:
        wanted = "scan_index, id, x and y"
        raise UsageError(f"--truth {path}: not readable as rows of {wanted}: {error!r}") from error
    return people


def score_places(places: Array, labels: Array, stamps: Array) -> PlaceScores:
    """Scores of places (N, 2) against labels (N, 2), both m and nan where there is none.

    A label without a place is a miss; whether a scan without a label shows the person is unknown.
    """
    labelled, claimed = np.isfinite(labels[:, 0]), np.isfinite(places[:, 0])
    error = np.where(claimed, np.hypot(*(places - labels).T), np.inf)
    error = error[labelled]
    known = error[np.isfinite(error)]
    median, p95 = np.percentile(known, [50, 95]).tolist() if known.size else (None, None)
    at = stamps[labelled]
    away, back = _gone(np.flatnonzero(labelled), stamps)
    lost_after = [_wait(~claimed[i:], stamps[i:]) for i in away]
    near = np.zeros(len(stamps), np.bool_)
    near[labelled] = error < NEAR
    back_after = [_wait(near[i:], stamps[i:]) for i in back]
    return PlaceScores(
        tracking_rate=float((error < NEAR).mean()) if error.size else None,
        losses=_losses(error > ASTRAY, at),
        error_median_m=median,
        error_p95_m=p95,
        claims_when_unlabelled=None if labelled.all() else float(claimed[~labelled].mean()),
        lost_after_s=max(lost_after, default=None),
        back_after_s=max(back_after, default=None),
        labels=int(labelled.sum()),
    )


def _losses(astray: npt.NDArray[np.bool_], stamps: Array) -> int:
    """Spells of more than LOSS seconds; time in which the person was gone does not count."""
    losses, spell, before = 0, 0.0, np.inf
    for bad, stamp in zip(astray.tolist(), stamps.tolist(), strict=True):
        dt = stamp - before if 0.0 <= stamp - before < GONE else 0.0
        losses += spell <= LOSS < spell + dt and bad
        spell, before = (spell + dt, stamp) if bad else (0.0, stamp)
    return losses


def _gone(labelled: npt.NDArray[np.intp], stamps: Array) -> tuple[list[int], list[int]]:
    """Indices of the last label before, and of the first after, each absence of the person."""
    apart = np.flatnonzero(np.diff(stamps[labelled]) > GONE)
    return labelled[apart].tolist(), labelled[apart + 1].tolist()


def _wait(happens: npt.NDArray[np.bool_], stamps: Array) -> float:
    """Seconds until something first happens; to the end where it never does."""
    when = int(happens.argmax()) if happens.any() else len(stamps) - 1
    return float(stamps[when] - stamps[0])
