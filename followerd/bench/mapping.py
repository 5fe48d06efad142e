"""A map from recorded scans: poses, then the grid, then its walls."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Literal, Protocol, TypeVar

import cv2
import numpy as np

from followerd.bench.laser import LaserStep
from followerd.errors import UsageError
from followerd.estimation.slam import Mapper
from followerd.geometry import Array, Pose2
from followerd.maps.floor import FloorMap
from followerd.maps.tracing import Tracer, View
from followerd.maps.walls import refined, walls_of
from followerd.messages import Pixels

Which = Literal["even", "odd", "all"]
T = TypeVar("T")

MOST_RETURNS = 200_000  # that walls are fitted to
WIDEST = 1600  # px of a check picture
WALL, PATH, INK = (40, 40, 220), (200, 120, 0), (60, 60, 60)


class Bars(Protocol):
    """Shows how far the work is."""

    def shown(self, items: Sequence[T], what: str) -> Iterator[T]:
        """The items, one after another, while a bar grows."""


def chosen(steps: Iterable[LaserStep], scans: Which) -> list[LaserStep]:
    """The scans with an even or odd index, or all."""
    return [step for step in steps if scans == "all" or step.index % 2 == (scans == "odd")]


def logged_poses(steps: Sequence[LaserStep], source: Path) -> list[Pose2]:
    """Their corrected poses; raises UsageError where there are none."""
    poses = [step.corrected for step in steps if step.corrected is not None]
    if len(poses) < len(steps):
        raise UsageError(f"{source}: the log has no corrected poses; use --poses match")
    return poses


def matched_poses(steps: Sequence[LaserStep], bars: Bars) -> list[Pose2]:
    """Their poses by odometry and matching; in the frame of the odometry, which begins there.

    Raises UsageError where there is no odometry.
    """
    mapper = Mapper()
    for step in bars.shown(steps, "matching scans"):
        if step.ego is None:
            raise UsageError("the scans have no odometry, which --poses match needs")
        mapper.add(step.scan, step.ego)
    return mapper.poses


def build_map(
    steps: Sequence[LaserStep], poses: Sequence[Pose2], cell: float, bars: Bars
) -> FloorMap:
    """The map of scans taken at `poses`, `map_from_base`; raises UsageError without returns."""
    views = [View.of(step.scan, pose) for step, pose in zip(steps, poses, strict=True)]
    if not any(np.isfinite(view.ends).any() for view in views):
        raise UsageError("the scans hold no returns to make a map of")
    tracer = Tracer(views, cell)
    for view in bars.shown(views, "tracing rays"):
        tracer.add(view)
    grid = tracer.grid()
    ends = np.concatenate([view.ends for view in views])
    origins = np.repeat([view.origin for view in views], [len(view.ends) for view in views], axis=0)
    seen = np.flatnonzero(np.isfinite(ends[:, 0]))
    some = seen[:: -(-seen.size // MOST_RETURNS)]
    return FloorMap(grid, refined(walls_of(grid), origins[some], ends[some]))


def draw_map(floor: FloorMap, poses: Sequence[Pose2] = ()) -> Pixels:
    """A picture (H, W, 3) BGR to check a map by: walls red, the way driven blue, a bar of 5 m."""
    grid = floor.grid
    height, width = grid.occupied.shape
    scale = max(1, WIDEST // max(height, width))
    image = np.full((height, width, 3), 205, np.uint8)
    image[grid.free], image[grid.occupied] = 255, 0
    image = np.kron(image, np.ones((scale, scale, 1), np.uint8))
    image = np.ascontiguousarray(image)
    for wall in floor.walls:
        _line(image, grid.origin, scale / grid.cell, wall, WALL, 1 + scale // 3)
    places = np.array([(pose.x, pose.y) for pose in poses]).reshape(-1, 2)
    for ends in pairwise(places):
        _line(image, grid.origin, scale / grid.cell, np.array(ends), PATH, 1)
    picture = np.ascontiguousarray(image[::-1])
    bar = round(5.0 / grid.cell * scale)
    cv2.line(picture, (10, 14), (10 + bar, 14), INK, 3)
    cv2.putText(picture, "5 m", (14, 34), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    return picture


def _line(
    image: Pixels,
    origin: tuple[float, float],
    scale: float,
    ends: Array,
    colour: tuple[int, int, int],
    width: int,
) -> None:
    (ax, ay), (bx, by) = np.rint((ends - origin) * scale).astype(int).tolist()
    cv2.line(image, (ax, ay), (bx, by), colour, width, cv2.LINE_AA)
