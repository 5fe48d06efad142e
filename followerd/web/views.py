"""What the page is told, as JSON values: plain, rounded, never NaN."""

from math import isfinite
from typing import Any

import numpy as np

from followerd.control.interfaces import View
from followerd.control.limits import GuardSettings
from followerd.geometry import Array, Pose2
from followerd.messages import Box, Decision, RobotPose, Scan, Twist, WheelSpeeds, Wish

MOST_PARTICLES = 120  # drawn


def track_view(decision: Decision) -> dict[str, Any] | None:
    """The track, for drawing on its picture."""
    track = decision.track
    if track is None:
        return None
    return {
        "frame": track.frame_id,
        "phase": track.phase.value,
        "confidence": number(track.confidence),
        "box": _box(track.box),
        "candidates": [_box(box) for box in track.candidates[:30]],
        "particles": _thinned(track.particles),
        "patches": _patches(track.patches),
        "range": number(track.range),
        "bearing": number(track.bearing),
        "position": None if track.position is None else [number(v) for v in track.position],
        "covariance": None
        if track.covariance is None
        else [number(v) for v in np.asarray(track.covariance)[:2, :2].ravel().tolist()],
    }


def decision_view(decision: Decision, base: Pose2 | None) -> dict[str, Any]:
    """Mode, reasons, command, and where the robot is."""
    wanted, given = motion(decision.wish), motion(decision.command.motion)
    return {
        "now": number(decision.stamp),
        "mode": decision.mode.value,
        "reasons": [str(reason) for reason in decision.reasons],
        "stops": decision.command.stops,
        "wish": [number(wanted.v), number(wanted.omega)],
        "command": [number(given.v), number(given.omega)],
        "motors": decision.motors,
        "base": pose_view(base),
        "map_from_odom": _placed(decision.pose),
    }


def scan_view(scan: Scan, base: Pose2) -> list[list[float]]:
    """End points of a scan in `odom`, cm: whole numbers are shorter."""
    points = scan.points()
    seen = base.apply(points[np.isfinite(points).all(axis=1)])
    whole: list[list[float]] = np.rint(100.0 * seen).astype(int).tolist()
    return whole


def legs_view(view: View) -> list[list[float]]:
    """What looks like a leg or two in a scan, in `odom`, cm."""
    seen = view.base.apply(view.clusters.centre[view.clusters.leg_like])
    whole: list[list[float]] = np.rint(100.0 * seen).astype(int).tolist()
    return whole


def lines_view(lines: Array) -> list[list[list[float]]]:
    """Lines (K, N, 2) in `odom`, cm."""
    whole: list[list[list[float]]] = np.rint(100.0 * lines).astype(int).tolist()
    return whole


def body_view(guard: GuardSettings) -> dict[str, float]:
    """The robot's footprint, and what the guard keeps free before it."""
    return {
        "front": guard.front_m,
        "rear": guard.rear_m,
        "half_width": guard.half_width_m,
        "margin": guard.margin_m,
        "side": guard.side_margin_m,
        "reaction": guard.reaction_s,
        "deceleration": guard.deceleration_mps2,
    }


def walls_view(walls: Array) -> list[list[float]]:
    """Walls (K, 2, 2) of a map as x1, y1, x2, y2 in `map`, m."""
    rounded: list[list[float]] = np.round(walls.reshape(-1, 4), 3).tolist()
    return rounded


def pose_view(pose: Pose2 | None) -> list[float | None] | None:
    """x, y, theta."""
    return None if pose is None else [number(pose.x), number(pose.y), number(pose.theta)]


def motion(wish: Wish | None) -> Twist:
    """Any wish as speed and turn rate, for showing."""
    if isinstance(wish, Twist):
        return wish
    if isinstance(wish, WheelSpeeds):
        return Twist(0.5 * (wish.left + wish.right), 0.0)
    return Twist() if wish is None else Twist(wish.v, wish.angle)


def number(value: float | None) -> float | None:
    """Rounded to a ten thousandth; None where it is no number."""
    return None if value is None or not isfinite(value) else round(float(value), 4)


def _placed(pose: RobotPose | None) -> list[float | None] | None:
    return None if pose is None or pose.lost else pose_view(pose.map_from_odom)


def _box(box: Box | None) -> list[float | None] | None:
    return None if box is None else [number(v) for v in (box.x, box.y, box.w, box.h)]


def _patches(patches: Array | None) -> list[list[float | None]]:
    """x, y, w, h and likeness of each, None where it is hidden."""
    return [] if patches is None else [[number(v) for v in row] for row in patches.tolist()]


def _thinned(particles: Array | None) -> list[list[float]]:
    if particles is None or not len(particles):
        return []
    every = max(1, len(particles) // MOST_PARTICLES)
    shown = np.asarray(particles)[::every, :2]
    rounded: list[list[float]] = np.round(shown[np.isfinite(shown).all(axis=1)], 2).tolist()
    return rounded
