"""A Kinect's raw depth in metres, as seen by its colour camera.

A raw value is the shift of the projected pattern, in quarters of a sensor pixel. libfreenect's
formula: with m = ((raw - 800) / 4 - 0.375) * pixel_size, the depth is m * zero_plane /
(emitter - m) + zero_plane. Both cameras look the same way, so that depth only shifts a pixel
along its row: u_colour = columns(u, v) - shifts(raw). A unit's own tables have the same form.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array, Camera

WIDTH, HEIGHT = 640, 480  # px
NO_DEPTH = 2047  # raw
RAW_VALUES = 2048
MAX_DEPTH = 10.0  # m
ZERO_PLANE = 1.2  # m, distance of the recorded pattern
PIXEL_SIZE = 1.042e-3  # m, of a sensor pixel (1280 in a row) on the zero plane
EMITTER = 0.075  # m, from the infrared camera to the projector
BASELINE = 0.024  # m, from the infrared camera to the colour camera on its right
DEPTH_FOCAL = ZERO_PLANE / (2 * PIXEL_SIZE)  # px, of the infrared camera at 640 in a row

FRACTION = 6  # bits behind the point of a column
BANDS = 8  # of rows, registered one after the other: their temporaries stay in the cache

Raw = npt.NDArray[np.uint16]
Depth = npt.NDArray[np.float32]


def metres_of_raw() -> Array:
    """Depth (2048,) in m of each raw value; inf = unknown."""
    raw = np.arange(RAW_VALUES, dtype=float)
    m = ((raw - 800.0) / 4.0 - 0.375) * PIXEL_SIZE
    depth: Array = m * ZERO_PLANE / (EMITTER - m) + ZERO_PLANE
    depth[(m >= EMITTER) | (depth <= 0.0) | (depth > MAX_DEPTH)] = np.inf
    depth[NO_DEPTH] = np.inf
    return depth


@dataclass(frozen=True, slots=True)
class RegistrationTables:
    """Where the colour camera sees what the infrared camera sees at a pixel."""

    columns: Array  # (H, W) px, at infinite distance; nan = nowhere
    rows: Array  # (H, W) px
    shifts: Array  # (2048,) px to the left, by raw value
    metres: Array  # (2048,) by raw value; inf = unknown

    @classmethod
    def of_pinholes(cls, colour: Camera) -> "RegistrationTables":
        """For a unit whose own tables cannot be read: two parallel pinhole cameras."""
        metres = metres_of_raw()
        u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
        x = (u - 0.5 * (WIDTH - 1)) / DEPTH_FOCAL
        y = (v - 0.5 * (HEIGHT - 1)) / DEPTH_FOCAL
        shifts: Array = colour.fx * BASELINE / metres
        return cls(colour.fx * x + colour.cx, colour.fy * y + colour.cy, shifts, metres)


class Registration:
    """Registers frames by tables and a z-buffer; 2 ms a frame."""

    def __init__(self, tables: RegistrationTables) -> None:
        known = np.isfinite(tables.metres)
        shifts = np.where(known, tables.shifts, 0.0)
        reach = float(np.abs(shifts).max())
        inside = (tables.columns > -reach) & (tables.columns < WIDTH + reach)
        rows = np.round(tables.rows)
        seen = inside & (rows >= 0) & (rows < HEIGHT)
        # what falls off the image falls into a margin beside it: no pixel needs to be tested
        self._margin = int(2 * reach) + 3
        stride = WIDTH + 2 * self._margin
        at = np.where(seen, rows * stride + self._margin + tables.columns, 1.0 + reach)
        base = np.round(at * (1 << FRACTION) + (1 << (FRACTION - 1))).astype(np.intp)
        self._bases = np.array_split(base, BANDS)
        self._shift = np.round(shifts * (1 << FRACTION)).astype(np.intp)
        self._metres = np.where(known, tables.metres, np.inf).astype(np.float32)
        self._canvas = np.empty((HEIGHT, stride), np.float32)

    def __call__(self, raw: Raw) -> Depth:
        """Depth (480, 640) in m in the colour image, nan = unknown; the nearest surface wins."""
        self._canvas.fill(np.inf)
        pixels = self._canvas.reshape(-1)
        for base, band in zip(self._bases, np.array_split(raw, BANDS), strict=True):
            at = np.take(self._shift, band, mode="clip")
            np.subtract(base, at, out=at)
            np.right_shift(at, FRACTION, out=at)
            np.minimum.at(pixels, at.ravel(), np.take(self._metres, band, mode="clip").ravel())
        depth: Depth = self._canvas[:, self._margin : self._margin + WIDTH].copy()
        depth[depth == np.inf] = np.nan
        return depth
