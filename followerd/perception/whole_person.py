"""The whole person, of whom a part was shown: a click, the legs, a box cut off by the image."""

from followerd.messages import Box, Image
from followerd.perception.depth_band import Depth, modes, torso_depth
from followerd.perception.depth_people import outline
from followerd.perception.region import region_of
from followerd.perception.spot import row, scale

TALL = 1.7  # m, of a person who is not seen from head to foot
SEED = (0.3, 0.5)  # m, of the part of a person that is clicked at
CLICK = 9.0  # px around a click in which its depth is looked for
BROAD = 0.5  # m, of a person who was clicked at
USUAL_DEPTH = 2.5  # m, where there is none
EDGE = 3.0  # px from the image's border: a box that near is cut off


def whole(
    image: Image, depth: Depth | None, region: Box | tuple[float, float]
) -> tuple[Box, float]:
    """The person's box, inside the image or not, and their depth, m; the nearest mode is theirs.

    Raises UsageError when the region is outside the image.
    """
    camera = image.camera
    if depth is not None and not isinstance(region, Box):
        region = _around_click(image, depth, *region)
    box = region_of(image.pixels, region)
    if depth is not None and (found := modes(depth, box)):
        middle = found[0].depth
        box = outline(depth, box, middle, camera)  # legs alone may have been shown
        middle = torso_depth(depth, box, middle) or middle
    elif box.y > EDGE and box.y + box.h < image.pixels.shape[0] - EDGE:
        middle = TALL * scale(camera, box.centre[1], 1.0)[1] / box.h
    else:
        middle = USUAL_DEPTH
    return _completed(image, box, middle), middle


def _around_click(image: Image, depth: Depth, u: float, v: float) -> Box | tuple[float, float]:
    """The body that was clicked at; the click itself where it has no depth."""
    found = modes(depth, Box.around(u, v, CLICK, CLICK))
    if not found:
        return u, v
    metre = image.camera.fx / found[0].depth
    seed = region_of(image.pixels, Box.around(u, v, SEED[0] * metre, SEED[1] * metre))
    box = outline(depth, seed, found[0].depth, image.camera, downward=True)
    return Box.around(*box.centre, BROAD * metre, box.h)


def _completed(image: Image, box: Box, middle: float) -> Box:
    """With what the image's border cuts off, of a usual height at least."""
    lowest = image.pixels.shape[0] - EDGE
    top, bottom = box.y, box.y + box.h
    tall = max(box.h, TALL * scale(image.camera, box.centre[1], middle)[1])
    if top > EDGE and bottom > lowest:
        bottom = top + tall
    elif top <= EDGE and bottom <= lowest:
        top = bottom - tall
    elif top <= EDGE:
        bottom = max(bottom, row(image.camera, middle, 0.0))
        top = min(top, bottom - tall)
    return Box(box.x, top, box.w, bottom - top)
