"""Oriented gradients of a window, pooled in cells: what a template compares.

Instead of a histogram of orientations its first Fourier terms are kept: the signed gradient, and
the second and fourth harmonic of the unsigned orientation. No bin edges, and a tenth of the work.
"""

import cv2
import numpy as np
import numpy.typing as npt

CELL = 3  # px of the window
PLANES = 8
EVEN = 3.0  # grey levels of gradient below which a cell counts as even

Channels = npt.NDArray[np.float32]  # (C, rows, columns)


def channels(grey: npt.NDArray[np.uint8]) -> Channels:
    """Cells (PLANES, H / CELL, W / CELL) of a window (H, W), free of its brightness."""
    height, width = grey.shape
    planes = np.empty((PLANES, height, width), np.float32)
    gx, gy, c2, s2, c4, s4, strength, level = planes
    level[:] = grey
    cv2.Sobel(level, cv2.CV_32F, 1, 0, dst=gx, ksize=1)
    cv2.Sobel(level, cv2.CV_32F, 0, 1, dst=gy, ksize=1)
    # not cv2.magnitude: its last bits depend on where in memory the planes happen to lie
    np.sqrt(gx * gx + gy * gy, out=strength)
    inverse = 1.0 / (strength + 1e-3)
    ux, uy = gx * inverse, gy * inverse
    np.subtract(gx * ux, gy * uy, out=c2)
    np.multiply(gx, 2.0 * uy, out=s2)
    ux, uy = c2 * inverse, s2 * inverse
    np.subtract(c2 * ux, s2 * uy, out=c4)
    np.multiply(c2, 2.0 * uy, out=s4)
    cells = pooled(planes)
    energy = cv2.blur(cells[6], (5, 5))
    cells[:7] /= energy + EVEN
    cells[6] -= 1.0
    mean, deviation = (float(v.ravel()[0]) for v in cv2.meanStdDev(cells[7]))
    cells[7] = (cells[7] - mean) * (0.5 / (deviation + 5.0))
    return cells


def pooled(planes: npt.NDArray[np.float32]) -> Channels:
    """Means of planes (C, H, W) in cells (C, H / CELL, W / CELL)."""
    count, height, width = planes.shape
    tall = planes.reshape(count * height, width)  # one call for all planes
    size = (width // CELL, count * height // CELL)
    cells = np.asarray(cv2.resize(tall, size, interpolation=cv2.INTER_AREA), np.float32)
    return cells.reshape(count, height // CELL, width // CELL)
