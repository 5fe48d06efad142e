"""Colour models of a person, each a table over the 32768 colours of 5 bits per channel.

`ColourInterval` is the paper's hue-saturation interval (Zhuang 2008, 3.1); `ColourRatio` tells the
person's colours from those of the surroundings, grey, black and white clothes included.
"""

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.messages import Box, Pixels

Codes = npt.NDArray[np.uint16]

SATURATED = 40  # of 255: below, hue is noise and the value tells colours apart
DARK = 30  # of 255: same


def encode(pixels: Pixels) -> Codes:
    """Colour codes (H, W) of an image (H, W, 3) BGR or (H, W) grey: 5 bits each of R, G, B."""
    packing = cv2.COLOR_BGR2BGR555 if pixels.ndim == 3 else cv2.COLOR_GRAY2BGR555
    packed = cv2.cvtColor(np.ascontiguousarray(pixels), packing)
    return packed.view(np.uint16).reshape(pixels.shape[:2])


def _all_colours() -> tuple[Array, Array, Array]:
    """Hue (0..179), saturation and value (0..255) of each code's middle colour, (32768,)."""
    code = np.arange(32768)
    levels = np.stack([code & 31, (code >> 5) & 31, code >> 10], axis=-1) * 8 + 4
    hsv = cv2.cvtColor(levels.astype(np.uint8).reshape(128, 256, 3), cv2.COLOR_BGR2HSV)
    h, s, v = hsv.reshape(-1, 3).astype(np.float32).T
    return h, s, v


HUE, SATURATION, VALUE = _all_colours()


def inner(box: Box, share: float, width: int, height: int) -> tuple[slice, slice]:
    """Rows and columns of the central `share` of a box, at least a pixel, inside the image."""
    x, y = box.centre
    half_w, half_h = 0.5 * share * box.w, 0.5 * share * box.h

    def span(middle: float, half: float, size: int) -> slice:
        start = int(np.clip(round(middle - half), 0, size - 1))
        return slice(start, int(np.clip(round(middle + half), start + 1, size)))

    return span(y, half_h, height), span(x, half_w, width)


class ColourInterval:
    """An interval of hue (it may wrap at red) and floors of saturation and value."""

    def __init__(self, hue: float, reach: float, saturation: float, value: float) -> None:
        """Middle and half width of the hue in OpenCV's 0..179; the floors in 0..255."""
        self.hue, self.reach = hue, reach
        self.saturation, self.value = saturation, value
        self._table = self.accepts(HUE, SATURATION, VALUE).astype(np.uint8)

    @classmethod
    def learn(cls, pixels: Pixels, box: Box) -> "ColourInterval":
        """Thresholds from the inner 60 % of `box` (the first step of 3.1)."""
        height, width = pixels.shape[:2]
        patch = np.ascontiguousarray(pixels[inner(box, 0.6, width, height)])
        h, s, _ = cv2.cvtColor(patch, cv2.COLOR_BGR2HSV).reshape(-1, 3).astype(float).T
        resultant = np.mean(np.exp(1j * np.pi * h / 90.0))
        hue = float(np.angle(resultant) * 90.0 / np.pi % 180.0)
        spread = 90.0 / np.pi * np.sqrt(-2.0 * np.log(max(float(np.abs(resultant)), 1e-3)))
        floor = float(np.percentile(s, 2)) - 30.0
        return cls(hue, max(8.0, 3.0 * float(spread) + 3.0), max(50.0, floor), 40.0)

    def accepts(self, hue: Array, saturation: Array, value: Array) -> npt.NDArray[np.bool_]:
        """Which colours belong to the person."""
        apart = np.abs((hue - self.hue + 90.0) % 180.0 - 90.0)
        bright = (saturation >= self.saturation) & (value >= self.value)
        accepted: npt.NDArray[np.bool_] = (apart <= self.reach) & bright
        return accepted

    def classify(self, codes: Codes) -> npt.NDArray[np.uint8]:
        """Mask (H, W) of 0 and 1 (the second step of 3.1)."""
        return self._table.take(codes)


HUES, SATURATIONS, VALUES, GREYS = 16, 3, 3, 16  # bins
BINS = HUES * SATURATIONS * VALUES + GREYS


def _bins() -> npt.NDArray[np.uint8]:
    """Histogram bin of each code (32768,): by hue, saturation and value, greys by value alone."""
    hue = np.minimum(HUE * HUES / 180.0, HUES - 1).astype(int)
    saturation = ((SATURATION - SATURATED) * SATURATIONS / (256.0 - SATURATED)).astype(int)
    value = (VALUE * VALUES / 256.0).astype(int)
    chromatic = (hue * SATURATIONS + saturation) * VALUES + value
    grey = HUES * SATURATIONS * VALUES + (VALUE * GREYS / 256.0).astype(int)
    return np.where((SATURATION < SATURATED) | (VALUE < DARK), grey, chromatic).astype(np.uint8)


BIN = _bins()


def histogram(codes: Codes) -> Array:
    """Pixels (BINS,) of each colour."""
    return np.bincount(BIN.take(codes).ravel(), minlength=BINS).astype(float)


class ColourRatio:
    """Log ratio of the person's histogram to that of the surroundings, as a table over codes."""

    def __init__(self) -> None:
        self._person = np.full(BINS, 1.0 / BINS)
        self._around = np.full(BINS, 1.0 / BINS)
        self._ratios = np.zeros(256, np.float32)  # of each bin; the rest is not used

    def learn(self, person: Array, around: Array, rate: float) -> None:
        """Blend in histograms of the person and of the surroundings."""
        for known, seen in ((self._person, person), (self._around, around)):
            total = float(seen.sum())
            if total > 0.0:
                known += rate * (seen / total - known)
        ratio = np.log((self._person + 2e-3) / (self._around + 2e-3))
        self._ratios[:BINS] = np.minimum(np.maximum(ratio, -2.0), 2.0)

    def log_ratio(self, codes: Codes) -> npt.NDArray[np.float32]:
        """Map (H, W): positive where the colour is the person's rather than its surroundings'."""
        return np.asarray(cv2.LUT(BIN.take(codes), self._ratios), np.float32)
