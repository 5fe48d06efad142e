"""What a localizer is to the pipeline: a peer input that says where `odom` lies in the map."""

from typing import Protocol

from followerd.geometry import Pose2
from followerd.messages import RobotPose, Scan


class Localizer(Protocol):
    """Finds the robot on a map; no clock, no I/O. It takes settings, a FloorMap and a Generator."""

    def start(self, at: Pose2 | None) -> None:
        """Begin at `at` (`map_from_base` of the next scan), or anywhere on the map (None)."""

    def step(
        self, scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        """The pose after one more scan, taken at `ego` (`odom_from_base`); None while unknown.

        Beams on the followed `person` (m, in `base`) are left out.
        """
