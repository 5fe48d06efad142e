"""The outline of a head that nobody has drawn: from the depth image, or from a usual height."""

from collections.abc import Iterator
from math import cos, sin

import cv2
import numpy as np
import numpy.typing as npt

from followerd.messages import Box, Image

Mask = npt.NDArray[np.bool_]

TALL = 1.72  # m, usual height
LOW, HIGH = 1.30, 2.10  # m, between which a head's top is
BREAST = 0.90  # m, what is lower is not looked at
HEAD = 0.16, 0.21  # m, width and height
HEADS = 0.09, 0.30  # m, widths that one may seem to have
SHOULDERS = 0.25, 0.60  # m below the top
WIDER = 1.4  # times the head, shoulders are
BROADEST = 1.0  # m, of them
THICK = 0.35  # m, from a body's axis to its nearest and farthest
SPARE = 0.30  # m, a head may be beside the legs
NEAREST, FARTHEST, LAYER = 0.8, 4.0, 0.25  # m, where anybody is looked for, and in what steps
FINE = 320  # px of a row that are enough
CUT = 0.05  # m below `HIGH`, a wall ends
SPECK = 0.05  # m, what is smaller in a depth image is an error


def head_box(image: Image, x: float, y: float) -> Box:
    """The head of whoever stands at (x, y) of `base`, px."""
    camera = image.camera
    column, row, depth = camera.project(np.array([[x, y, TALL]]))[0].tolist()
    if image.depth is not None:
        ahead = (x - camera.x) * cos(camera.yaw) + (y - camera.y) * sin(camera.yaw)
        for found, _ in Upright(image).heads(ahead):
            if abs(found.centre[0] - column) < SPARE * camera.fx / depth:
                return found
    w, h = (size * camera.fy / depth for size in HEAD)
    return Box(column + 0.5 - 0.5 * w, row, w, h)


def nearest_head(image: Image) -> Box | None:
    """The head of whoever is nearest, if the depth image shows head and shoulders."""
    if image.depth is None:
        return None
    upright, layers = Upright(image), np.arange(NEAREST, FARTHEST, LAYER).tolist()
    for body in (body for ahead in layers for _, body in upright.heads(ahead)):
        # a layer that only reaches its breast may have taken that for a head
        for head, _ in upright.heads(body):
            return head
    return None


class Upright:
    """A depth image as distances over the floor and heights above it; every `step`th pixel."""

    def __init__(self, image: Image) -> None:
        assert image.depth is not None
        camera = self._camera = image.camera
        self._step = step = max(1, camera.width // FINE)
        self._z = image.depth[step // 2 :: step, step // 2 :: step]
        down = ((np.arange(camera.height) - camera.cy) / camera.fy).astype(np.float32)
        down = down[step // 2 :: step, None]
        level, tilt = np.float32(cos(camera.elevation)), np.float32(sin(camera.elevation))
        self._ahead = self._z * (level + tilt * down)
        self._heights = np.float32(camera.z) + self._z * (tilt - level * down)

    def heads(self, ahead: float) -> Iterator[tuple[Box, float]]:
        """Heads on shoulders about `ahead` m before the camera, that of the largest body first.

        Each with how far ahead its body is.
        """
        camera = self._camera
        depth = ahead * cos(camera.elevation) + (TALL - camera.z) * sin(camera.elevation)
        metre = camera.fx / depth / self._step  # px
        layer = (self._heights > BREAST) & (self._heights < HIGH)
        layer &= np.abs(self._ahead - np.float32(ahead)) < THICK
        _, labels, stats, _ = cv2.connectedComponentsWithStats(_solid(layer, metre), connectivity=4)
        areas = np.asarray(stats)[1:, cv2.CC_STAT_AREA]
        for label in (1 + np.argsort(-areas, kind="stable")).tolist():
            body: Mask = np.asarray(labels) == label
            top = _top(body, metre)
            if top is None:
                continue
            body &= layer
            middle = float(np.median(self._ahead[body]))
            body[top + round(HEAD[1] * metre) :] = False
            if body.any() and LOW < np.percentile(self._heights[body], 90) < HIGH - CUT:
                yield self._outline(top, body), middle

    def _outline(self, top: int, head: Mask) -> Box:
        """Round a head's pixels (H, W), whose first row is `top`."""
        columns, depth = np.nonzero(head)[1], float(np.median(self._z[head]))
        middle = self._step * (float(np.median(columns)) + 0.5)
        w, h = (size * self._camera.fy / depth for size in HEAD)
        return Box(middle - 0.5 * w, self._step * top, w, h)


def _solid(layer: Mask, metre: float) -> npt.NDArray[np.uint8]:
    """The mask (H, W) without holes and specks of `SPECK`; a metre is `metre` px."""
    speck = np.ones(2 * (max(2, round(SPECK * metre)),), np.uint8)
    closed = cv2.morphologyEx(layer.view(np.uint8), cv2.MORPH_CLOSE, speck)
    return np.asarray(cv2.morphologyEx(closed, cv2.MORPH_OPEN, speck), np.uint8)


def _top(body: Mask, metre: float) -> int | None:
    """The first row of a body (H, W), if that is a head's on shoulders."""
    widths = body.sum(axis=1) / metre
    top = int(np.argmax(widths > 0.0))
    below = [top + round(metre * down) for down in (0.0, HEAD[1], *SHOULDERS)]
    if below[2] >= len(widths):
        return None
    head, shoulders = np.median(widths[top : below[1]]), widths[below[2] : below[3]].max()
    is_head = HEADS[0] < head < HEADS[1] and WIDER * head < shoulders < BROADEST
    return top if is_head else None
