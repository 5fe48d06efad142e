"""How long a footprint can keep a twist before it touches something."""

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.messages import Twist

EDGE = 1e-9  # m: a point that glides along the edge must not slip through the rounding
STRAIGHT = 1e-3  # rad/m: less curvature than this is driven straight


@dataclass(frozen=True, slots=True)
class Footprint:
    """A rectangle around the origin of `base`."""

    front: float  # m
    rear: float  # m, positive
    half_width: float  # m

    def grown(self, ends: float, sides: float) -> "Footprint":
        """Larger by `ends` in front and behind, by `sides` left and right."""
        return Footprint(self.front + ends, self.rear + ends, self.half_width + sides)

    def covers(self, points: Array) -> npt.NDArray[np.bool_]:
        """Which of the points (N, 2) lie inside or on the edge."""
        x, y = points[:, 0], points[:, 1]
        inside: npt.NDArray[np.bool_] = (x <= self.front + EDGE) & (x >= -self.rear - EDGE)
        inside &= np.abs(y) <= self.half_width + EDGE
        return inside


def time_to_contact(points: Array, twist: Twist, body: Footprint) -> Array:
    """Seconds (N,) until `body`, keeping `twist`, touches each of the points (N, 2).

    inf = never, 0 for points inside. Exact for straight lines, arcs and turns on the spot, of up
    to half a revolution; `twist` must not be zero.
    """
    if abs(twist.omega) <= STRAIGHT * abs(twist.v):
        time = _ahead(points, twist.v, body)
    else:
        time = _around(points, twist, body)
    time[body.covers(points)] = 0.0
    return time


def _ahead(points: Array, v: float, body: Footprint) -> Array:
    way = points[:, 0] - body.front if v > 0 else -points[:, 0] - body.rear
    hit = (way >= 0) & (np.abs(points[:, 1]) < body.half_width)
    time: Array = np.where(hit, way / abs(v), inf)
    return time


def _around(points: Array, twist: Twist, body: Footprint) -> Array:
    """Seen from the body the points circle the centre of rotation, and enter through an edge.

    Each edge lies `at` a coordinate of one axis and spans `low` to `high` on the other, measured
    from the centre; it is entered on that half of the circle on which it moves outward.
    """
    left, radius = (1.0 if twist.omega > 0 else -1.0), twist.v / twist.omega
    time = np.full(points.shape[0], inf)
    z = points[:, 0] + 1j * (points[:, 1] - radius)
    rho2 = z.real**2 + z.imag**2
    inner = max(0.0, abs(radius) - body.half_width)
    outer2 = max(body.front, body.rear) ** 2 + (abs(radius) + body.half_width) ** 2
    near = np.flatnonzero((rho2 < outer2) & (rho2 > inner * inner))
    edges = _edges(body, radius)
    at, low, high, half = edges[:, :4, None].transpose(1, 0, 2)
    square = rho2[near] - at * at
    place = left * half * np.sqrt(np.maximum(square, 0.0))
    edge, point = np.nonzero((square >= 0.0) & (place >= low) & (place <= high))
    crossing = at[edge, 0] + 1j * place[edge, point]
    # the sides' coordinates are the other way round
    crossing = np.where(edges[edge, 4] > 0.0, crossing, 1j * crossing.conj())
    turn = left * np.angle(z[near[point]] * crossing.conj())
    turns = np.full(square.shape, inf)
    turns[edge, point] = np.where(turn >= 0.0, turn, inf)
    time[near] = turns.min(axis=0) / abs(twist.omega)
    return time


def _edges(body: Footprint, radius: float) -> Array:
    """Front, rear, left and right: at, low, high, entered half in a left turn, an end or a side."""
    right, left = -body.half_width - radius, body.half_width - radius
    return np.array(
        [
            (body.front, right, left, -1.0, 1.0),
            (-body.rear, right, left, 1.0, 1.0),
            (left, -body.rear, body.front, 1.0, 0.0),
            (right, -body.rear, body.front, -1.0, 0.0),
        ]
    )


def stopping_speed(distance: float, reaction: float, deceleration: float) -> float:
    """Fastest speed v with v * reaction + v^2 / (2 deceleration) <= distance; 0 without room.

    Of a way in m, or of an angle in rad with the deceleration of the turn.
    """
    if distance <= 0.0:
        return 0.0
    braking = deceleration * reaction
    return sqrt(braking * braking + 2.0 * deceleration * distance) - braking


def stopping_distance(speed: float, reaction: float, deceleration: float) -> float:
    """The way of `stopping_speed`, m."""
    return speed * reaction + speed * speed / (2.0 * deceleration)
