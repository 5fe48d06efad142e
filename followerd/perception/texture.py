"""Rotation-invariant uniform local binary patterns (LBP 8,1; Ojala et al. 2002), as in Jia 2015."""

import cv2
import numpy as np
import numpy.typing as npt

from followerd.messages import Pixels

PATTERNS = 10  # 0..8 brighter neighbours in one run, 9: more than two changes around the ring
FLAT = 10  # too even to have a pattern: noise would draw it
CONTRAST = 4  # grey levels between the darkest and the brightest of nine
RING = ((0, 0), (0, 1), (0, 2), (1, 2), (2, 2), (2, 1), (2, 0), (1, 0))  # row, column


def _table() -> Pixels:
    """Pattern of each of the 256 rings."""
    rings = (np.arange(256)[:, None] >> np.arange(8)) & 1
    changes = (rings != np.roll(rings, 1, axis=1)).sum(axis=1)
    patterns: Pixels = np.where(changes <= 2, rings.sum(axis=1), 9).astype(np.uint8)
    return patterns


PATTERN = _table()


def patterns(grey: Pixels) -> Pixels:
    """The pattern (H, W), 0..9 or FLAT, around each pixel of `grey` (H, W)."""
    height, width = grey.shape
    framed = np.asarray(cv2.copyMakeBorder(grey, 1, 1, 1, 1, cv2.BORDER_REPLICATE), np.uint8)
    code: Pixels = np.zeros((height, width), np.uint8)
    brighter = np.empty((height, width), np.bool_)
    for bit, (row, column) in enumerate(RING):
        np.greater_equal(framed[row : row + height, column : column + width], grey, out=brighter)
        code |= brighter.view(np.uint8) << np.uint8(bit)
    found = np.asarray(cv2.LUT(code, PATTERN), np.uint8)
    nine: npt.NDArray[np.uint8] = np.ones((3, 3), np.uint8)
    contrast = cv2.subtract(cv2.dilate(grey, nine), cv2.erode(grey, nine))
    found[np.asarray(contrast) < CONTRAST] = FLAT
    return found
