"""The target's own turn, from the flow of its image less what the camera's motion explains.

Motai, Jha and Kruse 2012, section 4. Image x right and y down from the centre, px; `focal` px.
Angles left and up positive (REP-103), so that the paper's omega_y is -pan' and omega_x is tilt'.
"""

from math import atan, sqrt, tan

Pair = tuple[float, float]


def angles(x: float, y: float, pan: float, tilt: float, focal: float) -> Pair:
    """Direction (pan, tilt), rad, of image point (x, y) by a head at (pan, tilt) (eq. 21-23)."""
    return pan - atan(x / focal), tilt - atan(y / sqrt(focal * focal + x * x))


def pixels(direction: Pair, pan: float, tilt: float, focal: float) -> Pair:
    """Image point (x, y) where a head at (pan, tilt) sees a direction; the inverse of `angles`."""
    x = focal * tan(pan - direction[0])
    return x, sqrt(focal * focal + x * x) * tan(tilt - direction[1])


def camera_flow(
    x: float, y: float, turn: Pair, focal: float, ahead: float = 0.0, depth: float | None = None
) -> Pair:
    """Flow (u, v), px/s, of a resting point (eq. 24-25, 33-34).

    `turn` is the head's (pan', tilt'), rad/s; `ahead` the camera's speed along its axis, m/s, which
    counts where the point's `depth`, m, is known.
    """
    omega_x, omega_y = turn[1], -turn[0]
    xy = x * y / focal
    u = xy * omega_x - (focal * focal + x * x) / focal * omega_y
    v = (focal * focal + y * y) / focal * omega_x - xy * omega_y
    if depth is not None:
        u, v = u + x * ahead / depth, v + y * ahead / depth
    return u, v


def following_turn(x: float, y: float, flow: Pair, focal: float) -> Pair:
    """The head's (pan', tilt'), rad/s, that keeps a point of this flow in place (eq. 39-41).

    P is never singular; its inverse in closed form. The paper's V is the rotation that would cause
    the flow: the one that follows it is -V.
    """
    u, v = flow
    xy, D = x * y / focal, focal * focal + x * x + y * y
    omega_x = (-xy * u + (focal * focal + x * x) / focal * v) / D
    omega_y = (-(focal * focal + y * y) / focal * u + xy * v) / D
    return omega_y, -omega_x
