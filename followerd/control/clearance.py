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
    """Seen from the body the points circle the centre of rotation, and enter through an edge."""
    left, radius = (1.0 if twist.omega > 0 else -1.0), twist.v / twist.omega
    time = np.full(points.shape[0], inf)
    x, y = points[:, 0], points[:, 1] - radius
    rho2 = x * x + y * y
    inner = max(0.0, abs(radius) - body.half_width)
    outer2 = max(body.front, body.rear) ** 2 + (abs(radius) + body.half_width) ** 2
    near = ((rho2 < outer2) & (rho2 > inner * inner)).nonzero()[0]
    if not near.size:
        return time
    at, low, high, half = _edges(body, radius)
    square = rho2[near] - at * at
    place = left * half * np.sqrt(np.maximum(square, 0.0))
    edge, entering = ((square >= 0.0) & (place >= low) & (place <= high)).nonzero()
    point, across, along = near[entering], at[edge, 0], place[edge, entering]
    # the sides' coordinates are the other way round
    crossing = np.where(edge < 2, across + 1j * along, along + 1j * across)
    turn = left * np.angle((x[point] + 1j * y[point]) * crossing.conj())
    entered = turn >= 0.0
    np.minimum.at(time, point[entered], turn[entered] / abs(twist.omega))
    return time


def _edges(body: Footprint, radius: float) -> Array:
    """Front, rear, left and right (4, 4, 1): rows at, low, high, half.

    Each edge lies `at` a coordinate of one axis and spans `low` to `high` on the other, measured
    from the centre of rotation; in a left turn it is entered on that `half` of the circle on which
    it moves outward.
    """
    front, rear = body.front, -body.rear
    right, left = -body.half_width - radius, body.half_width - radius
    return np.array(
        (
            *(front, rear, left, right),
            *(right, right, rear, rear),
            *(left, left, front, front),
            *(-1.0, 1.0, 1.0, -1.0),
        )
    ).reshape(4, 4, 1)


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
