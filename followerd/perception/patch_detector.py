"""Where in an image with depth the enrolled person is: candidate boxes, judged by their patches.

Jia et al. 2015, section 3. Sizes follow from the depth alone (eq. 2, which multiplies the old size
by a ratio of histograms, has no meaning); the depth is looked for around where they are expected.
"""

from dataclasses import dataclass, replace
from enum import Enum
from math import exp
from typing import NamedTuple

import numpy as np
from pydantic import Field

from followerd.errors import UsageError
from followerd.geometry import Array
from followerd.messages import Box, Image
from followerd.perception.cells import Buffers
from followerd.perception.depth_band import Band, Depth, Mode, crop, modes, person_mode, torso_depth
from followerd.perception.depth_people import bodies
from followerd.perception.patches import (
    PatchModel,
    PatchSettings,
    View,
    Window,
    accepted,
    box_of,
    confidence,
    likeness,
    surely,
)
from followerd.perception.spot import Spot, in_base, levelled, row, scale
from followerd.perception.whole_person import whole
from followerd.settings import Settings

SLIM = 0.27  # of the height: no person is taken to be narrower
TORSO = 0.6  # share of the box, from its top, whose middle column is the person's
THIN = 0.1  # of the box's width: a row that shows more of the person is theirs
HIGHEST = 0.05  # of the box's height, that depth may miss of the head
CELLS = 24  # across a box, about
SUDDEN = 1.5  # times brighter or darker than last, light is made up for
LEAST_LIT = 4  # patches that tell how bright the person is
WIDEST = 2.5  # times the usual search, for who was not seen for a while
UNKNOWN = 0.7  # share of a box without depth: sunlight
BODIES = 3  # that are looked at in one image
SHIFTS = np.linspace(-0.3, 0.3, 7)  # of a body's box, in its widths, when found again
ASIDE = np.array([-1.0, -0.5, 0.5, 1.0])  # of the reach, where who turned off is looked for
LIFTS = np.linspace(-0.04, 0.04, 3)  # in its heights


class DetectorSettings(Settings):
    """Where is looked, and what the ablations leave out."""

    patch: PatchSettings = PatchSettings()
    gate_m: float = Field(0.45, gt=0, description="farthest from the expected depth")
    random_boxes: int = Field(18, ge=0, le=500)
    random_px: float = Field(12.0, ge=0, description="their deviation, in images 640 px wide")
    use_depth: bool = Field(True, description="False only for the ablation: as in sunlight")
    depth_mask: bool = Field(True, description="False only for the ablation")
    occlusion: bool = Field(True, description="False only for the ablation")
    literal_learning: bool = Field(False, description="True only for the ablation: eq. 11")


class Found(Enum):
    """What a look found."""

    PERSON = "person"
    HIDDEN = "hidden"  # by something before them
    NOTHING = "nothing"


@dataclass(frozen=True, slots=True)
class Sight:
    """Outcome of one look; what is no person has neither box nor spot."""

    found: Found
    confidence: float = 0.0
    box: Box | None = None  # of the whole person, inside the image or not
    spot: Spot | None = None
    by_depth: bool = True  # False: the depth was told by the size
    is_whole: bool = True  # nothing hides a part of them
    likeness: Array | None = None  # (P,) of its patches, nan = hidden or unknown


class Shown(NamedTuple):
    """What boxes show, in which band, and by how much the image was made brighter."""

    view: View
    band: Band
    gain: float


class PatchDetector:
    """Knows one person."""

    def __init__(
        self,
        image: Image,
        region: Box | tuple[float, float],
        settings: DetectorSettings,
        paper: bool,
    ) -> None:
        """Learn who is in the region; raises UsageError."""
        self.settings = settings
        self._paper = paper
        self._buffers = Buffers()
        self._bright: Array | None = None  # grey level of each patch in the light of the first look
        self._gain = 1.0  # that gives the person those again
        depth = self._depth(image)
        box, middle = whole(image, depth, region)
        across, up = scale(image.camera, box.centre[1], middle)
        self.height = box.h / up  # m
        self.width = max(box.w / across, SLIM * self.height)  # m; who is seen from the side turns
        self.first = Spot(*box.centre, middle)
        self.middle = float(in_base(image.camera, self.first)[2])  # m above the floor
        at = self.box(self.first, image)
        boxes = np.array([[at.x, at.y, at.w, at.h]])
        shown = self._shown(image, depth, middle, boxes)
        if shown is None:
            raise UsageError("there is nothing to learn in that box; draw it around the person")
        kernel = depth is None or not settings.depth_mask
        self.model = PatchModel(
            shown.view, settings.patch, paper, kernel, settings.literal_learning
        )
        top = shown.band.top_row(at, THIN * at.w) if depth is not None else None
        # what depth misses of the head, in heights
        self._brim = 0.0 if top is None else min(max((top - at.y) / at.h, -HIGHEST), HIGHEST)

    def look(
        self, image: Image, expected: Spot, gate: float, dt: float, rng: np.random.Generator
    ) -> Sight:
        """The person near where they are expected, `gate` m off at most in any direction."""
        s = self.settings
        depth, middle = self._depth(image), expected.depth
        reach = gate * image.camera.fx / middle
        nobody = Found.NOTHING
        if depth is not None:
            box = self.box(expected, image)
            here = modes(depth, box)
            mode = person_mode(here, middle, min(gate, s.gate_m))
            if mode is None and _missing(depth, box) <= UNKNOWN:
                before = sum(m.mass for m in here if m.depth < middle - 0.5 * s.gate_m)
                nobody = Found.HIDDEN if before > 0.5 else Found.NOTHING
                mode, aside = self._aside(depth, box, middle, min(gate, s.gate_m), reach)
                if mode is None:
                    return Sight(nobody)
                expected = replace(expected, u=expected.u + aside)
            if mode is None:
                depth = None
            else:
                body = self.box(replace(expected, depth=mode.depth), image)
                middle = torso_depth(depth, body, mode.depth) or mode.depth
        boxes = self._candidates(image, replace(expected, depth=middle), reach, rng)
        shown = self._shown(image, depth, middle, boxes)
        if shown is None:
            return Sight(nobody)
        verdict = self.model.judge(shown.view, occlusion=s.occlusion)
        best = int(verdict.score.argmax())
        hidden = float(verdict.hidden[best]) if s.occlusion else 0.0
        if hidden > s.patch.partial:
            self.model.distrust()
        if hidden > s.patch.full:
            return Sight(Found.HIDDEN)
        if not accepted(verdict, best, s.patch):
            return Sight(Found.HIDDEN if hidden > s.patch.partial else nobody)
        self._gain = shown.gain
        is_whole = hidden <= s.patch.partial
        if is_whole:
            self.model.learn(shown.view, verdict, best, dt)
        alike = likeness(verdict, best)
        sight = Sight(Found.PERSON, confidence(verdict, best), is_whole=is_whole, likeness=alike)
        return self._placed(sight, image, boxes[best], middle if depth is not None else None, shown)

    def find(self, image: Image, near: Array | None, reach: float) -> Sight:
        """The person anywhere in an image with depth, by how they looked first.

        Bodies farther than `reach` m from `near` (3,), in `base`, are somebody else; of those who
        are alike the nearer one is chosen.
        """
        depth, camera, patch = self._depth(image), image.camera, self.settings.patch
        if depth is None:
            return Sight(Found.NOTHING)
        best, sight = 0.0, Sight(Found.NOTHING)
        looked = 0
        for body, middle in bodies(depth, camera):
            spot = Spot(body.centre[0], row(camera, middle, self.middle), middle)
            away = 0.0 if near is None else float(np.hypot(*(in_base(camera, spot) - near)[:2]))
            if away > reach:
                continue
            looked += 1
            middle = torso_depth(depth, self.box(spot, image), middle) or middle
            boxes = self._around(image, replace(spot, depth=middle))
            shown = self._shown(image, depth, middle, boxes)
            if shown is None:
                continue
            occlusion = self.settings.occlusion
            verdict = self.model.judge(shown.view, first_only=True, occlusion=occlusion)
            one = int(verdict.score.argmax())
            is_whole = verdict.hidden[one] <= patch.partial
            score = float(verdict.score[one]) * exp(-2.0 * (away / reach) ** 2)
            if score > best and is_whole and surely(verdict, one, patch):
                best = score
                alike = likeness(verdict, one)
                who = Sight(Found.PERSON, confidence(verdict, one), likeness=alike)
                sight = self._placed(who, image, boxes[one], middle, shown)
                self._gain = shown.gain
            if looked == BODIES:
                break
        return sight

    def box(self, spot: Spot, image: Image) -> Box:
        """The whole person's box around a spot."""
        across, up = scale(image.camera, spot.v, max(spot.depth, 0.3))
        return Box.around(spot.u, spot.v, self.width * across, self.height * up)

    def _aside(
        self, depth: Depth, box: Box, middle: float, gate: float, reach: float
    ) -> tuple[Mode | None, float]:
        """The fullest mode near the expected depth in boxes aside, and how far aside, px."""
        best: Mode | None = None
        shift = 0.0
        for dx in (reach * ASIDE).tolist():
            there = modes(depth, replace(box, x=box.x + dx))
            mode = person_mode(there, middle, gate)
            if mode is not None and (best is None or mode.mass > best.mass):
                best, shift = mode, dx
        return best, shift

    def _depth(self, image: Image) -> Depth | None:
        if image.depth is None or not self.settings.use_depth:
            return None
        return levelled(image.camera, image.depth)

    def _candidates(
        self, image: Image, spot: Spot, reach: float, rng: np.random.Generator
    ) -> Array:
        """Boxes (M, 4) x, y, w, h around a spot, itself the first, up to `reach` px aside."""
        px = image.camera.width / 640.0
        spread = min(max(reach / (40.0 * px), 1.0), WIDEST)
        shifts = spread * px * np.arange(-40.0, 41.0, 10.0), px * np.array([0.0, -20.0, 20.0])
        x, y, scale = (a.ravel() for a in np.meshgrid(*shifts, (1.0, 0.93, 1.07)))
        wild = self.settings.random_px * px * rng.standard_normal((self.settings.random_boxes, 2))
        x, y = np.concatenate([[0.0], x, wild[:, 0]]), np.concatenate([[0.0], y, wild[:, 1]])
        scale = np.concatenate([[1.0], scale, np.ones(len(wild))])
        at = self.box(spot, image)
        w, h = at.w * scale, at.h * scale
        return np.column_stack([spot.u + x - 0.5 * w, spot.v + y - 0.5 * h, w, h])

    def _around(self, image: Image, spot: Spot) -> Array:
        """Boxes (M, 4) around a body, which need not be cut out exactly."""
        at = self.box(spot, image)
        x, y = np.meshgrid(at.x + SHIFTS * at.w, at.y + LIFTS * at.h)
        return np.column_stack([x.ravel(), y.ravel(), np.full((x.size, 2), (at.w, at.h))])

    def _shown(
        self, image: Image, depth: Depth | None, middle: float, boxes: Array
    ) -> Shown | None:
        """What boxes show; None outside the image."""
        low, high = boxes[:, :2].min(axis=0), (boxes[:, :2] + boxes[:, 2:]).max(axis=0)
        window = crop(Box(*low, *(high - low)), image.pixels.shape[1], image.pixels.shape[0])
        if not all(part.stop > part.start for part in window):
            return None
        gated = self.settings.depth_mask
        band = Band(depth, middle, window, gated)
        if not band.mask.any():
            return None
        gain = 1.0
        if gated and depth is not None and not self._paper:
            gain = self._light(image, band, box_of(boxes[0]))
        cell = int(min(max(boxes[0, 2] / CELLS, 2), 5))
        shown = Window(image.pixels, band, window, cell, self._buffers, gain)
        return Shown(shown.view(boxes, self.settings.patch.measured), band, gain)

    def _light(self, image: Image, band: Band, box: Box) -> float:
        """The gain that makes the person in a box as bright as they were first."""
        seen = band.brightness(image.pixels, box, self.settings.patch.measured)
        if self._bright is None:
            self._bright = seen
        gains = self._bright / np.maximum(seen, 1.0)
        gains = gains[np.isfinite(gains)]
        if gains.size < LEAST_LIT:
            return self._gain
        gain = float(np.median(gains))  # patch by patch: more of the trousers is no more light
        return min(max(gain, self._gain / SUDDEN), self._gain * SUDDEN)

    def _placed(
        self, sight: Sight, image: Image, chosen: Array, middle: float | None, shown: Shown
    ) -> Sight:
        """The sight with a box, at the depth `middle` or, without one, as far as it is small.

        Where nothing hides them the outline tells place and height better than the grid of boxes.
        """
        box = box_of(chosen)
        if middle is not None and sight.is_whole and self.settings.depth_mask:
            u = shown.band.column(Box(box.x, box.y, box.w, TORSO * box.h))
            top = shown.band.top_row(box, THIN * box.w)
            near = self.box(Spot(*box.centre, middle), image)  # as large as the depth says
            x = near.x if u is None else u - 0.5 * near.w
            y = near.y if top is None else top - self._brim * near.h
            box = Box(x, y, near.w, near.h)
        depth = middle
        if depth is None:
            depth = self.height * scale(image.camera, box.centre[1], 1.0)[1] / box.h
        by_depth = middle is not None
        return replace(sight, box=box, spot=Spot(*box.centre, depth), by_depth=by_depth)


def _missing(depth: Depth, box: Box) -> float:
    """Share of a box without depth."""
    rows, columns = crop(box, depth.shape[1], depth.shape[0])
    part = depth[rows, columns][::4, ::4]
    return float(np.isnan(part).mean()) if part.size else 0.0
