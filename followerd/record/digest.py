"""What a recording holds, in figures and in curves."""

from collections import Counter
from dataclasses import dataclass, field
from math import nan
from typing import Any

import numpy as np

from followerd.geometry import Array
from followerd.messages import Image, Odometry
from followerd.record.journal import Dropped, Enrolled, Taken
from followerd.record.reading import Decided, Heard, Numbered, Recording

Curve = dict[str, list[float]]


@dataclass
class Digest:
    """One pass over a recording; times are seconds from its beginning."""

    counts: Counter[str] = field(default_factory=Counter)
    stamps: list[float] = field(default_factory=list)  # of decisions
    modes: list[str] = field(default_factory=list)
    curves: Curve = field(default_factory=dict)  # one value a decision
    path: list[tuple[float, float]] = field(default_factory=list)  # of the robot in `odom`, m
    person: list[tuple[float, float]] = field(default_factory=list)  # likewise
    stops: list[tuple[float, str]] = field(default_factory=list)  # when the reasons changed

    @property
    def duration(self) -> float:
        """From the first decision to the last, s."""
        return self.stamps[-1] - self.stamps[0] if self.stamps else 0.0

    @property
    def times(self) -> Array:
        """Of the decisions (N,), from the first."""
        return np.array(self.stamps) - (self.stamps[0] if self.stamps else 0.0)

    def mode_times(self) -> dict[str, float]:
        """How long each mode lasted, s."""
        spent = dict.fromkeys(self.modes, 0.0)
        for mode, began, ended in zip(self.modes, self.stamps, self.stamps[1:], strict=False):
            spent[mode] += ended - began
        return {mode: round(seconds, 3) for mode, seconds in spent.items()}


def digest(recording: Recording) -> Digest:
    """Read all of it once."""
    found = Digest()
    for record in recording:
        if isinstance(record, Image):
            found.counts["images"] += 1
        elif isinstance(record, Heard):
            found.counts[f"bytes of {record.device}"] += len(record.data)
        elif isinstance(record, Numbered):
            _note(found, record)
        elif isinstance(record, Decided):
            _decide(found, record.plain)
    return found


def _note(found: Digest, record: Numbered) -> None:
    entry = record.entry
    if isinstance(entry, Taken):
        event = entry.event
        found.counts[f"{type(event).__name__} events"] += 1
        if isinstance(event, Odometry):
            found.path.append((event.pose.x, event.pose.y))
    elif isinstance(entry, Dropped):
        found.counts["images nobody looked at"] += 1
    elif isinstance(entry, Enrolled):
        found.counts["enrolments"] += 1


def _decide(found: Digest, decision: dict[str, Any]) -> None:
    found.counts["decisions"] += 1
    found.stamps.append(decision["stamp"])
    found.modes.append(decision["mode"])
    track, motion = decision["track"] or {}, decision["command"]["motion"] or {}
    figures = {
        "range_m": track.get("range"),
        "bearing_deg": None if track.get("bearing") is None else np.degrees(track["bearing"]),
        "confidence": track.get("confidence"),
        "speed_mps": motion.get("v", 0.0),
        "turn_degps": np.degrees(motion.get("omega", 0.0)),
    }
    for name, value in figures.items():
        found.curves.setdefault(name, []).append(nan if value is None else float(value))
    if track.get("position") is not None:
        found.person.append(tuple(track["position"]))
    full = [reason for reason in decision["reasons"] if reason["full_stop"]]
    text = "; ".join(dict.fromkeys(_text(reason) for reason in full))
    if text != (found.stops[-1][1] if found.stops else ""):
        found.stops.append((decision["stamp"], text))


def _text(reason: dict[str, Any]) -> str:
    where = f" ({reason['device']})" if reason["device"] else ""
    return f"{reason['stop']}{where}"
