"""Walkers: where they are, how fast, and where their legs are, as functions of scenario time.

A walker knows nothing of the robot. Its way is worked out tick by tick, only as far as asked.
"""

from collections.abc import Generator, Iterator
from math import asin, atan2, ceil, copysign, cos, exp, hypot, pi, radians, sin, sqrt, tau
from typing import NamedTuple

import numpy as np

from followerd.errors import ConfigError
from followerd.geometry import wrap_angle
from followerd.sim.scenarios import Arc, Mover, Outfit, Person, draw

TICK = 0.02  # s, grid of the tabulated motion
ACCELERATION = 0.7  # m/s2, of a person setting off or stopping
TURN_LAG = 0.25  # s, the body turns after the path
LEG_RADIUS = 0.065  # m, of a trouser leg at the laser's height
CROSSING = 0.3  # m, paths that come this near to each other cross
HIP = 0.085  # m, half the distance of the legs


class Motion(NamedTuple):
    """A walker at one time."""

    x: float  # m
    y: float  # m
    heading: float  # rad
    speed: float  # m/s; negative where the walker goes backward
    phase: float  # rad of the gait, grows for ever; pi a step

    @property
    def velocity(self) -> tuple[float, float]:
        """m/s, in the world."""
        return self.speed * cos(self.heading), self.speed * sin(self.heading)


class Walker:
    """A person or ball on its way."""

    def __init__(self, mover: Mover, rng: np.random.Generator) -> None:
        self.mover = mover
        self.name = mover.name
        self._hold = 0.0  # s by which the whole way is put off
        self._ticks = _way(mover, rng)
        self._table = [next(self._ticks)]

    def at(self, time: float) -> Motion:
        """The motion at scenario time `time` >= 0, s."""
        index, part = divmod(max(0.0, time - self._hold) / TICK, 1.0)
        i = int(index)
        while len(self._table) < i + 2:
            self._table.append(next(self._ticks))
        a, b = self._table[i], self._table[i + 1]
        return Motion(
            a.x + part * (b.x - a.x),
            a.y + part * (b.y - a.y),
            a.heading + part * wrap_angle(b.heading - a.heading),
            a.speed + part * (b.speed - a.speed),
            a.phase + part * (b.phase - a.phase),
        )


class Pedestrian(Walker):
    """A person on the way, with a body and clothes."""

    def __init__(self, person: Person, outfit: Outfit, rng: np.random.Generator) -> None:
        super().__init__(person, rng)
        self.outfit = outfit
        self._backward = person.backward
        self.height = draw(person.height_m, rng)
        self.crosses = None if person.crosses_m is None else draw(person.crosses_m, rng)

    def at(self, time: float) -> Motion:
        """The motion at scenario time `time` >= 0, s."""
        motion = super().at(time)
        if not self._backward:
            return motion
        return motion._replace(heading=wrap_angle(motion.heading + pi), speed=-motion.speed)

    def cross(self, target: Walker, duration: float) -> None:
        """Set out so as to cross the target's path `crosses` m behind the target."""
        times = np.arange(0.0, duration, 0.1)
        own = np.array([self.at(t)[:2] for t in times.tolist()])
        other = np.array([target.at(t)[:2] for t in times.tolist()])
        gaps = np.hypot(*(own[:, None] - other[None]).transpose(2, 0, 1))
        mine, theirs = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
        if gaps[mine, theirs] > CROSSING:
            raise ConfigError(f"{self.name}: crosses_m is given, but its path meets no target's")
        gone = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(other, axis=0).T))])
        due = np.searchsorted(gone, gone[theirs] + (self.crosses or 0.0))
        self._hold = max(0.0, float(times[min(due, len(times) - 1)] - times[mine]))


def step_length(speed: float) -> float:
    """Length of one step at a walking speed, m (0.4 m at a stroll, 0.7 m at 1.2 m/s)."""
    return 0.28 + 0.36 * speed


def swing(motion: Motion, side: int) -> float:
    """How far the left (+1) or right (-1) foot is ahead of the body, m.

    Nearly a triangle wave, as steep as the body is fast: the standing foot stays on its place.
    """
    speed = abs(motion.speed)
    reach = copysign(0.5 * step_length(speed), motion.speed) * min(1.0, speed / 0.15)
    return side * reach * asin(0.97 * sin(motion.phase)) / 0.97 * 2.0 / pi


def lift(motion: Motion, side: int) -> float:
    """How far the foot is off the floor while it swings forward, m."""
    forward = side * cos(motion.phase)
    return 0.09 * max(0.0, forward) * min(1.0, abs(motion.speed) / 0.6)


def legs(motion: Motion, height: float, above: float) -> list[tuple[float, float]]:
    """Centres (x, y) of both legs `above` m over the floor of a person `height` m tall."""
    c, s = cos(motion.heading), sin(motion.heading)
    share = min(1.0, max(0.0, (0.5 * height - above) / (0.5 * height - 0.08)))
    centres = []
    for side in (1, -1):
        ahead = share * swing(motion, side)
        centres.append(
            (motion.x + c * ahead - s * side * HIP, motion.y + s * ahead + c * side * HIP)
        )
    return centres


def _way(mover: Mover, rng: np.random.Generator) -> Iterator[Motion]:
    """The motion on the grid of TICK, for ever."""
    if mover.arc is not None:
        yield from _around(mover.arc, draw(mover.start_after_s, rng), rng)
    stops = [(draw(stop.x_m, rng), draw(stop.y_m, rng)) for stop in mover.path]
    facing = radians(draw(mover.facing_deg, rng))
    wait = draw(mover.start_after_s, rng)
    phase = float(rng.uniform(0.0, tau))
    if len(stops) == 1:
        yield from _stand(Motion(*stops[0], facing, 0.0, phase), None)
    line = _Line(stops, mover.corner_radius_m, mover.loop)
    last = Motion(*line.start, 0.0, phase)
    yield from _stand(last, wait)
    while True:
        last = yield from _walk_along(line, mover, last, rng)
        if not mover.loop:
            yield from _stand(last, None)


def _stand(motion: Motion, seconds: float | None) -> Iterator[Motion]:
    """Standing still, for ever when `seconds` is None."""
    motion = motion._replace(speed=0.0)
    ticks = 0
    while seconds is None or ticks * TICK < seconds:
        yield motion
        ticks += 1


def _walk_along(
    line: "_Line", mover: Mover, motion: Motion, rng: np.random.Generator
) -> Generator[Motion, None, Motion]:
    """Once along the line: speeds and pauses are drawn leg by leg; returns the last motion."""
    stops = mover.path[1:] + (mover.path[:1] if mover.loop else ())
    last = not mover.loop
    s = 0.0
    heading, speed, phase = motion.heading, motion.speed, motion.phase
    for number, (stop, end) in enumerate(zip(stops, line.marks, strict=True)):
        wanted = draw(stop.speed_mps, rng)
        pause = draw(stop.pause_s, rng)
        halts = pause > 0.0 or (last and number == len(stops) - 1)
        while s < end - 1e-3:
            brake = sqrt(2.0 * ACCELERATION * max(0.0, end - s - speed * TICK)) if halts else wanted
            aim = min(wanted, max(brake, 0.03))
            change = ACCELERATION * TICK
            speed += min(change, max(-change, aim - speed))
            s = min(end, s + speed * TICK)
            x, y, tangent = line.at(s)
            heading += wrap_angle(tangent - heading) * (1.0 - exp(-TICK / TURN_LAG))
            phase += pi * speed * TICK / step_length(speed)
            motion = Motion(x, y, heading, speed, phase)
            yield motion
        if halts:
            yield from _stand(motion, pause)
            speed = 0.0
    return motion


def _around(arc: Arc, wait: float, rng: np.random.Generator) -> Iterator[Motion]:
    """To and fro on a circle, for ever."""
    radius, start = draw(arc.radius_m, rng), radians(draw(arc.start_deg, rng))
    side = 1.0 if rng.random() < 0.5 else -1.0
    angle, rate, phase = start, 0.0, float(rng.uniform(0.0, tau))
    wanted, left = 0.0, wait
    while True:
        turned = angle - start
        if left <= 0.0 or (wanted * turned > 0 and abs(turned) > radians(arc.within_deg)):
            side = -side
            wanted = side * radians(draw(arc.rate_dps, rng))
            left = draw(arc.reversal_s, rng)
        change = radians(arc.accel_dps2) * TICK
        rate += min(change, max(-change, wanted - rate))
        angle, left = angle + rate * TICK, left - TICK
        speed = abs(rate) * radius
        phase += pi * speed * TICK / step_length(speed)
        x, y = arc.x_m + radius * cos(angle), arc.y_m + radius * sin(angle)
        yield Motion(x, y, wrap_angle(angle + copysign(0.5 * pi, side)), speed, phase)


class _Line:
    """The way points joined by straight lines with rounded corners."""

    def __init__(self, stops: list[tuple[float, float]], radius: float, loop: bool) -> None:
        points: list[tuple[float, float]] = [] if loop else [stops[0]]
        middles = []  # index of the sample nearest to each way point after the first
        corners = range(len(stops)) if loop else range(1, len(stops) - 1)
        for i in corners:
            arc = _rounded(stops[i - 1], stops[i], stops[(i + 1) % len(stops)], radius)
            middles.append(len(points) + len(arc) // 2)
            points += arc
        if loop:  # start in the first corner's middle and come back there
            first = middles[0]
            points = points[first:] + points[: first + 1]
            middles = [m - first for m in middles[1:]] + [len(points) - 1]
        else:
            middles.append(len(points))
            points.append(stops[-1])
        self._points = np.array(points)
        steps = np.hypot(*np.diff(self._points, axis=0).T)
        self._s = np.concatenate([[0.0], np.cumsum(steps)])
        self.marks = [float(self._s[m]) for m in middles]
        self._index = 0

    @property
    def start(self) -> tuple[float, float, float]:
        """x, y and heading at the start."""
        return self.at(0.0)

    def at(self, s: float) -> tuple[float, float, float]:
        """x, y and tangent at arc length `s`; `s` grows but for starting again."""
        if s < self._s[self._index]:
            self._index = 0
        while self._index < len(self._s) - 2 and self._s[self._index + 1] <= s:
            self._index += 1
        i = self._index
        (ax, ay), (bx, by) = self._points[i].tolist(), self._points[i + 1].tolist()
        part = (s - float(self._s[i])) / max(1e-9, float(self._s[i + 1] - self._s[i]))
        return ax + part * (bx - ax), ay + part * (by - ay), atan2(by - ay, bx - ax)


def _rounded(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], radius: float
) -> list[tuple[float, float]]:
    """Points of a curve that leaves a-b, bends near b and joins b-c (a quadratic Bezier)."""
    before, after = hypot(b[0] - a[0], b[1] - a[1]), hypot(c[0] - b[0], c[1] - b[1])
    cut = min(radius, 0.45 * before, 0.45 * after)
    p = (b[0] + cut * (a[0] - b[0]) / before, b[1] + cut * (a[1] - b[1]) / before)
    q = (b[0] + cut * (c[0] - b[0]) / after, b[1] + cut * (c[1] - b[1]) / after)
    count = 2 * ceil(cut / 0.05) + 2
    weights = [(1 - t) for t in np.linspace(0.0, 1.0, count + 1).tolist()]
    return [
        (
            w * w * p[0] + 2 * w * (1 - w) * b[0] + (1 - w) ** 2 * q[0],
            w * w * p[1] + 2 * w * (1 - w) * b[1] + (1 - w) ** 2 * q[1],
        )
        for w in weights
    ]
