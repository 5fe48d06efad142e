"""Where in a whole image a person of known colours may be."""

import cv2
import numpy as np

from followerd.geometry import Array
from followerd.messages import Pixels
from followerd.perception.colour import ColourRatio, encode
from followerd.perception.maps import contrast

BODY = 9.0  # px of the reduced image, square root of the person's area


def places(pixels: Pixels, colour: ColourRatio, size: Array, most: int) -> Array:
    """Centres (M, 2), px, of the `most` places where a box of `size` (2,) has the best contrast.

    Places lie at least half a body apart.
    """
    factor = float(np.sqrt(size[0] * size[1])) / BODY
    height, width = pixels.shape[:2]
    small = (max(int(width / factor), 8), max(int(height / factor), 8))
    step = max(int(factor) // 2, 1)  # every second px is enough for colours, and faster to reduce
    coarse = np.ascontiguousarray(pixels[::step, ::step])
    reduced = np.asarray(cv2.resize(coarse, small, interpolation=cv2.INTER_AREA), np.uint8)
    w, h = (float(v) for v in size / factor)
    ratio = colour.log_ratio(encode(reduced))
    score = contrast(ratio, (slice(0, small[1]), slice(0, small[0])), w, h)
    kernel = np.ones((int(0.5 * h) | 1, int(0.5 * w) | 1), np.uint8)
    peak = (score == cv2.dilate(score, kernel)) & (score > 0.0)
    y, x = np.nonzero(peak)
    order = np.argsort(-score[y, x], kind="stable")[:most]
    found: Array = np.column_stack([x, y])[order] + 0.5
    found *= (width / small[0], height / small[1])
    return found
