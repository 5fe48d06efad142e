"""The map of a scenario that somebody made with a tape: what a laser sees of it, a little wrong."""

from itertools import pairwise
from math import cos, hypot, pi, sin

import numpy as np

from followerd.geometry import Array
from followerd.maps.floor import FloorMap
from followerd.maps.plan import from_segments
from followerd.sim.place import Place
from followerd.sim.scenarios import Scenario

ERROR = 0.01  # m, of a wall along its normal
FACES = 8  # of a column


def surveyed(scenario: Scenario, rng: np.random.Generator) -> FloorMap:
    """Walls, furniture and columns as high as the laser; the robot starts on free floor."""
    segments, columns = Place(scenario).laser
    rows = [row for row in segments.tolist() if hypot(row[2] - row[0], row[3] - row[1]) > 0.0]
    for x, y, radius in columns.tolist():
        turns = [2.0 * pi * k / FACES for k in range(FACES + 1)]
        ring = [(x + radius * cos(turn), y + radius * sin(turn)) for turn in turns]
        rows += [(*a, *b) for a, b in pairwise(ring)]
    walls: Array = np.array(rows).reshape(-1, 2, 2)
    along = walls[:, 1] - walls[:, 0]
    along /= np.hypot(along[:, 0], along[:, 1])[:, None]
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    walls = walls + (ERROR * rng.standard_normal(len(walls)))[:, None, None] * normal[:, None]
    start = np.array([[scenario.robot.x_m, scenario.robot.y_m]])
    return from_segments(walls, free=start)
