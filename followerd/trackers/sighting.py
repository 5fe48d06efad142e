"""What a profile saw in one image, and where that puts the person."""

from dataclasses import dataclass
from math import hypot

from followerd.geometry import Array, Camera
from followerd.messages import Box, TrackPhase

TALL = 1.7  # m, of a person whose head is out of view
BODY = (0.15, 2.2)  # m: a box whose height on the ground is outside stands on no floor
FOOT_NOISE = 1.5  # px in images of 192 px width


@dataclass(frozen=True, slots=True)
class Sighting:
    """Outcome of one look."""

    phase: TrackPhase
    confidence: float  # 0..1
    candidates: tuple[Box, ...] = ()


@dataclass(frozen=True, slots=True)
class Ground:
    """A person's place on the ground."""

    point: tuple[float, float]  # m, in `base`
    range: float  # m
    sigma: float  # m


class Ranger:
    """Range from the foot point (eq. 15, 16), or from the width of the body learned by it."""

    def __init__(self) -> None:
        self._width: float | None = None  # m, running mean

    def locate(self, camera: Camera, box: Array) -> Ground | None:
        """Where the person of `box` (4,) x y w h stands; None if nothing says so."""
        x, y, w, h = box.tolist()
        scale = camera.width / 192.0
        foot = y + 0.5 * h - 0.5  # the last row of the box
        if foot < camera.height - 1 - 2.0 * scale:
            return self._by_foot(camera, x - 0.5, foot, w, h, scale)
        return self._by_width(camera, x - 0.5, w)

    def _by_foot(
        self, camera: Camera, column: float, foot: float, w: float, h: float, scale: float
    ) -> Ground | None:
        point = camera.ground_point(column, foot)
        if point is None:
            return None
        metres_per_px = _depth(camera, point) / camera.fy
        if not BODY[0] < h * metres_per_px < BODY[1]:
            return None
        lower = camera.ground_point(column, foot + 1.0)
        distance = hypot(*point)
        slope = distance - hypot(*lower) if lower else distance
        if self._width is None:
            self._width = w * metres_per_px
        self._width += 0.05 * (w * metres_per_px - self._width)
        return Ground(point, distance, 0.03 * distance + abs(slope) * FOOT_NOISE * scale)

    def _by_width(self, camera: Camera, column: float, w: float) -> Ground | None:
        """With the feet cut off: the height is cut too, the width is not."""
        if self._width is None:
            return None
        depth = self._width * camera.fx / w
        right = (column - camera.cx) / camera.fx
        axes = camera.axes
        x, y = (axes[2] + right * axes[0])[:2] * depth + (camera.x, camera.y)
        distance = hypot(x, y)
        return Ground((float(x), float(y)), distance, 0.2 * distance)


def completed(camera: Camera, box: Box) -> Box:
    """A box that the upper border of the image cuts off, with a person's height above its foot.

    So the box keeps its shape when the rest of the person comes into view.
    """
    foot = camera.ground_point(box.foot[0] - 0.5, box.foot[1] - 0.5)
    if box.y > camera.width / 192.0 or box.foot[1] > camera.height - 3 or foot is None:
        return box
    height = TALL * camera.fy / _depth(camera, foot)
    if not box.h < height < 2.0 * box.h:
        return box
    return Box(box.x, box.y + box.h - height, box.w, height)


def _depth(camera: Camera, point: tuple[float, float]) -> float:
    """Depth along the optical axis of a ground point of `base`, m."""
    ahead, left, up = camera.axes[2].tolist()
    depth: float = ahead * (point[0] - camera.x) + left * (point[1] - camera.y) - up * camera.z
    return depth


def ground_velocity(camera: Camera, box: Array, velocity: Array) -> tuple[float, float] | None:
    """Velocity in `base` directions, m/s, of a foot that moves with `velocity` (2,) px/s."""
    x, y, _, h = box.tolist()
    vx, vy = velocity.tolist()
    column, row = x - 0.5, y + 0.5 * h - 0.5
    here = camera.ground_point(column, row)
    there = camera.ground_point(column + 0.01 * vx, row + 0.01 * vy)
    if here is None or there is None:
        return None
    return (there[0] - here[0]) / 0.01, (there[1] - here[1]) / 0.01
