"""Procedural textures: surfaces of a building, clothes, heads and balls; BGR, uint8.

Rows run downwards. Limb textures carry a fourth channel, their soft-edged outline (alpha).
"""

from math import cos, pi, sin

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.messages import Pixels
from followerd.sim.scenarios import Cloth, Look, Outfit

Map = npt.NDArray[np.float32]

VIEWS = 16  # directions from which heads and torsos are drawn
TORSO_SHAPE = (160, 112)  # rows, columns
LIMB_SHAPE = (96, 40)
HEAD_SHAPE = (72, 60)
CLOTH_SCALE = 0.5  # m of cloth across the torso's texture


def bgr(colour: str) -> Array:
    """`#rrggbb` as BGR (3,), 0..255."""
    return np.array([int(colour[i : i + 2], 16) for i in (5, 3, 1)], float)


def clouds(shape: tuple[int, int], cell: float, rng: np.random.Generator) -> Map:
    """Smooth noise (H, W) of unit variance with blobs of about `cell` px."""
    small = max(2, round(shape[0] / cell)), max(2, round(shape[1] / cell))
    grid = rng.standard_normal(small).astype(np.float32)
    noise = np.asarray(cv2.resize(grid, shape[::-1], interpolation=cv2.INTER_CUBIC), np.float32)
    return noise / np.float32(max(1e-6, float(noise.std())))


def paint(colour: Array, brightness: Map) -> Pixels:
    """The colour times a brightness map (H, W) as an image."""
    image: Pixels = np.empty((*brightness.shape, 3), np.uint8)
    for channel, value in enumerate(colour.astype(np.float32)):
        image[..., channel] = np.clip(value * brightness, 0, 255)
    return image


def surface(
    look: Look, length: float, height: float, density: float, rng: np.random.Generator
) -> Pixels:
    """A piece of surface `length` x `height` m at `density` px/m."""
    shape = max(2, round(height * density)), max(2, round(length * density))
    x = (np.arange(shape[1], dtype=np.float32) + 0.5) / density
    y = (np.arange(shape[0], dtype=np.float32)[:, None] + 0.5) / density
    light: Array = 1.0 + 0.03 * clouds(shape, 0.5 * density, rng) + 0.02 * clouds(shape, 2.0, rng)
    match look.texture:
        case "tiles":
            light *= 1.0 + 0.06 * _patches(x // 0.5, y // 0.5, rng)
            light *= np.where(((x % 0.5) < 0.02) | ((y % 0.5) < 0.02), 0.75, 1.0)
        case "brick":
            row = y // 0.1
            shifted = x + 0.125 * (row % 2)
            light *= 1.0 + 0.10 * _patches(shifted // 0.25, row, rng)
            light *= np.where(((shifted % 0.25) < 0.012) | ((y % 0.1) < 0.012), 1.25, 1.0)
        case "wood":
            warp = 0.02 * clouds(shape, 0.3 * density, rng)
            light *= 1.0 + 0.08 * np.sin((y + warp) * 2 * pi / 0.06)
        case "carpet":
            light += 0.07 * clouds(shape, 2.5, rng)
        case "metal":
            light *= np.where(np.minimum(x % 0.6, y % 0.45) < 0.015, 0.75, 1.0)
        case "books":
            return _books(shape, density, rng)
        case "plaster":
            light += 0.03 * clouds(shape, 0.15 * density, rng)
        case "plain":
            pass
    return paint(bgr(look.colour), np.asarray(light, np.float32))


def _patches(column: Array, row: Array, rng: np.random.Generator) -> Map:
    """One random value per tile, standard normal."""
    table = rng.standard_normal((64, 64)).astype(np.float32)
    patches: Map = table[(row % 64).astype(int), (column % 64).astype(int)]
    return patches


def _books(shape: tuple[int, int], density: float, rng: np.random.Generator) -> Pixels:
    """Shelves full of backs of books."""
    image: Pixels = np.full((*shape, 3), (60, 80, 100), np.uint8)
    shelf = max(4, round(0.32 * density))
    for top in range(0, shape[0], shelf):
        x = 0
        while x < shape[1]:
            width = max(2, round(rng.uniform(0.02, 0.06) * density))
            gap = round(rng.uniform(0.04, 0.12) * density)
            colour = rng.integers(30, 190, 3).tolist()
            cv2.rectangle(image, (x, top + gap), (x + width - 1, top + shelf - 3), colour, -1)
            x += width
    return image


def add_door(wall: Pixels, middle: float, colour: str, density: float) -> None:
    """Paint a door 0.95 x 2.05 m, with frame and handle, onto a wall's texture."""
    height = wall.shape[0]
    left, right = round((middle - 0.475) * density), round((middle + 0.475) * density)
    top, frame = height - round(2.05 * density), max(1, round(0.05 * density))
    leaf = bgr(colour)
    cv2.rectangle(
        wall, (left - frame, top - frame), (right + frame, height), (leaf * 0.6).tolist(), -1
    )
    cv2.rectangle(wall, (left, top), (right, height), leaf.tolist(), -1)
    for low, high in ((0.15, 0.9), (1.1, 1.85)):
        a = left + round(0.15 * density), height - round(high * density)
        b = right - round(0.15 * density), height - round(low * density)
        cv2.rectangle(wall, a, b, (leaf * 0.82).tolist(), max(1, frame // 2))
    handle = left + round(0.08 * density), height - round(1.02 * density)
    cv2.circle(wall, handle, max(1, round(0.03 * density)), (190, 190, 190), -1)


def skirt(wall: Pixels, density: float) -> None:
    """Darken a wall towards floor and ceiling and paint a skirting board."""
    rows = np.arange(wall.shape[0], dtype=np.float32)[::-1, None] / density
    top = wall.shape[0] / density
    light = 1.0 - 0.18 * np.exp(-rows / 0.25) - 0.12 * np.exp(-(top - rows) / 0.3)
    light = np.where(rows < 0.08, 0.55, light)
    wall[:] = np.clip(wall * light[..., None], 0, 255).astype(np.uint8)


def cloth(cloth: Cloth, across: Map, along: Map, rng: np.random.Generator) -> Map:
    """Colours (H, W, 3) of a cloth at positions `across`, `along` (H, W), m."""
    shape = across.shape[0], across.shape[1]
    fold = 1.0 + 0.05 * clouds(shape, 0.25 * shape[1], rng)
    first, second = bgr(cloth.colour), bgr(cloth.second)
    mix: Array
    match cloth.pattern:
        case "stripes":
            mix = 1.0 * ((across % 0.05) < 0.018)
        case "hoops":
            mix = 1.0 * ((along % 0.09) < 0.04)
        case "checks":
            mix = 0.5 * ((across % 0.07) < 0.03) + 0.5 * ((along % 0.07) < 0.03)
        case "heather":
            mix = np.clip(0.25 + 0.25 * clouds(shape, 2.0, rng), 0, 1)
        case "denim":
            mix = np.clip(0.12 + 0.08 * clouds(shape, 2.0, rng), 0, 1)
            fold = fold + 0.12 * np.exp(-((across / 0.05) ** 2))
        case "plain":
            mix = np.zeros(shape)
    weight = np.asarray(mix, np.float32)[..., None]
    colours: Map = ((first * (1.0 - weight) + second * weight) * fold[..., None]).astype(np.float32)
    return colours


def _grid(shape: tuple[int, int]) -> tuple[Map, Map]:
    """u (H, W) from -1 to 1 across, v from 0 at the top to 1."""
    u = (2.0 * (np.arange(shape[1]) + 0.5) / shape[1] - 1.0).astype(np.float32)
    v = ((np.arange(shape[0]) + 0.5) / shape[0]).astype(np.float32)
    grid_u, grid_v = np.meshgrid(u, v)
    return grid_u, grid_v


def _cut_out(colours: Map, u: Map, half_width: Map, soft: float = 0.08) -> Pixels:
    """BGRA of a round body whose half width (H, W) is given in units of u, shaded as a cylinder."""
    inside = np.clip(u / np.maximum(half_width, 1e-3), -1.0, 1.0)
    shade = 0.62 + 0.38 * np.sqrt(1.0 - inside**2) - 0.06 * inside
    alpha = np.clip((half_width - np.abs(u)) / soft + 0.5, 0.0, 1.0) * 255.0
    image: Pixels = np.dstack([np.clip(colours * shade[..., None], 0, 255), alpha]).astype(np.uint8)
    return image


def limb(
    piece: Cloth, taper: float, rng: np.random.Generator, end: str | None = None, share: float = 0.2
) -> Pixels:
    """BGRA of a sleeve or trouser leg that narrows to `taper`; its last `share` in colour `end`."""
    u, v = _grid(LIMB_SHAPE)
    colours = cloth(piece, 0.08 * u, 0.45 * v, rng)
    if end is not None:
        colours = np.where((v > 1.0 - share)[..., None], bgr(end).astype(np.float32), colours)
    width = 0.86 * (1.0 + (taper - 1.0) * v) + 0.03 * clouds((LIMB_SHAPE[0], 2), 12.0, rng)[:, :1]
    cap = np.sqrt(1.0 - np.clip(1.0 - np.minimum(v, 1.0 - v) / 0.09, 0.0, 1.0) ** 2)
    return _cut_out(colours, u, width * cap, 0.15)


def torso(piece: Cloth, rng: np.random.Generator) -> list[Pixels]:
    """BGRA of the upper body from VIEWS directions: 0 from behind, then as it turns left."""
    u, v = _grid(TORSO_SHAPE)
    shoulders = 0.28 + 0.72 * np.sqrt(np.clip(v / 0.13, 0.0, 1.0))
    waist = (
        1.0 - 0.10 * np.exp(-(((v - 0.62) / 0.18) ** 2)) - 0.10 * np.clip((v - 0.96) / 0.04, 0, 1)
    )
    width = 0.90 * shoulders * waist + 0.012 * clouds((TORSO_SHAPE[0], 2), 18.0, rng)[:, :1]
    width = np.where(v < 0.015, 0.25, width)
    long_strip = (TORSO_SHAPE[0], 4 * TORSO_SHAPE[1])
    around = np.linspace(-pi, pi, long_strip[1], dtype=np.float32)  # 0 = middle of the back
    strip = cloth(
        piece,
        np.broadcast_to(around * CLOTH_SCALE / pi, long_strip),
        np.broadcast_to(0.65 * v[:, :1], long_strip),
        rng,
    )
    front = np.abs(np.abs(around) - pi) < 0.05
    strip[:, front] *= 0.55  # buttons or a zip
    views = []
    for view in range(VIEWS):
        angle = np.arcsin(np.clip(u / width, -1.0, 1.0)) - 2.0 * pi * view / VIEWS
        column = ((angle / (2.0 * pi) + 0.5) % 1.0 * (long_strip[1] - 1)).astype(int)
        rows = np.arange(TORSO_SHAPE[0])[:, None]
        views.append(_cut_out(strip[rows, column], u, width, 0.04))
    return views


def head(outfit: Outfit, rng: np.random.Generator) -> list[Pixels]:
    """BGRA of the head from VIEWS directions: 0 from behind, then as it turns left."""
    u, v = _grid(HEAD_SHAPE)
    y = 2.0 * v - 1.0
    width = 0.95 * np.sqrt(np.clip(1.0 - np.abs(y) ** 2.4, 0.0, 1.0)) * (1.0 - 0.10 * v)
    hair = bgr(outfit.hair) * (1.0 + 0.18 * clouds(HEAD_SHAPE, 3.0, rng))[..., None]
    skin = bgr(outfit.skin) * (1.0 + 0.03 * clouds(HEAD_SHAPE, 8.0, rng))[..., None]
    views = []
    for view in range(VIEWS):
        back = np.arcsin(np.clip(u / np.maximum(width, 1e-3), -1, 1)) - 2.0 * pi * view / VIEWS
        facing = -np.cos(back)  # 1 = middle of the face
        is_hair = (facing < -0.1) & (y < 0.55) | (y < -0.5) | ((facing < 0.35) & (y < -0.1))
        colours = np.where(is_hair[..., None], hair, skin)
        eye = (np.abs(np.sqrt(np.clip(1 - facing**2, 0, 1)) - 0.35) < 0.12) & (facing > 0)
        colours = np.where((eye & (np.abs(y + 0.05) < 0.06))[..., None], colours * 0.35, colours)
        mouth = (facing > 0.93) & (np.abs(y - 0.5) < 0.04)
        colours = np.where(mouth[..., None], colours * 0.6, colours)
        views.append(_cut_out(colours.astype(np.float32), u, width, 0.10))
    return views


def ball(colour: str) -> Pixels:
    """BGRA of a shaded ball with a highlight."""
    u, v = _grid((64, 64))
    y = 2.0 * v - 1.0
    radius = np.hypot(u, y)
    depth = np.sqrt(np.clip(1.0 - radius**2, 0.0, 1.0))
    shade = np.clip(0.45 + 0.65 * (0.35 * -u + 0.55 * -y + 0.75 * depth), 0.3, 1.15)
    glint = 110.0 * np.exp(-((u + 0.3) ** 2 + (y + 0.4) ** 2) / 0.03)
    alpha = np.clip((0.94 - radius) / 0.06 + 0.5, 0.0, 1.0) * 255.0
    colours = np.clip(bgr(colour) * shade[..., None] + glint[..., None], 0, 255)
    image: Pixels = np.dstack([colours, alpha]).astype(np.uint8)
    return image


def shadow() -> Pixels:
    """BGRA of the soft dark spot under a person."""
    u, v = _grid((32, 32))
    radius = np.hypot(u, 2.0 * v - 1.0)
    image: Pixels = np.zeros((32, 32, 4), np.uint8)
    image[..., 3] = (120.0 * np.clip(1.0 - radius, 0.0, 1.0)).astype(np.uint8)
    return image


def column(look: Look, height: float, rng: np.random.Generator) -> Pixels:
    """BGRA of an upright cylinder's side."""
    u, _ = _grid((max(8, round(96 * height)), 48))
    colours = surface(look, 0.5, height, 96.0, rng)
    flat = np.asarray(cv2.resize(colours, u.shape[::-1]), np.float32)
    return _cut_out(flat, u, np.full_like(u, 0.97), 0.05)


def lit(colours: Pixels, normal_yaw: float) -> Pixels:
    """An upright surface as the room's light falls on it: brighter towards one side."""
    light = 0.88 + 0.12 * cos(normal_yaw - 0.9) + 0.04 * sin(2.0 * normal_yaw)
    table = np.clip(np.arange(256) * light, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(colours, table), np.uint8)
