"""A scan's points as if all beams had been measured at once."""

import numpy as np

from followerd.geometry import Array
from followerd.messages import Scan, Twist


def deskewed(scan: Scan, twist: Twist) -> Array:
    """End points (N, 2) in `base` at the scan's stamp, m, of a robot that moves with `twist`."""
    points = scan.points()
    if twist == Twist():
        return points
    turn = twist.omega * scan.beam_times
    way = twist.v * scan.beam_times
    c, s = np.cos(turn), np.sin(turn)
    x, y = points.T
    moved: Array = np.column_stack(
        [
            c * x - s * y + way * np.cos(0.5 * turn),
            s * x + c * y + way * np.sin(0.5 * turn),
        ]
    )
    return moved
