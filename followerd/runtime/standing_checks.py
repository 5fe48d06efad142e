"""What `drive-check` can say of a base and a laser that stand still: reports in, verdicts out."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from math import degrees, isfinite

import numpy as np

from followerd.hw.p2os.parameters import Parameters
from followerd.messages import BatteryLevel, Odometry, Scan

LOSES = 0.05  # share of reports that may be lost: three in a row lose the link
SEES = 0.2  # share of beams that must see something


class Outcome(Enum):
    """Of a check."""

    OK = "ok"
    FAILED = "FAILED"
    LEFT_OUT = "left out"


@dataclass(frozen=True, slots=True)
class Check:
    """What was looked at, what came of it, and what to do."""

    name: str
    outcome: Outcome
    detail: str
    remedy: str = ""


def verdict(name: str, good: bool, detail: str, remedy: str = "") -> Check:
    """A check that was made; the remedy stands where it failed."""
    return Check(name, Outcome.OK if good else Outcome.FAILED, detail, "" if good else remedy)


def session(base_id: str, known: Parameters) -> Check:
    """Who the base is, and what it is held to."""
    return verdict(
        "session",
        True,
        f"{base_id}, firmware {known.firmware or 'unknown'}; at most {known.speed:.2f} m/s,"
        f" {degrees(known.turn):.0f}°/s, brakes with {known.deceleration:.2f} m/s²",
    )


def reports(heard: Sequence[Odometry], seconds: float, known: Parameters) -> Check:
    """Whether all of the base's reports come through."""
    due = seconds / known.cycle
    lost = max(0.0, 1.0 - (len(heard) + 1) / due)  # one more may be under way
    detail = f"{len(heard) / seconds:.1f} a second, {lost:.0%} lost"
    return verdict("reports", lost <= LOSES, detail, "check the cable, the adapter, the CPU load")


def battery(newest: Odometry) -> Check:
    """Whether it has enough to drive with."""
    level, volts = newest.battery_level, newest.battery
    detail = f"{volts:.1f} V, {level.value}" + (", charging" if newest.charging else "")
    poor = level in (BatteryLevel.WEAK, BatteryLevel.EMPTY) or not isfinite(volts)
    return verdict("battery", not poor, detail, "charge it")


def bumpers(newest: Odometry) -> Check:
    """Whether nothing is pressed, no wheel held."""
    if newest.stop_button:  # it is felt as a stall, too
        remedy = "release it, then press MOTORS"
        return verdict("bumpers", False, "the STOP button is pressed", remedy)
    pressed = [
        f"{place} bumper {number + 1}"
        for place, bits in (("front", newest.bumpers_front), ("rear", newest.bumpers_rear))
        for number in range(bits.bit_length())
        if bits >> number & 1
    ]
    sides = zip(("left", "right"), newest.wheel_stall, strict=True)
    pressed += [f"{side} wheel stalled" for side, stalled in sides if stalled]
    detail = ", ".join(pressed) or "none pressed, no wheel stalled"
    remedy = "free them; if there are none, the flash must say so (FrontBumps, RearBumps)"
    return verdict("bumpers", not pressed, detail, remedy)


def sonar(heard: Sequence[Odometry]) -> Check:
    """What the sonar hears; a base may have none."""
    echoes = {echo.disc: echo for report in heard for echo in report.sonar}
    if not echoes:
        return Check("sonar", Outcome.LEFT_OUT, "none reports; the robot never backs up then")
    nearest = min(echoes.values(), key=lambda echo: echo.range)
    where = side(degrees(nearest.pose.theta))
    detail = f"{len(echoes)} discs; nearest echo {nearest.range:.2f} m, {where}"
    return verdict("sonar", True, detail)


def laser(scans: Sequence[Scan], seconds: float) -> tuple[Check, str]:
    """Whether the laser sees, and in words where the nearest thing is, if it does."""
    if not scans:
        return verdict("laser", False, "no scans", "see followerd probe"), ""
    rate, scan = len(scans) / seconds, scans[-1]
    seen = np.isfinite(scan.ranges)
    detail = f"{rate:.1f} scans a second, {np.count_nonzero(seen)} of {seen.size} beams see"
    if scan.degraded:
        return verdict("laser", False, f"{detail}; it warns", "clean its window"), ""
    if seen.mean() < SEES:
        remedy = "take its cover off; in a wide hall, go nearer to something"
        return verdict("laser", False, detail, remedy), ""
    points = scan.points()
    distances = np.hypot(*points.T)
    index = int(np.nanargmin(distances))
    x, y = points[index].tolist()
    where = f"{distances[index]:.2f} m away, {side(degrees(np.arctan2(y, x)))}"
    return verdict("laser", True, f"{detail}; nearest return {where}"), where


def side(angle: float) -> str:
    """A bearing (deg, left positive) in words."""
    if abs(angle) < 5:
        return "straight ahead"
    return f"{abs(angle):.0f}° to the {'left' if angle > 0 else 'right'}"
