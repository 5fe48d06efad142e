"""What the laser says of itself, and what a person can do about it."""

from typing import NamedTuple

from followerd.hw.lms200.telegrams import (
    ERROR,
    FATAL,
    IMPLAUSIBLE,
    POLLUTED,
    SEVERITY,
    WARNING,
    ErrorEntry,
    Status,
)

SEVERITIES = {1: "information", WARNING: "warning", ERROR: "error", FATAL: "fatal error"}
CLEAN = "clean its window with a soft damp cloth, without scratching it"
POWER_CYCLE = "switch it off and on; if the error comes back, have it serviced"
SERVICE = "it is defective: have it serviced"
LOOK_AROUND = "look for sunlight, another scanner or a mirror in its view, and clean its window"


class Complaint(NamedTuple):
    """A problem in the device's words, and the remedy."""

    problem: str
    remedy: str


def complaint_of(status: int, errors: tuple[ErrorEntry, ...] = ()) -> Complaint | None:
    """What a status byte complains about, the gravest; None when it is content."""
    worst = max([status & SEVERITY, *(entry.severity & SEVERITY for entry in errors)])
    said = f"status 0x{status:02X}" + "".join(f", {described(entry)}" for entry in errors)
    if worst >= FATAL:
        return Complaint(f"reports a fatal error ({said})", SERVICE)
    if status & POLLUTED:
        return Complaint(f"reports a dirty window ({said})", CLEAN)
    if status & IMPLAUSIBLE:
        return Complaint(f"calls its own measurements implausible ({said})", LOOK_AROUND)
    if worst == ERROR:
        return Complaint(f"reports an error ({said})", POWER_CYCLE)
    if worst == WARNING:
        return Complaint(f"warns ({said})", CLEAN)
    return None


def described(entry: ErrorEntry) -> str:
    """An entry of its fault memory."""
    severity = SEVERITIES.get(entry.severity & SEVERITY, "entry")
    return f"{severity} {entry.number}"


def dirtiest(report: Status) -> tuple[int, float] | None:
    """The window's worst channel, from 1, and how clear it is, 1 = clean; None if unknown."""
    pairs = zip(report.pollution, report.pollution_calibration, strict=True)
    clear = [now / clean if clean else 1.0 for now, clean in pairs]
    if not any(report.pollution_calibration):
        return None
    channel = min(range(len(clear)), key=clear.__getitem__)
    return channel + 1, clear[channel]
