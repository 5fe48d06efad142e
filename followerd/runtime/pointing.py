"""Whom a click in a picture means: the laser knows where they stand, and so how large they are."""

from collections import deque
from collections.abc import Callable

from followerd.errors import UsageError
from followerd.geometry import Pose2
from followerd.messages import Box, Image, Measurement, Scan
from followerd.perception.body_outline import body_box
from followerd.perception.head_outline import head_box
from followerd.trackers.sweeping import person_towards

HISTORY = 120  # scans kept so that a click on a picture seen a moment ago can be honoured
APART = 0.3  # s, of a picture and the scan that goes with it

Region = Box | tuple[float, float]


class Pointing:
    """Watches scans; `ego_at` tells how the robot moved between a scan and a picture."""

    def __init__(self, ego_at: Callable[[float], Pose2 | None], *, heads: bool = False) -> None:
        """`heads`: the tracker wants the head, not the body."""
        self._ego_at = ego_at
        self._heads = heads
        self._scans: deque[Scan] = deque(maxlen=HISTORY)

    def measured(self, measurement: Measurement) -> None:
        """Remember a scan."""
        if isinstance(measurement, Scan):
            self._scans.append(measurement)

    def meant(self, image: Image, region: Region) -> Region:
        """The outline (px) of the person at a clicked point; a box means itself.

        So does a point that the tracker makes more of: one with depth, or of a time without scans.
        Raises UsageError when the laser sees no legs there.
        """
        if isinstance(region, Box) or not _is_inside(image, region):
            return region
        scan = min(self._scans, key=lambda seen: abs(seen.stamp - image.stamp), default=None)
        if scan is None or abs(scan.stamp - image.stamp) > APART:
            return region
        if image.depth is not None and not self._heads:
            return region
        person = self._person(scan, image, region[0])
        return head_box(image, *person) if self._heads else body_box(image.camera, *person)

    def _person(self, scan: Scan, image: Image, column: float) -> tuple[float, float]:
        """Where they stood in `base` when the picture was taken, m."""
        then, now = self._ego_at(scan.stamp), self._ego_at(image.stamp)
        moved = Pose2() if then is None or now is None else ~now @ then  # image's from scan's
        ray = ~moved @ Pose2(image.camera.x, image.camera.y, image.camera.bearing(column))
        found = person_towards(scan, ray)
        if found is None:
            raise UsageError(
                "the laser sees no legs there; click on somebody whose legs are in view,"
                " or drag a box around them"
            )
        return moved.apply_point(*found)


def _is_inside(image: Image, point: tuple[float, float]) -> bool:
    height, width = image.pixels.shape[:2]
    return bool(0 <= point[0] < width and 0 <= point[1] < height)
