"""Finds the enrolled person of `ofkf` in grey or thermal images: their looks vote."""

from math import exp, sqrt
from typing import NamedTuple

import numpy as np

from followerd.geometry import Array
from followerd.messages import Pixels
from followerd.perception.appearance import Appearance, View
from followerd.perception.hotspot import hot_regions, vertex
from followerd.perception.window import SIDE

GREY_TRUST, ANSWER_TRUST = 8.0, 12.0  # votes of a full score
GREY_SHARE = 0.7  # of the likeness; grey levels alone say little
STEPS = 36  # of the grid of places, along a window's side
GROW = 0.2  # share of a measured growth that is believed
LEAST_SIZE, LARGEST_SIZE = 0.12, 5.0  # of the size when enrolled
FOUND = 0.55, 0.5  # likeness and identity, from which somebody elsewhere is the enrolled person
SIZES = 1.0, 1.2, 0.83  # of the usual size, at which a lost person is looked for
SUSPECTS = 4

_LINE = (np.arange(STEPS) + 0.5) * (SIDE / STEPS)
PLACES = np.column_stack([grid.ravel() for grid in np.meshgrid(_LINE, _LINE)])  # (N, 2) window px


class Found(NamedTuple):
    """The best place of an image for the enrolled person."""

    centre: Array  # (2,) px
    likeness: float  # 0..1.2
    identity: float  # 0..1.2


class Finder:
    """The grey levels that set the person off from their surroundings and a template of their
    shape, first and recent, vote with the place that was foreseen.

    Images are evened (perception.hotspot.Levels), so gain and offset of the camera do not count.
    """

    def __init__(self, even: Pixels, box: Array) -> None:
        """Learn the person in `box` (4,) x y w h, centre and size."""
        self._appearance = Appearance(even, box, True)
        self._enrolled = sqrt(box[2] * box[3])
        self._shape = np.sqrt([box[2] / box[3], box[3] / box[2]])
        self.size = self._usual = self._enrolled  # px, square root of the area
        self._last: tuple[View, Array] | None = None  # of the last look: place in window px
        self._turn, self._unlearnt = 0, [0.0, 0.0]  # s, of template and grey levels
        self._suspects: list[Array] = []
        self._attempt = 0

    @property
    def extent(self) -> Array:
        """Width and height (2,), px."""
        extent: Array = self.size * self._shape
        return extent

    def find(self, even: Pixels, foreseen: Array, deviation: Array) -> Found:
        """The best place near `foreseen` (2,), which may be wrong by `deviation` (2,), px."""
        view = self._appearance.view(even, np.concatenate([foreseen, self.extent]))
        votes = GREY_TRUST * np.clip(self._appearance.colour(view, PLACES), -1.0, 1.5)
        answers = self._appearance.answer(view, PLACES)
        assert answers is not None
        votes += ANSWER_TRUST * answers
        x, y = np.square((_LINE - 0.5 * SIDE) * view.window.scale / deviation[:, None])
        votes = votes.reshape(STEPS, STEPS) - 0.5 * (x + y[:, None])
        return self._judged(view, _summit(votes))

    def learn(self, dt: float) -> None:
        """Adapt to the person as found last, `dt` s after the time before: the size every other
        image, template and grey levels in between, so that no image takes long."""
        assert self._last is not None
        view, place = self._last
        self._unlearnt = [since + dt for since in self._unlearnt]
        self._turn = (self._turn + 1) % 4
        if self._turn == 1:
            self._appearance.learn_template(view, place, self._unlearnt[0])
            self._unlearnt[0] = 0.0
        elif self._turn == 3:
            self._appearance.learn_colour(view, place, self._unlearnt[1])
            self._unlearnt[1] = 0.0
        else:
            grown = self._appearance.growth(view, place)
            if grown is not None:
                self.resize(self.size * exp(GROW * grown))
        self._usual = self.size

    def resize(self, size: float) -> None:
        """The person is now `size` px large, within what is possible."""
        self.size = min(max(size, LEAST_SIZE * self._enrolled), LARGEST_SIZE * self._enrolled)

    def search(self, even: Pixels) -> Found | None:
        """Look at one more suspicious place of the whole image: warm, or as grey as the person.
        The enrolled person, if there."""
        if not self._suspects:
            self._attempt = (self._attempt + 1) % len(SIZES)
            extent = SIZES[self._attempt] * self._usual * self._shape
            alike = self._appearance.places(even, extent, SUSPECTS)
            warm = hot_regions(even, SUSPECTS)[:, :2]
            places = np.concatenate([alike, warm])
            self._suspects = [np.concatenate([place, extent]) for place in places]
        if not self._suspects:
            return None
        box = self._suspects.pop(0)
        view = self._appearance.view(even, box)
        for peak in self._appearance.peaks(view, 1):
            found = self._judged(view, peak)
            if found.likeness >= FOUND[0] and found.identity >= FOUND[1]:
                self.resize(sqrt(box[2] * box[3]))
                self._appearance.recollect()
                self._suspects = []
                return found
        return None

    def _judged(self, view: View, place: Array) -> Found:
        centre = view.window.to_image(place[None])[0]
        answer = self._appearance.answer(view, place[None])
        assert answer is not None
        grey = min(max(float(self._appearance.colour(view, place[None])[0]), 0.0), 1.2)
        grey = 1.0 - GREY_SHARE + GREY_SHARE * grey
        likeness = sqrt(min(max(float(answer[0]), 0.0), 1.2) * grey)
        self._last = view, place
        return Found(centre, likeness, self._appearance.identity(view, place))


def _summit(votes: Array) -> Array:
    """Window point (2,) of the best place, to a fraction of a step."""
    row, column = divmod(int(votes.argmax()), STEPS)
    step = SIDE / STEPS
    x = column + 0.5 + vertex(votes[row], column)
    y = row + 0.5 + vertex(votes[:, column], row)
    return np.array([x * step, y * step])
