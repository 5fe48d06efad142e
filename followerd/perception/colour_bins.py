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
SPREAD = 0.3  # of brightness, by which pixels are dithered


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


@cache
def _gains() -> Pixels:
    """Gains (1024, 1024, 3) in 128ths, 4 x 4 different ones evenly spread over 1 +- SPREAD."""
    bayer = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])
    gains = 128.0 * (1.0 + SPREAD * ((2 * bayer + 1) / 16.0 - 1.0))
    tiled: Pixels = np.tile(gains.round().astype(np.uint8)[..., None], (256, 256, 3))
    return tiled


def dithered(pixels: Pixels) -> Pixels:
    """Neighbours (H, W, 3) or (H, W) made darker and brighter by turns.

    So what lies near the border of two bins of brightness counts for both, by how near it lies.
    """
    gains = _gains()[: pixels.shape[0], : pixels.shape[1]]
    if pixels.ndim == 2:
        gains = np.ascontiguousarray(gains[..., 0])
    return np.asarray(cv2.multiply(pixels, gains, scale=1.0 / 128.0), np.uint8)


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
