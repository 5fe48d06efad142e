"""How one person looks: colours that set them off from their surroundings, and a template.

Both are judged in a window in which the person is always as large, so one set of constants serves
every camera and distance. Every score is 1 when the person looks as when enrolled and about 0
where they are not: an absolute scale, by which somebody absent can be called absent.
"""

from dataclasses import dataclass
from math import exp, log, sqrt

import cv2
import numpy as np

from followerd.geometry import Array
from followerd.messages import Pixels
from followerd.perception import gradients, search
from followerd.perception.colour import Codes, ColourRatio, encode
from followerd.perception.gradients import CELL, Channels
from followerd.perception.maps import Map, contrast, reach, sampled
from followerd.perception.template import Spectrum, Template
from followerd.perception.window import SIDE, Window

CELLS = SIDE // CELL
GRID = np.arange(SIDE) + 0.5
MIDDLE = np.array([[0.5 * SIDE, 0.5 * SIDE]])
AROUND = np.ones((5, 5), np.uint8)  # cells in which a peak is the highest
MEMORY = 1.3  # s, of both cues
SLOW_MEMORY = 20.0  # s, of the template that vouches for the identity
OUTSTANDING = 8.0  # standard deviations that its answer stands out by, as a rule
ZOOM = 1.05  # by which a window is tried larger and smaller
FASTEST_GROWTH = 0.06  # of the log size, per measurement
EDGES = np.array([0.15, 0.25, 0.15, 1.0])  # weights of left, upper, right, lower edge
FIRST_ANSWER = 0.6  # of the template one frame after enrolment, as a rule
WORST_ANSWER = 0.25  # a template that answers no better is not a person's


@dataclass(frozen=True, slots=True)
class View:
    """One window of an image and what the cues make of it."""

    window: Window
    size: tuple[float, float]  # expected width and height of the person, window px
    codes: Codes  # (SIDE, SIDE)
    seen: Map  # (SIDE, SIDE) 1 inside the image, 0 outside
    patch: Pixels  # (SIDE, SIDE, 3), or (SIDE, SIDE) of a grey image
    ratio: Map  # (SIDE, SIDE) log colour ratio, 0 outside the image
    colours: Map  # (SIDE, SIDE) its contrast for boxes of the expected size
    cells: Channels | None  # (C, CELLS, CELLS) what the template sees
    spectrum: Spectrum | None
    answers: Map | None  # (CELLS, CELLS) of the template


class Appearance:
    """Learnt from one box, adapted to the person as they are followed."""

    def __init__(self, pixels: Pixels, box: Array, use_template: bool) -> None:
        """Learn the person in `box` (4,): x y of the centre, w h, px."""
        self._colour = ColourRatio()
        self._template: Template | None = None
        self._learn_colour(self.view(pixels, box), MIDDLE[0], 1.0)
        if use_template:
            view = self.view(pixels, box)
            self._template = Template(
                _features(view.patch, view.ratio, view.seen),
                (view.size[0] / CELL, view.size[1] / CELL),
            )
        view = self.view(pixels, box)
        self._full_colour = max(float(sampled(view.colours, MIDDLE)[0]), 0.1)
        self._full_answer = FIRST_ANSWER
        self._reach = self._relative_reach(view, MIDDLE[0])
        one, larger, smaller = (
            self._slow_answer(view, MIDDLE[0], z) for z in (1.0001, ZOOM, 1.0 / ZOOM)
        )
        self._bias = log(larger / smaller)
        fall = max(log(one) - 0.5 * log(larger * smaller), 0.02)
        self._gain = log(ZOOM) / (4.0 * fall)  # a Gaussian through the three answers

    def view(self, pixels: Pixels, box: Array) -> View:
        """The window around `box` (4,) px and all that is read from it."""
        window = Window.around(box, (pixels.shape[1], pixels.shape[0]))
        patch = window.cut(pixels)
        codes = encode(patch)
        seen = window.inside()
        ratio = self._colour.log_ratio(codes) * seen
        size = float(box[2]) / window.scale, float(box[3]) / window.scale
        cells = spectrum = answers = None
        if self._template is not None:
            cells = _features(patch, ratio, seen)
            spectrum = self._template.spectrum(cells)
            answers = self._template.respond(spectrum)
        colours = contrast(ratio, seen, *size)
        return View(window, size, codes, seen, patch, ratio, colours, cells, spectrum, answers)

    def colour(self, view: View, points: Array) -> Array:
        """Colour score (N,) of the person standing at window points (N, 2)."""
        score: Array = sampled(view.colours, points) / self._full_colour
        return score

    def answer(self, view: View, points: Array) -> Array | None:
        """Template score (N,) at window points (N, 2); None without a template."""
        if view.answers is None:
            return None
        score: Array = sampled(view.answers, points, CELL) / self._full_answer
        return score

    def likeness(self, view: View, point: Array) -> float:
        """0..1.2: how much the person at a window point (2,) is the enrolled one, by both cues."""
        colour = min(max(float(self.colour(view, point[None])[0]), 0.0), 1.2)
        answer = self.answer(view, point[None])
        if answer is None:
            return colour
        return sqrt(colour * min(max(float(answer[0]), 0.0), 1.2))

    def peaks(self, view: View, most: int) -> Array:
        """Window points (M, 2) of the best answers, best first."""
        if view.answers is None:
            return np.empty((0, 2))
        high = view.answers > 0.3 * self._full_answer
        high &= view.answers == cv2.dilate(view.answers, AROUND)
        places = np.flatnonzero(high)
        order = (-view.answers.ravel()[places]).argsort(kind="stable")[:most]
        rows, columns = divmod(places[order], CELLS)
        return (np.array([columns, rows]).T + 0.5) * CELL

    def places(self, pixels: Pixels, size: Array, most: int) -> Array:
        """Image points (M, 2) where someone of `size` (2,) px in these colours may be."""
        return search.places(pixels, self._colour, size, most)

    def identity(self, view: View, point: Array) -> float:
        """0..1.2: how surely the slow template knows the person at a window point (2,)."""
        if self._template is None or view.cells is None or view.spectrum is None:
            return 1.0
        answer = self._template.slow_answer(view.cells, _offset(point), 1.0)
        outstanding = self._template.vouch(view.spectrum, answer) / OUTSTANDING
        return min(max(outstanding, 0.0), 1.2)

    def learn_template(self, view: View, point: Array, dt: float) -> None:
        """Adapt the template to the person at a window point (2,), `dt` s after the last time."""
        answer = self.answer(view, point[None])
        if self._template is None or view.spectrum is None or answer is None:
            return
        quick, slow = 1.0 - exp(-dt / MEMORY), 1.0 - exp(-dt / SLOW_MEMORY)
        now = min(max(float(answer[0]) * self._full_answer, WORST_ANSWER), 1.0)
        self._full_answer += quick * (now - self._full_answer)
        self._template.learn(view.spectrum, _offset(point), quick, slow)

    def recollect(self) -> None:
        """Forget what was learnt lately: it may have been somebody else."""
        if self._template is not None:
            self._template.recollect()

    def learn_colour(self, view: View, point: Array, dt: float) -> None:
        """Adapt the colour model likewise."""
        self._learn_colour(view, point, 1.0 - exp(-dt / MEMORY))

    def _learn_colour(self, view: View, point: Array, rate: float) -> None:
        w, h = view.size
        dx, dy = np.abs(GRID - point[0]) / w, np.abs(GRID - point[1])[:, None] / h
        person = (dx < 0.45) & (dy < 0.48)
        around = ((dx > 0.6) | (dy > 0.6)) & (dx < 1.2) & (dy < 1.2)
        self._colour.learn(view.codes, person * view.seen, around * view.seen, rate)

    def growth(self, view: View, point: Array) -> float | None:
        """Log growth of the person at a window point (2,), over the expected size.

        The ratio of the template's answers in a larger and a smaller window, by the fall of the
        answers measured at enrolment. None where it cannot be told.
        """
        if view.cells is None:
            return None
        larger, smaller = (self._slow_answer(view, point, z) for z in (ZOOM, 1.0 / ZOOM))
        measured = self._gain * (log(larger / smaller) - self._bias)
        return min(max(measured, -FASTEST_GROWTH), FASTEST_GROWTH)

    def _slow_answer(self, view: View, point: Array, zoom: float) -> float:
        """The slow template's answer at a window point, in a window `zoom` times as large."""
        if self._template is None or view.cells is None:
            return 1.0
        return max(self._template.slow_answer(view.cells, _offset(point), zoom), 0.02)

    def outline_growth(self, view: View, point: Array) -> float | None:
        """Log growth by the edges of the person's colours; None where none is in view.

        The lower edge is the foot, the best; the width comes and goes with the legs. Edges out
        of the image count for nothing.
        """
        known = np.isfinite(now := self._relative_reach(view, point)) & np.isfinite(self._reach)
        weights = np.where(known, EDGES, 0.0)
        if weights.sum() < 0.5:
            return None
        change = np.log(np.where(known, now / self._reach, 1.0))
        change = np.minimum(np.maximum(change, -0.3), 0.3)
        measured = float(weights @ change / weights.sum())
        return min(max(measured, -FASTEST_GROWTH), FASTEST_GROWTH)

    def _relative_reach(self, view: View, point: Array) -> Array:
        """How far (4,) the person's colours reach left, up, right, down, in half sizes; nan at
        the border of the image."""
        w, h = view.size
        ends = np.maximum(reach(view.ratio, point, w, h), 1.0)
        edge = point[[0, 1, 0, 1]] + ends * (-1.0, -1.0, 1.0, 1.0)
        beyond = edge + (-1.5, -1.5, 0.5, 0.5)
        left, top, right, bottom, x, y = (
            int(min(max(v, 0.0), SIDE - 1)) for v in (*beyond.tolist(), *point.tolist())
        )
        seen = view.seen[(y, top, y, bottom), (left, x, right, x)]
        relative: Array = np.where(seen > 0.0, ends / (0.5 * np.array([w, h, w, h])), np.nan)
        return relative


def _offset(point: Array) -> tuple[float, float]:
    """Cells (x, y) that a window point (2,) lies off the middle."""
    return (float(point[0]) - 0.5 * SIDE) / CELL, (float(point[1]) - 0.5 * SIDE) / CELL


def _features(patch: Pixels, ratio: Map, seen: Map) -> Channels:
    """What the template sees of a window: oriented gradients, brightness, colour ratio.

    Outside the image there is nothing: its border must not become part of the person.
    """
    grey = cv2.cvtColor(patch, cv2.COLOR_BGR2GRAY) if patch.ndim == 3 else patch
    features = gradients.channels(np.asarray(grey, np.uint8), ratio)
    if seen.min() == 0.0:
        mask = gradients.pooled(seen[None])[0]
        total = max(float(mask.sum()), 1.0)
        means = features.reshape(len(features), -1) @ (mask.ravel() / np.float32(total))
        features -= means[:, None, None]
        features *= mask
    return features
