"""A person as a grid of patches, each with a colour and a texture histogram.

Jia et al. 2015, section 3, repaired: the pole of eq. 7 is cut off, patches that are hidden or hold
nobody do not count, the model of eq. 11 learns slowly, and its first state is kept for ever.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.geometry import Array
from followerd.messages import Box, Pixels
from followerd.perception.cells import Buffers, CellHistograms
from followerd.perception.colour_bins import COLOURS, colour_bins, dithered
from followerd.perception.depth_band import Band
from followerd.perception.texture import FLAT, PATTERNS, patterns
from followerd.settings import Settings

Map = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

MOST = 19.0  # of eq. 7, reached at a similarity of 0.975
WHOLE = 4  # patches a side that a whole box is weighted by
LEAST_TEXTURE = 0.05  # share of a patch's pixels with a pattern, that tell something
TINY = 1e-9


class PatchSettings(Settings):
    """When patches are alike, hidden or of no use, and how fast they are learned."""

    patches: int = Field(4, ge=1, le=8, description="a side; 1 is one whole box, weighted")
    similar: float = Field(0.80, gt=0, lt=1, description="a patch this like its model passes")
    passing: float = Field(0.6, gt=0, le=1, description="share of patches that must pass")
    strictly: float = Field(0.75, gt=0, le=1, description="the same, for a person found again")
    least_patches: int = Field(4, ge=1, description="fewer that are not hidden say nothing")
    least_cover: float = Field(0.2, gt=0, lt=1, description="share of a patch the person covers")
    hidden: float = Field(0.5, gt=0, lt=1, description="share of a patch with something before it")
    partial: float = Field(0.10, gt=0, lt=1, description="share of hidden patches: no learning")
    full: float = Field(0.75, gt=0, lt=1, description="share of hidden patches: nothing is seen")
    learning_per_s: float = Field(0.5, ge=0, description="of a patch that is the model's equal")
    learn_delay: int = Field(3, ge=0, description="frames not hidden before one is learned")

    @property
    def measured(self) -> int:
        """Patches a side that are measured."""
        return self.patches if self.patches > 1 else WHOLE


class View(NamedTuple):
    """What M boxes show in P patches each."""

    colours: Map  # (M, P, COLOURS) counts
    textures: Map  # (M, P, PATTERNS)
    cover: Array  # (M, P) share of what is not hidden or unknown that is the person
    hidden: Array  # (M, P) share with something before the person
    inside: Array  # (M, P) share that is in the image


class Verdict(NamedTuple):
    """How like the model each of M boxes is."""

    score: Array  # (M,) eq. 8, times how well the outline fits
    colour: Array  # (M,) share of the usable patches that pass by colour
    texture: Array  # (M,)
    usable: Array  # (M,) patches
    hidden: Array  # (M,) share of the person's patches
    rho: Array  # (2, M, P) similarities by colour and texture
    fit: Array  # (M,) agreement of the outlines, 0..1
    tells: Mask  # (M, P) patches that are usable


class Window:
    """A part of the image in which boxes are compared, made brighter by `gain`."""

    def __init__(
        self,
        pixels: Pixels,
        band: Band,
        window: tuple[slice, slice],
        cell: int,
        buffers: Buffers,
        gain: float = 1.0,
    ) -> None:
        self._band = band
        rows, columns = window
        tall, wide = band.bounds()
        # what lies outside is nobody
        part: Pixels = np.ascontiguousarray(pixels[rows, columns][tall, wide])
        if gain != 1.0:
            part = np.asarray(cv2.convertScaleAbs(part, alpha=gain), np.uint8)
        grey = part if part.ndim == 2 else np.asarray(cv2.cvtColor(part, cv2.COLOR_BGR2GRAY))
        self._histograms = CellHistograms(
            (colour_bins(dithered(part)), patterns(np.asarray(grey, np.uint8))),
            (COLOURS, FLAT + 1),
            band.mask[tall, wide],
            cell,
            buffers,
            columns.start + wide.start,
            rows.start + tall.start,
        )

    def view(self, boxes: Array, side: int) -> View:
        """Boxes (M, 4) x, y, w, h in px, in `side` patches a side."""
        steps = np.linspace(0.0, 1.0, side + 1)
        columns = boxes[:, 0, None] + boxes[:, 2, None] * steps
        rows = boxes[:, 1, None] + boxes[:, 3, None] * steps
        found = self._histograms.of(columns, rows)
        person, nearer, unknown, area = np.moveaxis(self._band.counts(columns, rows), -1, 0)
        whole = (boxes[:, 2] * boxes[:, 3])[:, None] / side**2
        return View(
            found[..., :COLOURS],
            found[..., COLOURS : COLOURS + PATTERNS],
            person / np.maximum(area - nearer - unknown, 1.0),
            nearer / np.maximum(area - unknown, 1.0),
            (area - unknown) / whole,
        )


@dataclass(slots=True, eq=False)
class Look:
    """What is remembered of every patch; histograms have unit length."""

    colours: Map  # (P, COLOURS)
    textures: Map  # (P, PATTERNS)
    cover: Array  # (P,)

    def mirrored(self, side: int) -> "Look":
        """The same, left and right exchanged."""
        order = np.arange(side * side).reshape(side, side)[:, ::-1].ravel()
        return Look(self.colours[order], self.textures[order], self.cover[order])


class PatchModel:
    """The enrolled person's patches: as they were first, and as they look now."""

    def __init__(
        self,
        view: View,
        settings: PatchSettings,
        paper: bool,
        kernel: bool = False,
        literal: bool = False,
    ) -> None:
        """`literal` learns by eq. 11 alone: at the printed rate, and without the first look."""
        self.settings = settings
        self._literal = literal or paper
        self._paper = paper
        self._kernel = _epanechnikov(settings.patches) if kernel else None
        self.first = self._look(view)
        self.now = self.first
        self._waiting: list[tuple[Look, Array]] = []
        self._arrange()

    def judge(self, view: View, first_only: bool = False, occlusion: bool = True) -> Verdict:
        """How like the person every box of a view is."""
        s = self.settings
        view = self._whole(view)
        looks = self._looks[:2] if first_only else self._looks  # (mirrored) first, (mirrored) now
        rho = np.stack(
            [
                _cosine(view.colours, np.stack([look.colours for look in looks], axis=-1)),
                _cosine(view.textures, np.stack([look.textures for look in looks], axis=-1)),
            ]
        )  # (2, M, P, looks)
        rho = np.maximum(rho[..., :2], rho[..., -2:])  # (2, M, P, as it is or mirrored)
        plain = ~self.first.textures.any(axis=1)  # patches too even to have a texture
        rho[1][:, plain] = rho[0][:, plain]
        covers = np.stack([looks[-2].cover, looks[-1].cover], axis=-1)  # (P, 2)
        hidden = (view.hidden >= s.hidden) if occlusion else np.zeros(view.hidden.shape, np.bool_)
        in_image = view.inside > 0.5
        usable = (view.cover >= s.least_cover) & ~hidden & in_image
        weight = usable if self._kernel is None else usable * self._kernel
        g = rho**2 / np.maximum(1.0 - rho**2, TINY if self._paper else 1.0 / (1.0 + MOST))
        g = np.minimum(g, 1e6 if self._paper else MOST)
        total = np.maximum(weight.sum(axis=1), TINY)
        means = (g * weight[..., None]).sum(axis=2) / total[:, None]  # (2, M, 2)
        fit = _agreement(view.cover, covers, ~hidden & in_image)
        score = means.prod(axis=0) * (1.0 if self._paper else fit**2)
        best = score.argmax(axis=1)
        which = np.arange(len(best))
        rho = np.moveaxis(rho, -1, 0)[best, :, which].swapaxes(0, 1)  # (2, M, P)
        passes = ((rho >= s.similar) & usable).sum(axis=2) / np.maximum(usable.sum(axis=1), 1)
        covered = covers[:, best].T
        own = (covered >= s.least_cover) & in_image
        return Verdict(
            score[which, best],
            passes[0],
            passes[1],
            usable.sum(axis=1),
            (hidden & own).sum(axis=1) / np.maximum(own.sum(axis=1), 1),
            rho,
            fit[which, best],
            usable,
        )

    def learn(self, view: View, verdict: Verdict, box: int, dt: float) -> None:
        """Move the model towards what box number `box` shows, some frames later (eq. 11).

        As it is printed, the rate is the similarity itself, at once.
        """
        s = self.settings
        view = self._whole(View(*(part[box : box + 1] for part in view)))
        seen, rho = self._look(view), verdict.rho[:, box]
        usable = (view.cover[0] >= s.least_cover) & (view.hidden[0] < s.hidden)
        if self._literal:
            self._mix(seen, rho * usable)
            return
        rates = np.clip((rho - s.similar) / (1.0 - s.similar), 0.0, 1.0)
        rates = np.maximum(rates, 0.4 * rates[::-1])  # one feature vouches for the other
        self._waiting.append((seen, np.minimum(rates * s.learning_per_s * dt, 1.0) * usable))
        if len(self._waiting) > s.learn_delay:
            self._mix(*self._waiting.pop(0))

    def distrust(self) -> None:
        """Forget what was seen in the last frames: something begins to hide the person."""
        self._waiting.clear()

    def _mix(self, seen: Look, rates: Array) -> None:
        colour, texture = rates[:, :, None].astype(np.float32)
        now = self.now
        cover = rates.max(axis=0)
        self.now = Look(
            _unit(now.colours + colour * (seen.colours - now.colours)),
            _unit(now.textures + texture * (seen.textures - now.textures)),
            now.cover + cover * (seen.cover - now.cover),
        )
        self._arrange()

    def _arrange(self) -> None:
        side = self.settings.patches
        first = self.now if self._literal else self.first
        self._looks = [first, first.mirrored(side), self.now, self.now.mirrored(side)]
        if self._paper:  # knows no turned person
            self._looks = [first, first, self.now, self.now]

    def _look(self, view: View) -> Look:
        view = self._whole(view)
        textured = view.textures[0].sum(axis=1) > LEAST_TEXTURE * view.colours[0].sum(axis=1)
        textures = _unit(view.textures[0]) * textured[:, None]
        return Look(_unit(view.colours[0]), textures, view.cover[0])

    def _whole(self, view: View) -> View:
        """Patches as they are, or all of them as one, the outer ones counting less."""
        if self.settings.patches > 1 or view.cover.shape[1] == 1:
            return view
        weight = _epanechnikov(WHOLE)
        parts = (np.einsum("mp...,p->m...", part, weight)[:, None] for part in view)
        return View(*parts)


def likeness(verdict: Verdict, box: int) -> Array:
    """How like the model each patch (P,) of a box is, 0..1; nan where it tells nothing."""
    alike: Array = np.where(verdict.tells[box], verdict.rho[:, box].min(axis=0), np.nan)
    return alike


def accepted(verdict: Verdict, box: int, settings: PatchSettings) -> bool:
    """Whether a box is the person: both features pass, or one does where light or pose changed."""
    both = min(verdict.colour[box], verdict.texture[box])
    one = max(verdict.colour[box], verdict.texture[box])
    share = settings.passing
    passes = both >= share or (one >= 0.9 and both >= 0.5 * share)
    return bool(passes and _tells(verdict, box, settings))


def surely(verdict: Verdict, box: int, settings: PatchSettings) -> bool:
    """Whether a box is the person wherever it is: both features pass."""
    both = min(verdict.colour[box], verdict.texture[box])
    return bool(both >= settings.strictly and _tells(verdict, box, settings))


def _tells(verdict: Verdict, box: int, settings: PatchSettings) -> bool:
    """Whether enough of a box is to be seen."""
    return bool(verdict.usable[box] >= min(settings.least_patches, settings.patches**2))


def confidence(verdict: Verdict, box: int) -> float:
    """Share 0..1 of the usable patches that pass, by both features."""
    return 0.5 * float(verdict.colour[box] + verdict.texture[box])


def box_of(row: Array) -> Box:
    """A row x, y, w, h as a box."""
    x, y, w, h = row.tolist()
    return Box(x, y, w, h)


def _cosine(histograms: Map, models: Map) -> Map:
    """Similarity (M, P, K) of histograms (M, P, B) to K models (P, B, K) of unit length."""
    length = np.sqrt(np.einsum("mpb,mpb->mp", histograms, histograms))
    product = np.matmul(histograms.swapaxes(0, 1), models).swapaxes(0, 1)
    return np.asarray(product / np.maximum(length, TINY)[..., None], np.float32)


def _agreement(cover: Array, models: Array, counts: Mask) -> Array:
    """How much (M, K) of covers (M, P) and of model covers (P, K) is common."""
    seen = cover[..., None]
    common = np.minimum(seen, models) * counts[..., None]
    either = np.maximum(seen, models) * counts[..., None]
    share: Array = common.sum(axis=1) / np.maximum(either.sum(axis=1), TINY)
    return share


def _unit(histograms: Map) -> Map:
    length = np.sqrt(np.einsum("pb,pb->p", histograms, histograms))
    return np.asarray(histograms / np.maximum(length, TINY)[:, None], np.float32)


def _epanechnikov(side: int) -> Array:
    """Weights (P,) of patches: 1 in the middle of the box, falling to its border."""
    middle = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    weight: Array = np.maximum(1.0 - 0.5 * (middle[:, None] ** 2 + middle**2), 0.05)
    return weight.ravel()
