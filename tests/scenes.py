"""Small worlds for tests: an ideal robot, even light, one person, and what is asked for."""

from typing import Any

import numpy as np

from followerd.sim.scenarios import Scenario
from followerd.sim.world import World

OUTFIT = {"upper": {"colour": "#b03a2e"}, "lower": {"colour": "#2c3e63"}}
STEADY = {"drift": 0.0, "noise": 0.0}
ROOM = [{"points_m": [[-4, -4], [8, -4], [8, 4], [-4, 4], [-4, -4]]}]


def person(x: float, y: float, **changes: Any) -> dict[str, Any]:
    """One who stands at a point, looking away from the robot."""
    fields = {"name": "p", "height_m": 1.75, "outfits": [OUTFIT], "path": [{"x_m": x, "y_m": y}]}
    return fields | changes


def walker(*points: tuple[float, float], speed: float = 1.0, **changes: Any) -> dict[str, Any]:
    """One who sets out at once along the points."""
    path = [{"x_m": x, "y_m": y, "speed_mps": speed} for x, y in points]
    return person(0, 0) | {"path": path, "start_after_s": 0.0} | changes


def scene(*people: dict[str, Any], **changes: Any) -> Scenario:
    """A scenario; the first person is the target, by default one 6 m ahead."""
    first, *others = people or (person(6.0, 0.0),)
    fields = {
        "name": "test",
        "light": STEADY,
        "robot": {"wheel_error": 0.0, "slip": 0.0},
        "people": [first | {"target": True}, *others],
    }
    return Scenario.model_validate(fields | changes)


def world(*people: dict[str, Any], seed: int = 0, **changes: Any) -> World:
    """The scene come to life at time 0."""
    made = World(scene(*people, **changes), np.random.default_rng(seed))
    made.advance(0.0)
    return made
