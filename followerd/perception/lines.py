"""Straight walls in a scan: split and merge, with the covariance of each line.

A line is x cos(alpha) + y sin(alpha) = rho, rho >= 0, in the frame of the points.
"""

from math import atan2, cos, hypot, pi, radians, sin, sqrt

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.geometry import Array, wrap_angle
from followerd.messages import Line
from followerd.settings import Settings


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
    spans: list[tuple[int, int]] = []
    for first, last in _groups(xy, settings):
        if last - first + 1 >= settings.min_points:
            spans += _merged(xy, _split(xy, first, last, settings.split_m), settings)
    lines = [_fitted(xy, first, last, seen, settings) for first, last in spans]
    return [line for line in lines if line is not None]


def _groups(xy: Array, settings: LineSettings) -> list[tuple[int, int]]:
    """First and last index of each run of returns without a gap."""
    steps = xy[1:] - xy[:-1]
    away = np.sqrt(np.einsum("ij,ij->i", xy, xy))
    gap = np.maximum(settings.gap_m, settings.gap_share * np.minimum(away[1:], away[:-1]))
    cuts = np.flatnonzero(np.einsum("ij,ij->i", steps, steps) > gap * gap)
    starts = [0, *(cuts + 1).tolist()]
    ends = [*cuts.tolist(), len(xy) - 1]
    return list(zip(starts, ends, strict=True))


def _split(xy: Array, first: int, last: int, limit: float) -> list[tuple[int, int]]:
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


def _merged(
    xy: Array, spans: list[tuple[int, int]], settings: LineSettings
) -> list[tuple[int, int]]:
    """Neighbours that fit one wall are one."""
    merged: list[tuple[int, int]] = []
    for span in spans:
        if merged and _is_one_wall(xy, merged[-1], span, settings):
            merged[-1] = merged[-1][0], span[1]
        else:
            merged.append(span)
    return merged


def _is_one_wall(
    xy: Array, one: tuple[int, int], other: tuple[int, int], settings: LineSettings
) -> bool:
    """Whether the joint fit is good, and the turn between them no more than noise explains."""
    both = xy[one[0] : other[1] + 1]
    alpha, rho = _fit(both)
    residual = both @ (cos(alpha), sin(alpha)) - rho
    if residual.std() > settings.merge_m:
        return False
    directions, doubt = [], radians(settings.merge_deg)
    for first, last in (one, other):
        part = xy[first : last + 1]
        directions.append(_fit(part)[0])
        along = part @ (-sin(alpha), cos(alpha))
        spread = np.square(along - along.mean()).sum()
        doubt += 3.0 * settings.range_sigma_m / sqrt(max(float(spread), 1e-9))
    turn = abs(wrap_angle(directions[0] - directions[1]))
    return min(turn, pi - turn) < doubt


def _fit(xy: Array) -> tuple[float, float]:
    """Total least squares: alpha and rho >= 0."""
    centre = xy.mean(axis=0)
    x, y = (xy - centre).T
    alpha = 0.5 * atan2(-2.0 * float(x @ y), float(y @ y - x @ x))
    rho = float(centre @ (cos(alpha), sin(alpha)))
    return (alpha, rho) if rho >= 0.0 else (wrap_angle(alpha + pi), -rho)


def _fitted(
    xy: Array, first: int, last: int, seen: npt.NDArray[np.intp], settings: LineSettings
) -> Line | None:
    """The wall of a run without its two outermost returns, which may be mixed pixels."""
    inner = xy[first + 1 : last]
    if len(inner) < settings.min_points + 1:
        return None
    alpha, rho = _fit(inner)
    normal, along = np.array([cos(alpha), sin(alpha)]), np.array([-sin(alpha), cos(alpha)])
    t = inner @ along
    if t.max() - t.min() < settings.min_length_m:
        return None
    residual = inner @ normal - rho
    variance = max(settings.range_sigma_m**2, float(residual @ residual) / len(inner))
    middle = float(t.mean())
    var_alpha = variance / float(np.square(t - middle).sum())
    cross = middle * var_alpha  # d rho / d alpha of a fixed centroid is its place along the line
    covariance = np.array(
        [[var_alpha, cross], [cross, variance / len(inner) + middle * middle * var_alpha]]
    )
    ends = rho * normal + np.outer((t[0], t[-1]), along)
    return Line(alpha, rho, covariance, ends, int(seen[first]), int(seen[last]))
