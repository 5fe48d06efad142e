"""What a Kinect v1 makes of true depth: its holes, its steps, its range, its registration.

The projector stands beside the infrared camera, so that what is near casts a shadow without depth
on what is behind; the shift of the pattern is measured in eighths of a sensor pixel, which gives
steps that grow with the square of the depth (Khoshelham and Elberink 2012); the depth image has
half the colour image's resolution and is laid on it a pixel or two off.
"""

from collections.abc import Callable
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Camera
from followerd.hw.camera.registration import BASELINE, EMITTER
from followerd.messages import Pixels

Depth = npt.NDArray[np.float32]


class Scene(Protocol):
    """What a unit looks at."""

    def render(self, camera: Camera) -> Pixels:
        """The colour image (H, W, 3) of now."""

    def still(self, camera: Camera) -> Pixels:
        """The same in even light and without noise."""

    def depth(self, camera: Camera) -> Depth:
        """True depth (H, W) of now, m; nan = nothing."""


NEAREST, FARTHEST = 0.5, 6.0  # m
SHIFT_STEP = 0.125  # px of the infrared camera at 640 in a row
FOCAL = 575.8  # px, of it
SHIFT_NOISE = 0.08  # px, deviation
GRAIN = 8  # px, in which that noise is one
LOST = 0.01  # share of lone pixels without depth
JUMP = 0.06  # of the depth, between neighbours: an edge at which it is lost
DARK = 26  # grey levels; what is darker may swallow the light
SWALLOWS = 0.35  # share of dark pixels that then have no depth
OFF = 0.04  # of the shift by which registration is wrong


class StructuredLight:
    """One unit: its noise is its own, its misregistration stays."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._rows_off, off = rng.uniform(-1.0, 1.0, 2)  # px
        self._shift_off = 1.0 + OFF * off

    def __call__(self, true: Depth, pixels: Pixels, camera: Camera) -> Depth:
        """Depth (H, W) m as measured, where the colour image `pixels` is; nan = unknown."""
        half = true[::2, ::2].copy()
        with np.errstate(invalid="ignore"):
            half[~((half > NEAREST) & (half < FARTHEST))] = np.nan
        seen = np.nan_to_num(half, nan=FARTHEST)
        unknown = np.isnan(half) | self._shadow(seen, camera) | _edges(seen)
        unknown |= self._rng.random(half.shape, np.float32) < LOST
        unknown |= self._swallowed(pixels[::2, ::2])
        measured = self._quantised(seen)
        measured[unknown] = np.nan
        full = np.repeat(np.repeat(measured, 2, axis=0), 2, axis=1)
        return self._displaced(full[: true.shape[0], : true.shape[1]], seen, camera)

    def of(self, world: Scene) -> Callable[[Camera], tuple[Pixels, Depth]]:
        """What a camera with this unit sees of the world's now."""

        def take(camera: Camera) -> tuple[Pixels, Depth]:
            pixels = world.render(camera)
            return pixels, self(world.depth(camera), world.still(camera), camera)

        return take

    def _shadow(self, depth: Depth, camera: Camera) -> npt.NDArray[np.bool_]:
        """Where something nearer stands between the projector and what the camera sees."""
        shift = 0.5 * camera.fx * EMITTER / depth  # px, in the half image
        # the projector is on the right: it sees a point at its column less its shift
        place = np.arange(depth.shape[1], dtype=np.float32) - shift
        first = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1]
        dark: npt.NDArray[np.bool_] = place > first + 1.0
        return dark

    def _swallowed(self, pixels: Pixels) -> npt.NDArray[np.bool_]:
        grey = pixels if pixels.ndim == 2 else np.asarray(pixels.max(axis=2))
        dark: npt.NDArray[np.bool_] = grey < DARK
        dark &= self._rng.random(grey.shape, np.float32) < SWALLOWS
        return dark

    def _quantised(self, depth: Depth) -> Depth:
        height, width = depth.shape
        coarse = self._rng.standard_normal((height // GRAIN + 2, width // GRAIN + 2), np.float32)
        noise = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)
        shift = FOCAL * EMITTER / depth + SHIFT_NOISE * noise
        steps = np.rint(np.asarray(shift) / SHIFT_STEP) * SHIFT_STEP
        return np.asarray(FOCAL * EMITTER / np.maximum(steps, SHIFT_STEP), np.float32)

    def _displaced(self, depth: Depth, seen: Depth, camera: Camera) -> Depth:
        """As laid on the colour image with slightly wrong tables."""
        typical = float(np.median(seen))
        columns = (self._shift_off - 1.0) * camera.fx * BASELINE / typical
        across, down = round(columns), round(self._rows_off)
        shift = np.array([[1.0, 0.0, across], [0.0, 1.0, down]])
        size, beyond = depth.shape[::-1], np.nan
        moved = cv2.warpAffine(
            depth, shift, size, None, cv2.INTER_NEAREST, cv2.BORDER_CONSTANT, beyond
        )
        return np.asarray(moved, np.float32)


def _edges(depth: Depth) -> npt.NDArray[np.bool_]:
    """Both sides of a jump in depth: the pattern there is of neither."""
    three = np.ones((3, 3), np.uint8)
    high, low = np.asarray(cv2.dilate(depth, three)), np.asarray(cv2.erode(depth, three))
    jump: npt.NDArray[np.bool_] = high - low > JUMP * depth
    return jump
