"""Where to stand so as to see the person, and where they may be a moment later.

Places straight ahead of the robot are weighed: how much of that cannot be seen from there past the
known returns, how far it is to drive, and how far from the person it would stand.
"""

from math import atan2, pi

import numpy as np
from pydantic import Field

from followerd.control.ground import SOLID, Ground, Mask, Point
from followerd.geometry import Array
from followerd.settings import Settings

RINGS = (0.3, 0.6, 0.9, 1.3, 1.8)  # m from the robot
RAYS = np.radians(np.linspace(-84.0, 84.0, 13))  # from the direction to the person
TURNS = np.array([0.0, 40.0, -40.0, 80.0, -80.0, 130.0, -130.0]) * pi / 180  # off their heading


class LookoutSettings(Settings):
    """What a good view is worth."""

    horizon_s: float = Field(2.5, ge=0, description="where the person may be by then is looked at")
    most_m: float = Field(1.6, gt=0, description="farthest from the person to be looked at")
    worth_m: float = Field(4.5, gt=0, description="of way: to see all of it instead of nothing")
    turn_m: float = Field(0.4, ge=0, description="of way: to turn by a radian before")
    nearest_m: float = Field(1.1, gt=0, description="a place is no nearer to the person")
    close_m: float = Field(1.2, gt=0, description="kept of a person who may soon be hidden")
    gain_m: float = Field(0.15, ge=0, description="what a place must be better than the present")
    keep_m: float = Field(0.6, ge=0, description="what another must be better than the last one")


def lookout(
    ground: Ground, person: Point, spots: Array, heading: float, last: Point | None,
    settings: LookoutSettings,
) -> Point | None:  # fmt: skip
    """The better place than the present one to see `spots` (N, 2) from; None where there is none.

    The robot looks along `heading`, the person is in sight or not; `last` is the place that was
    chosen before.
    """
    s, here = settings, np.array(ground.here)
    angles = atan2(person[1] - here[1], person[0] - here[0]) + RAYS
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    rings = [here + ring * rays for ring in RINGS]
    places = np.concatenate([here[None], *rings, [ground.here if last is None else last]])
    off = np.hypot(*(places - person).T)
    fits = ground.is_open(here, places, ground.narrow) & (off > s.nearest_m)
    fits[0] = True
    kept = last is not None and bool(fits[-1])
    places, off = places[fits], off[fits]
    way = places - here
    turns = np.abs(np.angle((way[:, 0] + 1j * way[:, 1]) * np.exp(-1j * heading)))
    turns[0] = 0.0
    cost = s.worth_m * (1.0 - seen(ground, places, spots).mean(axis=1))
    cost += np.hypot(*way.T) + s.turn_m * turns + 0.5 * np.abs(off - s.close_m)
    if kept:
        cost[-1] -= s.keep_m
    best = int(cost.argmin())
    if cost[best] > cost[0] - s.gain_m:
        return None
    x, y = places[best].tolist()
    return x, y


def around(ground: Ground, person: Point, heading: float, reach: float) -> Array:
    """Where somebody who walks along `heading` may be within `reach` m (N, 2); the present place
    first and twice.
    """
    angles = heading + TURNS
    rays = reach * np.column_stack([np.cos(angles), np.sin(angles)])
    at = np.array(person)
    middle = at + 0.5 * rays
    middle = middle[ground.is_open(at, middle, SOLID)]
    if not len(middle):
        return at[None]
    # on, or round one corner, which is a way of at most 1.5 times the reach
    far = at + rays
    first, last = np.repeat(middle, len(far), axis=0), np.tile(far, (len(middle), 1))
    come = ground.is_open(first, last, SOLID).reshape(len(middle), -1).any(axis=0)
    return np.concatenate([[at, at], middle, far[come]])


def seen(ground: Ground, places: Array, spots: Array) -> Mask:
    """Which spots (M, 2) are seen from which places (N, 2): (N, M)."""
    n, m = len(places), len(spots)
    lines = ground.is_open(np.repeat(places, m, axis=0), np.tile(spots, (n, 1)), SOLID)
    of_each: Mask = lines.reshape(n, m)
    return of_each
