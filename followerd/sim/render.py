"""The camera's picture of a world: building, furniture, people; light, blur and noise."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, ceil, cos, exp, hypot, radians, sin, sqrt

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array, Camera, Pose2
from followerd.messages import Box, Pixels
from followerd.sim import textures
from followerd.sim.canvas import (
    Canvas,
    Part,
    Point3,
    Sheet,
    Sheets,
    Spectrum,
    Texture,
    View,
    flatten,
)
from followerd.sim.figure import Figure
from followerd.sim.gain import Gain
from followerd.sim.people import Motion, Pedestrian, Walker
from followerd.sim.place import outline
from followerd.sim.scenarios import Ball, Block, Light, Look, Scenario, Wall, draw

DENSITY = 80.0  # px/m of textures
LARGEST = 4.0e6  # px of one texture; larger surfaces are coarser
TALLEST, WIDEST = 2.1, 0.7  # m, no walker reaches beyond
NOISE_SPARE = 64  # px by which a noise tile is larger than the image
DRIFT_TIME = 5.0  # s, correlation of the exposure's drift
WALL_HEAT, FLOOR_HEAT = 62, 55


@dataclass(frozen=True, slots=True)
class Shot:
    """Where and when a picture is taken."""

    camera: Camera
    pose: Pose2  # world_from_base
    time: float  # s of the scenario


Draw = Callable[[Shot, float], Pixels]  # as Renderer.colour
Standpoint = tuple[Camera, Pose2, Spectrum]


class Renderer:
    """Draws a scenario's walkers in its place."""

    def __init__(self, scenario: Scenario, walkers: list[Walker], rng: np.random.Generator) -> None:
        self._light = scenario.light
        self._rng = rng
        self._walkers = walkers
        self._sheets = Sheets(_building(scenario, rng))
        self._columns = _columns(scenario, rng)
        self._figures = [Figure(w, rng) if isinstance(w, Pedestrian) else None for w in walkers]
        self._balls = [
            (w.mover.radius_m, Texture(textures.ball(w.mover.colour), w.mover.heat))
            if isinstance(w.mover, Ball)
            else None
            for w in walkers
        ]
        self._shadow = Texture(textures.shadow(), 0)
        self._level = light_levels(scenario.light, rng)
        self._drift, self._lit_at = 0.0, 0.0
        self._gain = None if scenario.auto_gain is None else Gain(scenario.auto_gain, rng)
        self._noise: dict[tuple[int, int, int], tuple[Pixels, Pixels]] = {}
        self._seen_from: Standpoint | None = None  # in the last picture
        self._empty: tuple[Standpoint, Canvas] | None = None
        self._last: tuple[Shot, Canvas] | None = None

    def colour(self, shot: Shot, omega: float) -> Pixels:
        """A picture (H, W, 3) BGR; `omega` blurs it over the exposure."""
        canvas = self._draw(shot, "colour")
        self._last = shot, canvas
        image = self._blurred(_bgr(canvas.pixels), shot.camera.fx * omega * self._light.exposure_s)
        bright = cv2.convertScaleAbs(image, alpha=self._exposure(shot.time))
        return self._noisy(np.asarray(bright, np.uint8))

    def thermal(self, shot: Shot, omega: float) -> Pixels:
        """A thermal picture (H, W): persons bright, the building dark, no outer light."""
        heat = np.ascontiguousarray(self._draw(shot, "heat").pixels[..., :1])
        blurred = self._blurred(heat[..., 0], shot.camera.fx * omega * self._light.exposure_s)
        seen = self._noisy(blurred[..., None])[..., 0]
        return seen if self._gain is None else self._gain.applied(seen, shot.time)

    def depth(self, shot: Shot) -> npt.NDArray[np.float32]:
        """Depth (H, W) along the optical axis, m; nan = nothing there."""
        inverse = self._canvas(shot).inverse_depth
        with np.errstate(divide="ignore"):
            depth: npt.NDArray[np.float32] = np.where(inverse > 0.0, 1.0 / inverse, np.nan)
        return depth.astype(np.float32)

    def still(self, shot: Shot) -> Pixels:
        """The scene (H, W, 3) BGR in even light, without blur and noise."""
        return _bgr(self._canvas(shot).pixels)

    def box(self, shot: Shot, walker: int) -> tuple[Box, float] | None:
        """Box of one walker clipped to the image, and the share of it that nothing hides."""
        canvas = self._canvas(shot)
        whole = np.zeros(canvas.inverse_depth.shape, bool)
        visible = whole.copy()
        view = View(shot.camera, shot.pose)
        for flat in flatten(self._parts(walker, shot, view), view, canvas.width, canvas.height):
            inside = flat.warp(flat.part.texture.colour)[..., 3] > 127
            whole[flat.area] |= inside
            visible[flat.area] |= inside & (canvas.inverse_depth[flat.area] <= flat.inverse_depth)
        rows, columns = np.flatnonzero(whole.any(axis=1)), np.flatnonzero(whole.any(axis=0))
        if not rows.size:
            return None
        x, y = int(columns[0]), int(rows[0])
        box = Box(x, y, int(columns[-1]) + 1 - x, int(rows[-1]) + 1 - y)
        return box, float(visible.sum() / whole.sum())

    def _canvas(self, shot: Shot) -> Canvas:
        """The scene of `shot`, drawn anew unless it was the last picture."""
        if self._last is None or self._last[0] != shot:
            self._last = shot, self._draw(shot, "colour")
        return self._last[1]

    def _draw(self, shot: Shot, spectrum: Spectrum) -> Canvas:
        """The scene in still, even light."""
        view = View(shot.camera, shot.pose)
        canvas = self._building(shot, view, spectrum)
        seen = self._in_view(shot, view, canvas)
        if spectrum == "colour":
            canvas.draw_parts([self._spot(motion, view) for _, motion in seen], view, spectrum)
        limbs = [part for i, _ in seen for part in self._parts(i, shot, view)]
        canvas.draw_parts(limbs, view, spectrum)
        return canvas

    def _building(self, shot: Shot, view: View, spectrum: Spectrum) -> Canvas:
        """The scene without walkers, to be drawn on; while the robot stands a copy will do."""
        key = shot.camera, shot.pose, spectrum
        if self._empty is not None and self._empty[0] == key:
            return self._empty[1].copy()
        canvas = Canvas(shot.camera)
        canvas.draw_sheets(self._sheets, view, spectrum)
        canvas.draw_parts(self._columns, view, spectrum)
        stands, self._seen_from = key == self._seen_from, key
        if stands:
            self._empty = key, canvas.copy()
        return canvas

    def _in_view(self, shot: Shot, view: View, canvas: Canvas) -> list[tuple[int, Motion]]:
        """The walkers that may be seen, the farthest first."""
        motions = [walker.at(shot.time) for walker in self._walkers]
        ends = np.array([(m.x, m.y, z) for m in motions for z in (0.0, TALLEST)])
        pixels = view.project(ends).tolist()
        seen = [
            (depth, i, motion)
            for i, motion in enumerate(motions)
            if (depth := _depth_in_view(pixels[2 * i], pixels[2 * i + 1], view, canvas)) is not None
        ]
        seen.sort(key=lambda item: -item[0])
        return [(i, motion) for _, i, motion in seen]

    def _parts(self, walker: int, shot: Shot, view: View) -> list[Part]:
        motion = self._walkers[walker].at(shot.time)
        figure, ball = self._figures[walker], self._balls[walker]
        if figure is not None:
            return figure.parts(motion, view.eye[0], view.eye[1])
        assert ball is not None, "a walker is a person or a ball"
        radius, skin = ball
        top, bottom = (motion.x, motion.y, 2 * radius), (motion.x, motion.y, 0.0)
        return [Part(top, bottom, 2 * radius, 0.0, skin)]

    def _spot(self, motion: Motion, view: View) -> Part:
        """The shadow on the floor, from its far to its near end."""
        towards = atan2(motion.y - view.eye[1], motion.x - view.eye[0])
        dx, dy = 0.32 * cos(towards), 0.32 * sin(towards)
        far, near = (motion.x + dx, motion.y + dy, 0.0), (motion.x - dx, motion.y - dy, 0.0)
        return Part(far, near, 0.7, 0.0, self._shadow, nearer=0.5)

    def _exposure(self, time: float) -> float:
        """Gain of this picture: the place's level times a slow random drift."""
        keep = exp(-abs(time - self._lit_at) / DRIFT_TIME)
        fresh = sqrt(1.0 - keep * keep) * self._light.drift
        self._drift = keep * self._drift + fresh * float(self._rng.standard_normal())
        self._lit_at = time
        level = float(np.interp(time, *self._level))
        return max(0.2, level * (1.0 + self._drift))

    def _blurred(self, image: Pixels, length: float) -> Pixels:
        """Smeared sideways over `length` px."""
        spread = abs(length)
        if spread < 0.5:
            return image
        reach = ceil(0.5 * (spread - 1.0)) if spread > 1.0 else 1
        kernel = np.clip(0.5 * spread + 0.5 - np.abs(np.arange(-reach, reach + 1)), 0.0, 1.0)
        blurred = cv2.sepFilter2D(image, -1, kernel / kernel.sum(), np.ones(1))
        return np.asarray(blurred, np.uint8)

    def _noisy(self, image: Pixels) -> Pixels:
        """With sensor noise: a random window of a tile drawn once per image size."""
        height, width, channels = image.shape
        tile = self._noise.get(image.shape)
        if tile is None:
            shape = height + NOISE_SPARE, width + NOISE_SPARE, channels
            noise = np.rint(self._rng.normal(0.0, self._light.noise, shape))
            brighter, darker = (np.clip(n, 0, 255).astype(np.uint8) for n in (noise, -noise))
            tile = self._noise[height, width, channels] = brighter, darker
        top, left = self._rng.integers(NOISE_SPARE, size=2).tolist()
        window = slice(top, top + height), slice(left, left + width)
        noisy = cv2.subtract(cv2.add(image, tile[0][window]), tile[1][window])
        return np.asarray(noisy, np.uint8).reshape(image.shape)


def _depth_in_view(
    foot: Sequence[float], head: Sequence[float], view: View, canvas: Canvas
) -> float | None:
    """Depth of a walker, None where it is outside the image or wholly behind something.

    `foot` and `head` are column px, row px and depth m of both ends of its axis.
    """
    column, _, depth = foot
    top = head[1]
    if depth < WIDEST:
        return depth if depth > -WIDEST else None
    reach = WIDEST * view.camera.fx / (depth - 0.5 * WIDEST)
    left, right = max(0, int(column - reach)), min(canvas.width, int(column + reach) + 1)
    if left >= right or top >= canvas.height:
        return None
    front = canvas.inverse_depth[max(0, int(top)) :, left:right].min(initial=np.inf)
    return depth if front * (depth - WIDEST) < 1.0 else None


def light_levels(light: Light, rng: np.random.Generator) -> tuple[list[float], list[float]]:
    """Times (s) and the light's levels then; in between it goes straight from one to the next."""
    times, levels = [0.0], [draw(light.level, rng)]
    for change in light.changes:
        begins = draw(change.at_s, rng)
        times += [begins, begins + change.over_s]
        levels += [levels[-1], draw(change.level, rng)]
    return times, levels


def _bgr(pixels: Pixels) -> Pixels:
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGRA2BGR), np.uint8)


def _building(scenario: Scenario, rng: np.random.Generator) -> list[Sheet]:
    """Floor, ceiling, walls and furniture as sheets."""
    points = np.array([p for wall in scenario.walls for p in wall.points_m]).reshape(-1, 2)
    low = points.min(axis=0, initial=-1.0)
    high = points.max(axis=0, initial=1.0)
    sheets = [_level_sheet(scenario.floor, low, high, 0.0, rng)]
    if scenario.ceiling is not None:
        sheets.append(_level_sheet(scenario.ceiling, low, high, scenario.ceiling_m, rng))
    for wall in scenario.walls:
        sheets += _wall_sheets(wall, rng)
    for block in scenario.boxes:
        sheets += _block_sheets(block, rng)
    return sheets


def _sheet(
    corner: Point3,
    along: Point3,
    up: Point3,
    length: float,
    height: float,
    colour: Pixels,
    heat: int,
    one_sided: bool = False,
) -> Sheet:
    bgra = np.asarray(cv2.cvtColor(colour, cv2.COLOR_BGR2BGRA), np.uint8)
    return Sheet(corner, along, up, length, height, Texture(bgra, heat), one_sided)


def _level_sheet(look: Look, low: Array, high: Array, z: float, rng: np.random.Generator) -> Sheet:
    length, width = (high - low).tolist()
    density = min(DENSITY, sqrt(LARGEST / (length * width)))
    colour = textures.surface(look, length, width, density, rng)
    corner = float(low[0]), float(low[1]), z
    return _sheet(corner, (1, 0, 0), (0, 1, 0), length, width, colour, FLOOR_HEAT)


def _wall_sheets(wall: Wall, rng: np.random.Generator) -> list[Sheet]:
    sheets, begin = [], 0.0
    for (ax, ay), (bx, by) in pairwise(wall.points_m):
        length = hypot(bx - ax, by - ay)
        colour = textures.surface(wall.look, length, wall.height_m, DENSITY, rng)
        for middle in wall.doors_m:
            if 0.5 < middle - begin < length - 0.5:
                textures.add_door(colour, middle - begin, wall.door_colour, DENSITY)
        textures.skirt(colour, DENSITY)
        along = (bx - ax) / length, (by - ay) / length, 0.0
        lit = textures.lit(colour, atan2(-along[0], along[1]))
        sheets.append(
            _sheet((ax, ay, 0.0), along, (0, 0, 1), length, wall.height_m, lit, WALL_HEAT)
        )
        begin += length
    return sheets


def _block_sheets(block: Block, rng: np.random.Generator) -> list[Sheet]:
    """Four sides and top; the bottom too where the box hangs."""
    corners = outline(block)
    high = block.height_m - block.bottom_m
    sheets = []
    for (ax, ay), (bx, by) in pairwise([*corners, corners[0]]):
        length = hypot(bx - ax, by - ay)
        along = (bx - ax) / length, (by - ay) / length, 0.0
        colour = textures.surface(block.look, length, high, DENSITY, rng)
        lit = textures.lit(colour, atan2(-along[0], along[1]))
        sheets.append(
            _sheet((ax, ay, block.bottom_m), along, (0, 0, 1), length, high, lit, block.heat, True)
        )
    yaw = radians(block.yaw_deg)
    along, left = (cos(yaw), sin(yaw), 0.0), (-sin(yaw), cos(yaw), 0.0)
    flat = textures.surface(block.look, block.length_m, block.width_m, DENSITY, rng)
    size = block.length_m, block.width_m
    sheets.append(_sheet((*corners[0], block.height_m), along, left, *size, flat, block.heat, True))
    if block.bottom_m > 0.0:
        dark = (flat * 0.5).astype(np.uint8)
        back = (-along[0], -along[1], 0.0)
        sheets.append(
            _sheet((*corners[1], block.bottom_m), back, left, *size, dark, block.heat, True)
        )
    return sheets


def _columns(scenario: Scenario, rng: np.random.Generator) -> list[Part]:
    parts = []
    for column in scenario.columns:
        colour = textures.column(column.look, column.height_m, rng)
        top = column.x_m, column.y_m, column.height_m
        parts.append(
            Part(
                top,
                (column.x_m, column.y_m, 0.0),
                2 * column.radius_m,
                0.0,
                Texture(colour, column.heat),
                nearer=column.radius_m,
            )
        )
    return parts
