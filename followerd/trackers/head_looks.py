"""How the enrolled head looks: colours inside its ellipse, its outline, and a template.

The template is ours: grey levels in an ellipse say little, and colours change with the light.
"""

from dataclasses import dataclass, replace
from math import exp

import numpy as np

from followerd.estimation.head_cloud import HeadCloud
from followerd.geometry import Array
from followerd.messages import Image, Pixels
from followerd.perception.appearance import Appearance, View
from followerd.perception.ellipse import Ellipse, Patch, Places
from followerd.perception.head_colour import Tone, evened_grey, is_grey
from followerd.perception.hotspot import grey_of
from followerd.trackers.head_settings import HeadSettings

OUTLINE_SHARE = 0.5  # weight of the gradient beside the colours
TRUST, MINMAX_TRUST = 30.0, 20.0  # log weight of a full score; of one stretched over the cloud
ANSWER_TRUST = 12.0  # same, of the template
LARGER = 1.0 / 27.0  # sizes tried beside the expected one: 1 px of a head 54 px wide
SIZES = 1.0 - LARGER, 1.0, 1.0 + LARGER
MORE_SIZES = 1.0 - 2.0 * LARGER, *SIZES, 1.0 + 2.0 * LARGER  # without a depth
DEPTH_WEIGHT = 0.5  # same, of the share that is as far away as the head should be
GRID_STEP = 0.06  # of half the width, between the places near the particles' mean
GRID = np.mgrid[-4:5, -4:5].reshape(2, -1).T.astype(float)
BESIDE = np.mgrid[-1:2, -1:2].reshape(2, -1).T.astype(float)
ATTRACTED = 0.2  # share of the particles drawn anew at the best of them
FIT = 0.12  # s, over which the size by colours and outline is averaged, without a depth
GROW = 0.2  # share of the growth by the template that is believed
LIKE, SHARP = 0.35, 0.15  # intersection and gradient below which it is no longer the head
ALIKE, SAME = 0.42, 0.4  # same, of the template's answer and its identity
LEARN = 0.5  # intersection from which colours are learnt
ANCHOR = 0.1  # share of the first colours that is never forgotten
NOTICE = 0.3  # s, over which scores are averaged
LEAST_SIZE, LARGEST_SIZE = 0.2, 5.0  # of the size when enrolled
SEARCHED = 7.0  # px, half a head's width where a whole image is searched
SEARCH_STEP = 3  # px between the places looked at there
SEARCH_SIZES = 1.0, 1.3, 0.77  # of the last size
SUSPECTS = 4
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
        self._grey = is_grey(image.pixels)
        image = self._plain(image)
        self._enrolled = self._usual = head.a
        self._patch = self._cut(image.pixels, head)
        self._first = self._patch.histogram(head)
        self._colours = self._first
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
        image = self._plain(image)
        head = self.head if size is None else replace(self.head, a=self._bounded(size))
        self._patch = self._cut(image.pixels, head)
        sizes = [head.a * share for share in (SIZES if size is not None else MORE_SIZES)]
        logs, widths = self._weights(image, cloud.particles[:, :2], sizes, depth)
        view = None
        if self._appearance is not None:
            view = self._appearance.view(evened_grey(image.pixels), _array(head))
            logs += self._answers(view, cloud.particles[:, :2])
        cloud.weigh(logs)
        x, y = cloud.mean[:2].tolist()
        a = float(cloud.weights @ widths)
        if self._ours:
            x, y = self._refined(image, x, y, a, depth, view)
            cloud.attract(x, y, a, ATTRACTED)
            a = self._sized(image, x, y, sizes, depth)
            if size is None:
                by_template = self._grey and view is not None  # grey levels do not tell a size
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
        rate = 1.0 - (1.0 - self.settings.adaptation) ** (dt / 0.1)
        seen = self._patch.histogram(self.head)
        self._colours = self._colours + rate * (seen - self._colours)
        if self._ours and rate > 0.0:
            self._colours = ANCHOR * rate * self._first + (1.0 - ANCHOR * rate) * self._colours
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
        image = self._plain(image)
        if not self._suspects:
            self._attempt = (self._attempt + 1) % len(SEARCH_SIZES)
            a = self._bounded(SEARCH_SIZES[self._attempt] * self._usual)
            self._suspects = self._suspicious(image.pixels, a)
            if self._appearance is not None:
                size = 2.0 * a * np.array([1.0, self.head.aspect])
                alike = self._appearance.places(evened_grey(image.pixels), size, SUSPECTS)
                heads = [Ellipse(x, y, a, self.head.aspect) for x, y in alike.tolist()]
                self._suspects += heads
            return None
        head = self._suspects.pop(0)
        if self._appearance is None:
            patch = self._cut(image.pixels, head)
            place = patch.places(np.array([[head.x, head.y]]))
            colour = float(patch.colour(self._colours, place, [head.a], head.aspect)[0, 0])
            outline = float(patch.outline(place, [head.a], head.aspect)[0, 0])
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

    def _suspicious(self, pixels: Pixels, a: float) -> list[Ellipse]:
        """Where in the whole image colours and outline fit best."""
        patch = Patch.of(pixels, a / SEARCHED, Tone.of(pixels, self._ours))
        width, height = patch.size
        rows, columns = np.mgrid[2 : height - 2 : SEARCH_STEP, 2 : width - 2 : SEARCH_STEP]
        places = np.column_stack([columns.ravel(), rows.ravel()]).astype(np.intp)
        score = patch.colour(self._colours, places, [a], self.head.aspect)
        score = score + OUTLINE_SHARE * patch.outline(places, [a], self.head.aspect)
        points = patch.points(places)
        suspects: list[Ellipse] = []
        for best in np.argsort(-score[0], kind="stable").tolist():
            x, y = points[best].tolist()
            if all(max(abs(x - s.x), abs(y - s.y)) > a for s in suspects):
                suspects.append(Ellipse(x, y, a, self.head.aspect))
            if len(suspects) == SUSPECTS:
                break
        return suspects

    def _plain(self, image: Image) -> Image:
        """The image without channels that say nothing."""
        if self._grey and image.pixels.ndim == 3:
            return replace(image, pixels=grey_of(image.pixels))
        return image

    def _cut(self, pixels: Pixels, head: Ellipse) -> Patch:
        return Patch.around(pixels, head, Tone.of(pixels, self._ours))

    def _weights(
        self, image: Image, points: Array, sizes: list[float], depth: float | None
    ) -> tuple[Array, Array]:
        """Log weights (N,) of the ellipse's cues at image points (N, 2), and the best sizes (N,).

        Each pixel is scored once, however many particles stand on it.
        """
        patch = self._patch
        places = patch.places(points)
        width = patch.size[0]
        keys, back = np.unique(places[:, 1] * width + places[:, 0], return_inverse=True)
        places = np.column_stack([keys % width, keys // width])
        score = self._fit(image, places, sizes, depth)
        best = np.array(sizes)[score.argmax(axis=0)]
        logs = score.max(axis=0) * (TRUST if self._ours else MINMAX_TRUST)
        return logs[back.ravel()], best[back.ravel()]

    def _answers(self, view: View, points: Array) -> Array:
        """Log weights (N,) of the template at image points (N, 2)."""
        assert self._appearance is not None
        answers = self._appearance.answer(view, view.window.to_window(points))
        assert answers is not None
        return ANSWER_TRUST * answers

    def _refined(
        self, image: Image, x: float, y: float, a: float, depth: float | None, view: View | None
    ) -> tuple[float, float]:
        """The best place near (x, y), where few particles may stand."""
        points = GRID * (GRID_STEP * a) + (x, y)
        logs, _ = self._weights(image, points, [a], depth)
        if view is not None:
            logs += self._answers(view, points)
        weights = np.exp(logs - logs.max())
        fine = weights @ points / weights.sum()
        return float(fine[0]), float(fine[1])

    def _sized(
        self, image: Image, x: float, y: float, sizes: list[float], depth: float | None
    ) -> float:
        """The half width, px, that fits best at (x, y) or beside it."""
        points = BESIDE * (GRID_STEP * sizes[len(sizes) // 2]) + (x, y)
        score = self._fit(image, self._patch.places(points), sizes, depth).max(axis=1)
        weights = np.exp(TRUST * (score - score.max()))
        return float(weights @ np.array(sizes) / weights.sum())

    def _fit(self, image: Image, places: Places, sizes: list[float], depth: float | None) -> Array:
        """Scores (S, K) of ellipses at pixels (K, 2) of the patch by all cues but the template."""
        score = self._score(self._patch, places, sizes)
        if self._ours and depth is not None and image.depth is not None:
            near = self._patch.near(image, depth, places, sizes, self.head.aspect)
            score = score + DEPTH_WEIGHT * near
        return score

    def _score(self, patch: Patch, places: Places, sizes: list[float]) -> Array:
        """Scores (S, K) of the ellipse's cues at pixels (K, 2) of the patch."""
        parts = []
        if self.settings.cues != "gradient":
            parts.append(patch.colour(self._colours, places, sizes, self.head.aspect))
        if self.settings.cues != "colour":
            parts.append(patch.outline(places, sizes, self.head.aspect))
        if not self._ours:  # as Birchfield has it: over the whole search set
            parts = [(p - p.min()) / max(float(np.ptp(p)), 1e-9) for p in parts]
            return sum(parts[1:], parts[0])
        if len(parts) == 2:
            parts[1] = OUTLINE_SHARE * parts[1]
        return sum(parts[1:], parts[0])

    def _judge(self, dt: float) -> Look:
        head, patch = self.head, self._patch
        place = patch.places(np.array([[head.x, head.y]]))
        colour = float(patch.colour(self._colours, place, [head.a], head.aspect)[0, 0])
        outline = float(patch.outline(place, [head.a], head.aspect)[0, 0])
        now = np.array([colour / LIKE, outline / SHARP, 2.0, 2.0])
        if self._view is not None:
            answer, identity = self._vouched(*self._view)
            now[1:] = 2.0, answer / ALIKE, identity / SAME  # an outline fades in the dark
            if self._grey:
                now[0] = 2.0  # grey levels alone say little
        self._scores += (1.0 - exp(-dt / NOTICE)) * (np.minimum(now, 2.0) - self._scores)
        confidence = 0.5 * float(self._scores.min())
        good = confidence >= 0.5
        if self._ours:
            good &= (colour >= LEARN or self._grey) and bool((now >= 1.0).all())
        if confidence < 0.5:
            self.head = replace(head, a=self._usual)
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
