"""How well a run followed its person: the `follow` figures, from its decisions and the truth.

A figure that the logs cannot tell is None, never 0.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import degrees, hypot, isfinite, pi

import numpy as np

from followerd.bench.looks import Look, looks
from followerd.geometry import Camera, wrap_angle
from followerd.messages import Decision, Mode
from followerd.sim.truth import Actor, Truth

PRIVATE_ZONE = 0.45  # m, between the robot's centre and a person's axis

Figure = float | int | None
Figures = dict[str, Figure | dict[str, Figure]]


def follow_figures(
    truths: Sequence[Truth], decisions: Sequence[Decision], camera: Camera
) -> Figures:
    """The `follow` part of a run's summary; both logs in the order of time.

    Tracking counts from the moment the first track is held. Collisions and the least distance are
    those that the robot caused (see Truth).
    """
    seen = looks(truths, decisions)
    first = next((i for i, look in enumerate(seen) if look.held), len(seen))
    tracked = seen[first:]
    gaps = [look.truth.target.distance for look in seen if look.mode is Mode.FOLLOWING]
    bearing = _rms([look.bearing_error for look in tracked])
    waits = reacquisition_times(tracked)
    last = truths[-1] if truths else None
    return {
        "tracking_rate": _mean([look.on_target for look in tracked]),
        "target_visibility_ratio": _mean([is_visible(truth.target, camera) for truth in truths]),
        "range_rmse_m": _rms([look.range_error for look in tracked]),
        "bearing_rmse_deg": None if bearing is None else degrees(bearing),
        "position_rmse_m": _rms([look.position_error for look in tracked]),
        "follow_distance_mean_m": _mean(gaps),
        "follow_distance_std_m": float(np.std(gaps)) if gaps else None,
        "lost_count": losses(tracked) if tracked else None,
        "time_to_reacquire_s": {"p50": _percentile(waits, 50), "p95": _percentile(waits, 95)},
        "identity_switch_count": identity_switches(tracked) if tracked else None,
        "wrong_follow_m": wrong_follow(tracked) if tracked else None,
        "collision_count": last.collisions if last else None,
        "bumped_count": last.bumped if last else None,
        "min_person_distance_m": nearest(last) if last else None,
        "min_any_distance_m": _finite(last.min_any_distance) if last else None,
        "time_in_private_zone_s": private_time(truths) if truths else None,
    }


def nearest(last: Truth) -> float | None:
    """Least distance to a person whom the robot approached; of all if it never approached any."""
    caused = _finite(last.min_person_distance)
    return _finite(last.min_any_distance) if caused is None else caused


def is_visible(actor: Actor, camera: Camera) -> bool:
    """Whether the camera's field of view holds the actor, and nothing hides them."""
    aside = wrap_angle(actor.bearing - camera.yaw)
    in_view = abs(aside) < 0.5 * pi and 0 <= camera.column(actor.bearing) < camera.width
    return actor.in_sight and in_view


def losses(tracked: Sequence[Look]) -> int:
    """How often a held track was lost."""
    return sum(before.held and not after.held for before, after in pairwise(tracked))


def reacquisition_times(tracked: Sequence[Look]) -> list[float]:
    """From every loss to the next right position, s; a loss for good has none."""
    waits = []
    lost_at: float | None = None
    for before, look in pairwise(tracked):
        if lost_at is None and before.held and not look.held:
            lost_at = look.truth.stamp
        elif lost_at is not None and look.on_target:
            waits.append(look.truth.stamp - lost_at)
            lost_at = None
    return waits


def identity_switches(tracked: Sequence[Look]) -> int:
    """How often the track came to stand on another person than it stood on last."""
    stood_on = [look.person for look in tracked if look.person is not None]
    return sum(before != after for before, after in pairwise(stood_on))


def wrong_follow(tracked: Sequence[Look]) -> float:
    """Path that the robot was driven after what is not its person, m; braking is not counted."""
    return sum(
        hypot(after.truth.pose.x - before.truth.pose.x, after.truth.pose.y - before.truth.pose.y)
        for before, after in pairwise(tracked)
        if before.follows_wrongly
    )


def private_time(truths: Sequence[Truth]) -> float:
    """Time that the robot was within a person's private zone, s."""
    return sum(
        after.stamp - before.stamp
        for before, after in pairwise(truths)
        if min(actor.distance for actor in (before.target, *before.others)) < PRIVATE_ZONE
    )


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _rms(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.sqrt(np.mean(np.square(known)))) if known else None


def _percentile(values: Sequence[float], share: float) -> float | None:
    return float(np.percentile(values, share)) if values else None


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
