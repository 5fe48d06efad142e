"""How well a localizer knew where the robot was: the `localization` figures of a summary."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from followerd.messages import Decision, RobotPose
from followerd.sim.truth import Truth


def localization_figures(
    truths: Sequence[Truth], decisions: Sequence[Decision]
) -> dict[str, float | int | None]:
    """Share of the time with a pose, times it got lost, and errors where the truth is the map's."""
    known = [_is_known(decision.pose) for decision in decisions]
    poses = {d.pose.stamp: d.pose for d in decisions if d.pose is not None and not d.pose.lost}
    figures: dict[str, float | int | None] = {
        "known_rate": float(np.mean(known)) if known else None,
        "lost_count": sum(before and not after for before, after in pairwise(known)),
        "position_error_mean_m": None,
        "position_error_p95_m": None,
        "heading_error_mean_deg": None,
    }
    if not truths or not poses:
        return figures
    stamps = [truth.stamp for truth in truths]
    rows = np.array([(t.pose.x, t.pose.y, t.pose.theta) for t in truths])
    rows[:, 2] = np.unwrap(rows[:, 2])
    right = np.column_stack([np.interp(list(poses), stamps, column) for column in rows.T])
    at = [pose.map_from_base for pose in poses.values()]
    off = np.array([(pose.x, pose.y, pose.theta) for pose in at]) - right
    away = np.hypot(off[:, 0], off[:, 1])
    turned = np.abs((off[:, 2] + np.pi) % (2.0 * np.pi) - np.pi)
    return figures | {
        "position_error_mean_m": float(away.mean()),
        "position_error_p95_m": float(np.percentile(away, 95)),
        "heading_error_mean_deg": float(np.degrees(turned).mean()),
    }


def _is_known(pose: RobotPose | None) -> bool:
    return pose is not None and not pose.lost
