"""Rays against line segments and circles in the plane: pure, vectorised."""

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array

Indices = npt.NDArray[np.intp]

PARALLEL = 1e-12  # a ray this parallel to a segment misses it
JOINT = 1e-9  # share by which segments overlap where they are joined
SLACK = 1e-9  # rad, m


def cast(origins: Array, directions: Array, segments: Array, circles: Array) -> Array:
    """Distance (N,) along each ray to the first thing hit; inf = nothing.

    `origins` (N, 2) or (2,), `directions` (N, 2) of unit length, `segments` (M, 4) as x0 y0 x1 y1,
    `circles` (K, 3) as x y radius, or (N, K, 3) where they move from ray to ray. Circles are hit
    from outside and, where a ray starts within, from inside.
    """
    origins = np.broadcast_to(origins, directions.shape)
    hits = np.full(len(directions), np.inf)
    if len(segments):
        np.minimum(hits, _to_segments(origins, directions, segments), out=hits)
    if circles.shape[-2]:
        np.minimum(hits, _to_circles(origins, directions, circles), out=hits)
    return hits


def _to_segments(origins: Array, directions: Array, segments: Array) -> Array:
    rays, pieces = _candidates(origins, directions, segments)
    ox, oy = origins[rays].T
    dx, dy = directions[rays].T
    ax, ay, bx, by = segments[pieces].T
    ex, ey = bx - ax, by - ay
    ax, ay = ax - ox, ay - oy
    # with o + t d = a + u e:  t = (a - o) x e / (d x e),  u = (a - o) x d / (d x e)
    across = dx * ey - dy * ex
    across[np.abs(across) < PARALLEL] = np.nan
    t = (ax * ey - ay * ex) / across
    u = (ax * dy - ay * dx) / across
    hit = (t >= 0.0) & (np.abs(u - 0.5) <= 0.5 + JOINT)
    nearest = np.full(len(directions), np.inf)
    np.minimum.at(nearest, rays[hit], t[hit])
    return nearest


def _candidates(origins: Array, directions: Array, segments: Array) -> tuple[Indices, Indices]:
    """Pairs (ray, segment) that may meet, by the angles in which the segments are seen."""
    centre = origins.mean(axis=0)
    spread = float(np.hypot(*(origins - centre).T).max(initial=0.0))
    angles = np.arctan2(directions[:, 1], directions[:, 0])
    order = np.argsort(angles, kind="stable")
    circle = np.concatenate([angles[order], angles[order] + 2 * np.pi])
    begin = np.arctan2(segments[:, 1] - centre[1], segments[:, 0] - centre[0])
    end = np.arctan2(segments[:, 3] - centre[1], segments[:, 2] - centre[0])
    width = (end - begin + np.pi) % (2 * np.pi) - np.pi
    near = distance_to_segments(float(centre[0]), float(centre[1]), segments)
    # seen from an origin off the centre, a point turns by at most this
    pad = np.arcsin(np.minimum(1.0, spread / np.maximum(near, 1e-12))) + SLACK
    pad[near <= spread + SLACK] = np.pi
    low = (np.minimum(begin, begin + width) - pad + np.pi) % (2 * np.pi) - np.pi
    first = np.searchsorted(circle, low)
    last = np.searchsorted(circle, low + np.abs(width) + 2 * pad, side="right")
    counts = np.minimum(last - first, len(angles))
    pieces = np.repeat(np.arange(len(segments)), counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return order[(first[pieces] + within) % len(angles)], pieces


def _to_circles(origins: Array, directions: Array, circles: Array) -> Array:
    x = circles[..., 0] - origins[:, 0, None]
    y = circles[..., 1] - origins[:, 1, None]
    ahead = x * directions[:, 0, None] + y * directions[:, 1, None]
    aside = x * directions[:, 1, None] - y * directions[:, 0, None]
    half = circles[..., 2] ** 2 - aside * aside  # squared half chord
    chord = np.sqrt(np.maximum(half, 0.0))
    near, far = ahead - chord, ahead + chord
    t = np.where(near >= 0.0, near, far)
    t[(half < 0.0) | (far < 0.0)] = np.inf
    nearest: Array = t.min(axis=1)
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
