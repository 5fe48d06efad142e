"""`operator: auto`: enrols whoever stands in front of the robot, confirms and arms, once.

For demonstrations and benchmarks. It knows no more than the robot does: the person is the nearest
pair of legs in the laser inside the camera's view. A tracker of images gets a body's outline
projected into the image, one of scans the place.
"""

import structlog

from followerd import clock
from followerd.control.transitions import Action
from followerd.errors import UsageError
from followerd.geometry import Camera
from followerd.messages import Box, Image, Measurement, Scan
from followerd.perception.body_outline import body_box
from followerd.perception.head_outline import head_box, nearest_head
from followerd.runtime.daemon import Daemon
from followerd.trackers.sweeping import person_between

RETRY = 0.5  # s
FRESH = 0.3  # s, a scan shows where somebody is
NEAREST, FARTHEST = 0.8, 4.0  # m

log = structlog.get_logger()


class AutoOperator:
    """Presses the buttons a person would press, as soon as the daemon allows."""

    def __init__(
        self, daemon: Daemon, region: Box | None = None, *, arm: bool = True, heads: bool = False
    ) -> None:
        """`region` (px) is enrolled instead of whoever stands in front; without `arm` it stands.

        `heads`: the tracker wants the head, not the body.
        """
        self._daemon = daemon
        self._region = region
        self._arm = arm
        self._heads = heads
        self._scan: Scan | None = None
        daemon.measurement_watchers.append(self._look)

    async def run(self) -> None:
        """Enrol, confirm and, if it may, arm; then done."""
        while not (await self._enrol() and not self._daemon.act(Action.CONFIRM)):
            await clock.sleep(RETRY)
        while self._arm and self._daemon.act(Action.ARM):
            await clock.sleep(RETRY)

    def _look(self, measurement: Measurement) -> None:
        if isinstance(measurement, Scan):
            self._scan = measurement

    async def _enrol(self) -> bool:
        image, scan = self._daemon.vision.newest, self._scan
        if image is None or scan is None or clock.now() - scan.stamp > FRESH:
            return False
        region: Box | tuple[float, float] | None = self._region or self._found(image, scan)
        if region is None:
            log.info("nobody in front of the robot to enrol")
            return False
        frame_id = image.id if isinstance(region, Box) else None
        try:
            await self._daemon.enrol(region, frame_id)
        except UsageError as error:
            log.info("cannot enrol", error=str(error))
            return False
        return True

    def _found(self, image: Image, scan: Scan) -> Box | tuple[float, float] | None:
        """Who stands in front of the camera: their outline, or their place where scans are used."""
        legs = person_ahead(scan, image.camera)
        if self._daemon.scanning is not None:
            return legs
        if not self._heads:
            return None if legs is None else body_box(image.camera, *legs)
        return nearest_head(image) if legs is None else head_box(image, *legs)


def person_ahead(scan: Scan, camera: Camera) -> tuple[float, float] | None:
    """Where (x, y in `base`, m) the nearest standing person in the camera's view has its axis."""
    left, right = camera.bearing(0.0), camera.bearing(camera.width - 1.0)
    return person_between(scan, right, left, NEAREST, FARTHEST)
