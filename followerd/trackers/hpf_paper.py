"""The `paper` profile: what Zhuang et al. measured, and what they leave to the reader."""

import numpy as np

from followerd.estimation.hybrid import PAPER_NOISE, HybridFilter
from followerd.estimation.particles import Estimator
from followerd.geometry import Array
from followerd.messages import Box, Image, TrackPhase
from followerd.perception import blobs
from followerd.perception.colour import ColourInterval, encode
from followerd.trackers.sighting import Sighting

WIDEST = 320  # px: wider images are classified on every n-th pixel
GATE = 9.21  # chi-square, 2 degrees of freedom, 99 %: the paper gives no number
REACQUIRE_AFTER = 0.25  # s without a candidate
ALIKE = 1.2  # log sizes and distance in widths that a re-acquired blob may differ by
LOST_AFTER = 3.0  # s
SURE_AFTER = 0.15  # s of candidates before a new track is confirmed


class PaperProfile:
    """Hue-saturation interval, rectangles, shape gate, nearest candidate, MAP."""

    def __init__(self, image: Image, box: Box, estimator: Estimator, mix: float) -> None:
        """Learn the colour of `box`; `mix` is the share of particles drawn on candidates."""
        self._colour = ColourInterval.learn(image.pixels, box)
        self.noise = PAPER_NOISE.scaled(image.pixels.shape[1] / 192.0)
        self._estimator = estimator
        self._mix = mix
        self._unseen = 0.0  # s
        self._seen = 0.0  # s
        self._confidence = 1.0

    def candidates(self, image: Image, size: Array) -> Array:
        """Rectangles (M, 4) of the learned colour (sections 3.1, 3.2); `size` (2,) is expected."""
        height, width = image.pixels.shape[:2]
        step = -(-width // WIDEST)
        codes = encode(image.pixels[::step, ::step])
        mask = self._colour.classify(codes)
        close = int(0.25 * size[0] / step)
        found = blobs.rectangles(mask, close, 0.0011 * width * height / step**2)
        found *= step
        return found

    def look(self, image: Image, hybrid: HybridFilter, dt: float) -> Sighting:
        """Steps 4-6 on one image; `hybrid` was predicted to it `dt` seconds on."""
        boxes = self.candidates(image, hybrid.size[:2])
        drawn = tuple(Box.around(*b) for b in boxes)
        boxes = blobs.split(boxes, hybrid.box())
        gated = boxes[hybrid.shape_distance(boxes[:, 2:]) < GATE]
        if self._mix:
            hybrid.propose(gated[:, :2], self._mix)
        found = hybrid.update(gated, self._estimator)
        if found is None:
            return self._missed(boxes, drawn, hybrid, dt)
        self._unseen = 0.0
        self._seen += dt
        share = 0.6 * found.support + 0.4 * found.shape
        self._confidence += min(1.0, 5.0 * dt) * (share - self._confidence)
        sure = self._seen >= SURE_AFTER
        phase = TrackPhase.CONFIRMED if sure else TrackPhase.TENTATIVE
        return Sighting(phase, self._confidence, drawn)

    def _missed(
        self, boxes: Array, drawn: tuple[Box, ...], hybrid: HybridFilter, dt: float
    ) -> Sighting:
        """The miss rule: coast, then take the blob most like the person, at last give up."""
        hybrid.coast(dt)
        self._unseen += dt
        self._confidence *= float(np.exp(-dt / 0.5))
        if self._unseen > REACQUIRE_AFTER and len(boxes):
            x, y, w, h = hybrid.box()
            apart = np.hypot(boxes[:, 0] - x, boxes[:, 1] - y) / w
            unlike = np.abs(np.log(boxes[:, 2] / w)) + np.abs(np.log(boxes[:, 3] / h)) + 0.3 * apart
            best = int(np.argmin(unlike))
            if unlike[best] < ALIKE:
                hybrid.seed(boxes[best], np.zeros(2))
                self._unseen = self._seen = 0.0
                return Sighting(TrackPhase.TENTATIVE, self._confidence, drawn)
        lost = self._unseen > LOST_AFTER
        phase = TrackPhase.LOST if lost else TrackPhase.OCCLUDED
        return Sighting(phase, self._confidence, drawn)
