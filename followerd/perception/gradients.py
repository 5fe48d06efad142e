"""Oriented gradients of a window, pooled in cells: what a template compares.

Instead of a histogram of orientations its first Fourier terms are kept: the signed gradient, and
the second and fourth harmonic of the unsigned orientation. No bin edges, and a tenth of the work.
"""

import cv2
import numpy as np
import numpy.typing as npt

CELL = 3  # px of the window
PLANES = 9
EVEN = 3.0  # grey levels of gradient below which a cell counts as even

Channels = npt.NDArray[np.float32]  # (C, rows, columns)


def channels(grey: npt.NDArray[np.uint8], colour: npt.NDArray[np.float32]) -> Channels:
    """Cells (PLANES, H / CELL, W / CELL) of a window (H, W), free of its brightness.

    The last plane is half of `colour` (H, W), any score of the window's pixels.
    """
    height, width = grey.shape
    planes = np.empty((PLANES, height, width), np.float32)
    gx, gy, c2, s2, c4, s4, strength, level, _ = planes
    level[:] = grey
    np.multiply(colour, np.float32(0.5), out=planes[8])
    flat = level.ravel()  # one long row is faster; what crosses its ends is overwritten
    np.subtract(flat[2:], flat[:-2], out=gx.ravel()[1:-1])
    gx[:, 0] = gx[:, -1] = gy[0] = gy[-1] = 0.0
    np.subtract(level[2:], level[:-2], out=gy[1:-1])
    # not cv2.magnitude: its last bits depend on where in memory the planes happen to lie
    xx, yy = gx * gx, gy * gy
    np.sqrt(np.add(xx, yy, out=strength), out=strength)
    inverse = np.reciprocal(strength + np.float32(1e-3))
    xx -= yy
    np.multiply(xx, inverse, out=c2)
    twice = np.float32(2.0) * inverse
    np.multiply(np.multiply(gx, gy, out=s2), twice, out=s2)
    np.multiply(c2, c2, out=xx)
    xx -= np.multiply(s2, s2, out=yy)
    np.multiply(xx, inverse, out=c4)
    np.multiply(np.multiply(c2, s2, out=s4), twice, out=s4)
    cells = pooled(planes)
    energy = cv2.blur(cells[6], (5, 5))
    energy += EVEN
    cells[:7] /= energy
    cells[6] -= 1.0
    mean, deviation = (float(v.ravel()[0]) for v in cv2.meanStdDev(cells[7]))
    cells[7] -= mean
    cells[7] *= 0.5 / (deviation + 5.0)
    return cells


def pooled(planes: npt.NDArray[np.float32]) -> Channels:
    """Means of planes (C, H, W) in cells (C, H / CELL, W / CELL)."""
    count, height, width = planes.shape
    flat = planes.reshape(count, height // CELL, CELL, width)
    low = flat[:, :, 0] + flat[:, :, 1]  # the rows first: they lie together in memory
    low += flat[:, :, 2]
    cells = low[:, :, ::CELL] + low[:, :, 1::CELL]
    cells += low[:, :, 2::CELL]
    cells *= np.float32(1.0 / CELL**2)
    return cells
