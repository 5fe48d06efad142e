"""The `default` profile: soft colour and a template weigh the particles, and say who is there."""

from math import cos, exp, hypot, sin, sqrt
from typing import NamedTuple

import numpy as np

from followerd.estimation.hybrid import HybridFilter, Noise
from followerd.estimation.particles import Estimator
from followerd.geometry import Array, Camera
from followerd.messages import Box, Image, Place, TrackPhase
from followerd.perception.appearance import Appearance, View
from followerd.trackers.sighting import Sighting

BODY_PX = 49.0  # the noise below is for a person of this size: square root of the area
NOISE = Noise((3e4, 1e4), (400.0, 800.0), (3.0, 3.0), (2.5, 4.0))
COLOUR_TRUST, ANSWER_TRUST = 8, 12  # log weight of a particle with a full score

SEEN, SAME = 0.42, 0.4  # likeness and identity from which the person is surely seen
LEARN = 0.46, 0.5  # same, from which their looks are learnt
FOUND = 0.55, 0.5  # same, from which somebody found elsewhere is the enrolled person
NOTICE = 0.12, 0.3  # s, over which likeness and identity are averaged
CONFIRM_AFTER = 0.2  # s of being sure
SEARCH_AFTER, LOST_AFTER = 0.15, 0.6  # s of not being sure
ASIDE = 0.25  # of the width, deviation of the other sensor's column
ABOVE = 0.12  # of the height, deviation of its row
EXPECTED_SHARE = 0.15  # of the particles, drawn anew where the other sensor sees the person
FAR_OFF = 40.0  # squared deviations beyond which it is doubted rather than believed
LEARN_ASIDE, LEARN_ABOVE = 0.25, 0.15  # of width and height: farther off nothing is learnt
BACKED = 0.65  # share of the usual likeness that suffices where the other sensor agrees
LOST_BACKED_AFTER = 2.0  # s of not being sure, while it goes on seeing the person
TURNING = 0.6  # colour score of a person who turns and whose shape is not known yet
LOST_TURNING_AFTER = 3.0  # s of not being sure, while it lasts
SAME_PERSON = 1.3  # ratio of sizes beyond which a distance is somebody else's
USUAL = 1.5  # s, over which the size is averaged
SIZES = 1.0, 1.4, 0.7  # of that, at which a lost person is looked for
LEAST_SIZE, LARGEST_SIZE = 0.12, 5.0  # of the size when enrolled
OUTSIDE = 0.2  # of the height, that a box's centre may lie above or below the image


class Expected(NamedTuple):
    """The ground point where another sensor sees the person, in the image."""

    column: float  # px
    row: float  # px
    distance: float  # m
    aside: float  # px, deviation of the column
    above: float  # px, deviation of the row
    seen: bool  # False: foreseen only


class DefaultProfile:
    """Occlusion, loss and return are decided by the absolute likeness to the enrolled person."""

    def __init__(
        self,
        image: Image,
        box: Box,
        estimator: Estimator,
        mix: float,
        template: bool,
        on_ground: bool,
    ) -> None:
        """Learn the person in `box`; `mix` is the share of particles drawn on candidates.

        `on_ground`: the robot's odometry is known, so its motion zooms the person. That drifts
        unless the person's outline, their foot above all, is measured too. Without odometry
        nothing zooms them, and the template alone is the steadier measure.
        """
        self._estimator = estimator
        self._mix = mix
        self._appearance = Appearance(image.pixels, np.array([*box.centre, box.w, box.h]), template)
        self._template = template
        self._outline = on_ground or not template
        self._shape = np.sqrt([box.w / box.h, box.h / box.w])
        self.noise = NOISE.scaled(sqrt(box.w * box.h) / BODY_PX)
        self._enrolled = sqrt(box.w * box.h)  # px
        self._metric_size: float | None = None  # px at 1 m
        self._looks = [1.0, 1.0]  # likeness and identity, averaged
        self._colour = 1.0  # score, averaged
        self._sure = self._unsure = 0.0  # s
        self._backed = False  # another sensor sees the person at the same place
        self._turn = 0
        self._unlearnt = np.zeros(2)  # s since the template, the colour were learnt
        self._suspects: list[Array] = []  # boxes not yet looked at
        self._attempt = 0
        self._usual = sqrt(box.w * box.h)  # px, size averaged while sure
        self._expected: Expected | None = None
        self._foot: float | None = None  # of the height: box's lower edge under the ground point

    def expect(self, place: Place | None, camera: Camera) -> None:
        """Another sensor's word on where the person stands in the next image."""
        self._expected = None
        if place is not None and place.refuted:
            self._let_go()
        if place is not None:
            x, y = place.distance * cos(place.bearing), place.distance * sin(place.bearing)
            x, y, z = x - camera.x, y - camera.y, -camera.z
            right, down, depth = (a * x + b * y + c * z for a, b, c in camera.axes.tolist())
            if depth > 0.0:
                column = camera.cx + camera.fx * right / depth
                row = camera.cy + camera.fy * down / depth
                aside = place.sigma * camera.fx / depth
                above = place.sigma / place.distance * max(0.0, row - camera.horizon)
                self._expected = Expected(
                    column + 0.5, row + 0.5, place.distance, aside, above, place.seen
                )

    def _let_go(self) -> None:
        """Whoever is followed is not the person: look for them as for somebody lost."""
        self._looks = [0.0, 0.0]
        self._unsure = max(self._unsure, SEARCH_AFTER)
        self._appearance.recollect()

    def look(self, image: Image, hybrid: HybridFilter, dt: float) -> Sighting:
        """One image; `hybrid` was predicted to it `dt` seconds on."""
        box = hybrid.box()
        box[:2] = hybrid.weights @ hybrid.particles[:, :2]
        hybrid.noise = NOISE.scaled(sqrt(box[2] * box[3]) / BODY_PX)
        if not LEAST_SIZE < sqrt(box[2] * box[3]) / self._enrolled < LARGEST_SIZE:
            self._looks = [0.0, 0.0]  # the size has run away: nobody is there
            box[2:] = self._enrolled * self._shape
            hybrid.seed(box, np.zeros(2))
        view = self._appearance.view(image.pixels, box)
        peaks = view.window.to_image(self._appearance.peaks(view, 5))
        if self._mix:
            hybrid.propose(peaks, self._mix)
        if self._expected is not None:
            hybrid.scatter(np.array([self._middle(self._expected, hybrid)]), EXPECTED_SHARE)
        self._weigh(hybrid, view)
        place = view.window.to_window(hybrid.state[None, :2])[0]
        looks = self._compare(view, place)
        colour = float(self._appearance.colour(view, place[None])[0])
        self._colour += (1.0 - exp(-dt / NOTICE[1])) * (colour - self._colour)
        for i, notice in enumerate(NOTICE):
            self._looks[i] += (1.0 - exp(-dt / notice)) * (looks[i] - self._looks[i])
        self._backed = self._expected is not None and self._is_expected(hybrid)
        if self._confidence() >= 0.5:
            self._sure, self._unsure = self._sure + dt, 0.0
            self._stand(hybrid)
            size = sqrt(hybrid.size[0] * hybrid.size[1])
            self._usual *= (size / self._usual) ** (1.0 - exp(-dt / USUAL))
            if _reach(looks, LEARN) and self._looks[1] >= LEARN[1] and self._is_expected(hybrid):
                self._learn(hybrid, view, place, dt)
        else:
            self._sure, self._unsure = 0.0, self._unsure + dt
            hybrid.coast(dt)
            if self._unsure > SEARCH_AFTER:
                self._search(image, hybrid)
        w, h = hybrid.size[:2].tolist()
        candidates = tuple(Box.around(x, y, w, h) for x, y in peaks.tolist())
        return Sighting(self._phase(hybrid, image), self._confidence(), candidates)

    def _compare(self, view: View, place: Array) -> tuple[float, float]:
        """Likeness and identity of whoever stands at a window point (2,)."""
        return self._appearance.likeness(view, place), self._appearance.identity(view, place)

    def _confidence(self) -> float:
        """0..1; from 0.5 on both likeness and identity suffice."""
        needed = BACKED if self._backed else 1.0
        return min(1.0, 0.5 * self._looks[0] / SEEN / needed, 0.5 * self._looks[1] / SAME / needed)

    def _weigh(self, hybrid: HybridFilter, view: View) -> None:
        """The likelihood of every particle, in place of eq. 14."""
        at = view.window.to_window(hybrid.particles[:, :2])
        logs = np.minimum(np.maximum(self._appearance.colour(view, at), -1.0), 1.5)
        logs *= COLOUR_TRUST
        answers = self._appearance.answer(view, at)
        if answers is not None:
            logs += ANSWER_TRUST * answers
        if self._expected is not None:
            column, row = self._middle(self._expected, hybrid)
            aside = hypot(ASIDE * hybrid.size[0], self._expected.aside)
            above = hypot(ABOVE * hybrid.size[1], self._expected.above)
            off = (hybrid.particles[:, :2] - (column, row)) / (aside, above)
            logs -= 0.5 * np.minimum((off * off).sum(axis=1), FAR_OFF)
        hybrid.update_soft(logs, self._estimator)

    def _learn(self, hybrid: HybridFilter, view: View, place: Array, dt: float) -> None:
        """The size every other frame, template and colour in between, so that no frame is slow."""
        self._unlearnt += dt
        self._turn = (self._turn + 1) % 4
        if self._turn == 1:
            self._appearance.learn_template(view, place, self._unlearnt[0])
            self._unlearnt[0] = 0.0
        elif self._turn == 3:
            self._appearance.learn_colour(view, place, self._unlearnt[1])
            self._unlearnt[1] = 0.0
        else:
            self._measure(hybrid, self._appearance.growth(view, place))
            if self._outline:
                self._measure(hybrid, self._appearance.outline_growth(view, place))

    def _is_expected(self, hybrid: HybridFilter) -> bool:
        """Whether the person stands where the other sensor, if any, sees them."""
        if self._expected is None:
            return True
        if not self._expected.seen:
            return False
        column, row = self._middle(self._expected, hybrid)
        aside, above = abs(hybrid.state[0] - column), abs(hybrid.state[1] - row)
        return bool(aside < LEARN_ASIDE * hybrid.size[0] and above < LEARN_ABOVE * hybrid.size[1])

    def _middle(self, expected: Expected, hybrid: HybridFilter) -> tuple[float, float]:
        """Where the box's centre should be; how far it reaches below the ground point is learnt."""
        if self._foot is None:
            return expected.column, float(hybrid.state[1])
        return expected.column, expected.row + (self._foot - 0.5) * float(hybrid.size[1])

    def _stand(self, hybrid: HybridFilter) -> None:
        """Size is inverse to distance; the first sure sight says how large the person is."""
        if self._expected is None or not (self._expected.seen or self._metric_size):
            return
        if self._foot is None:
            foot = float(hybrid.state[1] + 0.5 * hybrid.size[1])
            self._foot = (foot - self._expected.row) / float(hybrid.size[1])
        distance = self._expected.distance
        size = sqrt(hybrid.size[0] * hybrid.size[1]) * distance
        if self._metric_size is None:
            self._metric_size = size
        elif 1.0 / SAME_PERSON < size / self._metric_size < SAME_PERSON:
            hybrid.measure_size(self._metric_size / distance * self._shape)

    def _measure(self, hybrid: HybridFilter, grown: float | None) -> None:
        """The size half follows the measured growth; the shape stays as enrolled."""
        if grown is not None:
            hybrid.measure_size(sqrt(hybrid.size[0] * hybrid.size[1]) * exp(grown) * self._shape)

    def _search(self, image: Image, hybrid: HybridFilter) -> None:
        """Look at one more suspicious place a frame; move there if it is the enrolled person."""
        if not self._suspects:
            self._attempt = (self._attempt + 1) % len(SIZES)
            size = SIZES[self._attempt] * self._usual * self._shape
            places = self._appearance.places(image.pixels, size, 4)
            self._suspects = [np.concatenate([place, size]) for place in places]
        if not self._suspects:
            return
        box = self._suspects.pop(0)
        view = self._appearance.view(image.pixels, box)
        for peak in self._appearance.peaks(view, 1):
            looks = self._compare(view, peak)
            if _reach(looks, FOUND):
                box[:2] = view.window.to_image(peak[None])[0]
                hybrid.seed(box, np.zeros(2))
                self._appearance.recollect()
                self._looks = list(looks)
                self._unsure = 0.0
                self._suspects = []

    def _phase(self, hybrid: HybridFilter, image: Image) -> TrackPhase:
        patience = LOST_AFTER
        if self._expected is not None:
            patience = LOST_BACKED_AFTER
        elif self._colour > TURNING:
            patience = LOST_TURNING_AFTER
        if _has_left(hybrid.box(), image) or self._unsure > patience:
            return TrackPhase.LOST
        if self._confidence() < 0.5:
            return TrackPhase.OCCLUDED
        return TrackPhase.CONFIRMED if self._sure >= CONFIRM_AFTER else TrackPhase.TENTATIVE


def _reach(looks: tuple[float, float], least: tuple[float, float]) -> bool:
    return looks[0] >= least[0] and looks[1] >= least[1]


def _has_left(box: Array, image: Image) -> bool:
    """Whether the centre of a box (4,) lies beside the image, or well above or below it."""
    height, width = image.pixels.shape[:2]
    margin = OUTSIDE * box[3]
    return not (0.0 < box[0] < width and -margin < box[1] < height + margin)
