"""Jia's tracker (2015): a person by patches of colour and texture in a camera with depth.

The detector looks near where a Kalman filter in the robot's axes expects the person; profile
`paper` is the published system where it can work, `default` the one that is repaired.
"""

from dataclasses import replace
from math import atan2, cos, exp, hypot, sin
from typing import Literal

import numpy as np
from pydantic import Field

from followerd.errors import UsageError
from followerd.estimation.motion_ekf import (
    Estimate,
    Look,
    MotionEkf,
    MotionEkfSettings,
    sight_noise,
)
from followerd.geometry import Array, Pose2
from followerd.messages import Box, Image, Odometry, Place, Scan, TrackPhase, TrackState
from followerd.perception.patch_detector import DetectorSettings, Found, PatchDetector, Sight
from followerd.perception.spot import in_base, in_image
from followerd.settings import Settings

SIZE_ERROR = 0.08  # share of a distance that is told by the size alone
HALF_SEEN = 0.12  # m, deviation of the middle of who is hidden in part
FADES = 2.0  # s in which confidence fades while nothing is seen
DEVIATIONS = 3.0  # of the expected depth, within which it is looked for
LEAST_GATE = 0.3  # m


class PatchesSettings(Settings):
    """Detector, filter, and how long a person who is not seen is expected."""

    profile: Literal["default", "paper"] = "default"
    detector: DetectorSettings = DetectorSettings()
    motion: MotionEkfSettings = MotionEkfSettings()
    hidden_s: float = Field(3.0, gt=0, description="behind something, before the track is lost")
    missing_s: float = Field(1.0, gt=0, description="not behind anything, before it is lost")
    search_after_s: float = Field(0.5, ge=0, description="unseen: looked for among all bodies")
    search_hidden_s: float = Field(1.5, ge=0, description="the same, while something hides them")
    start_m: float = Field(0.4, gt=0, description="of where they were seen last, just after that")
    pace_mps: float = Field(0.9, ge=0, description="by which that grows")
    same_m: float = Field(0.2, gt=0, description="of who is found, to the next image; grows alike")


class Patches:
    """The tracker `patches`."""

    Settings = PatchesSettings

    needs = frozenset({"image"})
    sees = frozenset({"depth"})

    def __init__(self, settings: PatchesSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self._rng = rng
        self.forget()

    def forget(self) -> None:
        """Drop the enrolled person."""
        self._detector: PatchDetector | None = None
        self._motion: MotionEkf | None = None
        # where seen last (`base`), odom_from_base, stamp
        self._last: tuple[Array, Pose2 | None, float] = (np.zeros(3), None, 0.0)
        self._lost = False
        # (3,) m in `base`, who looked like the person, and when, s
        self._maybe: tuple[Array, float] | None = None

    def enrol(
        self, seen: Image | Scan, region: Box | tuple[float, float], ego: Pose2 | None
    ) -> TrackState:
        """Learn the person in `region`; see Tracker. Raises UsageError."""
        if not isinstance(seen, Image):
            raise UsageError("patches follows a person in images, not in scans")
        self.forget()
        paper = self.settings.profile == "paper"
        self._detector = PatchDetector(seen, region, self.settings.detector, paper)
        first = self._detector.first
        self._start(seen, ego, in_base(seen.camera, first))
        sight = Sight(Found.PERSON, 1.0, self._detector.box(first, seen), first)
        return self._state(seen, ego, TrackPhase.TENTATIVE, sight)

    def step(
        self,
        measurement: Image | Scan | Odometry,
        ego: Pose2 | None,
        place: Place | None = None,
    ) -> TrackState | None:
        """The track after one more image; None before enrolment or for an image out of order."""
        del place  # depth knows better
        motion = self._motion
        if not isinstance(measurement, Image) or motion is None:
            return None
        image = measurement
        dt = image.stamp - motion.look.stamp
        if dt <= 0.0:
            return None
        sight = Sight(Found.NOTHING)
        unseen = image.stamp - self._last[2]
        if not self._lost:
            sight = self._look(image, ego, dt)
        s = self.settings
        patience = s.search_hidden_s if sight.found is Found.HIDDEN else s.search_after_s
        if sight.found is not Found.PERSON and unseen > patience:
            sight = self._search(image, ego, unseen) or sight
        return self._state(image, ego, self._phase(image, sight), sight)

    @property
    def place(self) -> Array | None:
        """The middle (3,) of the person in `base` at the newest image, m; None = lost."""
        return None if self._lost or self._motion is None else self._motion.estimate.x[:3]

    def _start(self, image: Image, ego: Pose2 | None, place: Array) -> None:
        self._motion = MotionEkf(Look(image.stamp, ego, place), self.settings.motion)
        self._last = (place, ego, image.stamp)
        self._lost = False
        self._maybe = None

    def _look(self, image: Image, ego: Pose2 | None, dt: float) -> Sight:
        """Look where the filter expects the person, and tell it."""
        detector, motion = self._detector, self._motion
        assert detector is not None, "is set together with the filter"
        assert motion is not None, "is asked for before"
        expected = motion.foreseen(image.stamp, ego)
        spot = in_image(image.camera, expected.x)
        sight = Sight(Found.NOTHING)
        if spot is not None:
            forward = image.camera.axes[2]
            spread = float(forward @ expected.P[:3, :3] @ forward) ** 0.5
            sight = detector.look(image, spot, max(DEVIATIONS * spread, LEAST_GATE), dt, self._rng)
        if sight.spot is None:
            motion.step(Look(image.stamp, ego))
            return sight
        place = in_base(image.camera, sight.spot)
        noise = motion.noise(place) if sight.by_depth else self._by_size(place)
        if not sight.is_whole:
            noise += np.diag([0.0, HALF_SEEN**2, HALF_SEEN**2])
        if not motion.step(Look(image.stamp, ego, place, noise)):
            return Sight(Found.NOTHING)
        self._last = (place, ego, image.stamp)
        return sight

    def _by_size(self, place: Array) -> Array:
        """Covariance (3, 3) of a place whose distance the size has told."""
        away = hypot(place[0], place[1])
        return sight_noise(place, SIZE_ERROR * away, self.settings.motion.aside_sigma_m)

    def _search(self, image: Image, ego: Pose2 | None, unseen: float) -> Sight | None:
        """Look for the person among all bodies, near where they were seen last.

        Who looks like them in one image must do so in the next.
        """
        detector = self._detector
        assert detector is not None, "is set together with the filter"
        near, then, _ = self._last
        if then is not None and ego is not None:
            near = np.array([*(~ego @ then).apply_point(near[0], near[1]), near[2]])
        s = self.settings
        found = detector.find(image, near, s.start_m + s.pace_mps * unseen)
        before = self._maybe
        if found.spot is None:
            self._maybe = None
            return None
        here = in_base(image.camera, found.spot)
        self._maybe = here, image.stamp
        if before is None:
            return None
        there, then_seen = before
        walked = s.pace_mps * (image.stamp - then_seen)
        if float(np.hypot(*(here - there)[:2])) > s.same_m + walked:
            return None
        self._start(image, ego, here)
        return found

    def _phase(self, image: Image, sight: Sight) -> TrackPhase:
        if sight.found is Found.PERSON:
            return TrackPhase.CONFIRMED
        unseen = image.stamp - self._last[2]
        s = self.settings
        patience = s.hidden_s if sight.found is Found.HIDDEN else s.missing_s
        self._lost |= unseen > patience
        return TrackPhase.LOST if self._lost else TrackPhase.OCCLUDED

    def _state(
        self, image: Image, ego: Pose2 | None, phase: TrackPhase, sight: Sight
    ) -> TrackState:
        detector, motion = self._detector, self._motion
        if phase is TrackPhase.LOST or motion is None or detector is None:
            return TrackState(image.stamp, TrackPhase.LOST, 0.0, image.id)
        estimate = motion.estimate
        x, y = estimate.x[:2].tolist()
        box, spot = sight.box, in_image(image.camera, estimate.x)
        if box is None and spot is not None:
            box = detector.box(spot, image)
        away = max(hypot(x, y), 1e-3)
        along = np.array([x, y]) / away
        unseen = image.stamp - self._last[2]
        state = TrackState(
            image.stamp,
            phase,
            sight.confidence if sight.found is Found.PERSON else exp(-unseen / FADES),
            image.id,
            box=None if box is None else _visible(box, image),
            bearing=atan2(y, x),
            range=away,
            range_sigma=float(along @ estimate.P[:2, :2] @ along) ** 0.5,
            patches=_patches(sight),
        )
        return state if ego is None else _in_odom(state, estimate, ego)


def _in_odom(state: TrackState, estimate: Estimate, ego: Pose2) -> TrackState:
    """The state with position, velocity and their covariance in `odom`."""
    c, s = cos(ego.theta), sin(ego.theta)
    turn = np.kron(np.eye(2), np.array([[c, -s], [s, c]]))
    x, y, _, vx, vy = estimate.x[:5].tolist()
    plane = [0, 1, 3, 4]
    return replace(
        state,
        position=ego.apply_point(x, y),
        velocity=Pose2(theta=ego.theta).apply_point(vx, vy),
        covariance=turn @ estimate.P[np.ix_(plane, plane)] @ turn.T,
    )


def _patches(sight: Sight) -> Array | None:
    """The grid of patches in the image; see TrackState."""
    if sight.box is None or sight.likeness is None:
        return None
    box, side = sight.box, round(sight.likeness.size**0.5)
    w, h = box.w / side, box.h / side
    rows, columns = np.divmod(np.arange(sight.likeness.size), side)
    sizes = np.full((sight.likeness.size, 2), (w, h))
    corners = np.column_stack([box.x + w * columns, box.y + h * rows])
    return np.column_stack([corners, sizes, sight.likeness])


def _visible(box: Box, image: Image) -> Box | None:
    """The part of a box inside the image; None where nothing is."""
    height, width = image.pixels.shape[:2]
    left, top = max(box.x, 0.0), max(box.y, 0.0)
    right, bottom = min(box.x + box.w, float(width)), min(box.y + box.h, float(height))
    return Box(left, top, right - left, bottom - top) if right > left and bottom > top else None
