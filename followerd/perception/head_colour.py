"""The colours of a head: 8 x 8 x 4 bins of hue, saturation and value (Kwolek 2004, section 3).

Grey levels use the bins in which hue would be noise, so one histogram serves colour, grey and
thermal images.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from followerd.messages import Pixels
from followerd.perception.colour import HUE, SATURATION, VALUE, encode
from followerd.perception.hotspot import Levels, grey_of

BINS = 256  # 8 hues x 8 saturations x 4 values
GREYS = 16  # grey levels told apart in images without colour
UNSATURATED, DARK = 32, 24  # of 255: less, and hue is noise
MIDDLE = 110.0  # grey level that a patch is brought to
SPARSE = 8  # px between those that are asked whether they have a colour
COLOURLESS = 6  # grey levels between the channels
BLACK = 25.0  # mean level below which a patch is no brighter made: there is only noise


def _table() -> npt.NDArray[np.uint8]:
    """Bin of each of the 32768 colour codes; without saturation the value alone decides."""
    hue, saturation, value = (t.astype(int) for t in (HUE, SATURATION, VALUE))
    chromatic = (hue * 8 // 180 * 8 + saturation // 32) * 4 + value // 64
    grey = value // 64
    return np.where((saturation < UNSATURATED) | (value < DARK), grey, chromatic).astype(np.uint8)


_TABLE = _table()
_GREY = (np.arange(256) * GREYS // 256).astype(np.uint8)


def bins(pixels: Pixels) -> npt.NDArray[np.uint8]:
    """Histogram bin (H, W) of each pixel of a colour or grey image."""
    if pixels.ndim == 2:
        return np.asarray(cv2.LUT(pixels, _GREY), np.uint8)
    return _TABLE.take(encode(pixels))


@dataclass(frozen=True, slots=True)
class Tone:
    """How the brightness of the scene is taken out of a patch."""

    levels: Levels | None  # of a grey image
    even: bool

    @classmethod
    def of(cls, pixels: Pixels, even: bool) -> "Tone":
        """Of a whole image; `even` False leaves patches as they are."""
        return cls(Levels.of(pixels) if even and pixels.ndim == 2 else None, even)

    def evened(self, pixels: Pixels) -> Pixels:
        """The patch as bright as every other: colours by their mean, greys by the scene's."""
        if self.levels is not None:
            return self.levels.even(np.ascontiguousarray(pixels))
        if not self.even:
            return pixels
        mean = float(np.mean(cv2.mean(pixels)[:3]))
        gain = MIDDLE / max(mean, BLACK)
        return np.asarray(cv2.convertScaleAbs(pixels, alpha=gain), np.uint8)


def evened_grey(pixels: Pixels) -> Pixels:
    """Grey levels (H, W) of a whole image, free of its brightness and contrast."""
    grey = grey_of(pixels)
    return Levels.of(grey).even(grey)


def is_grey(pixels: Pixels) -> bool:
    """Whether an image shows no colours, whatever its channels."""
    if pixels.ndim == 2:
        return True
    sparse = pixels[::SPARSE, ::SPARSE].astype(np.int16)
    return bool((np.ptp(sparse, axis=2) <= COLOURLESS).mean() > 0.99)
