"""How one person looks: colours that set them off from their surroundings, and a template.

Both are judged in a window in which the person is always as large, so one set of constants serves
every camera and distance. Every score is 1 when the person looks as when enrolled and about 0
where they are not: an absolute scale, by which somebody absent can be called absent.
"""

from dataclasses import dataclass
from math import ceil, exp, floor, isfinite, log, nan, sqrt

import cv2
import numpy as np

from followerd.geometry import Array
from followerd.messages import Pixels
from followerd.perception import gradients, search
from followerd.perception.colour import Codes, ColourRatio, encode, histogram
from followerd.perception.gradients import CELL, Channels
from followerd.perception.maps import Map, contrast, is_whole, reach, sampled
from followerd.perception.template import Spectrum, Template
from followerd.perception.window import SIDE, Part, Window

CELLS = SIDE // CELL
MIDDLE = np.array([[0.5 * SIDE, 0.5 * SIDE]])
AROUND = np.ones((5, 5), np.uint8)  # cells in which a peak is the highest
MEMORY = 1.3  # s, of both cues
SLOW_MEMORY = 20.0  # s, of the template that vouches for the identity
OUTSTANDING = 8.0  # standard deviations that its answer stands out by, as a rule
ZOOM = 1.05  # by which a window is tried larger and smaller
FASTEST_GROWTH = 0.06  # of the log size, per measurement
EDGES = (0.15, 0.25, 0.15, 1.0)  # weights of left, upper, right, lower edge
FIRST_ANSWER = 0.6  # of the template one frame after enrolment, as a rule
WORST_ANSWER = 0.25  # a template that answers no better is not a person's


@dataclass(frozen=True, slots=True)
class View:
    """One window of an image and what the cues make of it."""

    window: Window
    size: tuple[float, float]  # expected width and height of the person, window px
    codes: Codes  # (SIDE, SIDE)
    seen: Part  # inside the image
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
        one, larger, smaller = self._slow_answers(view, MIDDLE[0], (1.0001, ZOOM, 1.0 / ZOOM))
        self._bias = log(larger / smaller)
        fall = max(log(one) - 0.5 * log(larger * smaller), 0.02)
        self._gain = log(ZOOM) / (4.0 * fall)  # a Gaussian through the three answers

    def view(self, pixels: Pixels, box: Array) -> View:
        """The window around `box` (4,) px and all that is read from it."""
        window = Window.around(box, (pixels.shape[1], pixels.shape[0]))
        patch = window.cut(pixels)
        codes = encode(patch)
        seen = window.inside()
        ratio = np.zeros((SIDE, SIDE), np.float32)
        ratio[seen] = self._colour.log_ratio(codes[seen])
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
        places = high.ravel().nonzero()[0]
        answers = view.answers.ravel()[places].tolist()
        best = sorted(zip(answers, places.tolist(), strict=True), key=lambda a: -a[0])[:most]
        points = [((i % CELLS + 0.5) * CELL, (i // CELLS + 0.5) * CELL) for _, i in best]
        return np.array(points).reshape(-1, 2)

    def places(self, pixels: Pixels, size: Array, most: int) -> Array:
        """Image points (M, 2) where someone of `size` (2,) px in these colours may be."""
        return search.places(pixels, self._colour, size, most)

    def identity(self, view: View, point: Array) -> float:
        """0..1.2: how surely the slow template knows the person at a window point (2,)."""
        if self._template is None or view.cells is None or view.spectrum is None:
            return 1.0
        (answer,) = self._template.slow_answers(view.cells, _offset(point), (1.0,))
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
        person, apart, around = (
            histogram(view.codes[_part(view, point, *reach)])
            for reach in ((0.45, 0.48), (0.6, 0.6), (1.2, 1.2))
        )
        self._colour.learn(person, around - apart, rate)

    def growth(self, view: View, point: Array) -> float | None:
        """Log growth of the person at a window point (2,), over the expected size.

        The ratio of the template's answers in a larger and a smaller window, by the fall of the
        answers measured at enrolment. None where it cannot be told.
        """
        if view.cells is None:
            return None
        larger, smaller = self._slow_answers(view, point, (ZOOM, 1.0 / ZOOM))
        measured = self._gain * (log(larger / smaller) - self._bias)
        return min(max(measured, -FASTEST_GROWTH), FASTEST_GROWTH)

    def _slow_answers(self, view: View, point: Array, zooms: tuple[float, ...]) -> list[float]:
        """The slow template's answers at a window point, in windows `zooms` times as large."""
        if self._template is None or view.cells is None:
            return [1.0] * len(zooms)
        answers = self._template.slow_answers(view.cells, _offset(point), zooms)
        return [max(answer, 0.02) for answer in answers]

    def outline_growth(self, view: View, point: Array) -> float | None:
        """Log growth by the edges of the person's colours; None where none is in view.

        The lower edge is the foot, the best; the width comes and goes with the legs. Edges out
        of the image count for nothing.
        """
        change = weight = 0.0
        for now, then, share in zip(
            self._relative_reach(view, point), self._reach, EDGES, strict=True
        ):
            if isfinite(now) and isfinite(then):
                change += share * min(max(log(now / then), -0.3), 0.3)
                weight += share
        if weight < 0.5:
            return None
        return min(max(change / weight, -FASTEST_GROWTH), FASTEST_GROWTH)

    def _relative_reach(self, view: View, point: Array) -> list[float]:
        """How far the person's colours reach left, up, right, down, in half sizes; nan at the
        border of the image."""
        (x, y), (w, h), (rows, columns) = point.tolist(), view.size, view.seen
        across = (x, w, columns, _is_in(y, rows)), (y, h, rows, _is_in(x, columns))
        relative = []
        for k, end in enumerate(reach(view.ratio, x, y, w, h)):
            at, size, part, seen = across[k % 2]
            far = max(end, 1.0)
            beyond = at - far - 1.5 if k < 2 else at + far + 0.5
            relative.append(far / (0.5 * size) if seen and _is_in(beyond, part) else nan)
        return relative


def _is_in(place: float, part: slice) -> bool:
    """Whether the pixel of the window next to a place is one of `part`."""
    start, stop = part.start, part.stop
    return bool(start <= int(min(max(place, 0.0), SIDE - 1)) < stop)


def _offset(point: Array) -> tuple[float, float]:
    """Cells (x, y) that a window point (2,) lies off the middle."""
    return (float(point[0]) - 0.5 * SIDE) / CELL, (float(point[1]) - 0.5 * SIDE) / CELL


def _part(view: View, point: Array, wide: float, high: float) -> Part:
    """The pixels seen less than `wide` widths and `high` heights from a window point (2,)."""
    reaches = high * view.size[1], wide * view.size[0]
    rows, columns = (
        slice(
            first := max(floor(p - r - 0.5) + 1, s.start),
            max(min(ceil(p + r - 0.5), s.stop), first),
        )
        for p, r, s in zip((point[1], point[0]), reaches, view.seen, strict=True)
    )
    return rows, columns


def _features(patch: Pixels, ratio: Map, seen: Part) -> Channels:
    """What the template sees of a window: oriented gradients, brightness, colour ratio.

    Outside the image there is nothing: its border must not become part of the person.
    """
    grey = cv2.cvtColor(patch, cv2.COLOR_BGR2GRAY) if patch.ndim == 3 else patch
    features = gradients.channels(np.asarray(grey, np.uint8), ratio)
    if not is_whole(seen, ratio):
        lines = np.zeros((2, SIDE), np.float32)
        lines[0, seen[0]] = lines[1, seen[1]] = 1.0 / CELL
        rows, columns = lines.reshape(2, CELLS, CELL).sum(axis=2)
        mask = rows[:, None] * columns
        means = features.reshape(len(features), -1) @ mask.ravel()
        means /= np.float32(max(float(rows.sum() * columns.sum()), 1.0))
        features -= means[:, None, None]
        features *= mask
    return features
