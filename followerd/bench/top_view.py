"""The world from above, north up, around the robot: what is so (grey, green) and claimed (red)."""

from collections.abc import Sequence
from itertools import pairwise
from math import cos, sin

import cv2
import numpy as np

from followerd.geometry import Array, Camera, Pose2
from followerd.messages import Pixels, Scan, TrackState
from followerd.sim.place import outline
from followerd.sim.scenarios import Scenario
from followerd.sim.truth import Actor, Truth

SPAN = 9.0  # m, side of what is shown
PAPER, WALL, FURNITURE, LASER = (245, 245, 245), (60, 60, 60), (190, 200, 205), (200, 120, 0)
ROBOT, TARGET, OTHER, CLAIM, VIEW = (40, 40, 40), (60, 160, 60), (150, 150, 150), (0, 0, 230), 215
BODY = 0.2  # m, radius of a person
SIGHT = 4.0  # m, length of the drawn field of view

Colour = tuple[int, int, int]


class TopView:
    """Square pictures (size, size, 3) of one scenario."""

    def __init__(self, scenario: Scenario, size: int) -> None:
        self._size = size
        self._scenario = scenario
        self._scale = size / SPAN  # px/m

    def draw(
        self, truth: Truth, camera: Camera, scan: Scan | None, track: TrackState | None
    ) -> Pixels:
        """The world at `truth`, with the newest scan and what the daemon believes."""
        canvas = np.full((self._size, self._size, 3), PAPER, np.uint8)
        robot = truth.pose
        self._draw_view(canvas, robot, camera)
        self._draw_plan(canvas, robot)
        if scan is not None:
            for point in robot.apply(scan.points()):
                if np.isfinite(point).all():
                    cv2.circle(canvas, self._spot(point, robot), 1, LASER, -1)
        for actor, colour in ((truth.target, TARGET), *((a, OTHER) for a in truth.others)):
            self._draw_actor(canvas, robot, actor, colour)
        self._draw_robot(canvas, robot)
        if track is not None and track.bearing is not None and track.range is not None:
            claim = (track.range * cos(track.bearing), track.range * sin(track.bearing))
            spot = self._spot(robot.apply_point(*claim), robot)
            cv2.drawMarker(canvas, spot, CLAIM, cv2.MARKER_TILTED_CROSS, 14, 2, cv2.LINE_AA)
        return canvas

    def _spot(self, point: Array | tuple[float, float], robot: Pose2) -> tuple[int, int]:
        """The pixel of a point (x, y) of the world."""
        half = 0.5 * self._size
        return (
            round(half + self._scale * float(point[0] - robot.x)),
            round(half - self._scale * float(point[1] - robot.y)),
        )

    def _polygon(
        self, points: Sequence[tuple[float, float]] | Array, robot: Pose2
    ) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]]:
        return np.array([self._spot(point, robot) for point in points], np.int32)

    def _draw_plan(self, canvas: Pixels, robot: Pose2) -> None:
        for block in self._scenario.boxes:
            corners = self._polygon(outline(block), robot)
            cv2.fillPoly(canvas, [corners], FURNITURE, cv2.LINE_AA)
            cv2.polylines(canvas, [corners], True, WALL, 1, cv2.LINE_AA)
        for column in self._scenario.columns:
            spot = self._spot((column.x_m, column.y_m), robot)
            cv2.circle(canvas, spot, round(column.radius_m * self._scale), FURNITURE, -1)
        for wall in self._scenario.walls:
            for a, b in pairwise(wall.points_m):
                cv2.line(canvas, self._spot(a, robot), self._spot(b, robot), WALL, 2, cv2.LINE_AA)

    def _draw_view(self, canvas: Pixels, robot: Pose2, camera: Camera) -> None:
        edges = [robot.theta + camera.bearing(column) for column in (0, camera.width)]
        angles = np.linspace(edges[0], edges[1], 12)
        arc = np.array([robot.x, robot.y]) + SIGHT * np.column_stack(
            [np.cos(angles), np.sin(angles)]
        )
        corners = self._polygon([(robot.x, robot.y), *map(tuple, arc.tolist())], robot)
        cv2.fillPoly(canvas, [corners], (VIEW, 235, 240), cv2.LINE_AA)

    def _draw_actor(self, canvas: Pixels, robot: Pose2, actor: Actor, colour: Colour) -> None:
        spot = self._spot((actor.x, actor.y), robot)
        cv2.circle(canvas, spot, round(BODY * self._scale), colour, -1, cv2.LINE_AA)
        nose = (
            actor.x + 1.5 * BODY * cos(actor.heading),
            actor.y + 1.5 * BODY * sin(actor.heading),
        )
        cv2.line(canvas, spot, self._spot(nose, robot), colour, 2, cv2.LINE_AA)

    def _draw_robot(self, canvas: Pixels, robot: Pose2) -> None:
        radius = self._scenario.robot.radius_m
        spot = self._spot((robot.x, robot.y), robot)
        cv2.circle(canvas, spot, round(radius * self._scale), ROBOT, -1, cv2.LINE_AA)
        front = robot.apply_point(1.6 * radius, 0.0)
        cv2.line(canvas, spot, self._spot(front, robot), ROBOT, 3, cv2.LINE_AA)
