"""An image with a depth buffer: flat textured rectangles and soft-edged limbs in perspective."""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import groupby
from math import hypot, log2
from typing import Literal, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array, Camera, Pose2
from followerd.messages import Pixels

NEAR = 0.05  # m, nothing nearer is drawn
STRIP = 32  # px; a sheet's texture may change its level so often
COARSEST = 5  # levels of a texture
BLOCKY = 2.0  # px a texel may be wide before it is interpolated
ALPHA, HALF, ONE = np.float32(1 / 255), np.float32(0.5), np.float32(1.0)

Map = npt.NDArray[np.float32]
Polygon = list[tuple[float, float, float]]  # corners (x, y, z) in order
Rectangle = tuple[int, int, int, int]  # px: left, top, right, bottom
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
        pixels: Array = (points - self.eye) @ self.matrix.T
        pixels[:, :2] /= np.maximum(pixels[:, 2:], NEAR)
        return pixels


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


class Part(NamedTuple):
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
        self._columns, self._rows, self._planes = _frame(camera.width, camera.height)

    def copy(self) -> "Canvas":
        """The same picture, to be drawn on."""
        twin = copy(self)
        twin.pixels, twin.inverse_depth = self.pixels.copy(), self.inverse_depth.copy()
        return twin

    def draw_sheets(self, sheets: Sheets, view: View, spectrum: Spectrum) -> None:
        """Draw every sheet that may be seen, the nearest first: it hides the others."""
        towards = sheets.normals @ view.eye - sheets.offsets
        corners = (sheets.corners - view.eye) @ view.matrix.T  # (N, 4, 3) pixel * depth
        outside = corners @ self._planes[:, :3].T < self._planes[:, 3]  # (N, 4, 5)
        hidden = (
            outside.all(axis=1).any(axis=1)
            | (sheets.one_sided & (towards <= 0.0))
            | (np.abs(towards) < 1e-6)
        )
        chosen = np.flatnonzero(~hidden)
        chosen = chosen[np.argsort(corners[chosen, :, 2].min(axis=1), kind="stable")]
        frames = sheets.frames[chosen]
        frames[:, :, 2] -= view.eye
        # (along, up, 1) / depth = inverse @ pixel: its last row gives the inverse depth
        inverses = np.linalg.inv(view.matrix @ frames)
        crossed = outside[chosen].any(axis=1)
        levels = sheets.levels(spectrum)
        for i, metres, planes in zip(chosen.tolist(), inverses, crossed, strict=True):
            outline: Polygon = [(x, y, z) for x, y, z in corners[i].tolist()]
            for plane in self._planes[planes].tolist():
                outline = _cut(outline, *plane)
            if len(outline) > 2:
                axis = int(sheets.sheets[i].up[2] == 0.0)  # what is level is cut into rows
                self._draw_sheet(outline, metres, levels[i], axis, view.camera.fx)

    def _draw_sheet(
        self, outline: Polygon, metres: Array, levels: list[Level], axis: int, focal: float
    ) -> None:
        """What of a sheet nothing hides, in strips across `axis` (0 = x, 1 = y).

        `metres` (3, 3) is explained in draw_sheets. Each strip is drawn with the coarsest texture
        that is fine enough for it.
        """
        points = [(x / z, y / z) for x, y, z in outline]
        xs, ys = [x for x, _ in points], [y for _, y in points]
        left, right = int(min(xs)), min(int(max(xs)) + 2, self.width)
        top, bottom = int(min(ys)), min(int(max(ys)) + 2, self.height)
        if left >= right or top >= bottom:
            return
        mask = np.zeros((bottom - top, right - left), np.uint8)
        fixed = [(round(16 * (x - left)), round(16 * (y - top))) for x, y in points]
        cv2.fillConvexPoly(mask, np.array(fixed, np.int32), 1, cv2.LINE_8, 4)
        a, b, c = metres[2].tolist()
        behind = self.inverse_depth[top:bottom, left:right]
        inverse = (self._rows[top:bottom] * b + c) + self._columns[left:right] * a
        cv2.bitwise_and(mask, cv2.compare(inverse, behind, cv2.CMP_GT), mask)
        cv2.copyTo(inverse, mask, behind)
        x, y, width, height = cv2.boundingRect(mask)
        density = float(levels[0][1][0, 0])

        def texture(strip: Rectangle) -> tuple[int, bool]:
            """Level of the texture, and whether it is to be interpolated."""
            x0, y0, x1, y1 = strip
            finest = focal * (max(a * x0, a * x1) + max(b * y0, b * y1) + c)  # px/m
            coarser = int(log2(max(1.0, density / max(finest, 1e-9))))
            return min(len(levels) - 1, coarser), finest > BLOCKY * density

        seen = (left + x, top + y, left + x + width, top + y + height)
        for (level, soft), strips in groupby(_strips(seen, axis), texture):
            x0, y0, x1, y1 = _around(list(strips))
            picture, texels = levels[level]
            source = texels @ metres
            source[:, 2] += source[:, 0] * x0 + source[:, 1] * y0
            warped = cv2.warpPerspective(
                picture,
                source,
                (x1 - x0, y1 - y0),
                flags=(cv2.INTER_LINEAR if soft else cv2.INTER_NEAREST) | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_REPLICATE,
            )
            visible = mask[y0 - top : y1 - top, x0 - left : x1 - left]
            cv2.copyTo(warped, visible, self.pixels[y0:y1, x0:x1])

    def draw_parts(self, parts: list[Part], view: View, spectrum: Spectrum) -> None:
        """Blend limbs in, the farthest first."""
        for flat in flatten(parts, view, self.width, self.height):
            colours = flat.warp(flat.part.texture.of(spectrum))
            below, behind = self.pixels[flat.area], self.inverse_depth[flat.area]
            alpha = colours[..., 3] * ALPHA
            alpha *= behind < flat.inverse_depth
            cv2.blendLinear(colours, below, alpha, ONE - alpha, below)
            np.putmask(behind, alpha > HALF, flat.inverse_depth)


class FlatPart(NamedTuple):
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


@lru_cache(maxsize=4)
def _frame(width: int, height: int) -> tuple[Map, Map, Array]:
    """Columns (W,), rows (H, 1), and what is in view: a x + b y + c z >= d (5, 4).

    The latter of homogeneous pixels (x, y, z).
    """
    planes = [(0, 0, 1, NEAR), (1, 0, 0, 0), (-1, 0, width, 0), (0, 1, 0, 0), (0, -1, height, 0)]
    columns, rows = np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)
    return columns, rows[:, None], np.array(planes, float)


def _strips(area: Rectangle, axis: int) -> Iterator[Rectangle]:
    """An area in pieces STRIP px long along an axis (0 = x, 1 = y)."""
    left, top, right, bottom = area
    if axis == 0:
        for x in range(left, right, STRIP):
            yield x, top, min(x + STRIP, right), bottom
    else:
        for y in range(top, bottom, STRIP):
            yield left, y, right, min(y + STRIP, bottom)


def _around(strips: list[Rectangle]) -> Rectangle:
    """Neighbouring strips as one."""
    return (*strips[0][:2], *strips[-1][2:])


def _cut(points: Polygon, a: float, b: float, c: float, least: float) -> Polygon:
    """The part of a convex polygon where a x + b y + c z >= least."""
    kept: Polygon = []
    if not points:
        return kept
    x0, y0, z0 = points[-1]
    before = a * x0 + b * y0 + c * z0 - least
    for x, y, z in points:
        here = a * x + b * y + c * z - least
        if (here >= 0.0) != (before >= 0.0):
            share = before / (before - here)
            kept.append((x0 + share * (x - x0), y0 + share * (y - y0), z0 + share * (z - z0)))
        if here >= 0.0:
            kept.append((x, y, z))
        x0, y0, z0, before = x, y, z, here
    return kept
