"""How the enrolled head looks: colours inside its ellipse, its outline, and a template.

The template is ours: grey levels in an ellipse say little, and colours change with the light.
"""

from dataclasses import dataclass, replace
from math import exp

import numpy as np

from followerd.estimation.head_cloud import HeadCloud
from followerd.geometry import Array
from followerd.messages import Image
from followerd.perception.appearance import Appearance, View
from followerd.perception.ellipse import Ellipse
from followerd.perception.head_colour import evened_grey
from followerd.trackers.head_cues import SUSPECTS, EllipseCues
from followerd.trackers.head_settings import HeadSettings

ANSWER_TRUST = 12.0  # log weight of a full answer of the template
LARGER = 1.0 / 27.0  # sizes tried beside the expected one: 1 px of a head 54 px wide
SIZES = 1.0 - LARGER, 1.0, 1.0 + LARGER
MORE_SIZES = 1.0 - 2.0 * LARGER, *SIZES, 1.0 + 2.0 * LARGER  # without a depth
GRID_STEP = 0.06  # of half the width, between the places near the particles' mean
GRID = np.mgrid[-4:5, -4:5].reshape(2, -1).T.astype(float)
ATTRACTED = 0.2  # share of the particles drawn anew at the best of them
PACED = 0.5  # share of what it moved beside its expected way that is taken for speed
FIT = 0.12  # s, over which the size by colours and outline is averaged, without a depth
GROW = 0.2  # share of the growth by the template that is believed
LIKE, SHARP = 0.35, 0.15  # intersection and gradient below which it is no longer the head
ALIKE, SAME = 0.42, 0.4  # same, of the template's answer and its identity
VOUCHED = 1.5  # times `ALIKE` and `SAME`, from which colours do not refute it
LEARN = 0.5  # intersection from which colours are learnt
NOTICE = 0.3  # s, over which scores are averaged
LEAST_SIZE, LARGEST_SIZE = 0.2, 5.0  # of the size when enrolled
SEARCH_SIZES = 1.0, 1.3, 0.77  # of the last size
FOUND = 0.55, 0.5  # of the template's answer and identity, elsewhere
FOUND_COLOUR, FOUND_OUTLINE = 0.6, 0.2  # without a template


@dataclass(frozen=True, slots=True)
class Look:
    """What one image shows of the head."""

    colour: float  # intersection, 0..1
    outline: float  # gradient, 0..1
    confidence: float  # 0..1; from 0.5 on it is the head
    good: bool  # sure enough to learn from


class HeadLooks:
    """Learnt from one ellipse, adapted as it is followed; `head` is where it is."""

    def __init__(self, image: Image, head: Ellipse, settings: HeadSettings) -> None:
        """Learn the head in an ellipse."""
        self.settings = settings
        self.head = head
        self._ours = settings.profile == "default"
        self._cues = EllipseCues(image, head, settings)
        image = self._cues.plain(image)
        self._enrolled = self._usual = head.a
        self._scores = np.full(4, 1.0)  # colour, outline, answer, identity over their limits
        self._appearance: Appearance | None = None
        self._view: tuple[View, Array] | None = None  # and the head's place in it
        if self._ours and settings.template:
            self._appearance = Appearance(evened_grey(image.pixels), _array(head), True)
        self._turn, self._unlearnt = 0, np.zeros(2)
        self._suspects: list[Ellipse] = []
        self._attempt = 0

    def move(self, x: float, y: float) -> None:
        """It is expected elsewhere."""
        self.head = replace(self.head, x=x, y=y)

    def look(
        self, image: Image, cloud: HeadCloud, size: float | None, depth: float | None, dt: float
    ) -> Look:
        """Weigh the particles by what they see, and move the head to their mean.

        `size` is the half width, px, by the `depth`, m; None where it is unknown.
        """
        image = self._cues.plain(image)
        head = self.head if size is None else replace(self.head, a=self._bounded(size))
        self._cues.look_at(image, head, depth)
        sizes = [head.a * share for share in (SIZES if size is not None else MORE_SIZES)]
        logs, widths = self._cues.weights(cloud.particles[:, :2], sizes)
        view = None
        if self._appearance is not None:
            view = self._appearance.view(evened_grey(image.pixels), _array(head))
            logs += self._answers(view, cloud.particles[:, :2])
        cloud.weigh(logs)
        x, y = cloud.mean[:2].tolist()
        a = float(cloud.weights @ widths)
        if self._ours:
            x, y = self._refined(x, y, a, view)
            pace = PACED * (x - self.head.x) / dt, PACED * (y - self.head.y) / dt
            cloud.attract(x, y, a, ATTRACTED, pace)
            a = self._cues.size(x, y, sizes)
            if size is None:
                by_template = (
                    self._cues.is_grey and view is not None
                )  # grey levels do not tell a size
                a = head.a + (0.0 if by_template else 1.0 - exp(-dt / FIT)) * (a - head.a)
        self.head = Ellipse(x, y, self._bounded(a), head.aspect)
        self._view = None
        if view is not None:
            self._view = view, view.window.to_window(np.array([[x, y]]))[0]
            if size is None:
                self._grow()
        return self._judge(dt)

    def learn(self, dt: float) -> None:
        """Adapt to what the last look showed."""
        self._usual = self.head.a
        self._cues.learn(self.head, dt)
        if self._appearance is None or self._view is None:
            return
        view, place = self._view
        self._unlearnt += dt
        self._turn = (self._turn + 1) % 4
        if self._turn == 1:
            self._appearance.learn_template(view, place, float(self._unlearnt[0]))
            self._unlearnt[0] = 0.0
        elif self._turn == 3:
            self._appearance.learn_colour(view, place, float(self._unlearnt[1]))
            self._unlearnt[1] = 0.0

    def search(self, image: Image) -> Ellipse | None:
        """Look at one more suspicious place of the whole image; the head, if it is there."""
        image = self._cues.plain(image)
        if not self._suspects:
            self._attempt = (self._attempt + 1) % len(SEARCH_SIZES)
            a = self._bounded(SEARCH_SIZES[self._attempt] * self._usual)
            self._suspects = self._cues.suspicious(image.pixels, a)
            if self._appearance is not None:
                size = 2.0 * a * np.array([1.0, self.head.aspect])
                alike = self._appearance.places(evened_grey(image.pixels), size, SUSPECTS)
                heads = [Ellipse(x, y, a, self.head.aspect) for x, y in alike.tolist()]
                self._suspects += heads
            return None
        head = self._suspects.pop(0)
        if self._appearance is None:
            self._cues.look_at(image, head, None)
            colour, outline = self._cues.likeness(head)
            is_head = colour >= FOUND_COLOUR and outline >= FOUND_OUTLINE
        else:
            is_head = False
            view = self._appearance.view(evened_grey(image.pixels), _array(head))
            for peak in self._appearance.peaks(view, 1):
                answer, identity = self._vouched(view, peak)
                is_head = answer >= FOUND[0] and identity >= FOUND[1]
                x, y = view.window.to_image(peak[None])[0].tolist()
                head = replace(head, x=x, y=y)
        if not is_head:
            return None
        self.head, self._suspects = head, []
        self._scores = np.full(4, 1.0)
        return head

    def _answers(self, view: View, points: Array) -> Array:
        """Log weights (N,) of the template at image points (N, 2)."""
        assert self._appearance is not None
        answers = self._appearance.answer(view, view.window.to_window(points))
        assert answers is not None
        return ANSWER_TRUST * answers

    def _refined(self, x: float, y: float, a: float, view: View | None) -> tuple[float, float]:
        """The best place near (x, y), where few particles may stand."""
        points = GRID * (GRID_STEP * a) + (x, y)
        logs, _ = self._cues.weights(points, [a])
        if view is not None:
            logs += self._answers(view, points)
        weights = np.exp(logs - logs.max())
        fine = weights @ points / weights.sum()
        return float(fine[0]), float(fine[1])

    def _judge(self, dt: float) -> Look:
        colour, outline = self._cues.likeness(self.head)
        now = np.array([colour / LIKE, outline / SHARP, 2.0, 2.0])
        if self._view is not None:
            answer, identity = self._vouched(*self._view)
            now[1:] = 2.0, answer / ALIKE, identity / SAME  # an outline fades in the dark
            if self._cues.is_grey:
                now[0] = 2.0  # grey levels alone say little
            elif now[2:].min() >= VOUCHED:
                now[0] = max(now[0], 1.0)  # in another light, from another side
        self._scores += (1.0 - exp(-dt / NOTICE)) * (np.minimum(now, 2.0) - self._scores)
        confidence = 0.5 * float(self._scores.min())
        good = confidence >= 0.5
        if self._ours:
            good &= (colour >= LEARN or self._cues.is_grey) and bool((now >= 1.0).all())
        if confidence < 0.5:
            self.head = replace(self.head, a=self._usual)
        return Look(colour, outline, confidence, good)

    def _vouched(self, view: View, place: Array) -> tuple[float, float]:
        """Answer and identity, 0..1.2, of the template at a window point (2,)."""
        assert self._appearance is not None
        answer = self._appearance.answer(view, place[None])
        assert answer is not None
        likeness = min(max(float(answer[0]), 0.0), 1.2)
        return likeness, self._appearance.identity(view, place)

    def _grow(self) -> None:
        """The size by the template, in every other image: it takes long."""
        if self._appearance is None or self._view is None or self._turn % 2:
            return
        grown = self._appearance.growth(*self._view)
        if grown is not None:
            self.head = replace(self.head, a=self._bounded(self.head.a * exp(GROW * grown)))

    def _bounded(self, a: float) -> float:
        return min(max(a, LEAST_SIZE * self._enrolled), LARGEST_SIZE * self._enrolled)


def _array(head: Ellipse) -> Array:
    """(4,) x y w h."""
    return np.array([head.x, head.y, 2.0 * head.a, 2.0 * head.aspect * head.a])
