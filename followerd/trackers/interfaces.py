"""What a tracker is to the pipeline."""

from typing import Protocol, runtime_checkable

from followerd.geometry import Array, Pose2
from followerd.maps.floor import FloorMap
from followerd.messages import Box, Image, Odometry, Place, RobotPose, Scan, TrackState


class Tracker(Protocol):
    """Follows one enrolled person through measurements; no clock, no I/O, no threads."""

    needs: frozenset[str]  # streams it must get, e.g. {"image"}
    sees: frozenset[str]  # kinds of images it can use: colour, depth (with colour), thermal

    def enrol(
        self, seen: Image | Scan, region: Box | tuple[float, float], ego: Pose2 | None
    ) -> TrackState:
        """Learn the person in `region` of what is `seen`.

        That is a box or a clicked point (px) of an image, or a point (m, `base`) of a scan. `ego`
        is `odom_from_base` at its stamp, None without odometry. Raises UsageError when the tracker
        does not learn from such a thing, or the region is not in it or shows nothing to learn.
        """

    def step(
        self,
        measurement: Image | Scan | Odometry,
        ego: Pose2 | None,
        place: Place | None = None,
    ) -> TrackState | None:
        """The track after one more measurement; None before enrolment or if it says nothing new.

        `place` is where another sensor sees the person just then; None = unknown.
        """

    def forget(self) -> None:
        """Drop the enrolled person."""


@runtime_checkable
class Foreseeing(Tracker, Protocol):
    """A tracker that can show where its person may go."""

    def courses(self) -> Array:
        """Ways (K, N, 2) from where they are, m in `odom`; empty while they are lost."""


@runtime_checkable
class MapTracker(Tracker, Protocol):
    """A tracker that thinks on a map; its config must have a localizer."""

    def enter(self, floor: FloorMap) -> None:
        """Learn the map, before anything else."""

    def locate(self, pose: RobotPose | None, ego: Pose2 | None) -> None:
        """Where the robot is at the scan that comes next; None = not known.

        `ego` is `odom_from_base` then.
        """
