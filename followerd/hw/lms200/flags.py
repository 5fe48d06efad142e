"""What the upper bits of a value word say besides the range, by measuring mode.

The measuring modes, with the longest range in mm and in cm: 00 to 02 reach 8 and 80 m, 03 and 04
16 and 160 m, 05, 06 and 0F 32 and 320 m (the device itself sees no farther than 80 m).
"""

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.hw.lms200.scans import RANGE_BITS, Words

WORD_BITS = 16
FIELDS = {0x00: 2, 0x02: 3, 0x04: 2, 0x06: 1}  # modes that flag the fields A, B, C
REFLECTORS = (0x01, 0x03, 0x05)  # modes that grade how much of a reflector each value hit


def fields_of(words: Words, measuring_mode: int) -> npt.NDArray[np.bool_]:
    """Whether each value (N,) lies in the fields A, B, C (N, up to 3), as far as flagged."""
    bits = RANGE_BITS[measuring_mode] + np.arange(FIELDS.get(measuring_mode, 0))
    return (words[:, None] >> bits & 1).astype(np.bool_)


def reflection_of(words: Words, measuring_mode: int) -> Array | None:
    """How reflecting each value's target is (N,), 0 to 1; None when the mode does not say."""
    if measuring_mode not in REFLECTORS:
        return None
    bits = RANGE_BITS[measuring_mode]
    levels = (1 << WORD_BITS - bits) - 1
    reflection: Array = (words >> bits) / levels
    return reflection
