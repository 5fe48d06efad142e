"""The geometry of a calibrated stereo pair, and its matching."""

from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from followerd.errors import ConfigError
from followerd.geometry import Array
from followerd.messages import Pixels

NEEDED = {"M1": (3, 3), "D1": None, "M2": (3, 3), "D2": None, "R": (3, 3), "T": (3, 1)}
BASELINES = (0.01, 2.0)  # m
BLOCKS = {"bm": 15, "sgbm": 5}  # px
SUBPIXELS = 16.0  # of a disparity as OpenCV gives it

Depth = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class StereoGeometry:
    """Two cameras as OpenCV's stereoCalibrate leaves them; x_right = R x_left + T."""

    m1: Array  # (3, 3) px
    d1: Array  # (N,)
    m2: Array  # (3, 3) px
    d2: Array  # (N,)
    r: Array  # (3, 3)
    t: Array  # (3,) m

    @classmethod
    def read(cls, path: Path) -> "StereoGeometry":
        """From OpenCV's FileStorage (YAML, XML, JSON); raises ConfigError naming every fault."""
        if not path.is_file():
            raise ConfigError(f"{path}: no such file")
        try:
            storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        except (cv2.error, SystemError):  # the binding forgets its own error
            raise ConfigError(f"{path}: is not in OpenCV's FileStorage format") from None
        found: dict[str, Any] = {name: storage.getNode(name).mat() for name in NEEDED}
        storage.release()
        problems = []
        for name, shape in NEEDED.items():
            matrix = found[name]
            if matrix is None:
                problems.append(f"{path}: {name} is missing; M1 D1 M2 D2 R T are needed")
            elif not np.isfinite(matrix).all():
                problems.append(f"{path}: {name} is not finite")
            elif shape is not None and matrix.size != shape[0] * shape[1]:
                problems.append(f"{path}: {name} is {matrix.shape}, expected {shape}")
        if problems:
            raise ConfigError(*problems)
        m1, d1, m2, d2, r, t = (np.asarray(found[name], float) for name in NEEDED)
        pair = cls(m1, d1.ravel(), m2, d2.ravel(), r, t.ravel())
        pair._check(path)
        return pair

    def _check(self, path: Path) -> None:
        low, high = BASELINES
        if not low <= (baseline := float(np.linalg.norm(self.t))) <= high:
            hint = "T must be in m: give the board's squares in m when calibrating"
            raise ConfigError(f"{path}: the cameras are {baseline:g} m apart; {hint}")
        if not np.allclose(self.r @ self.r.T, np.eye(3), atol=1e-3):
            raise ConfigError(f"{path}: R is no rotation")
        if abs(self.t[0]) < abs(self.t[1]) or self.t[0] > 0:
            hint = "the right camera must stand to the right of the left one: are they swapped?"
            raise ConfigError(f"{path}: T is {np.round(self.t, 3).tolist()}; {hint}")


class Rectification:
    """Both images as two equal cameras side by side see them, and the depth of the left one."""

    def __init__(self, pair: StereoGeometry, size: tuple[int, int]) -> None:
        width, height = size
        r1, r2, p1, p2, _, _, _ = cv2.stereoRectify(
            pair.m1, pair.d1, pair.m2, pair.d2, size, pair.r, pair.t.reshape(3, 1), alpha=0
        )
        self.width, self.height = width, height
        self.focal = float(p1[0, 0])  # px
        self.centre = float(p1[0, 2]), float(p1[1, 2])  # px
        self.baseline = -float(p2[0, 3]) / self.focal  # m
        maps = cv2.CV_16SC2
        self._left = cv2.initUndistortRectifyMap(pair.m1, pair.d1, r1, p1, size, maps)
        self._right = cv2.initUndistortRectifyMap(pair.m2, pair.d2, r2, p2, size, maps)

    def rectify(self, left: Pixels, right: Pixels) -> tuple[Pixels, Pixels]:
        """The two images, rows aligned."""
        straight = (
            cv2.remap(left, *self._left, cv2.INTER_LINEAR),
            cv2.remap(right, *self._right, cv2.INTER_LINEAR),
        )
        return np.asarray(straight[0], np.uint8), np.asarray(straight[1], np.uint8)


class Matcher:
    """Depth by StereoBM or StereoSGBM, on images made `shrink` times smaller.

    For 640x480, rectified: SGBM at half size 9 ms, BM 5 ms; at full size 42 and 19 ms.
    """

    def __init__(self, kind: str, pair: Rectification, nearest: float, shrink: int) -> None:
        self._shrink = shrink
        self._metres = pair.focal * pair.baseline / shrink  # over a disparity in px
        disparities = 16 * ceil(self._metres / nearest / 16)
        block = BLOCKS[kind]
        if kind == "bm":
            self._matcher: cv2.StereoMatcher = cv2.StereoBM.create(disparities, block)
        else:
            self._matcher = cv2.StereoSGBM.create(
                0, disparities, block, P1=8 * block**2, P2=32 * block**2, preFilterCap=31,
                uniquenessRatio=10, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
            )  # fmt: skip
        self._matcher.setDisp12MaxDiff(1)
        self._matcher.setSpeckleWindowSize(100)
        self._matcher.setSpeckleRange(2)

    def depth(self, left: Pixels, right: Pixels) -> Depth:
        """Depth (H, W) in m of rectified images' left one; nan = not found."""
        height, width = left.shape[:2]
        small = (width // self._shrink, height // self._shrink)
        grey = [self._grey(image, small) for image in (left, right)]
        shift = np.asarray(self._matcher.compute(*grey), np.float32) / SUBPIXELS
        with np.errstate(divide="ignore"):
            depth = np.float32(self._metres) / shift
        depth[shift <= 0.0] = np.nan
        if self._shrink == 1:
            return depth
        full = cv2.resize(depth, (width, height), None, 0, 0, cv2.INTER_NEAREST)
        return np.asarray(full, np.float32)

    def _grey(self, image: Pixels, size: tuple[int, int]) -> Pixels:
        if self._shrink > 1:
            image = np.asarray(cv2.resize(image, size, None, 0, 0, cv2.INTER_AREA), np.uint8)
        if image.ndim == 2:
            return image
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
