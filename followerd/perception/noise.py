"""Whether a picture shows anything at all: of the world, neighbouring pixels look alike."""

import numpy as np

from followerd.messages import Pixels

EVERY = 8  # of the rows that are looked at
ALIKE = 0.8  # pictures have at most 0.2 here, white noise 1


def is_noise(pixels: Pixels) -> bool:
    """Whether neighbours in a row differ as much as any two pixels, as in random bytes."""
    if pixels.shape[1] < 2:
        return False
    rows = pixels[::EVERY].astype(np.float32)
    steps = rows[:, 1:] - rows[:, :-1]
    rows -= rows.mean()
    difference, variance = (float(np.vdot(part, part)) / part.size for part in (steps, rows))
    return difference > 2.0 * ALIKE * variance
