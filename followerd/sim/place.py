"""The fixed part of a world, cut into the planes in which things are touched and seen."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import cos, hypot, radians, sin

import numpy as np

from followerd.geometry import Array
from followerd.sim.raycast import Floats, cast_one, distance_to_segments
from followerd.sim.scenarios import Block, Scenario

Circle = tuple[float, float, float]  # x, y, radius, m

LASER_HEIGHT = 0.3  # m, of the scanner's plane
ROBOT_HEIGHT = 0.6  # m, what hangs higher is passed under
TOUCHING = 0.02  # m, a ray that comes this near to a body has met it
EYE_HEIGHT = 1.2  # m, lower furniture does not hide a person


class Place:
    """Walls, boxes and columns as segments (M, 4) and circles (K, 3) in the world, m."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self.laser = self._at(lambda low, high: low <= LASER_HEIGHT <= high)
        self.body = self._at(lambda low, _high: low < ROBOT_HEIGHT)
        self.everything = self._at(lambda _low, _high: True)
        segments, columns = self._at(lambda _low, high: high > EYE_HEIGHT)
        self._sight: tuple[list[Floats], list[Floats]] = (segments.tolist(), columns.tolist())

    def _at(self, counts: Callable[[float, float], bool]) -> tuple[Array, Array]:
        """Segments and circles of everything whose bottom and top `counts` accepts."""
        segments: list[tuple[float, float, float, float]] = []
        for wall in self._scenario.walls:
            if counts(0.0, wall.height_m):
                segments += [(*a, *b) for a, b in pairwise(wall.points_m)]
        for block in self._scenario.boxes:
            if counts(block.bottom_m, block.height_m):
                corners = outline(block)
                segments += [(*a, *b) for a, b in pairwise([*corners, corners[0]])]
        circles = [
            (column.x_m, column.y_m, column.radius_m)
            for column in self._scenario.columns
            if counts(0.0, column.height_m)
        ]
        return np.array(segments).reshape(-1, 4), np.array(circles).reshape(-1, 3)

    def nearest(self, x: float, y: float) -> tuple[float, float, float]:
        """Distance to what the robot's body would touch first, and the direction there (x, y)."""
        segments, circles = self.body
        best = (float("inf"), 1.0, 0.0)
        if len(segments):
            distances = distance_to_segments(x, y, segments)
            i = int(np.argmin(distances))
            ax, ay, bx, by = segments[i].tolist()
            length2 = max(1e-12, (bx - ax) ** 2 + (by - ay) ** 2)
            part = min(1.0, max(0.0, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length2))
            best = _towards(ax + part * (bx - ax) - x, ay + part * (by - ay) - y, 0.0)
        for cx, cy, radius in circles.tolist():
            best = min(best, _towards(cx - x, cy - y, radius))
        return best

    def sees(self, x: float, y: float, bodies: Sequence[Circle]) -> list[bool]:
        """For each body (x, y, radius), whether nothing hides its middle from (x, y)."""
        segments, circles = self._sight
        circles = [*circles, *bodies]
        seen = []
        for body_x, body_y, radius in bodies:
            dx, dy = body_x - x, body_y - y
            distance = max(1e-9, hypot(dx, dy))
            hit = cast_one(x, y, dx / distance, dy / distance, segments, circles)
            seen.append(hit > distance - radius - TOUCHING)
        return seen


def outline(block: Block) -> list[tuple[float, float]]:
    """The four corners of a box on the floor plan, counter-clockwise."""
    c, s = cos(radians(block.yaw_deg)), sin(radians(block.yaw_deg))
    half_x, half_y = 0.5 * block.length_m, 0.5 * block.width_m
    return [
        (block.x_m + c * u - s * v, block.y_m + s * u + c * v)
        for u, v in ((-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y))
    ]


def _towards(dx: float, dy: float, radius: float) -> tuple[float, float, float]:
    length = max(1e-9, hypot(dx, dy))
    return length - radius, dx / length, dy / length
