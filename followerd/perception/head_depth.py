"""How far away a head is, in a depth image that also shows what is behind it and has holes."""

import numpy as np

from followerd.geometry import Array
from followerd.messages import Image
from followerd.perception.ellipse import DISC, SAME_DEPTH, Ellipse

INNER = 0.6  # of the ellipse, that is looked at
THICK = 0.25  # m, from the middle of a head's depths to its nearest and farthest
LEAST = 0.15  # share of the points that must agree


def head_depth(image: Image, head: Ellipse, expected: float | None) -> float | None:
    """Depth along the axis, m, of the head inside an ellipse; None where nothing tells it.

    Near `expected` m if enough lies there; else what most of the ellipse shows.
    """
    if image.depth is None:
        return None
    height, width = image.depth.shape
    points = np.floor(INNER * head.a * DISC * (1.0, head.aspect) + (head.x, head.y)).astype(int)
    inside = (points >= 0).all(axis=1) & (points < (width, height)).all(axis=1)
    z = image.depth[points[inside, 1], points[inside, 0]]
    z = np.sort(z[np.isfinite(z)]).astype(float)
    least = max(LEAST * len(DISC), 1.0)
    if expected is not None:
        near = z[np.abs(z - expected) < SAME_DEPTH]
        if near.size >= least:
            return _within(near, float(np.median(near)))
    if z.size < least:
        return None
    # the stretch of depths that holds most points
    ends = np.searchsorted(z, z + 2.0 * THICK, side="right")
    first = int(np.argmax(ends - np.arange(z.size)))
    return float(np.median(z[first : ends[first]]))


def _within(z: Array, middle: float) -> float:
    return float(np.median(z[np.abs(z - middle) <= THICK]))
