"""Motion of the camera from two images, where there is no odometry."""

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.messages import Box, Pixels

WIDTH = 320  # px: wider images are reduced by a whole factor
CORNERS = 120
REFRESH = 5  # frames between two searches for corners
FEWEST = 12  # corners that must agree

Points = npt.NDArray[np.float32]  # (N, 2) px
NONE = np.empty((0, 2), np.float32)


class EgoFlow:
    """Follows corners of the background from frame to frame (Lucas-Kanade) and fits a map to
    them (RANSAC): shift, turn and scale; on people's images as good as a homography."""

    def __init__(self) -> None:
        self._grey: Pixels | None = None
        self._corners: Points = NONE
        self._age = 0

    def step(self, pixels: Pixels, person: Box | None) -> Array | None:
        """Map (3, 3) from the previous image's pixels to those of `pixels`; None if unknown.

        Corners on the `person` (px, in the previous image) are left out.
        """
        factor = -(-pixels.shape[1] // WIDTH)
        grey = _reduced_grey(pixels, factor)
        before, self._grey = self._grey, grey
        if before is None or before.shape != grey.shape:
            self._corners = NONE
            return None
        self._age += 1
        if len(self._corners) < 3 * FEWEST or self._age >= REFRESH:
            self._corners = _background_corners(before, person, factor)
            self._age = 0
        start, end = _followed(before, grey, self._corners)
        self._corners = end
        if len(start) < FEWEST:
            return None
        affine, inliers = cv2.estimateAffinePartial2D(
            start, end, ransacReprojThreshold=1.5, maxIters=200, confidence=0.98
        )
        agreed = np.asarray(inliers).ravel() == 1
        if agreed.sum() < FEWEST:
            return None
        self._corners = end[agreed]
        full = np.eye(3)
        full[:2] = affine
        full[:2, 2] *= factor
        return full


def _reduced_grey(pixels: Pixels, factor: int) -> Pixels:
    grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    if factor > 1:
        size = (grey.shape[1] // factor, grey.shape[0] // factor)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(grey, np.uint8)


def _followed(before: Pixels, after: Pixels, corners: Points) -> tuple[Points, Points]:
    """Those corners (N, 2) that were found again, and where."""
    if len(corners) == 0:
        return NONE, NONE
    found_at, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, corners.reshape(-1, 1, 2), np.empty(0, np.float32), winSize=(15, 15)
    )
    good = np.asarray(found).ravel() == 1
    return corners[good], np.asarray(found_at, np.float32).reshape(-1, 2)[good]


def _background_corners(grey: Pixels, person: Box | None, factor: int) -> Points:
    mask = np.full(grey.shape, 255, np.uint8)
    if person is not None:
        x, y = person.x / factor, person.y / factor
        w, h = person.w / factor, person.h / factor
        rows = slice(max(int(y - 0.1 * h), 0), max(int(y + 1.1 * h), 0))
        mask[rows, max(int(x - 0.2 * w), 0) : max(int(x + 1.2 * w), 0)] = 0
    corners = cv2.goodFeaturesToTrack(grey, CORNERS, 0.01, 8, mask=mask)
    return np.asarray([] if corners is None else corners, np.float32).reshape(-1, 2)
