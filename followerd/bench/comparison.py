"""Two trackers on the same inputs: the recorded one, and the one that was replayed."""

import csv
from pathlib import Path
from typing import Any

import numpy as np

from followerd.bench.scores import as_array, overlap
from followerd.errors import UsageError
from followerd.messages import Box, TrackPhase, TrackState
from followerd.record.codec import restored
from followerd.record.replay import Pair

FIGURES = ("status", "x", "y", "w", "h", "bearing", "range", "confidence")
COLUMNS = (
    "stamp",
    "frame",
    *(f"recorded_{f}" for f in FIGURES),
    *(f"replayed_{f}" for f in FIGURES),
)
AGREE = 0.5  # overlap of two boxes that are the same person


class Comparison:
    """Both tracks, a line for each new one."""

    def __init__(self) -> None:
        self._lines: list[tuple[object, ...]] = []
        self._boxes: list[tuple[Box | None, Box | None]] = []
        self._newest: int | None = None

    def add(self, pair: Pair) -> None:
        """One decision of both."""
        old, new = pair.recorded["track"], pair.replayed.track
        frame = old and old["frame_id"] if new is None else new.frame_id
        if frame is None or frame == self._newest:
            return
        self._newest = frame
        self._lines.append((pair.replayed.stamp, frame, *_old(old), *_new(new)))
        box = None if old is None or old["box"] is None else restored(Box, old["box"])
        self._boxes.append((box, new.box if new is not None else None))

    def figures(self) -> dict[str, Any]:
        """How far the two agree; a share is None where there was nothing to share."""
        if not self._boxes:
            return {"tracks": 0}
        old, new = (as_array(side) for side in zip(*self._boxes, strict=True))
        has_old, has_new = (np.isfinite(side).all(axis=1) for side in (old, new))
        both = has_old & has_new
        return {
            "tracks": len(self._boxes),
            "recorded_share": round(float(has_old.mean()), 4),
            "replayed_share": round(float(has_new.mean()), 4),
            "agreement": round(float((overlap(old, new)[both] > AGREE).mean()), 4)
            if both.any()
            else None,
        }

    def write(self, path: Path) -> None:
        """The lines as CSV; raises UsageError."""
        try:
            with path.open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(COLUMNS)
                writer.writerows(self._lines)
        except OSError as error:
            raise UsageError(f"--out {path}: cannot be written: {error.strerror}") from error


def _old(track: dict[str, Any] | None) -> tuple[object, ...]:
    if track is None:
        return ("none", *[None] * 7)
    box = track["box"] or dict.fromkeys("xywh")
    figures = track["bearing"], track["range"], track["confidence"]
    return (track["phase"], *(box[key] for key in "xywh"), *figures)


def _new(track: TrackState | None) -> tuple[object, ...]:
    if track is None:
        return ("none", *[None] * 7)
    box = track.box
    corners = (None,) * 4 if box is None else (box.x, box.y, box.w, box.h)
    phase = TrackPhase(track.phase).value
    return (phase, *corners, track.bearing, track.range, track.confidence)
