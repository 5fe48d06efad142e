"""Kwolek's head tracker (2004): an ellipse of colours with an outline, its size from the depth.

Profile `paper` is the published system, with what it leaves open as Birchfield (1998) has it;
`default` also works where the light is switched on, in grey and in thermal images.
"""

from math import hypot, inf

import numpy as np

from followerd.errors import UsageError
from followerd.estimation.head_cloud import HeadCloud
from followerd.geometry import Pose2
from followerd.messages import Box, Image, Odometry, Place, Scan, TrackPhase, TrackState
from followerd.perception.ellipse import SAME_DEPTH, Ellipse
from followerd.perception.head_depth import head_depth
from followerd.perception.region import region_of
from followerd.trackers.head_looks import HeadLooks, Look
from followerd.trackers.head_settings import HeadSettings

LONGEST_GAP = 0.5  # s between frames; after a longer one nothing is foreseen
DEPTH_KEPT = 0.5  # s that a depth is expected again after the camera had none, or a wall's
CONFIRM_AFTER = 0.2  # s of being sure
PAPER_ASPECT = 1.2  # height over width of an ellipse
ASPECTS = 0.9, 1.7  # of those drawn around heads
HEAD = 0.08  # m, half a head's width
HEADS = 0.05, 0.14  # m, that can be one
DEPTH_SHARE = 0.02  # of the range, its deviation from a depth image
SIZE_SHARE = 0.15  # same, from the size of the head


class HeadTracker:
    """The tracker `head`."""

    Settings = HeadSettings

    needs = frozenset({"image"})
    sees = frozenset({"colour", "depth", "thermal"})

    def __init__(self, settings: HeadSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self._rng = rng
        self.forget()

    def forget(self) -> None:
        """Drop the enrolled person."""
        self._looks: HeadLooks | None = None
        self._cloud = HeadCloud(self.settings.count, self.settings.profile == "default", self._rng)
        self._last: tuple[float, Pose2 | None] | None = None  # stamp, odom_from_base
        self._depth: float | None = None  # m along the axis
        self._depth_at = -inf  # s
        self._half_width = HEAD  # m
        self._sure = self._unsure = 0.0  # s

    def enrol(
        self, seen: Image | Scan, region: Box | tuple[float, float], ego: Pose2 | None
    ) -> TrackState:
        """Learn the head inside `region`; see Tracker. Raises UsageError."""
        if not isinstance(seen, Image):
            raise UsageError("head follows a head in images, not in scans")
        self.forget()
        head = Ellipse.inside(region_of(seen.pixels, region))
        aspect = PAPER_ASPECT
        if self.settings.profile == "default":
            aspect = min(max(head.aspect, ASPECTS[0]), ASPECTS[1])
        head = Ellipse(head.x, head.y, head.a, aspect)
        self._looks = HeadLooks(seen, head, self.settings)
        self._cloud.seed(head.x, head.y, head.a)
        self._last = seen.stamp, ego
        if self.settings.depth:
            self._depth = head_depth(seen, head, None)
        if self._depth is not None:
            self._depth_at = seen.stamp
            self._half_width = min(max(head.a * self._depth / seen.camera.fx, HEADS[0]), HEADS[1])
        return self._state(seen, ego, TrackPhase.TENTATIVE, 1.0)

    def step(
        self,
        measurement: Image | Scan | Odometry,
        ego: Pose2 | None,
        place: Place | None = None,
    ) -> TrackState | None:
        """The track after one more image; None before enrolment or for an image out of order.

        Where the camera gives no depth, `place` stands in for it.
        """
        looks = self._looks
        if not isinstance(measurement, Image) or looks is None or self._last is None:
            return None
        image, cloud = measurement, self._cloud
        dt = image.stamp - self._last[0]
        if dt <= 0.0:
            return None
        before, self._last = self._last[1], (image.stamp, ego)
        if ego is not None and before is not None and self.settings.compensate_ego_motion:
            cloud.move_camera(image.camera, before, ego, self._depth)
        dt = min(dt, LONGEST_GAP)
        cloud.predict(dt, looks.head.a, (image.pixels.shape[1], image.pixels.shape[0]))
        x, y = cloud.mean[:2].tolist()
        looks.move(x, y)
        seen = self._measured(image, looks.head, place)
        depth = self._believed(seen, image.stamp)
        size = None if depth is None else self._half_width * image.camera.fx / depth
        look = looks.look(image, cloud, size, depth, dt)
        if look.confidence >= 0.5:
            self._sure, self._unsure = self._sure + dt, 0.0
            steady = seen is None or self._depth is None or abs(seen - self._depth) < SAME_DEPTH
            if depth is None or depth == seen:
                self._depth, self._depth_at = depth, image.stamp
            if look.good and steady:
                looks.learn(dt)
        else:
            self._sure, self._unsure = 0.0, self._unsure + dt
            cloud.still()
            self._search(image, looks)
        return self._state(image, ego, self._phase(look), look.confidence)

    def _believed(self, seen: float | None, stamp: float) -> float | None:
        """The depth that is `seen`, or that of a moment ago if nobody walks from there to it."""
        if self._depth is None or stamp - self._depth_at > DEPTH_KEPT:
            return seen
        return seen if seen is not None and abs(seen - self._depth) < SAME_DEPTH else self._depth

    def _measured(self, image: Image, head: Ellipse, place: Place | None) -> float | None:
        """Depth of the head along the axis, m, by the depth image or another sensor."""
        if not self.settings.depth:
            return None
        found = head_depth(image, head, self._depth)
        if found is None and place is not None and not place.vague:
            x, y = place.distance * np.cos(place.bearing), place.distance * np.sin(place.bearing)
            at = image.camera.project(np.array([[x, y, image.camera.z]]))[0, 2]
            found = float(at) if at > HEADS[1] else None
        return found

    def _search(self, image: Image, looks: HeadLooks) -> None:
        """Look at one more part of the image for a head that is not where it should be."""
        found = looks.search(image) if self._unsure > 0.3 else None
        if found is not None:
            self._cloud.seed(found.x, found.y, found.a)
            self._unsure, self._depth = 0.0, None

    def _phase(self, look: Look) -> TrackPhase:
        if self._unsure > self.settings.lost_after_s:
            return TrackPhase.LOST
        if look.confidence < 0.5:
            return TrackPhase.OCCLUDED
        return TrackPhase.CONFIRMED if self._sure >= CONFIRM_AFTER else TrackPhase.TENTATIVE

    def _state(
        self, image: Image, ego: Pose2 | None, phase: TrackPhase, confidence: float
    ) -> TrackState:
        if self._looks is None or phase is TrackPhase.LOST:
            return TrackState(image.stamp, TrackPhase.LOST, min(confidence, 0.49), image.id)
        head, camera = self._looks.head, image.camera
        depth, share = self._depth, DEPTH_SHARE
        if depth is None or image.depth is None or self._depth_at < image.stamp:
            depth, share = self._half_width * camera.fx / head.a, SIZE_SHARE
        right, down = (head.x - 0.5 - camera.cx) / camera.fx, (head.y - 0.5 - camera.cy) / camera.fy
        way = np.array([right, down, 1.0]) @ camera.axes
        x, y = (depth * way[:2] + (camera.x, camera.y)).tolist()
        return TrackState(
            image.stamp,
            phase,
            confidence,
            image.id,
            box=head.box,
            bearing=camera.bearing(head.x - 0.5),
            range=hypot(x, y),
            range_sigma=share * hypot(x, y) + 0.01,
            position=None if ego is None else ego.apply_point(x, y),
            particles=self._cloud.particles[:, :2].copy(),  # the cloud moves on
        )
