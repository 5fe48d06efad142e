"""Motai, Jha and Kruse's tracker (2012): a direction foreseen by Kalman filter or optical flow.

For thermal images (recordings may be of any kind: they are taken as grey). Who of several warm
people is followed is decided by a vote of their looks (ofkf_finder), which the paper lacks.
"""

from math import exp, hypot, inf, radians
from typing import Literal

import numpy as np
from pydantic import Field

from followerd.estimation.direction import Look, Predictor
from followerd.estimation.pan_flow import Pair, pixels
from followerd.estimation.predictors import Kind, predictor
from followerd.geometry import Array, Pose2
from followerd.messages import Box, Image, Odometry, Place, Scan, TrackPhase, TrackState
from followerd.perception.flow import Flow, Halves, body_flow, halves
from followerd.perception.hotspot import Levels, grey_of
from followerd.perception.region import region_of
from followerd.settings import Settings
from followerd.trackers.ofkf_column import ColumnFinder
from followerd.trackers.ofkf_finder import Finder, Found
from followerd.trackers.ofkf_head import Head
from followerd.trackers.sighting import Ranger

SEEN, SAME = 0.42, 0.4  # likeness and identity from which the person is surely seen
LEARN = 0.46, 0.5  # same, from which their looks are learnt
NOTICE = 0.12, 0.3  # s, over which likeness and identity are averaged
CONFIRM_AFTER = 0.2  # s of being sure
SEARCH_AFTER = 0.3  # s of not being sure
RETURNED = 0.7, 0.55  # same, averaged, of somebody found elsewhere who is believed to be the person
JUMP = 0.65, 0.4  # of width and height off the expected place, beyond which it is somewhere else
PROVE = 0.4  # s that they are given to reach it
LONGEST_GAP = 0.5  # s between images; nothing is foreseen farther
FLOWN = 0.25, 0.15  # of width and height, deviation of a place carried by the flow
FORESEEN = 0.5, 0.2  # same, of one foreseen
WIDENING = 2.0  # 1/s, by which deviations grow while the person is not surely seen
COASTED = 0.4  # s, of motion that an unseen person is given at most
ASIDE = 0.25  # of the width, deviation of another sensor's column


class OfkfSettings(Settings):
    """Lengths in px are scaled by the person's size; angles need the camera's field of view."""

    profile: Literal["default", "paper"] = Field(
        "default", description="paper: the most salient column, whoever it is"
    )
    predictor: Kind | None = Field(
        None, description="foresees the direction; null is imm_pda, and ofkf in profile paper"
    )
    look_sigma_deg: float = Field(0.3, gt=0, le=10, description="noise of a seen direction")
    coast_s: float = Field(1.0, gt=0, le=5, description="a person unseen for longer is lost")

    @property
    def leading(self) -> Kind:
        """The predictor that is listened to."""
        return self.predictor or ("ofkf" if self.profile == "paper" else "imm_pda")


class Ofkf:
    """The tracker `ofkf`."""

    Settings = OfkfSettings

    needs = frozenset({"image"})
    # a person's grey levels are their temperature; in visible light it would follow a lamp's
    sees = frozenset({"thermal"})

    def __init__(self, settings: OfkfSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self._rng = rng
        self.forget()

    def forget(self) -> None:
        """Drop the enrolled person."""
        self._finder: Finder | ColumnFinder | None = None
        self._images: Halves | None = None  # the last one, evened
        self._stamp = self._looked = -inf  # s, of the last image; of the last with the person
        self._head = Head()
        self._centre: Array = np.zeros(2)  # px
        self._looks = [1.0, 1.0]  # likeness and identity, averaged
        self._sure = self._unsure = 0.0  # s
        self._proven: float | None = None  # s, that somebody found elsewhere is watched
        self._depth: float | None = None  # m
        self._heard: tuple[float, bool] | None = None  # px, another sensor's column; seen there
        self._metric_size: float | None = None  # px at 1 m
        self._ranger = Ranger()
        self._predictor: Predictor | None = None

    def foresee(self, dt: float) -> Pair:
        """Direction (pan, tilt), rad, of the enrolled person `dt` s after they were last seen."""
        assert self._predictor is not None
        return self._predictor.ahead(dt)

    def enrol(
        self, image: Image, region: Box | tuple[float, float], ego: Pose2 | None
    ) -> TrackState:
        """Learn the person in `region`; see Tracker. Raises UsageError."""
        self.forget()
        grey = grey_of(image.pixels)
        box = region_of(grey, region)
        self._images = images = halves(Levels.of(grey).even(grey))
        self._centre = np.array(box.centre)
        finder = Finder if self.settings.profile == "default" else ColumnFinder
        self._finder = finder(images[0], np.array([*box.centre, box.w, box.h]))
        self._head.move(image.camera, ego, images, None)
        self._stamp = image.stamp
        self._start(image)
        return self._state(image, ego, TrackPhase.TENTATIVE, 1.0)

    def step(
        self,
        measurement: Image | Scan | Odometry,
        ego: Pose2 | None,
        place: Place | None = None,
    ) -> TrackState | None:
        """The track after one more image; None before enrolment or for an image out of order."""
        finder, before = self._finder, self._images
        if not isinstance(measurement, Image) or finder is None or before is None:
            return None
        image = measurement
        dt = image.stamp - self._stamp
        if dt <= 0.0:
            return None
        grey = grey_of(image.pixels)
        self._images = images = halves(Levels.of(grey).even(grey))
        last = self._box()
        self._head.move(image.camera, ego, images, last)
        self._stamp = image.stamp
        flow = body_flow(before, images, last)
        if self._unsure > self.settings.coast_s and self._proven is None:
            self._seek(dt)
        else:
            self._look(image, flow, place, dt)
        return self._state(image, ego, self._phase(image), self._confidence())

    def _look(self, image: Image, flow: Flow | None, place: Place | None, dt: float) -> None:
        """Find the person where they should be."""
        finder, images = self._finder, self._images
        assert finder is not None
        assert images is not None
        centre, deviation = self._expected(image, flow, place)
        found = finder.find(images[0], centre, deviation)
        off = np.abs(found.centre - centre) / finder.extent
        if self._proven is None and (off > JUMP).any():
            self._doubt(found)
        self._notice(found, dt)
        if self._confidence() >= 0.5:
            self._see(image, found, flow, dt)
            return
        self._centre, self._sure, self._proven = centre, 0.0, None
        if self._unsure > SEARCH_AFTER:
            self._seek(dt)
        else:
            self._unsure += dt

    def _start(self, image: Image) -> None:
        """Predictors begin anew where the person is seen now."""
        sigma = radians(self.settings.look_sigma_deg)
        self._predictor = predictor(self.settings.leading, sigma, self._rng)
        self._take(image, None)

    def _take(self, image: Image, flow: Pair | None, ahead: float = 0.0) -> None:
        camera, head = image.camera, self._head
        x, y = (self._centre - (camera.cx + 0.5, camera.cy + 0.5)).tolist()
        look = Look(
            image.stamp, x, y, head.pan, head.tilt, camera.fx, flow, ahead, self._depth
        )  # fmt: skip
        assert self._predictor is not None
        self._predictor.step(look)
        self._looked = image.stamp

    def _expected(
        self, image: Image, flow: Flow | None, place: Place | None
    ) -> tuple[Array, Array]:
        """Where the person should be in this image, and the deviation of that, px (2,) each."""
        camera, head, finder = image.camera, self._head, self._finder
        assert finder is not None
        # an unseen person is less and less likely to go on as they did
        gap = COASTED * (1.0 - exp(-(self._stamp - self._looked) / COASTED))
        direction = self.foresee(gap)
        x, y = pixels(direction, head.pan, head.tilt, camera.fx)
        foreseen = np.array([x + camera.cx + 0.5, y + camera.cy + 0.5])
        share = FORESEEN
        if flow is not None and (self._unsure == 0.0 or self._proven is not None):
            foreseen = self._centre + (flow.u, flow.v)
            share = FLOWN
        deviation = np.array(share) * finder.extent * (1.0 + WIDENING * self._unsure)
        self._depth = self._heard = None
        if place is not None and not place.vague:
            self._heed(image, place, foreseen, deviation)
        return foreseen, deviation

    def _heed(self, image: Image, place: Place, foreseen: Array, deviation: Array) -> None:
        """Another sensor's word on column and size."""
        finder = self._finder
        assert finder is not None
        x, y = place.distance * np.cos(place.bearing), place.distance * np.sin(place.bearing)
        column, _, depth = image.camera.project(np.array([[x, y, 0.0]]))[0].tolist()
        if not depth > 0.0:
            return
        self._depth = depth
        self._heard = column + 0.5, place.seen
        foreseen[0] = column + 0.5
        aside = place.sigma * image.camera.fx / depth
        deviation[0] = hypot(ASIDE * finder.extent[0], aside)
        if self._metric_size is not None:
            finder.resize(self._metric_size / depth)
        elif place.seen and self._unsure == 0.0:
            self._metric_size = finder.size * depth

    def _notice(self, found: Found, dt: float) -> None:
        for i, now in enumerate((found.likeness, found.identity)):
            self._looks[i] += (1.0 - exp(-dt / NOTICE[i])) * (now - self._looks[i])

    def _confidence(self) -> float:
        """0..1; from 0.5 on both likeness and identity suffice."""
        return min(1.0, 0.5 * self._looks[0] / SEEN, 0.5 * self._looks[1] / SAME)

    def _see(self, image: Image, found: Found, flow: Flow | None, dt: float) -> None:
        finder = self._finder
        assert finder is not None
        self._centre = found.centre
        if self._proven is not None:
            self._prove(image, dt)
            return
        self._sure, self._unsure = self._sure + dt, 0.0
        if dt > LONGEST_GAP:
            self._start(image)
        else:
            speed = None if flow is None else (flow.u / dt, flow.v / dt)
            self._take(image, speed, self._head.advance / dt)
        known = found.likeness >= LEARN[0] and min(found.identity, self._looks[1]) >= LEARN[1]
        if known and self._is_backed():
            finder.learn(dt)

    def _is_backed(self) -> bool:
        """Whether the other sensor, if any, sees the person there too."""
        if self._heard is None:
            return True
        assert self._finder is not None
        column, seen = self._heard
        return seen and abs(column - float(self._centre[0])) < ASIDE * self._finder.extent[0]

    def _doubt(self, found: Found) -> None:
        """Somebody found elsewhere is to prove that they are the enrolled person."""
        self._looks = [found.likeness, found.identity]
        self._sure, self._proven = 0.0, 0.0

    def _prove(self, image: Image, dt: float) -> None:
        """Somebody found elsewhere must look like the enrolled person for longer than an image."""
        assert self._proven is not None
        self._proven += dt
        self._unsure += dt
        if self._looks[0] >= RETURNED[0] and self._looks[1] >= RETURNED[1]:
            self._proven, self._unsure = None, 0.0
            self._start(image)
        elif self._proven > PROVE:
            self._proven, self._looks = None, [0.0, 0.0]

    def _seek(self, dt: float) -> None:
        """Look for the person in one more place of the whole image."""
        finder, images = self._finder, self._images
        assert finder is not None
        assert images is not None
        self._unsure += dt
        found = finder.search(images[0])
        if found is not None:
            self._centre = found.centre
            self._doubt(found)

    def _phase(self, image: Image) -> TrackPhase:
        height, width = image.pixels.shape[:2]
        x, y = self._centre.tolist()
        if self._unsure > self.settings.coast_s or not (0 < x < width and 0 < y < height):
            return TrackPhase.LOST
        if self._confidence() < 0.5 or self._proven is not None:
            return TrackPhase.OCCLUDED
        return TrackPhase.CONFIRMED if self._sure >= CONFIRM_AFTER else TrackPhase.TENTATIVE

    def _box(self) -> Box:
        assert self._finder is not None
        return Box.around(*self._centre.tolist(), *self._finder.extent.tolist())

    def _state(
        self, image: Image, ego: Pose2 | None, phase: TrackPhase, confidence: float
    ) -> TrackState:
        if phase is TrackPhase.LOST:
            return TrackState(image.stamp, phase, confidence, image.id)
        camera, box = image.camera, self._box()
        ground = self._ranger.locate(camera, np.array([*box.centre, box.w, box.h]))
        return TrackState(
            image.stamp,
            phase,
            confidence,
            image.id,
            box=box,
            bearing=camera.bearing(box.centre[0] - 0.5),
            range=ground.range if ground else None,
            range_sigma=ground.sigma if ground else None,
            position=ego.apply_point(*ground.point) if ground and ego else None,
        )
