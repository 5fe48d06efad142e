"""The depth band of a followed person, and what stands before it.

Jia et al. 2015, section 3.1, in metres. There the nearest mode is the person; here that holds at
the start only, later it is the mode nearest to where they are expected, lest it be a passer-by.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from followerd.geometry import Array
from followerd.messages import Box, Pixels

Depth = npt.NDArray[np.float32]

BIN = 0.10  # m, of the histogram
FARTHEST = 6.0  # m; a Kinect's depth says nothing beyond
HALF_BAND = 0.25  # m, of a person about their mode
BEFORE = 0.30  # m, what is that much nearer hides them
LEAST_MASS = 0.15  # share of the box that makes a mode
TORSO = (0.2, 0.5)  # rows of a person's box, shares of its height
LEAST_TORSO = 0.25  # share of it that tells its depth
LEAST_PIXELS = 10  # of those, in a patch, that tell how bright it is
STRIDE = 3  # px, every so many are looked at for the modes


class Mode(NamedTuple):
    """A depth at which much of a box lies."""

    depth: float  # m
    mass: float  # share of the box's pixels


def crop(box: Box, width: int, height: int) -> tuple[slice, slice]:
    """Rows and columns of a box inside the image."""
    left, top = max(0, int(box.x)), max(0, int(box.y))
    right, bottom = min(width, round(box.x + box.w)), min(height, round(box.y + box.h))
    return slice(top, max(top, bottom)), slice(left, max(left, right))


def modes(depth: Depth, box: Box, least: float = LEAST_MASS) -> list[Mode]:
    """The modes of the depth (H, W) inside a box, from near to far."""
    rows, columns = crop(box, depth.shape[1], depth.shape[0])
    seen = depth[rows, columns][::STRIDE, ::STRIDE].ravel()
    with np.errstate(invalid="ignore"):
        near = seen[seen < FARTHEST]
    if not near.size:
        return []
    counts = np.bincount((near / BIN).astype(np.intp), minlength=round(FARTHEST / BIN) + 2)
    mass = np.convolve(counts, np.ones(5), "same") / seen.size  # as wide as the band
    found = []
    for i in _peaks(mass, least):
        middle = (i + 0.5) * BIN
        inside = near[np.abs(near - middle) < HALF_BAND + 0.5 * BIN]
        found.append(Mode(float(np.median(inside)), float(inside.size / seen.size)))
    return found


def torso_depth(depth: Depth, box: Box, middle: float, least: float = LEAST_TORSO) -> float | None:
    """The depth of the chest and back inside a person's box, near `middle`, m; None where hidden.

    Legs swing and arms hang: the torso alone keeps its distance from the body's axis.
    """
    height = box.h * (TORSO[1] - TORSO[0])
    chest = Box(box.x + 0.25 * box.w, box.y + TORSO[0] * box.h, 0.5 * box.w, height)
    rows, columns = crop(chest, depth.shape[1], depth.shape[0])
    seen = depth[rows, columns][::STRIDE, ::STRIDE].ravel()
    with np.errstate(invalid="ignore"):
        near = seen[np.abs(seen - np.float32(middle)) < HALF_BAND]
    return float(np.median(near)) if near.size and near.size > least * seen.size else None


def _peaks(mass: Array, least: float) -> list[int]:
    """Bins that no bin of the same band outweighs."""
    taken: list[int] = []
    for i in np.argsort(-mass, kind="stable").tolist():
        if mass[i] < least:
            break
        if all(abs(i - other) >= 5 for other in taken):
            taken.append(i)
    return sorted(taken)


def person_mode(found: Sequence[Mode], expected: float, gate: float) -> Mode | None:
    """The mode nearest to where the person is expected, within the gate."""
    best = min(found, key=lambda mode: abs(mode.depth - expected), default=None)
    return best if best is not None and abs(best.depth - expected) <= gate else None


class Band:
    """What a window of the image shows: the person's depth, something before it, or nothing.

    All three are counted in any rectangle. Without a depth, or not gated by it, everything is the
    person.
    """

    def __init__(
        self, depth: Depth | None, middle: float, window: tuple[slice, slice], gated: bool = True
    ) -> None:
        rows, columns = window
        self.top, self.left = rows.start, columns.start
        shape = rows.stop - rows.start, columns.stop - columns.start
        if depth is None:
            self.mask = np.ones(shape, np.bool_)
            nearer = unknown = np.zeros(shape, np.bool_)
        else:
            seen = depth[rows, columns]
            with np.errstate(invalid="ignore"):
                self.mask = np.abs(seen - np.float32(middle)) < HALF_BAND
                nearer = seen < middle - BEFORE
            unknown = seen != seen
        if not gated:
            self.mask = np.ones(shape, np.bool_)
        planes = [plane.view(np.uint8) for plane in (self.mask, nearer, unknown)]
        self._sums = np.asarray(cv2.integral(cv2.merge(planes)), np.int32)

    def bounds(self) -> tuple[slice, slice]:
        """Rows and columns of the window that hold the mask, in the window."""
        x, y, w, h = cv2.boundingRect(self.mask.view(np.uint8))
        return slice(y, y + h), slice(x, x + w)

    def column(self, box: Box) -> float | None:
        """The middle column of the person inside a box, px; None where there is nobody."""
        height, width = self.mask.shape
        inside = Box(box.x - self.left, box.y - self.top, box.w, box.h)
        rows, columns = crop(inside, width, height)
        mass = np.cumsum(self.mask[rows, columns].sum(axis=0))
        if not mass.size or not mass[-1]:
            return None
        return float(self.left + columns.start + np.searchsorted(mass, 0.5 * mass[-1]) + 0.5)

    def top_row(self, box: Box, least: float) -> float | None:
        """The first row of the person, near the top of a box, that shows more than `least` px.

        None where that is the first row that was looked at.
        """
        height, width = self.mask.shape
        inside = Box(box.x - self.left, box.y - self.top - 0.1 * box.h, box.w, 0.3 * box.h)
        rows, columns = crop(inside, width, height)
        shows = self.mask[rows, columns].sum(axis=1) > least
        first = int(shows.argmax()) if shows.size else 0
        return float(self.top + rows.start + first) if first else None

    def brightness(self, image: Pixels, box: Box, side: int) -> Array:
        """Mean grey level (side * side,) of the person in each patch of a box; nan = too little."""
        x, y, w, h = box.x - self.left, box.y - self.top, box.w, box.h
        rows, columns = crop(Box(x, y, w, h), self.mask.shape[1], self.mask.shape[0])
        part = image[self.top :, self.left :][rows, columns][::STRIDE, ::STRIDE]
        down, across = np.nonzero(self.mask[rows, columns][::STRIDE, ::STRIDE])
        level = part[down, across]
        level = level if level.ndim == 1 else level.max(axis=1)
        patch = np.minimum((rows.start + STRIDE * down - y) / h * side, side - 1).astype(np.intp)
        patch *= side
        patch += np.minimum((columns.start + STRIDE * across - x) / w * side, side - 1).astype(int)
        count = np.bincount(patch, minlength=side * side)
        total = np.bincount(patch, weights=level, minlength=side * side)
        return np.where(count >= LEAST_PIXELS, total / np.maximum(count, 1), np.nan)

    def counts(self, columns: Array, rows: Array) -> Array:
        """(M, J * I, 4): pixels of the person, before them, of unknown depth, and in the image,
        in grids of patches with edges `columns` (M, I + 1) and `rows` (M, J + 1), px."""
        height, width = self._sums.shape[0] - 1, self._sums.shape[1] - 1
        x = np.clip(np.rint(columns - self.left).astype(np.intp), 0, width)
        y = np.clip(np.rint(rows - self.top).astype(np.intp), 0, height)
        corner = self._sums[y[:, :, None], x[:, None, :]]
        strip = corner[:, 1:] - corner[:, :-1]
        inside = strip[:, :, 1:] - strip[:, :, :-1]
        area = np.diff(y)[:, :, None] * np.diff(x)[:, None, :]
        counts: Array = np.concatenate([inside, area[..., None]], axis=3).astype(np.float32)
        return counts.reshape(len(counts), -1, 4)
