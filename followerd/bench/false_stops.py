"""Stops that nothing called for: no fault, and the person in plain sight with nobody beside them.

A robot that loses a person who is hidden, or who may be somebody else, does what it owes.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import hypot

from followerd.messages import Decision, Mode, StopReason
from followerd.sim.truth import Actor, Truth

IDENTITY = frozenset({StopReason.TARGET_UNSURE, StopReason.TARGET_LOST})
BROKEN = IDENTITY | {
    StopReason.SCAN_STALE, StopReason.IMAGE_STALE, StopReason.ODOMETRY_STALE,
    StopReason.DECISION_STALE, StopReason.ABSURD_DATA, StopReason.LINK_LOST,
    StopReason.DEVICE_REFUSED, StopReason.LOOP_LATE, StopReason.WHEEL_STALL,
    StopReason.BUMPER, StopReason.MOTORS_OFF, StopReason.STOP_BUTTON,
    StopReason.LOW_BATTERY, StopReason.OPERATOR_GONE,
}  # fmt: skip
STARTING = frozenset({Mode.DISARMED, Mode.READY, Mode.ESTOP, Mode.MANUAL})
PLAIN = 1.0  # s of plain sight before a stop for the person's identity is false
BESIDE = 1.0  # m; whoever is nearer to the person may be them
LONGEST = 0.1  # s that one decision is taken to last

InView = Callable[[Actor], bool]


@dataclass(frozen=True, slots=True)
class Account:
    """How well a run went on where nothing stood in its way."""

    sound: float  # s of following, or of standing falsely, without a fault
    stood: float  # s of these it stood falsely
    stops: tuple[tuple[float, StopReason], ...]  # when it began to, and why


def account(
    truths: Sequence[Truth],
    decisions: Sequence[Decision],
    hurt: Sequence[tuple[float, float]],
    in_view: InView,
) -> Account:
    """`hurt`: begins and ends (s) of what faults may explain; decisions in the order of time.

    A false stop lasts until the robot follows again, gives its arming up, or something is hurt.
    """
    stamps = [truth.stamp for truth in truths]
    sound = stood = 0.0
    stops: list[tuple[float, StopReason]] = []
    was_moving = is_false = False
    for decision, following in pairwise(decisions):
        now, reason = decision.stamp, broken(decision)
        if any(first <= now <= last for first, last in hurt) or decision.mode in STARTING:
            was_moving = is_false = False
            continue
        if reason is None and decision.mode is Mode.FOLLOWING:
            was_moving, is_false = True, False
        elif was_moving and reason is not None:
            seen = truths[bisect_right(stamps, now - PLAIN) : bisect_right(stamps, now)]
            plain = all(_is_plain(truth, in_view) for truth in seen)
            is_false, was_moving = plain or reason not in IDENTITY, False
            stops += [(now, reason)] if is_false else []
        lasts = min(following.stamp - now, LONGEST)
        sound += lasts if was_moving or is_false else 0.0
        stood += lasts if is_false else 0.0
    return Account(sound, stood, tuple(stops))


def broken(decision: Decision) -> StopReason | None:
    """What broke, that the robot stands for it."""
    return next((r.stop for r in decision.reasons if r.full_stop and r.stop in BROKEN), None)


def _is_plain(truth: Truth, in_view: InView) -> bool:
    """Whether the person is in plain sight."""
    target = truth.target
    near = (hypot(other.x - target.x, other.y - target.y) < BESIDE for other in truth.others)
    return in_view(target) and not any(near)
