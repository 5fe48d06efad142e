"""The outline of a head that nobody has drawn: from the depth image, or from a usual height."""

import numpy as np
import numpy.typing as npt

from followerd.messages import Box, Image

TALL, LOW, HIGH = 1.72, 1.30, 2.10  # m: usual height; between these a head's top is looked for
HEAD = 0.16, 0.21  # m, width and height
THICK = 0.35  # m, from a body's axis to its nearest and farthest
SPARE = 0.30  # m, half width of the strip in which a head is looked for
NEAREST, FARTHEST = 0.7, 4.0  # m
LEAST = 12  # points that make a head


def head_box(image: Image, x: float, y: float) -> Box:
    """The head of whoever stands at (x, y) of `base`, px."""
    camera = image.camera
    column, row, depth = camera.project(np.array([[x, y, TALL]]))[0].tolist()
    if image.depth is not None:
        near = np.abs(image.depth - np.float32(depth)) < THICK
        reach = SPARE * camera.fx / depth
        columns = np.arange(camera.width)
        near &= np.abs(columns - column) < reach
        found = _top_of(image, near)
        if found is not None:
            return found
    w, h = (size * camera.fy / depth for size in HEAD)
    return Box(column + 0.5 - 0.5 * w, row, w, h)


def nearest_head(image: Image) -> Box | None:
    """The head of whoever is nearest, if the depth image shows anything as high."""
    if image.depth is None:
        return None
    heights = _heights(image)
    high = (heights > LOW) & (heights < HIGH) & (image.depth > NEAREST) & (image.depth < FARTHEST)
    if int(high.sum()) < LEAST:
        return None
    front = float(np.percentile(image.depth[high], 2))
    return _top_of(image, high & (image.depth < front + THICK))


def _top_of(image: Image, body: npt.NDArray[np.bool_]) -> Box | None:
    """The head at the upper end of a body's pixels (H, W)."""
    assert image.depth is not None
    heights = _heights(image)
    body = body & (heights > LOW) & (heights < HIGH)
    if int(body.sum()) < LEAST:
        return None
    rows, columns = np.nonzero(body)
    depth = float(np.median(image.depth[rows, columns]))
    top = int(np.percentile(rows, 1))
    w, h = (size * image.camera.fy / depth for size in HEAD)
    middle = float(np.median(columns[(rows >= top) & (rows < top + h)])) + 0.5
    return Box(middle - 0.5 * w, top, w, h)


def _heights(image: Image) -> npt.NDArray[np.float32]:
    """Height (H, W) above the floor of what each pixel shows, m; nan where nothing."""
    assert image.depth is not None
    camera = image.camera
    down = ((np.arange(camera.height) - camera.cy) / camera.fy)[:, None]
    right = (np.arange(camera.width) - camera.cx) / camera.fx
    up = right * camera.axes[0, 2] + down * camera.axes[1, 2] + camera.axes[2, 2]
    heights = camera.z + image.depth * up.astype(np.float32)
    return np.asarray(heights, np.float32)
