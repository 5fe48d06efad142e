"""Calibrating a camera by views of a flat chessboard (Zhang 2000, as OpenCV has it)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from followerd.errors import UsageError
from followerd.geometry import Array
from followerd.hw.camera.calibration import Calibration
from followerd.messages import Pixels

NEEDED = 5  # different views
ANOTHER = 0.03  # of the image's width that corners move by, on average, in another view
TILTED = 15.0  # degrees between the two boards that lean most apart
ROUGH = 1.0  # px rms: something is wrong with the board or the images


@dataclass(frozen=True, slots=True)
class Board:
    """Inner corners of the board, and the side of its squares."""

    columns: int
    rows: int
    square: float  # m

    @classmethod
    def parse(cls, text: str, square: float) -> "Board":
        """From COLUMNSxROWS; raises UsageError."""
        columns, _, rows = text.partition("x")
        if not (columns.isdecimal() and rows.isdecimal() and min(int(columns), int(rows)) >= 3):
            raise UsageError(f"--board {text}: give inner corners, COLUMNSxROWS, such as 9x6")
        return cls(int(columns), int(rows), square)

    @property
    def points(self) -> Array:
        """Corners (N, 3) on the board, m."""
        rows, columns = np.mgrid[: self.rows, : self.columns]
        flat = np.column_stack([columns.ravel(), rows.ravel(), np.zeros(rows.size)])
        return np.asarray(flat * self.square, np.float32)

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"


class View(NamedTuple):
    """The board in one image."""

    name: str
    corners: Array  # (N, 2) px
    image: Pixels


def find(image: Pixels, board: Board) -> Array | None:
    """The board's corners (N, 2) in an image, px; None when it is not whole in view."""
    grey = image
    if image.ndim == 3:
        grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    size = board.columns, board.rows
    good, corners = cv2.findChessboardCorners(grey, size, None, flags)
    if not good:
        return None
    found = np.asarray(corners, np.float32).reshape(-1, 2)
    apart = np.linalg.norm(np.diff(found.reshape(board.rows, board.columns, 2), axis=1), axis=2)
    half = int(np.clip(0.4 * apart.min(), 2, 11))  # a window must not reach the next corner
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
    refined = cv2.cornerSubPix(grey, found.reshape(-1, 1, 2), (half, half), (-1, -1), stop)
    return np.asarray(refined, np.float32).reshape(-1, 2)


def is_another(corners: Array, views: Sequence[View], width: int) -> bool:
    """Whether the board stands otherwise than in all these views."""
    moved = (np.linalg.norm(corners - view.corners, axis=1).mean() for view in views)
    return all(way > ANOTHER * width for way in moved)


def coverage(views: Sequence[View]) -> float:
    """Share of the image that lies between corners of any view."""
    hull = cv2.convexHull(np.concatenate([view.corners for view in views]).astype(np.float32))
    height, width = views[0].image.shape[:2]
    return float(cv2.contourArea(hull) / (width * height))


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """What the views say of the camera."""

    calibration: Calibration
    rms: float  # px, of all corners
    view_rms: Array  # (V,) px
    expected: list[Array]  # (N, 2) px for each view, where the model sees the corners


def calibrate(views: Sequence[View], board: Board) -> Fit:
    """Pinhole and distortion (k3 = 0); raises UsageError when the views do not fix them."""
    if len(views) < NEEDED:
        raise UsageError(
            f"{len(views)} different views of the board, at least {NEEDED} are needed:"
            " hold it in all parts of the image, near and far, tilted each time"
        )
    height, width = views[0].image.shape[:2]
    if (spread := _spread(views, board)) < TILTED:
        raise UsageError(
            f"the board leans the same way in all views, within {spread:.0f} degrees: that does"
            " not tell the focal length; tilt it by 30 to 45 degrees, each time another way"
        )
    points = [board.points] * len(views)
    corners = [view.corners.reshape(-1, 1, 2) for view in views]
    start, none = np.eye(3), np.zeros(5)
    rms, k, distortion, turns, places, _, _, errors = cv2.calibrateCameraExtended(
        points, corners, (width, height), start, none, flags=cv2.CALIB_FIX_K3
    )
    expected: list[Array] = []
    for turn, place in zip(turns, places, strict=True):
        seen, _ = cv2.projectPoints(board.points, turn, place, k, distortion)
        expected.append(np.asarray(seen, float).reshape(-1, 2))
    k1, k2, p1, p2, k3 = (float(value) for value in np.asarray(distortion).ravel()[:5])
    found = Calibration(
        width=width,
        height=height,
        fx=float(k[0, 0]),
        fy=float(k[1, 1]),
        cx=float(k[0, 2]),
        cy=float(k[1, 2]),
        distortion=(k1, k2, p1, p2, k3),
        rms_px=float(rms),
    )
    return Fit(found, float(rms), np.asarray(errors, float).ravel(), expected)


def _spread(views: Sequence[View], board: Board) -> float:
    """Largest angle between two views' boards, degrees; about, by a guessed focal length.

    Parallel boards have one vanishing line, whatever the camera is; the fit cannot tell then, and
    does not say so.
    """
    height, width = views[0].image.shape[:2]
    guess = np.array([[width, 0, 0.5 * width], [0, width, 0.5 * height], [0, 0, 1.0]])
    normals = []
    for view in views:
        plane, _ = cv2.findHomography(board.points[:, :2], view.corners)
        normal = guess.T @ np.linalg.inv(np.asarray(plane, float)).T[:, 2]
        normals.append(normal / np.linalg.norm(normal))
    cosines = np.abs(np.array(normals) @ np.array(normals).T)
    return float(np.degrees(np.arccos(np.clip(cosines.min(), 0.0, 1.0))))
