"""Potential flow toward a goal and round discs: how a person walks, and how a robot may.

Tseng and Tang 2009, eq. (3)-(4), put right: a sink of strength U at s has the complex potential
W = -U log(z - s), a disc in its way adds an image sink at the inverse point and an equal source at
the disc's centre (circle theorem), and the velocity is the conjugate of dW/dz. Points of the plane
are complex numbers x + iy, m.
"""

import numpy as np
import numpy.typing as npt

Complex = npt.NDArray[np.complex128]
Floats = npt.NDArray[np.float64]

NEAREST = 1e-3  # m, to a sink: nearer counts as this
FASTEST = 1.8  # m/s
OUTWARD = 0.3  # m/s, for who stands inside a disc
RIM = 1.02  # radii from a disc's centre below which a goal lies inside it
WALL = 0.02  # m from a disc, within which nothing flows into it


def velocity(
    at: Complex, sink: Complex, strength: Floats, centres: Complex, radii: Floats
) -> Complex:
    """Velocities (N,), m/s, at points (N,) drawn by sinks (N,) of `strength` (N,), m²/s.

    Discs (M,) have `centres` and `radii`. For several discs their images are summed, which is a
    first order; the wall rule then keeps the flow out of the nearest.
    """
    slope = -strength * _reciprocal(at - sink)
    if not centres.size:
        return _capped(slope.conj())
    off = at[:, None] - centres
    to_sink = sink[:, None] - centres
    gap = np.sqrt(off.real**2 + off.imag**2) - radii
    nobody = (gap < 0.0) | (to_sink.real**2 + to_sink.imag**2 < (RIM * radii) ** 2)
    # 1 / (off - inverse) - 1 / off with the inverse point a² / conj(to_sink), in one fraction
    power = radii**2
    divisor = off * (off * to_sink.conj() - power)
    size2 = divisor.real**2 + divisor.imag**2
    size2[nobody] = np.inf
    images = ((power / size2) * divisor).conj()
    flow = _capped((slope - strength * images.sum(axis=1)).conj())
    rows = np.arange(at.size)
    nearest = gap.argmin(axis=1)
    gap, off = gap[rows, nearest], off[rows, nearest]
    outward = off / np.maximum(gap + radii[nearest], NEAREST)
    into = np.minimum((flow * outward.conj()).real, 0.0)
    flow -= np.where(gap < WALL, into, 0.0) * outward
    flow += np.where(gap < 0.0, OUTWARD, 0.0) * outward
    return _capped(flow)


def lines(
    starts: Complex, sinks: Complex, centres: Complex, radii: Floats, step: float, count: int
) -> Complex:
    """Stream lines (N, count) from points (N,) to their sinks, in steps of `step`, m."""
    strength = np.ones(starts.size)
    points = [starts]
    for _ in range(count - 1):
        at = points[-1]
        flow = velocity(at, sinks, strength, centres, radii)
        way = np.minimum(step, np.abs(sinks - at)) / np.maximum(np.abs(flow), NEAREST)
        points.append(at + way * flow)
    return np.stack(points, axis=1)


def discs(segments: npt.ArrayLike, radius: float = 0.28, spacing: float = 1.2) -> Complex:
    """Centres (M,) of a chain of discs along boards (K, 2, 2), `spacing` radii apart, m."""
    centres = []
    for (ax, ay), (bx, by) in np.asarray(segments, float).tolist():
        start, end = complex(ax, ay), complex(bx, by)
        count = max(int(np.ceil(abs(end - start) / (spacing * radius))), 1)
        centres.append(start + (end - start) * (np.arange(count) + 0.5) / count)
    return np.concatenate(centres) if centres else np.empty(0, complex)


def _reciprocal(z: Complex) -> Complex:
    """1/z, its size no larger than at NEAREST."""
    size = np.maximum(np.abs(z), NEAREST)
    result: Complex = z.conj() / (size * size)
    return result


def _capped(flow: Complex) -> Complex:
    speed = np.abs(flow)
    slower: Complex = flow * np.where(speed > FASTEST, FASTEST / np.maximum(speed, FASTEST), 1.0)
    return slower
