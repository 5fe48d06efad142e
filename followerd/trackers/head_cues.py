"""What an ellipse shows of the enrolled head: colours, outline and depth, as one score."""

from dataclasses import replace

import numpy as np

from followerd.geometry import Array
from followerd.messages import Image, Pixels
from followerd.perception.ellipse import Ellipse, Patch, Places
from followerd.perception.head_colour import Tone, is_grey
from followerd.perception.hotspot import grey_of
from followerd.trackers.head_settings import HeadSettings

OUTLINE_SHARE = 0.5  # weight of the gradient beside the colours
DEPTH_SHARE = 1.0  # same, of the share that is as far away: what stands behind is no head
TRUST, MINMAX_TRUST = 30.0, 20.0  # log weight of a full score; of one stretched over the cloud
BESIDE = np.mgrid[-1:2, -1:2].reshape(2, -1).T.astype(float)
BESIDE_STEP = 0.06  # of half the width
ANCHOR = 0.1  # share of the first colours that is never forgotten
SEARCHED = 7.0  # px, half a head's width where a whole image is searched
SEARCH_STEP = 3  # px between the places looked at there
SUSPECTS = 4


class EllipseCues:
    """Learnt from one ellipse; `look_at` chooses the part of an image that is then scored."""

    def __init__(self, image: Image, head: Ellipse, settings: HeadSettings) -> None:
        """Learn the head in an ellipse."""
        self._cues = settings.cues
        self._adaptation = settings.adaptation
        self._ours = settings.profile == "default"
        self._aspect = head.aspect
        self.is_grey = is_grey(image.pixels)
        self.look_at(self.plain(image), head, None)
        self._first = self._patch.histogram(head)
        self._colours = self._first

    def plain(self, image: Image) -> Image:
        """The image without channels that say nothing."""
        if self.is_grey and image.pixels.ndim == 3:
            return replace(image, pixels=grey_of(image.pixels))
        return image

    def look_at(self, image: Image, head: Ellipse, depth: float | None) -> None:
        """From now on score the part of a plain image around `head`, which is `depth` m away."""
        self._patch = Patch.around(image.pixels, head, Tone.of(image.pixels, self._ours))
        self._image, self._depth = image, depth

    def weights(self, points: Array, sizes: list[float]) -> tuple[Array, Array]:
        """Log weights (N,) of the ellipse's cues at image points (N, 2), and the best sizes (N,).

        Each pixel is scored once, however many particles stand on it.
        """
        patch = self._patch
        places = patch.places(points)
        width = patch.size[0]
        keys, back = np.unique(places[:, 1] * width + places[:, 0], return_inverse=True)
        places = np.column_stack([keys % width, keys // width])
        score = self._score(places, sizes)
        best = np.array(sizes)[score.argmax(axis=0)]
        logs = score.max(axis=0) * (TRUST if self._ours else MINMAX_TRUST)
        return logs[back.ravel()], best[back.ravel()]

    def size(self, x: float, y: float, sizes: list[float]) -> float:
        """The half width, px, that fits best at (x, y) or beside it."""
        points = BESIDE * (BESIDE_STEP * sizes[len(sizes) // 2]) + (x, y)
        score = self._score(self._patch.places(points), sizes).max(axis=1)
        weights = np.exp(TRUST * (score - score.max()))
        return float(weights @ np.array(sizes) / weights.sum())

    def likeness(self, head: Ellipse) -> tuple[float, float]:
        """Intersection of the colours and gradient along the outline, 0..1 each."""
        place = self._patch.places(np.array([[head.x, head.y]]))
        colour = self._patch.colour(self._colours, place, [head.a], head.aspect)
        outline = self._patch.outline(place, [head.a], head.aspect)
        return float(colour[0, 0]), float(outline[0, 0])

    def learn(self, head: Ellipse, dt: float) -> None:
        """Adapt the colours to those of `head`, `dt` s after the last time."""
        rate = 1.0 - (1.0 - self._adaptation) ** (dt / 0.1)
        seen = self._patch.histogram(head)
        self._colours = self._colours + rate * (seen - self._colours)
        if self._ours and rate > 0.0:
            self._colours = ANCHOR * rate * self._first + (1.0 - ANCHOR * rate) * self._colours

    def suspicious(self, pixels: Pixels, a: float) -> list[Ellipse]:
        """Where in the whole image colours and outline fit best."""
        patch = Patch.of(pixels, a / SEARCHED, Tone.of(pixels, self._ours))
        width, height = patch.size
        rows, columns = np.mgrid[2 : height - 2 : SEARCH_STEP, 2 : width - 2 : SEARCH_STEP]
        places = np.column_stack([columns.ravel(), rows.ravel()]).astype(np.intp)
        score = patch.colour(self._colours, places, [a], self._aspect)
        score = score + OUTLINE_SHARE * patch.outline(places, [a], self._aspect)
        points = patch.points(places)
        suspects: list[Ellipse] = []
        for best in np.argsort(-score[0], kind="stable").tolist():
            x, y = points[best].tolist()
            if all(max(abs(x - s.x), abs(y - s.y)) > a for s in suspects):
                suspects.append(Ellipse(x, y, a, self._aspect))
            if len(suspects) == SUSPECTS:
                break
        return suspects

    def _score(self, places: Places, sizes: list[float]) -> Array:
        """Scores (S, K) of ellipses at pixels (K, 2) of the patch."""
        patch, parts = self._patch, []
        if self._cues != "gradient":
            parts.append(patch.colour(self._colours, places, sizes, self._aspect))
        if self._cues != "colour":
            parts.append(patch.outline(places, sizes, self._aspect))
        if not self._ours:  # as Birchfield has it: over the whole search set
            parts = [(p - p.min()) / max(float(np.ptp(p)), 1e-9) for p in parts]
            return sum(parts[1:], parts[0])
        if len(parts) == 2:
            parts[1] = OUTLINE_SHARE * parts[1]
        if self._depth is not None and self._image.depth is not None:
            near = patch.near(self._image, self._depth, places, sizes, self._aspect)
            parts.append(DEPTH_SHARE * near)
        return sum(parts[1:], parts[0])
