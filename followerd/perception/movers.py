"""What moves before sensors that stand still: a person, seen without knowing the person.

Whatever stays where it is, the median of a session, is taken away from each image and each scan.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.messages import Pixels, Scan

Mask = npt.NDArray[np.uint8]

DIFFERS = 30  # grey levels of one channel
SHADOW, SHADOW_HUE = (0.6, 1.0), 14  # share of the background's light; grey levels beside it
LEAST_AREA = 0.003  # of the image, of a person
BORDER = 2  # px; what touches it is cut off
NEARER = 0.3  # m before the background
GAP_BEAMS, GAP = 2, 0.15  # beams, m: farther apart are two legs
STRIDE = 0.75  # m, farthest apart two legs of one person are


@dataclass(frozen=True, slots=True)
class Silhouette:
    """A whole person in an image, head perhaps cut off, px."""

    column: float  # centre of its area
    row: float
    foot: float  # lower edge of the lowest pixel


@dataclass(frozen=True, slots=True)
class Legs:
    """The visible sides of one person's legs in a scan; m, in `base`."""

    nearest: tuple[float, float]  # of the nearer leg
    middle: tuple[float, float]  # of both
    count: int


class StillImage:
    """The image without whoever walks through it."""

    def __init__(self, images: Sequence[Pixels]) -> None:
        """`images` (H, W, 3) of one camera, from which every place is free most of the time."""
        self._still = np.median(np.stack(images), axis=0).astype(np.float32)
        self._power = np.maximum(np.einsum("ijk,ijk->ij", self._still, self._still), 1.0)

    def silhouette(self, pixels: Pixels) -> Silhouette | None:
        """The one who moves; None when nobody does, or the feet or a side are cut off."""
        mask = self._moved(pixels)
        count, _, stats, _ = cv2.connectedComponentsWithStats(mask)
        if count < 2:
            return None
        largest = stats[1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))].tolist()
        left, _, width, _, area = largest
        rows, columns = np.nonzero(mask[:, left : left + width])
        bottom = int(rows.max())
        high, wide = mask.shape
        is_cut = left < BORDER or left + width > wide - BORDER or bottom > high - 1 - BORDER
        if area < LEAST_AREA * mask.size or is_cut:
            return None
        return Silhouette(left + float(columns.mean()), float(rows.mean()), bottom + 0.5)

    def _moved(self, pixels: Pixels) -> Mask:
        """Where it differs from the still image, shadows left out."""
        now = pixels.astype(np.float32)
        light = np.einsum("ijk,ijk->ij", now, self._still) / self._power
        beside = np.abs(now - light[..., None] * self._still).max(axis=2)
        shadow = (light > SHADOW[0]) & (light < SHADOW[1]) & (beside < SHADOW_HUE)
        differs = (np.abs(now - self._still).max(axis=2) > DIFFERS) & ~shadow
        opened = cv2.morphologyEx(differs.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3)))
        return np.asarray(opened, np.uint8)


class StillScan:
    """The ranges without whoever walks through them."""

    def __init__(self, scans: Sequence[Scan]) -> None:
        """`scans` of one shape."""
        self._still: Array = np.median([_reach(scan) for scan in scans], axis=0)

    def legs(self, scan: Scan) -> Legs | None:
        """The one who moves; None when nobody does, or more than one."""
        moved = np.flatnonzero(_reach(scan) < self._still - NEARER)
        if moved.size < 2:
            return None
        points = scan.points()[moved]
        steps = np.hypot(*np.diff(points, axis=0).T)
        cuts = np.flatnonzero((np.diff(moved) > GAP_BEAMS) | (steps > GAP)) + 1
        seen = [part.mean(axis=0) for part in np.split(points, cuts) if len(part) > 1]
        if not seen:
            return None
        centres = np.array(seen)
        nearest = centres[int(np.argmin(np.hypot(*centres.T)))]
        mates = centres[np.hypot(*(centres - nearest).T) < STRIDE]
        if len(mates) > 2 or len(mates) < len(centres):
            return None
        middle = mates.mean(axis=0)
        return Legs(
            (float(nearest[0]), float(nearest[1])), (float(middle[0]), float(middle[1])), len(mates)
        )


def _reach(scan: Scan) -> Array:
    """Ranges, where nothing was seen the longest."""
    return np.where(np.isfinite(scan.ranges), scan.ranges, scan.range_max)
