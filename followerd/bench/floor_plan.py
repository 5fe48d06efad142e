"""Maps of places that need no scans: plans measured by hand, and simulated worlds."""

from math import pi
from pathlib import Path

import numpy as np

from followerd import yaml
from followerd.geometry import Array
from followerd.maps.floor import FloorMap
from followerd.maps.plan import CELL, PLAN_KEYS, from_segments, read_plan
from followerd.sim import scenarios
from followerd.sim.place import Place

CORNERS = 16  # of a column


def floor_of(source: Path) -> FloorMap | None:
    """The map of a plan's file or of a simulated world, by name or file; None for what is neither.

    Raises ConfigError for a wrong file.
    """
    if source.suffix in (".yaml", ".yml"):
        given = yaml.read(source).value
        if isinstance(given, dict) and PLAN_KEYS & given.keys():
            return read_plan(source)
    elif source.exists() or str(source) not in scenarios.known():
        return None
    return world_map(scenarios.load(source))


def world_map(scenario: scenarios.Scenario, cell: float = CELL) -> FloorMap:
    """What a laser can see of a world's fixed part, columns with 16 sides."""
    segments, circles = Place(scenario).laser
    walls = [segments.reshape(-1, 2, 2), *(_sides(*circle) for circle in circles.tolist())]
    start = np.array([[scenario.robot.x_m, scenario.robot.y_m]])
    return from_segments(np.concatenate(walls), cell, start)


def _sides(x: float, y: float, radius: float) -> Array:
    angles = np.linspace(0.0, 2.0 * pi, CORNERS + 1)
    corners = np.column_stack([x + radius * np.cos(angles), y + radius * np.sin(angles)])
    return np.stack([corners[:-1], corners[1:]], axis=1)
