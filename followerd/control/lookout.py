"""Where to drive so as to go on seeing the person, wherever they walk next.

Courses straight ahead of the robot are weighed: how much of where the person may be in the next
seconds could not be seen on the way there and from its end, past the known returns and within the
laser's field, how far it is to drive, and how far from the person it would end.
"""

from math import atan2, cos, hypot, sin

import numpy as np
from pydantic import Field

from followerd.control.ground import SOLID, Ground, Mask, Point
from followerd.geometry import Array
from followerd.settings import Settings

RINGS = (0.4, 0.9, 1.5, 2.1)  # m from the robot
RAYS = np.radians(np.linspace(-85.0, 85.0, 11))  # from the direction to the person
# rad/s in the first and in the second half of the time
TURNS = np.array([(0, 0), (0.5, 0), (-0.5, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
DODGES = np.array([0.0, 0.5, -0.5, 1.0, -1.0, 1.6, -1.6])  # rad, where something stands in the way
BODY = 0.25  # m, that a person keeps from what stands around
STEPS = 8  # of a walk
LOOKS = 4  # of them that are looked at
SLOWEST = 0.1  # m/s, of a person who may walk
NOTHING = 0.9  # unseen: as good as all of it


class LookoutSettings(Settings):
    """What is looked at, and what a place costs."""

    horizon_s: float = Field(5.5, gt=0, description="where the person may be by then is looked at")
    speed_mps: float = Field(0.5, gt=0, description="at which the robot gets to a place")
    turn_radps: float = Field(1.0, gt=0, description="and turns there")
    field_deg: float = Field(87.0, gt=0, le=180, description="what is farther aside is not seen")
    nearest_m: float = Field(1.1, gt=0, description="a place is no nearer to their walk")
    close_m: float = Field(1.8, gt=0, description="kept of a person who may soon be hidden")
    roomy_m: float = Field(0.9, gt=0, description="off all returns the guard lets it go anywhere")
    unseen_cost: float = Field(6.0, gt=0, description="to see nothing of where they may be")
    way_cost_per_m: float = Field(0.3, ge=0)
    turn_cost_per_rad: float = Field(0.2, ge=0, description="before it can set out")
    far_cost_per_m: float = Field(0.7, ge=0, description="nearer or farther than `close_m`")
    tight_cost_per_m: float = Field(3.0, ge=0, description="nearer to a return than `roomy_m`")
    gain: float = Field(0.15, ge=0, description="cost that a place must save")
    keep: float = Field(0.3, ge=0, description="cost that another must save over the last one")
    stay_share: float = Field(0.5, ge=0, le=1, description="if more is unseen it goes to them")


def walks(ground: Ground, person: Point, velocity: Point, sigma: float, horizon: float) -> Array:
    """Where the person, known to `sigma` m, may be (LOOKS, M, 2), until `horizon`, s."""
    speed = max(hypot(*velocity), SLOWEST)
    heading = atan2(velocity[1], velocity[0])
    along = np.array([0.0] if sigma < BODY else [-0.7 * sigma, 0.0, 0.7 * sigma])
    aim = np.full((len(along), len(TURNS)), heading).ravel()
    ahead = np.array([cos(heading), sin(heading)])
    at = np.repeat(np.array(person) + along[:, None] * ahead, len(TURNS), axis=0)
    turns = np.tile(TURNS, (len(along), 1))
    dt, every, shown = horizon / STEPS, STEPS // LOOKS, []
    for step in range(STEPS):
        aim = aim + dt * turns[:, 2 * step // STEPS]
        tried = aim[:, None] + DODGES
        there = at[:, None] + dt * speed * np.stack([np.cos(tried), np.sin(tried)], axis=2)
        free: Mask = (ground.room(there.reshape(-1, 2)) >= BODY).reshape(tried.shape)
        first = free.argmax(axis=1)
        row = np.arange(len(at))
        aim = tried[row, first]
        at = np.where(free[row, first][:, None], there[row, first], at)
        if (step + 1) % every == 0:
            shown.append(at)
    return np.array(shown)


def unseen(
    ground: Ground, places: Array, spots: Array, heading: float, s: LookoutSettings
) -> Array:
    """Share (N,) of `spots` (T, M, 2) that is not seen on the way to each of `places` (N, 2)."""
    here = np.array(ground.here)
    way = places - here
    length = np.hypot(way[:, 0], way[:, 1])
    unit = way / np.maximum(length, 1e-9)[:, None]
    direction = unit[:, 0] + 1j * unit[:, 1]
    moves = length > 1e-6
    turn = np.where(moves, np.abs(np.angle(direction * np.exp(-1j * heading))), 0.0)
    times = s.horizon_s * np.arange(1, len(spots) + 1) / len(spots)
    gone = np.clip(s.speed_mps * (times - turn[:, None] / s.turn_radps), 0.0, length[:, None])
    stands = here + gone[:, :, None] * unit[:, None]  # (N, T, 2)
    n, (t, m) = len(places), spots.shape[:2]
    ends = np.broadcast_to(spots, (n, t, m, 2))
    starts = np.broadcast_to(stands[:, :, None], (n, t, m, 2))
    seen = ground.is_open(starts.reshape(-1, 2), ends.reshape(-1, 2), SOLID).reshape(n, t, m)
    off = ends - starts
    aside = np.angle((off[..., 0] + 1j * off[..., 1]) * direction.conj()[:, None, None])
    under_way = moves[:, None] & (gone < length[:, None])
    seen &= ~(under_way[:, :, None] & (np.abs(aside) > np.radians(s.field_deg)))
    share: Array = 1.0 - seen.mean(axis=(1, 2))
    return share


def lookout(
    ground: Ground, person: Point, spots: Array, heading: float, last: Point | None,
    settings: LookoutSettings,
) -> Point | None:  # fmt: skip
    """The best place to see `spots` (T, M, 2) from, perhaps the present one; None where nearly
    nothing can be seen from any.

    The robot looks along `heading`, the person is in sight or not; `last` is the place that was
    chosen before.
    """
    s, here = settings, np.array(ground.here)
    angles = atan2(person[1] - here[1], person[0] - here[0]) + RAYS
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    rings = [here + ring * rays for ring in RINGS]
    places = np.concatenate([here[None], *rings, [ground.here if last is None else last]])
    course = np.concatenate([[person], spots.mean(axis=1)])
    off = np.hypot(*(places[:, None] - course).transpose(2, 0, 1))  # (N, T + 1)
    fits = ground.is_open(here, places, ground.narrow) & (off.min(axis=1) > s.nearest_m)
    fits[0] = True
    kept = last is not None and bool(fits[-1])
    places, off = places[fits], off[fits, off.shape[1] // 2]
    way = places - here
    turns = np.abs(np.angle((way[:, 0] + 1j * way[:, 1]) * np.exp(-1j * heading)))
    turns[0] = 0.0
    hidden = unseen(ground, places, spots, heading, s)
    cost = s.unseen_cost * hidden
    cost += s.way_cost_per_m * np.hypot(*way.T) + s.turn_cost_per_rad * turns
    cost += s.far_cost_per_m * np.abs(off - s.close_m)
    cost += s.tight_cost_per_m * np.maximum(s.roomy_m - ground.room(places), 0.0)
    if kept:
        cost[-1] -= s.keep
    best = int(cost.argmin())
    if cost[best] > cost[0] - s.gain:
        return ground.here if hidden[0] < s.stay_share else None
    if hidden[best] > NOTHING:
        return None
    x, y = places[best].tolist()
    return x, y


def seen(ground: Ground, place: Point, spots: Array) -> Mask:
    """Which spots (T, M) are seen from a place."""
    lines = ground.is_open(np.array([place]), spots.reshape(-1, 2), SOLID)
    of_each: Mask = lines.reshape(spots.shape[:2])
    return of_each
