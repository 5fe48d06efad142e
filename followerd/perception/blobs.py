"""Connected regions of a mask as rectangles (Zhuang 2008, 3.2), and blobs that hide a person.

Rectangles are (M, 4) arrays x y w h: centre and size, px.
"""

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array

Mask = npt.NDArray[np.uint8]


def rectangles(mask: Mask, close: int, area_min: float, most: int = 50) -> Array:
    """The `most` largest 8-connected regions with at least `area_min` px.

    Speckle is opened away (3x3); gaps up to `close` px wide, as between two trouser legs, closed.
    The library's labelling does the work of Bruce's runs and union-find.
    """
    clean = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    if close >= 3:
        clean = cv2.morphologyEx(clean, cv2.MORPH_CLOSE, np.ones((3, close | 1), np.uint8))
    stats = cv2.connectedComponentsWithStats(clean, connectivity=8)[2].reshape(-1, 5)[1:]
    stats = stats[stats[:, cv2.CC_STAT_AREA] >= area_min]
    stats = stats[np.argsort(-stats[:, cv2.CC_STAT_AREA], kind="stable")[:most]].astype(float)
    x, y, w, h = stats[:, :4].T
    boxes: Array = np.column_stack([x + 0.5 * w, y + 0.5 * h, w, h])
    return boxes


def split(boxes: Array, predicted: Array) -> Array:
    """Boxes (M, 4) with pseudo-candidates of the predicted size for blobs that are too wide.

    A blob much wider than the prediction (4,) and about as tall, near it, is the person and
    something of the same colour: the person may stand at its left edge, at its right edge, or
    where it was expected.
    """
    x, _, w, h = predicted
    reach = 0.5 * (boxes[:, 2] + w) + 0.5 * w
    wide = (boxes[:, 2] > 1.25 * w) & (boxes[:, 3] > 0.7 * h)
    wide &= np.abs(boxes[:, 0] - x) < reach
    parts = [boxes]
    for bx, by, bw, bh in boxes[wide]:
        left, right = bx - 0.5 * (bw - w), bx + 0.5 * (bw - w)
        bottom = by + 0.5 * (bh - h)
        parts.append(
            np.array([[at, bottom, w, h] for at in (left, right, np.clip(x, left, right))])
        )
    return np.concatenate(parts)
