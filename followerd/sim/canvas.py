"""An image with a depth buffer: flat textured rectangles and soft-edged limbs in perspective."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import ceil, hypot, log2
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array, Camera, Pose2
from followerd.messages import Pixels

NEAR = 0.05  # m, nothing nearer is drawn
STRIP_COLUMNS, STRIP_ROWS = 96, 48  # px; large sheets are drawn in strips of this size
COARSEST = 5  # levels of a texture
BLOCKY = 2.0  # px a texel may be wide before it is interpolated
ALPHA, HALF, ONE = np.float32(1 / 255), np.float32(0.5), np.float32(1.0)

Map = npt.NDArray[np.float32]
Polygon = list[list[float]]  # corners (x, y, z) in order
Level = tuple[Pixels, Array]  # a texture, and the matrix (3, 3) from metres to its texels
Point3 = tuple[float, float, float]
Spectrum = Literal["colour", "heat"]


class View:
    """A camera at one place in the world."""

    def __init__(self, camera: Camera, world_from_base: Pose2) -> None:
        self.camera = camera
        turn = ~Pose2(theta=world_from_base.theta)
        axes = camera.axes.copy()
        c, s = np.cos(turn.theta), np.sin(turn.theta)
        axes[:, :2] = camera.axes[:, :2] @ np.array([[c, -s], [s, c]])
        self.axes = axes  # rows right, down, forward in the world
        x, y = world_from_base.apply_point(camera.x, camera.y)
        self.eye = np.array([x, y, camera.z])
        self.matrix = camera.intrinsics @ axes  # pixel * depth = matrix @ (point - eye)

    def project(self, points: Array) -> Array:
        """Points (N, 3) of the world as (N, 3): column px, row px, depth m (not below NEAR)."""
        q = (points - self.eye) @ self.matrix.T
        depth = np.maximum(q[:, 2], NEAR)
        return np.column_stack([q[:, 0] / depth, q[:, 1] / depth, q[:, 2]])


class Texture:
    """A picture (H, W, 4), first row at the top, and how warm what it shows is (0..255).

    The last channel is the outline: 0 where there is nothing.
    """

    def __init__(self, colour: Pixels, heat: int) -> None:
        self.colour = colour
        self._heat = heat

    @cached_property
    def warmth(self) -> Pixels:
        """The thermal twin: the same outline, nearly one temperature."""
        grey = self.colour[..., :3].mean(axis=2, keepdims=True, dtype=np.float32)
        level = np.clip(self._heat + 0.08 * (grey - grey.mean()), 0, 255).astype(np.uint8)
        return np.concatenate([level, level, level, self.colour[..., 3:]], axis=2)

    def of(self, spectrum: Spectrum) -> Pixels:
        """Colour or warmth."""
        return self.colour if spectrum == "colour" else self.warmth


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A flat textured rectangle; `along` and `up` are unit vectors of the world."""

    corner: Point3  # m, lower left corner
    along: Point3
    up: Point3
    length: float  # m
    height: float  # m
    texture: Texture
    one_sided: bool = False  # seen only where along x up points to


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A limb: a textured strip around the line from `top` to `bottom`, turned to the camera."""

    top: Point3  # m, in the world
    bottom: Point3
    width: float  # m
    cap: float  # m by which it reaches beyond both ends
    texture: Texture
    nearer: float = 0.0  # m taken off its depth, so that it is drawn over its neighbours


class Sheets:
    """Many sheets, with what can be worked out once."""

    def __init__(self, sheets: list[Sheet]) -> None:
        self.sheets = sheets
        corner = np.array([s.corner for s in sheets])
        along = np.array([s.along for s in sheets])
        up = np.array([s.up for s in sheets])
        across = along * np.array([[s.length] for s in sheets])
        over = up * np.array([[s.height] for s in sheets])
        self.frames = np.stack([along, up, corner], axis=2)  # (N, 3, 3)
        self.corners = np.stack([corner, corner + across, corner + across + over, corner + over], 1)
        self.normals = np.cross(along, up)
        self.offsets = np.einsum("ni,ni->n", self.normals, corner)
        self.one_sided = np.array([s.one_sided for s in sheets])
        self._levels: dict[Spectrum, list[list[Level]]] = {}

    def levels(self, spectrum: Spectrum) -> list[list[Level]]:
        """For each sheet its texture, ever coarser by 2."""
        if spectrum not in self._levels:
            self._levels[spectrum] = [_levels(s, s.texture.of(spectrum)) for s in self.sheets]
        return self._levels[spectrum]


def _levels(sheet: Sheet, texture: Pixels) -> list[Level]:
    levels = []
    while True:
        rows, columns = texture.shape[:2]
        x, y = columns / sheet.length, rows / sheet.height
        texels = np.array([[x, 0.0, -0.5], [0.0, -y, rows - 0.5], [0.0, 0.0, 1.0]])
        levels.append((texture, texels))
        if min(rows, columns) < 16 or len(levels) == COARSEST:
            return levels
        size = columns // 2, rows // 2
        texture = np.asarray(cv2.resize(texture, size, interpolation=cv2.INTER_AREA), np.uint8)


class Canvas:
    """What is drawn so far: `pixels` (H, W, 4) and `inverse_depth` (H, W), 1/m; 0 = nothing."""

    def __init__(self, camera: Camera) -> None:
        self.width, self.height = camera.width, camera.height
        self.pixels: Pixels = np.zeros((camera.height, camera.width, 4), np.uint8)
        self.inverse_depth: Map = np.zeros((camera.height, camera.width), np.float32)
        self._columns = np.arange(camera.width, dtype=np.float32)
        self._rows = np.arange(camera.height, dtype=np.float32)[:, None]

    def draw_sheets(self, sheets: Sheets, view: View, spectrum: Spectrum) -> None:
        """Draw every sheet that may be seen."""
        towards = sheets.normals @ view.eye - sheets.offsets
        corners = (sheets.corners - view.eye) @ view.matrix.T  # (N, 4, 3) pixel * depth
        across, down, depth = corners[..., 0], corners[..., 1], corners[..., 2]
        hidden = (
            (depth < NEAR).all(axis=1)
            | (across < 0).all(axis=1)
            | (across > self.width * depth).all(axis=1)
            | (down < 0).all(axis=1)
            | (down > self.height * depth).all(axis=1)
            | (sheets.one_sided & (towards <= 0.0))
            | (np.abs(towards) < 1e-6)
        )
        chosen = np.flatnonzero(~hidden)
        frames = sheets.frames[chosen]
        frames[:, :, 2] -= view.eye
        # (along, up, 1) / depth = inverse @ pixel: its last row gives the inverse depth
        inverses = np.linalg.inv(view.matrix @ frames)
        for i, metres in zip(chosen.tolist(), inverses, strict=True):
            is_level = sheets.sheets[i].up[2] == 0.0
            a, b, c = metres[2].tolist()
            outline = _clipped(corners[i].tolist(), self.width, self.height)
            for strip in _strips(outline, STRIP_ROWS if is_level else STRIP_COLUMNS, int(is_level)):
                nearest = max(a * x + b * y + c for x, y, _ in strip)
                finest = nearest * view.camera.fx  # px/m
                levels = sheets.levels(spectrum)[i]
                density = levels[0][1][0, 0]
                level = min(len(levels) - 1, int(log2(max(1.0, density / finest))))
                soft = finest > BLOCKY * density
                self._draw_strip(strip, metres, *levels[level], soft)

    def _draw_strip(
        self, outline: Polygon, metres: Array, texture: Pixels, texels: Array, soft: bool
    ) -> None:
        """One convex piece of a sheet; `metres` (3, 3) is explained in draw_sheets."""
        xs, ys = [p[0] for p in outline], [p[1] for p in outline]
        left, right = int(min(xs)), min(int(max(xs)) + 2, self.width)
        top, bottom = int(min(ys)), min(int(max(ys)) + 2, self.height)
        if left >= right or top >= bottom:
            return
        area = slice(top, bottom), slice(left, right)
        mask = np.zeros((bottom - top, right - left), np.uint8)
        fixed = np.array([[16 * (p[0] - left), 16 * (p[1] - top)] for p in outline])
        cv2.fillConvexPoly(mask, np.rint(fixed).astype(np.int32), 1, cv2.LINE_8, 4)
        a, b, c = metres[2].astype(np.float32)
        inverse = a * self._columns[area[1]] + (b * self._rows[area[0]] + c)
        mask &= inverse > self.inverse_depth[area]
        source = texels @ metres
        source[:, 2] += source[:, 0] * left + source[:, 1] * top
        warped = cv2.warpPerspective(
            texture,
            source,
            (right - left, bottom - top),
            flags=(cv2.INTER_LINEAR if soft else cv2.INTER_NEAREST) | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        cv2.copyTo(inverse, mask, self.inverse_depth[area])
        cv2.copyTo(warped, mask, self.pixels[area])

    def draw_parts(self, parts: list[Part], view: View, spectrum: Spectrum) -> None:
        """Blend limbs in, the farthest first."""
        for flat in flatten(parts, view, self.width, self.height):
            colours = flat.warp(flat.part.texture.of(spectrum))
            below, behind = self.pixels[flat.area], self.inverse_depth[flat.area]
            alpha = colours[..., 3] * ALPHA
            alpha *= behind < flat.inverse_depth
            cv2.blendLinear(colours, below, alpha, ONE - alpha, below)
            np.putmask(behind, alpha > HALF, flat.inverse_depth)


@dataclass(frozen=True, slots=True, eq=False)
class FlatPart:
    """A limb as it lies in the image: middle of its upper edge, its axis and half its width."""

    part: Part
    area: tuple[slice, slice]  # rows, columns
    inverse_depth: float  # 1/m
    start: tuple[float, float]  # px
    axis: tuple[float, float]  # px, from the upper to the lower edge
    half: tuple[float, float]  # px, from the axis to the right edge

    def warp(self, texture: Pixels) -> Pixels:
        """The limb's texture (h, w, 4) in its area of the image."""
        rows, columns = texture.shape[:2]
        (ax, ay), (hx, hy) = self.axis, self.half
        left, top = self.area[1].start, self.area[0].start
        det = 2.0 * (hx * ay - hy * ax)
        # pixel = start - half + u 2 half + v axis, solved for u and v
        ux, uy = columns * ay / det, -columns * ax / det
        vx, vy = -2.0 * rows * hy / det, 2.0 * rows * hx / det
        x, y = left - self.start[0] + hx, top - self.start[1] + hy
        inverse = np.array([[ux, uy, ux * x + uy * y - 0.5], [vx, vy, vx * x + vy * y - 0.5]])
        warped = cv2.warpAffine(
            texture,
            inverse,
            (self.area[1].stop - left, self.area[0].stop - top),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
        )
        return np.asarray(warped, np.uint8)


def flatten(parts: list[Part], view: View, width: int, height: int) -> list[FlatPart]:
    """The limbs that lie at least partly in the image, the farthest first."""
    if not parts:
        return []
    ends = view.project(np.array([(p.top, p.bottom) for p in parts]).reshape(-1, 3)).tolist()
    flat = []
    for part, (ax, ay, az), (bx, by, bz) in zip(parts, ends[::2], ends[1::2], strict=True):
        depth = 0.5 * (az + bz)
        if min(az, bz, depth - part.nearer) < 4 * NEAR:
            continue
        scale = view.camera.fx / depth
        dx, dy = bx - ax, by - ay
        length = hypot(dx, dy)
        ex, ey = (dx / length, dy / length) if length > 0.1 else (0.0, 1.0)
        cap, half = part.cap * scale, 0.5 * part.width * scale
        x, y = ax - cap * ex, ay - cap * ey
        dx, dy = dx + 2 * cap * ex, dy + 2 * cap * ey
        hx, hy = ey * half, -ex * half
        left = max(0, int(min(x, x + dx) - abs(hx)))
        top = max(0, int(min(y, y + dy) - abs(hy)))
        right = min(width, int(max(x, x + dx) + abs(hx)) + 2)
        bottom = min(height, int(max(y, y + dy) + abs(hy)) + 2)
        if left < right and top < bottom:
            area = slice(top, bottom), slice(left, right)
            near = 1.0 / (depth - part.nearer)
            flat.append(FlatPart(part, area, near, (x, y), (dx, dy), (hx, hy)))
    flat.sort(key=lambda f: f.inverse_depth)
    return flat


def _clipped(points: Polygon, width: int, height: int) -> Polygon:
    """A polygon of homogeneous pixels, cut at NEAR and at the image's edge, as (x, y, 1)."""
    w, h = float(width), float(height)
    planes = ((0, 0, 1, NEAR), (1, 0, 0, 0), (-1, 0, w, 0), (0, 1, 0, 0), (0, -1, h, 0))
    for a, b, c, least in planes:
        points = _cut(points, a, b, c, least)
    return [[x / z, y / z, 1.0] for x, y, z in points]


def _strips(outline: Polygon, size: int, axis: int) -> Iterator[Polygon]:
    """A flat polygon in pieces at most `size` px long along an axis (0 = x, 1 = y)."""
    if len(outline) < 3:
        return
    low, high = min(p[axis] for p in outline), max(p[axis] for p in outline)
    count = ceil((high - low) / size)
    if count <= 1:
        yield outline
        return
    x, y = 1 - axis, axis
    for k in range(count):
        begin, end = low + k * (high - low) / count, low + (k + 1) * (high - low) / count
        piece = _cut(_cut(outline, x, y, 0, begin), -x, -y, 0, -end)
        if len(piece) >= 3:
            yield piece


def _cut(points: Polygon, a: float, b: float, c: float, least: float) -> Polygon:
    """The part of a convex polygon where a x + b y + c z >= least."""
    sides = [a * x + b * y + c * z - least for x, y, z in points]
    if not sides or min(sides) >= 0.0:
        return points
    kept = []
    for i, (p, here) in enumerate(zip(points, sides, strict=True)):
        before = sides[i - 1]
        if (here >= 0.0) != (before >= 0.0):
            share = before / (before - here)
            kept.append([q + share * (r - q) for q, r in zip(points[i - 1], p, strict=True)])
        if here >= 0.0:
            kept.append(p)
    return kept
