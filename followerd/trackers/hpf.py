"""Zhuang's hybrid particle filter tracker (2008): follows one person by colour in a moving camera.

Profile `paper` is the published system, `default` the one that also works on real clothes.
"""

from math import exp
from typing import Literal

import numpy as np
from pydantic import Field

from followerd.errors import UsageError
from followerd.estimation.hybrid import HybridFilter
from followerd.estimation.image_plane import PlaneChange, by_odometry
from followerd.estimation.particles import Estimator
from followerd.geometry import Array, Pose2
from followerd.messages import Box, Image, Odometry, Place, Scan, TrackPhase, TrackState
from followerd.perception.ego_flow import EgoFlow
from followerd.perception.region import region_of
from followerd.settings import Settings
from followerd.trackers.hpf_default import DefaultProfile
from followerd.trackers.hpf_paper import PaperProfile
from followerd.trackers.sighting import (
    Ranger,
    Sighting,
    completed,
    ground_velocity,
)

LONGEST_GAP = 0.5  # s between frames; after a longer one the filter is predicted no further
VELOCITY_MEMORY = 0.4  # s


class HpfSettings(Settings):
    """One set for every camera: lengths in px are scaled by the image's or the person's width."""

    profile: Literal["default", "paper"] = "default"
    particles: int = Field(150, ge=10, le=100_000)
    estimator: Estimator = Field("max", description="position from the particles: max is the MAP")
    mixture: float = Field(
        0.0, ge=0.0, le=0.5, description="share of particles drawn on candidates, with odometry"
    )
    mixture_without_odometry: float = Field(0.1, ge=0.0, le=0.5)
    compensate_ego_motion: bool = Field(True, description="False only for the ablation")
    template: bool = Field(True, description="default profile: use the template cue")


class Hpf:
    """The tracker `hpf`."""

    Settings = HpfSettings

    needs = frozenset({"image"})
    sees = frozenset({"colour", "depth"})

    def __init__(self, settings: HpfSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self._rng = rng
        self.forget()

    def forget(self) -> None:
        """Drop the enrolled person."""
        self._hybrid: HybridFilter | None = None
        self._profile: DefaultProfile | PaperProfile | None = None
        self._last: tuple[float, Pose2 | None] | None = None  # stamp, odom_from_base
        self._flow = EgoFlow()
        self._seen = True
        self._ranger = Ranger()
        self._velocity: tuple[float, float] | None = None  # m/s, in `odom`

    def enrol(
        self, seen: Image | Scan, region: Box | tuple[float, float], ego: Pose2 | None
    ) -> TrackState:
        """Learn the person in `region`; see Tracker. Raises UsageError."""
        if not isinstance(seen, Image):
            raise UsageError("hpf follows a person in images, not in scans")
        image = seen
        if image.pixels.ndim != 3:
            raise UsageError("hpf tracks by colour; this camera is grey")
        self.forget()
        settings = self.settings
        box = region_of(image.pixels, region)
        if settings.profile == "default" and ego is not None:
            box = completed(image.camera, box)
        mix = settings.mixture if ego is not None else settings.mixture_without_odometry
        profile: DefaultProfile | PaperProfile
        if settings.profile == "paper":
            profile = PaperProfile(image, box, settings.estimator, mix)
        else:
            profile = DefaultProfile(
                image, box, settings.estimator, mix, settings.template, ego is not None
            )
        height, width = image.pixels.shape[:2]
        state = np.array([*box.centre, box.w, box.h])
        self._hybrid = HybridFilter(
            state, settings.particles, profile.noise, (width, height), self._rng
        )
        self._profile = profile
        self._last = image.stamp, ego
        if ego is None:
            self._flow.step(image.pixels, box)
        return self._state(image, ego, Sighting(TrackPhase.TENTATIVE, 1.0), 0.0)

    def step(
        self,
        measurement: Image | Scan | Odometry,
        ego: Pose2 | None,
        place: Place | None = None,
    ) -> TrackState | None:
        """The track after one more image; None before enrolment or for an image out of order.

        `place`, where another sensor knows it, says how large the person now looks, and roughly
        in which column.
        """
        if not isinstance(measurement, Image) or self._last is None:
            return None
        image = measurement
        hybrid, profile = self._hybrid, self._profile
        dt = image.stamp - self._last[0]
        if hybrid is None or profile is None or dt <= 0.0:
            return None
        change = self._plane_change(image, ego, hybrid)
        if change is not None and self.settings.compensate_ego_motion:
            hybrid.move_camera(change.homography, change.below, change.zoom if self._seen else 1.0)
        self._last = image.stamp, ego
        dt = min(dt, LONGEST_GAP)
        hybrid.predict(dt)
        if isinstance(profile, DefaultProfile):
            profile.expect(place, image.camera)
        sighting = profile.look(image, hybrid, dt)
        self._seen = sighting.phase in (TrackPhase.CONFIRMED, TrackPhase.TENTATIVE)
        return self._state(image, ego, sighting, dt)

    def _plane_change(
        self, image: Image, ego: Pose2 | None, hybrid: HybridFilter
    ) -> PlaneChange | None:
        before = self._last[1] if self._last else None
        if ego is not None and before is not None:
            return by_odometry(image.camera, before, ego, hybrid.box())
        if ego is not None:
            return None
        affine = self._flow.step(image.pixels, Box.around(*hybrid.box()))
        return None if affine is None else PlaneChange(affine)

    def _state(self, image: Image, ego: Pose2 | None, sighting: Sighting, dt: float) -> TrackState:
        hybrid = self._hybrid
        if hybrid is None or sighting.phase is TrackPhase.LOST:
            self._velocity = None
            return TrackState(
                image.stamp,
                TrackPhase.LOST,
                sighting.confidence,
                image.id,
                candidates=sighting.candidates,
            )
        camera = image.camera
        box = hybrid.box()
        ground = self._ranger.locate(camera, box)
        position = ego.apply_point(*ground.point) if ground and ego else None
        if position is not None and ego is not None:
            self._follow_velocity(image, ego, dt)
        moving = self._velocity if position is not None else None
        return TrackState(
            image.stamp,
            sighting.phase,
            sighting.confidence,
            image.id,
            box=_visible(box, *image.pixels.shape[1::-1]),
            bearing=camera.bearing(float(box[0]) - 0.5),
            range=ground.range if ground else None,
            range_sigma=ground.sigma if ground else None,
            position=position,
            velocity=moving,
            candidates=sighting.candidates,
            particles=hybrid.particles[:, :2].copy(),  # they move on
        )

    def _follow_velocity(self, image: Image, ego: Pose2, dt: float) -> None:
        """Smooth the person's velocity over the ground; the particles' own is rough."""
        hybrid = self._hybrid
        if hybrid is None:
            return
        mean = hybrid.weights @ hybrid.particles[:, 2:]
        in_base = ground_velocity(image.camera, hybrid.box(), mean)
        if in_base is None:
            return
        now = Pose2(theta=ego.theta).apply_point(*in_base)
        vx, vy = self._velocity or (0.0, 0.0)
        share = 1.0 - exp(-dt / VELOCITY_MEMORY)
        self._velocity = (
            vx + share * (min(max(now[0], -3.0), 3.0) - vx),
            vy + share * (min(max(now[1], -3.0), 3.0) - vy),
        )


def _visible(box: Array, width: int, height: int) -> Box:
    """The part of a box (4,) inside the image; at least a pixel at its border."""
    x, y, w, h = box.tolist()
    left = min(max(x - 0.5 * w, 0.0), width - 1.0)
    top = min(max(y - 0.5 * h, 0.0), height - 1.0)
    right, bottom = min(x + 0.5 * w, float(width)), min(y + 0.5 * h, float(height))
    return Box(left, top, max(right - left, 1.0), max(bottom - top, 1.0))
