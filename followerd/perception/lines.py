"""Straight walls in a scan: split and merge, with the covariance of each line.

A line is x cos(alpha) + y sin(alpha) = rho, rho >= 0, in the frame of the points.
"""

from dataclasses import dataclass
from math import atan2, cos, hypot, pi, radians, sin, sqrt

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.geometry import Array, wrap_angle
from followerd.messages import Line
from followerd.settings import Settings

Span = tuple[int, int]  # first and last index of a run


class LineSettings(Settings):
    """What counts as one straight wall."""

    gap_m: float = Field(0.15, gt=0, description="between neighbours that ends a wall")
    gap_share: float = Field(0.10, ge=0, description="of the range, if that is more")
    min_points: int = Field(8, ge=4, description="fewest returns of a wall")
    split_m: float = Field(0.03, gt=0, description="a return farther off its wall splits it")
    min_length_m: float = Field(0.4, gt=0, description="shortest wall")
    merge_m: float = Field(0.02, gt=0, description="residual below which neighbours are one wall")
    merge_deg: float = Field(3.0, gt=0, description="between neighbours that are one wall")
    range_sigma_m: float = Field(0.01, gt=0, description="least deviation of a return")


def find_lines(points: Array, settings: LineSettings) -> list[Line]:
    """The walls in a scan's end points (N, 2), nan where nothing was seen."""
    seen = np.flatnonzero(np.isfinite(points[:, 0]))
    if seen.size < settings.min_points:
        return []
    xy = points[seen]
    sums = Sums(xy)
    spans: list[Span] = []
    for first, last in _groups(xy, settings):
        if last - first + 1 >= settings.min_points:
            spans += _merged(sums, _split(xy, first, last, settings.split_m), settings)
    lines = [_fitted(xy, sums, first, last, seen, settings) for first, last in spans]
    return [line for line in lines if line is not None]


@dataclass(frozen=True, slots=True)
class Fit:
    """A run of returns by total least squares."""

    alpha: float  # rad
    rho: float  # m, >= 0
    across: float  # m2, sum of the squares off the line
    along: float  # m2, sum of the squares from the middle along it
    count: int


class Sums:
    """Fits any run of the points (N, 2) at the same cost, by sums up to each of them."""

    def __init__(self, xy: Array) -> None:
        x, y = xy.T
        terms = np.column_stack([x, y, x * x, x * y, y * y])
        self._upto: list[list[float]] = [[0.0] * 5, *np.cumsum(terms, axis=0).tolist()]

    def fit(self, first: int, last: int) -> Fit:
        """The line of the points from `first` to `last`, both counted."""
        before, upto, n = self._upto[first], self._upto[last + 1], last + 1 - first
        sx, sy, sxx, sxy, syy = (after - start for after, start in zip(upto, before, strict=True))
        mx, my = sx / n, sy / n
        xx, xy, yy = sxx - sx * mx, sxy - sx * my, syy - sy * my
        alpha = 0.5 * atan2(-2.0 * xy, yy - xx)
        c, s = cos(alpha), sin(alpha)
        rho = mx * c + my * s
        across = max(0.0, c * c * xx + 2.0 * c * s * xy + s * s * yy)
        along = max(0.0, s * s * xx - 2.0 * c * s * xy + c * c * yy)
        if rho < 0.0:
            alpha, rho = wrap_angle(alpha + pi), -rho
        return Fit(alpha, rho, across, along, n)


def _groups(xy: Array, settings: LineSettings) -> list[Span]:
    """First and last index of each run of returns without a gap."""
    steps = xy[1:] - xy[:-1]
    away = np.sqrt(np.einsum("ij,ij->i", xy, xy))
    gap = np.maximum(settings.gap_m, settings.gap_share * np.minimum(away[1:], away[:-1]))
    cuts = np.flatnonzero(np.einsum("ij,ij->i", steps, steps) > gap * gap)
    starts = [0, *(cuts + 1).tolist()]
    ends = [*cuts.tolist(), len(xy) - 1]
    return list(zip(starts, ends, strict=True))


def _split(xy: Array, first: int, last: int, limit: float) -> list[Span]:
    """Runs in which no return lies farther than `limit` from the chord, in order."""
    waiting, spans = [(first, last)], []
    while waiting:
        a, b = waiting.pop()
        chord = xy[b] - xy[a]
        long = hypot(*chord)
        off = xy[a : b + 1] - xy[a]
        apart = np.abs(off[:, 0] * chord[1] - off[:, 1] * chord[0])
        worst = int(apart.argmax())
        if b - a > 2 and apart[worst] > limit * long and 0 < worst < b - a:
            waiting += [(a + worst, b), (a, a + worst)]
        else:
            spans.append((a, b))
    return spans


def _merged(sums: Sums, spans: list[Span], settings: LineSettings) -> list[Span]:
    """Neighbours that fit one wall are one."""
    merged: list[Span] = []
    for span in spans:
        if merged and _is_one_wall(sums, merged[-1], span, settings):
            merged[-1] = merged[-1][0], span[1]
        else:
            merged.append(span)
    return merged


def _is_one_wall(sums: Sums, one: Span, other: Span, settings: LineSettings) -> bool:
    """Whether the joint fit is good, and the turn between them no more than noise explains."""
    both = sums.fit(one[0], other[1])
    if both.across > settings.merge_m**2 * both.count:
        return False
    fits, doubt = (sums.fit(*one), sums.fit(*other)), radians(settings.merge_deg)
    for fit in fits:
        doubt += 3.0 * settings.range_sigma_m / sqrt(max(fit.along, 1e-9))
    turn = abs(wrap_angle(fits[0].alpha - fits[1].alpha))
    return min(turn, pi - turn) < doubt


def _fitted(
    xy: Array, sums: Sums, first: int, last: int, seen: npt.NDArray[np.intp], settings: LineSettings
) -> Line | None:
    """The wall of a run without its two outermost returns, which may be mixed pixels."""
    n = last - first - 1
    if n < settings.min_points + 1:
        return None
    fit = sums.fit(first + 1, last - 1)
    normal = np.array([cos(fit.alpha), sin(fit.alpha)])
    along = np.array([-sin(fit.alpha), cos(fit.alpha)])
    t = xy[first + 1 : last] @ along
    if t.max() - t.min() < settings.min_length_m:
        return None
    variance = max(settings.range_sigma_m**2, fit.across / n)
    middle = float(t.sum()) / n
    var_alpha = variance / fit.along
    cross = middle * var_alpha  # d rho / d alpha of a fixed centroid is its place along the line
    covariance = np.array([[var_alpha, cross], [cross, variance / n + middle * middle * var_alpha]])
    ends = fit.rho * normal + np.array([[t[0]], [t[-1]]]) * along
    return Line(fit.alpha, fit.rho, covariance, ends, int(seen[first]), int(seen[last]))
