"""Rays against line segments and circles in the plane: pure, vectorised."""

from collections.abc import Sequence
from math import inf, sqrt

import numpy as np

from followerd.geometry import Array

Floats = Sequence[float]

PARALLEL = 1e-12  # a ray this parallel to a segment misses it
JOINT = 1e-9  # share by which segments overlap where they are joined


def cast(origins: Array, directions: Array, segments: Array, circles: Array) -> Array:
    """Distance (N,) along each ray to the first thing hit; inf = nothing.

    `origins` (N, 2) or (2,), `directions` (N, 2) of unit length, `segments` (M, 4) as x0 y0 x1 y1,
    `circles` (K, 3) as x y radius, or (K, 3, N) where they move from ray to ray. Circles are hit
    from outside and, where a ray starts within, from inside.
    """
    origin = np.ascontiguousarray(origins.T)
    direction = np.ascontiguousarray(directions.T)
    hits = np.full(len(directions), np.inf)
    if len(segments):
        np.minimum(hits, _to_segments(origin, direction, segments), out=hits)
    if len(circles):
        np.minimum(hits, _to_circles(origin, direction, circles), out=hits)
    return hits


def cast_one(
    x: float, y: float, dx: float, dy: float, segments: Sequence[Floats], circles: Sequence[Floats]
) -> float:
    """The same for a single ray, where arrays are not worth their while."""
    nearest = inf
    for ax, ay, bx, by in segments:
        a, b = dx * (ay - y) - dy * (ax - x), dx * (by - y) - dy * (bx - x)
        if a * b > 0.0 or abs(b - a) < PARALLEL:
            continue  # both ends on one side of the ray
        t = ((ax - x) * (by - ay) - (ay - y) * (bx - ax)) / (b - a)
        if 0.0 <= t < nearest:
            nearest = t
    for cx, cy, radius in circles:
        aside = (cx - x) * dy - (cy - y) * dx
        if abs(aside) < radius:
            ahead, chord = (cx - x) * dx + (cy - y) * dy, sqrt(radius * radius - aside * aside)
            t = ahead - chord if ahead >= chord else ahead + chord
            if 0.0 <= t < nearest:
                nearest = t
    return nearest


def _to_segments(origin: Array, direction: Array, segments: Array) -> Array:
    """Every ray against every segment: for the few dozens of a floor plan choosing costs more."""
    ax, ay, bx, by = segments.T
    ex, ey = bx - ax, by - ay
    aside, back = np.array([ey, -ex]).T, np.array([-ay, ax]).T
    # with o + t d = a + u e:  t = (a - o) x e / (d x e),  u = (a - o) x d / (d x e)
    across = aside @ direction
    across[np.abs(across) < PARALLEL] = np.nan
    t = ((ax * ey - ay * ex)[:, None] - (aside @ origin).reshape(len(segments), -1)) / across
    u = (back @ direction - (origin[0] * direction[1] - origin[1] * direction[0])) / across
    t[~((t >= 0.0) & (np.abs(u - 0.5) <= 0.5 + JOINT))] = np.inf
    nearest: Array = t.min(axis=0)
    return nearest


def _to_circles(origin: Array, direction: Array, circles: Array) -> Array:
    dx, dy = direction
    x, y, radius = circles.reshape(len(circles), 3, -1).swapaxes(0, 1)
    x, y = x - origin[0], y - origin[1]
    ahead = x * dx + y * dy
    aside = x * dy - y * dx
    half = radius * radius - aside * aside  # squared half chord
    chord = np.sqrt(np.maximum(half, 0.0))
    near, far = ahead - chord, ahead + chord
    t = np.where(near >= 0.0, near, far)
    t[(half < 0.0) | (far < 0.0)] = np.inf
    nearest: Array = t.min(axis=0)
    return nearest


def distance_to_segments(x: float, y: float, segments: Array) -> Array:
    """Distance (M,) of a point from each segment."""
    start = segments[:, :2]
    along = segments[:, 2:] - start
    offset = np.array([x, y]) - start
    length2 = np.einsum("mi,mi->m", along, along)
    part = np.clip(np.einsum("mi,mi->m", offset, along) / np.maximum(length2, 1e-12), 0.0, 1.0)
    gap = offset - part[:, None] * along
    distance: Array = np.hypot(gap[:, 0], gap[:, 1])
    return distance
