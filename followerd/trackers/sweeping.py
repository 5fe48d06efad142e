"""What a tracker of scans is shown: pure, so that a replay shows it the same."""

from collections import deque
from collections.abc import Callable
from math import cos, hypot, inf, pi, sin

import numpy as np
import numpy.typing as npt

from followerd.errors import UsageError
from followerd.geometry import Array, Pose2
from followerd.messages import Box, Clusters, Image, RobotPose, Scan, TrackState
from followerd.perception.clusters import ClusterSettings, find_clusters
from followerd.trackers.interfaces import Foreseeing, MapTracker, Tracker

HISTORY = 60  # scans kept so that a click on a picture seen a moment ago can be honoured
ASIDE = 0.3  # m, of the direction of a clicked point, that a leg of the person may be
STRIDE = 0.6  # m, farthest apart two legs of one standing person are
LEG_RADIUS = 0.06  # m, from a leg's visible side to its middle

Seen = tuple[Scan, Pose2 | None, RobotPose | None]


class Sweeping:
    """A tracker, the scans it was shown last, and the robot's pose where the tracker needs it."""

    def __init__(self, tracker: Tracker, ego_at: Callable[[float], Pose2 | None]) -> None:
        self._tracker = tracker
        self._ego_at = ego_at
        self._history: deque[Seen] = deque(maxlen=HISTORY)

    def take(self, scan: Scan, pose: RobotPose | None) -> TrackState | None:
        """Track one more scan; `pose` is the robot's at it."""
        seen = scan, self._ego_at(scan.stamp), pose
        self._history.append(seen)
        return self._step(*seen)

    def enrol(
        self, region: Box | tuple[float, float], image: Image | None
    ) -> tuple[Scan, TrackState]:
        """Enrol who stands at a point (m, `base`), or in a `region` (px) of an `image`.

        Gives the newest scan and its track. Raises UsageError when nobody does.
        """
        first = self._at(None if image is None else image.stamp)
        scan, ego, pose = self._history[first]
        point = _clicked(scan, region, image)
        if isinstance(self._tracker, MapTracker):
            self._tracker.locate(pose, ego)
        state = self._tracker.enrol(scan, point, ego)
        for later in list(self._history)[first + 1 :]:
            state = self._step(*later) or state
        return self._history[-1][0], state

    def courses(self) -> Array:
        """Where the person may go; see Foreseeing. Empty where the tracker does not tell."""
        if isinstance(self._tracker, Foreseeing):
            return self._tracker.courses()
        return np.empty((0, 0, 2))

    def _step(self, scan: Scan, ego: Pose2 | None, pose: RobotPose | None) -> TrackState | None:
        if isinstance(self._tracker, MapTracker):
            self._tracker.locate(pose, ego)
        return self._tracker.step(scan, ego)

    def _at(self, stamp: float | None) -> int:
        """The index of the scan nearest to `stamp` in time; None is now."""
        if not self._history:
            raise UsageError("no scan yet; wait for the laser")
        stamps = np.array([seen[0].stamp for seen in self._history])
        return len(stamps) - 1 if stamp is None else int(np.abs(stamps - stamp).argmin())


def person_between(
    scan: Scan, right: float, left: float, nearest: float = 0.0, farthest: float = inf
) -> tuple[float, float] | None:
    """Where (x, y in `base`, m) the nearest person between two bearings, rad, has their axis."""
    found = find_clusters(scan, scan.points(), ClusterSettings())
    fits = found.leg_like & (found.range > nearest) & (found.range < farthest)
    half = 0.5 * ((left - right) % (2.0 * pi))
    aside = np.abs((found.bearing - right - half + pi) % (2.0 * pi) - pi)
    fits &= aside < half
    return _nearest(found, fits)


def person_towards(scan: Scan, ray: Pose2) -> tuple[float, float] | None:
    """Where (x, y in `base`, m) the first person along a `ray` has their axis."""
    found = find_clusters(scan, scan.points(), ClusterSettings())
    off = found.centre - (ray.x, ray.y)
    along = np.array([cos(ray.theta), sin(ray.theta)])
    aside = np.abs(off @ (-along[1], along[0]))
    return _nearest(found, found.leg_like & (off @ along > 0.0) & (aside < ASIDE))


def _nearest(found: Clusters, fits: npt.NDArray[np.bool_]) -> tuple[float, float] | None:
    """The axis of the nearest person of those clusters that fit."""
    candidates = np.flatnonzero(fits)
    if not candidates.size:
        return None
    chosen = candidates[np.argmin(found.range[candidates])]
    gaps = np.hypot(*(found.centre[candidates] - found.centre[chosen]).T)
    x, y = found.centre[candidates[gaps < STRIDE]].mean(axis=0)
    longer = 1.0 + LEG_RADIUS / hypot(x, y)
    return float(longer * x), float(longer * y)


def _clicked(
    scan: Scan, region: Box | tuple[float, float], image: Image | None
) -> tuple[float, float]:
    """The point that is meant, m in `base`."""
    if not isinstance(region, Box) and image is None:
        return region
    if image is None:
        raise UsageError("a box is drawn in a picture; the camera has not given one yet")
    if isinstance(region, Box):
        left, right = image.camera.bearing(region.x), image.camera.bearing(region.x + region.w)
        point = person_between(scan, right, left)
    else:
        camera = image.camera
        point = person_towards(scan, Pose2(camera.x, camera.y, camera.bearing(region[0])))
    if point is None:
        raise UsageError("the laser sees no legs there; click on somebody whose legs are in view")
    return point
