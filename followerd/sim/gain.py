"""A thermal camera's automatic gain and offset, which jump when the scene's temperatures do."""

import cv2
import numpy as np

from followerd.messages import Pixels
from followerd.sim.scenarios import AutoGain, draw

MIDDLE = 80.0  # grey levels, about which the gain turns


class Gain:
    """Steady between jumps at random times."""

    def __init__(self, settings: AutoGain, rng: np.random.Generator) -> None:
        self._settings = settings
        self._rng = rng.spawn(1)[0]
        self._gain, self._offset = 1.0, 0.0
        self._jumps_at = draw(settings.jumps_s, self._rng)

    def applied(self, image: Pixels, time: float) -> Pixels:
        """The picture (H, W) as it comes out at `time`, s."""
        s = self._settings
        while time >= self._jumps_at:
            self._gain, self._offset = draw(s.gain, self._rng), draw(s.offset, self._rng)
            self._jumps_at += max(0.1, draw(s.jumps_s, self._rng))
        levels = self._gain * (np.arange(256) - MIDDLE) + MIDDLE + self._offset
        table = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
        return np.asarray(cv2.LUT(image, table), np.uint8)
