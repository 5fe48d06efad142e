"""The outline of a body that nobody has drawn: where the laser has found its legs."""

from math import hypot

import numpy as np

from followerd.geometry import Camera
from followerd.messages import Box

HALF_WIDTH, TOP = 0.20, 1.0  # m: legs and hips, what the camera keeps in view


def body_box(camera: Camera, x: float, y: float) -> Box:
    """The visible part of the box around a body at (x, y) of `base`: legs and hips, px."""
    distance = hypot(x, y)
    aside = np.array([-y, x]) / distance * HALF_WIDTH
    corners = np.array(
        [[x + s * aside[0], y + s * aside[1], z] for s in (-1.0, 1.0) for z in (0.0, TOP)]
    )
    columns, rows, _ = camera.project(corners).T
    first = max(0.0, float(columns.min())), max(0.0, float(rows.min()))
    last = min(camera.width - 1.0, columns.max()), min(camera.height - 1.0, rows.max())
    return Box(*first, float(last[0] - first[0]), float(last[1] - first[1]))
