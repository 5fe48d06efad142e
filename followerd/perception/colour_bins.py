"""Colours in 128 bins of hue, saturation and value, by one table."""

from functools import cache

import cv2
import numpy as np

from followerd.messages import Pixels

HUES, SATURATIONS, VALUES = 8, 4, 4
COLOURS = HUES * SATURATIONS * VALUES
GREY = 30  # saturation below which the hue is noise: only the value counts
GREYS = 8  # values told apart there
LEVELS = 32  # of each channel, in the table


@cache
def _table() -> Pixels:
    """Bin of every (blue, green, red), each in LEVELS."""
    level = (np.arange(LEVELS) * 8 + 4).astype(np.uint8)
    bgr = np.stack(np.meshgrid(level, level, level, indexing="ij"), axis=-1).reshape(1, -1, 3)
    h, s, v = np.moveaxis(np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV)[0], int), -1, 0)
    # 180 hues in bins whose middles, not ends, are at red, yellow, green, ...
    hue = ((h + 180 / HUES / 2) * HUES // 180 % HUES).astype(int)
    saturation = 1 + (s - GREY) * (SATURATIONS - 1) // (256 - GREY)
    coloured = (saturation * HUES + hue) * VALUES + v * VALUES // 256
    bins: Pixels = np.where(s < GREY, v * GREYS // 256, coloured).astype(np.uint8)
    return bins


def colour_bins(pixels: Pixels) -> Pixels:
    """The bin (H, W), below COLOURS, of each pixel (H, W, 3) BGR or (H, W) grey."""
    if pixels.ndim == 2:
        return np.asarray(pixels // (256 // GREYS), np.uint8)
    level = pixels >> np.uint8(3)
    index = level[..., 0].astype(np.intp)
    for channel in (1, 2):
        index *= LEVELS
        index += level[..., channel]
    bins: Pixels = np.take(_table(), index)
    return bins
