"""A head before a cluttered room with a wooden door, drawn; its true ellipse is known.

Kwolek's sequences are not published. As in them somebody walks about and turns before a door in
nearly the colour of skin, while the light changes and the stereo pair sometimes finds no depth.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi, sin, tau

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Camera
from followerd.messages import Image, Pixels
from followerd.perception.ellipse import Ellipse

WIDTH, HEIGHT, FOCAL = 640, 480, 540.0  # px
RATE = 10.0  # Hz
BASELINE, MATCHING = 0.09, 0.3  # m; px of disparity, deviation
HALF_HEAD, ASPECT = 0.08, 1.2  # m; height over width
WALL, DOOR = 3.6, (240, 400)  # m; px, its left and right edge
SKIN, WOOD, HAIR = (102, 146, 206), (98, 142, 196), (28, 36, 48)  # BGR
NOISE = 5.0  # grey levels
NO_DEPTH = 0.03  # share of frames, and of blocks of pixels, without depth
BLOCK = 12  # px
DIMMER = 0.15
TURN = 18.0  # s, from facing the camera around to the back of the head and on
HALFWAY = 0.45  # share of the frames after which somebody crosses, where anybody does
CROSSING = 1.6  # s, from one border to the other
NEARER = 0.45  # m, before the head


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One image, and where the head really is."""

    image: Image
    head: Ellipse
    hidden: bool  # for the greater part


class Walk:
    """One person's walk, drawn from a seed."""

    def __init__(self, frames: int, rng: np.random.Generator, crossed: bool = False) -> None:
        """`crossed`: somebody else in the same colours walks through between."""
        self.frames = frames
        self.crossed = crossed
        self._rng = rng
        self._camera = Camera(WIDTH, HEIGHT, FOCAL, FOCAL, 319.5, 239.5, z=1.1)
        self._phases = rng.uniform(0.0, tau, 5)
        self._period = rng.uniform(7.0, 11.0)
        self._half_head = HALF_HEAD * rng.uniform(0.92, 1.08)
        self._shirt = rng.integers(40, 200, 3).tolist()
        self._room = _room(rng)
        shape = HEIGHT + 64, WIDTH + 64, 3
        self._noise = np.rint(rng.normal(0.0, NOISE, shape)).astype(np.int16)

    def __iter__(self) -> Iterator[Frame]:
        for k in range(self.frames):
            yield self._frame(k)

    def head(self, time: float) -> tuple[Ellipse, float]:
        """The true ellipse, and its depth, m."""
        p = self._phases
        depth = 1.9 + 0.7 * sin(tau * time / 13.0 + p[0])
        x = 320.0 + 150.0 * sin(tau * time / self._period + p[1])
        x += 25.0 * sin(tau * time / 2.3 + p[2])
        y = 190.0 + 14.0 * sin(tau * time / 3.1 + p[3])
        return Ellipse(x, y, FOCAL * self._half_head / depth, ASPECT), depth

    def _frame(self, k: int) -> Frame:
        time, rng = k / RATE, self._rng
        pixels = self._room.copy()
        depth = np.full((HEIGHT, WIDTH), WALL, np.float32)
        head, z = self.head(time)
        self._draw(pixels, depth, head, z, pi * abs((2.0 * time / TURN + 1.0) % 2.0 - 1.0) + pi)
        hidden = False
        since = time - HALFWAY * self.frames / RATE
        if self.crossed and 0.0 <= since < CROSSING:
            a = FOCAL * HALF_HEAD / (z - NEARER)
            x = -2.0 * a + (WIDTH + 4.0 * a) * since / CROSSING
            other = Ellipse(x, head.y, a, ASPECT)
            self._draw(pixels, depth, other, z - NEARER, 0.5 * pi)
            hidden = abs(x - head.x) < a
        light = 1.0 + DIMMER * sin(tau * time / 5.0 + self._phases[4])
        top, left = rng.integers(64, size=2).tolist()
        noisy = cv2.convertScaleAbs(pixels, alpha=light).astype(np.int16)
        noisy += self._noise[top : top + HEIGHT, left : left + WIDTH]
        seen = np.clip(noisy, 0, 255).astype(np.uint8)
        image = Image(k, time, time, seen, self._camera, self._matched(depth))
        return Frame(image, head, hidden)

    def _matched(self, depth: npt.NDArray[np.float32]) -> npt.NDArray[np.float32] | None:
        """Depth as a stereo pair finds it: noisy, with holes, in some frames not at all."""
        rng = self._rng
        error, lost = rng.normal(0.0, MATCHING), rng.random() < NO_DEPTH
        holes = rng.random((HEIGHT // BLOCK, WIDTH // BLOCK + 1)) < NO_DEPTH
        if lost:
            return None
        disparity = FOCAL * BASELINE / depth + np.float32(error)
        found = np.float32(FOCAL * BASELINE) / np.maximum(disparity, np.float32(1.0))
        found[np.kron(holes, np.ones((BLOCK, BLOCK), bool))[:HEIGHT, :WIDTH]] = np.nan
        return np.asarray(found, np.float32)

    def _draw(
        self, pixels: Pixels, depth: npt.NDArray[np.float32], head: Ellipse, z: float, yaw: float
    ) -> None:
        """A person's head and shoulders; at a `yaw` of 0 the back of the head is seen."""
        a, b = head.a, head.aspect * head.a
        x, y = round(head.x), round(head.y)
        body = (round(x - 2.3 * a), round(y + 1.25 * b)), (round(x + 2.3 * a), HEIGHT)
        neck = (round(x - 0.55 * a), y), (round(x + 0.55 * a), round(y + 1.35 * b))
        for (start, end), colour in ((neck, SKIN), (body, self._shirt)):
            cv2.rectangle(pixels, start, end, colour, -1)
            cv2.rectangle(depth, start, end, z + 0.05, -1)
        left, right = max(int(head.x - a) - 1, 0), min(int(head.x + a) + 2, WIDTH)
        top, bottom = max(int(head.y - b) - 1, 0), min(int(head.y + b) + 2, HEIGHT)
        if left >= right or top >= bottom:
            return
        u = (np.arange(left, right) + 0.5 - head.x) / a
        v = ((np.arange(top, bottom) + 0.5 - head.y) / b)[:, None]
        share = np.clip((1.0 - np.hypot(u, v)) * a + 0.5, 0.0, 1.0)
        around = np.arcsin(np.clip(u / np.sqrt(np.maximum(1.0 - v * v, 1e-3)), -1.0, 1.0))
        facing = -np.cos(around - yaw)  # 1 = the middle of the face
        hair = ((facing < -0.1) & (v < 0.6)) | (v < -0.5) | ((facing < 0.35) & (v < -0.1))
        colours = np.where(hair[..., None], np.array(HAIR, float), np.array(SKIN, float))
        eyes = (np.abs(facing - 0.93) < 0.05) & (np.abs(v + 0.1) < 0.07)
        mouth = (facing > 0.93) & (np.abs(v - 0.5) < 0.05)
        colours[eyes | mouth] *= 0.5
        colours *= (1.0 - 0.12 * u * u)[:, None]
        part = pixels[top:bottom, left:right]
        part[:] = np.rint(part + share[..., None] * (colours - part)).astype(np.uint8)
        depth[top:bottom, left:right][share > 0.5] = z


def _room(rng: np.random.Generator) -> Pixels:
    """A wall with pictures and shelves, and the door."""
    room = np.full((HEIGHT, WIDTH, 3), (196, 205, 210), np.float32)
    for _ in range(26):
        x, y = rng.integers(0, WIDTH), rng.integers(0, HEIGHT)
        w, h = rng.integers(15, 90, 2)
        cv2.rectangle(room, (int(x), int(y)), (int(x + w), int(y + h)), _any(rng), -1)
    left, right = DOOR
    grain = cv2.GaussianBlur(rng.normal(0.0, 40.0, (HEIGHT, right - left)), (3, 41), 0)
    room[:, left:right] = np.array(WOOD) + grain[..., None]
    for edge in DOOR:
        cv2.line(room, (edge, 0), (edge, HEIGHT), (60, 80, 110), 5)
    return np.clip(room, 0, 255).astype(np.uint8)


def _any(rng: np.random.Generator) -> tuple[float, float, float]:
    """A colour."""
    b, g, r = rng.uniform(20.0, 235.0, 3).tolist()
    return b, g, r
