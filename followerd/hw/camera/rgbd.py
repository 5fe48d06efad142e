"""Recorded pairs of colour and depth: `rgb/`, `depth/`, and `calib.json` to register the two.

Depth images are 16-bit, in mm, 0 = unknown. With `calib.json` (Kdepth, Krgb, and R, T in m from the
depth camera to the colour camera) depth is registered; without it is taken to be.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from followerd.errors import DeviceError, UsageError
from followerd.geometry import Array
from followerd.hw.camera.files import ImageFolder
from followerd.hw.camera.protocol import Frame

RATE = 2.0  # Hz, taken where nothing tells: such recordings are snapshots
MILLIMETRE = np.float32(0.001)

Depth = npt.NDArray[np.float32]


class RgbdFolder:
    """The pairs, in the order of the numbers in their names."""

    def __init__(self, folder: Path) -> None:
        self._colour = ImageFolder(folder / "rgb", RATE)
        self._depths = [folder / "depth" / f"{Path(name).stem}.png" for name in self._colour.names]
        for path in self._depths:
            if not path.exists():
                raise UsageError(f"{path} is missing: every image in rgb/ needs its depth")
        self.rate, self.count = RATE, self._colour.count
        self.width, self.height = self._colour.width, self._colour.height
        calibration = folder / "calib.json"
        self._laid = _Registration(calibration) if calibration.exists() else None

    @property
    def lens(self) -> tuple[float, float, float, float] | None:
        """The colour camera's fx, fy, cx, cy, px, where they are known."""
        return None if self._laid is None else self._laid.lens

    def __iter__(self) -> Iterator[Frame]:
        shape = self.height, self.width
        for frame, path in zip(self._colour, self._depths, strict=True):
            raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            if raw is None or raw.dtype != np.uint16 or raw.ndim != 2:
                raise DeviceError(str(path), "is no 16-bit depth image", "is the file damaged?")
            metres = np.asarray(raw, np.float32) * MILLIMETRE
            if self._laid is not None:
                metres = self._laid(metres, shape)
            elif metres.shape != shape:
                raise DeviceError(str(path), "is not of its colour image's size", "add calib.json")
            metres[metres == 0.0] = np.nan
            yield frame._replace(depth=metres)


class _Registration:
    """Two pinhole cameras, and where one is seen from the other."""

    def __init__(self, path: Path) -> None:
        try:
            table = json.loads(path.read_text(encoding="utf-8"))
            matrices = [np.array(table[name], float) for name in ("Kdepth", "Krgb", "R", "T")]
            self._depth, self._colour, self._turn = (m.reshape(3, 3) for m in matrices[:3])
            self._shift: Array = matrices[3].reshape(3)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UsageError(f"{path}: not readable as Kdepth, Krgb, R and T: {error!r}") from error
        k = self._colour
        self.lens = float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])

    def __call__(self, metres: Depth, shape: tuple[int, int]) -> Depth:
        """Depth (H, W) where the colour camera sees it, 0 = unknown; the nearest surface wins."""
        rows, columns = np.nonzero(metres)
        z = metres[rows, columns].astype(float)
        pixels = np.stack([columns, rows, np.ones_like(columns)]).astype(float)
        points = self._turn @ (np.linalg.inv(self._depth) @ pixels * z) + self._shift[:, None]
        u, v, depth = self._colour @ points
        x, y = np.rint(u / depth).astype(np.intp), np.rint(v / depth).astype(np.intp)
        inside = (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])
        canvas = np.full(shape, np.inf, np.float32)
        at = y[inside] * shape[1] + x[inside]
        np.minimum.at(canvas.reshape(-1), at, depth[inside].astype(np.float32))
        canvas[np.isinf(canvas)] = 0.0
        return canvas
