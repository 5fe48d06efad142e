"""The mechanics of the VC-C50i twin: two axes and a zoom lens that take their time.

Top speeds are the manual's. Nobody gives accelerations and the lens's speed: those are guesses
that fit the manual's running times (180° in some 2 s) and the 5 s that clients allow for finding
the home position.
"""

from math import copysign, sqrt
from typing import NamedTuple

import numpy as np

from followerd.hw.vcc50i.models import SLOWEST, Limits

TICK = 0.005  # s
ACCELERATION = 4000.0  # steps/s² (450°/s²)
ZOOM_SPEED = 700.0  # positions/s
ZOOM_ACCELERATION = 7000.0  # positions/s²
BRAKING = 0.7  # of the acceleration, so that it does not run past its goal
OVERSHOOT = 30  # steps beyond home, from where it is approached slowly
HOME_SIGMA = 0.5  # steps by which it finds its home position differently each time


class Axis:
    """One motor on a ramp: accelerates, runs at its speed, and brakes into its goal."""

    def __init__(self, speed: float, acceleration: float) -> None:
        self.position = 0.0
        self.speed = speed
        self._goal: float | None = None
        self._velocity = 0.0
        self._acceleration = acceleration

    @property
    def runs(self) -> bool:
        """Whether it has a goal; one that was halted brakes without saying so."""
        return self._goal is not None

    @property
    def rests(self) -> bool:
        """Whether it stands, and will."""
        return self._goal is None and self._velocity == 0.0

    def go(self, goal: float, speed: float) -> None:
        """Run to `goal`."""
        self._goal, self.speed = goal, speed

    def halt(self) -> None:
        """Brake."""
        self._goal = None

    def cut(self) -> None:
        """Stand at once: no power."""
        self._goal, self._velocity = None, 0.0

    def advance(self, dt: float) -> None:
        """Move on by a tick."""
        way = 0.0 if self._goal is None else self._goal - self.position
        braking = sqrt(2 * BRAKING * self._acceleration * abs(way))
        wanted = copysign(min(self.speed, braking), way)
        change = self._acceleration * dt
        self._velocity += min(max(wanted - self._velocity, -change), change)
        self.position += self._velocity * dt
        arrives = self._goal is not None and (self._goal - self.position) * way <= 0
        if self._goal is not None and arrives and abs(self._velocity) <= 3 * change:
            self.position, self._goal, self._velocity = self._goal, None, 0.0


class Leg(NamedTuple):
    """A part of the way home, in steps and steps/s."""

    pan: float
    tilt: float
    fast: bool


class Head:
    """Pan (right positive) and tilt (up positive) in steps, and the zoom position."""

    def __init__(self, limits: Limits, rng: np.random.Generator) -> None:
        self.limits = limits
        self.pan_speed: float = limits.pan_speed  # steps/s, as set
        self.tilt_speed: float = limits.tilt_speed
        self.knows_home = False
        self.pan = Axis(limits.pan_speed, ACCELERATION)  # these are where it really points
        self.tilt = Axis(limits.tilt_speed, ACCELERATION)
        self.lens = Axis(ZOOM_SPEED, ZOOM_ACCELERATION)
        self._rng = rng
        self._home = (0.0, 0.0)  # where it believes its home position to be
        self._way_home: list[Leg] = []
        self._now = 0.0

    @property
    def counted(self) -> tuple[float, float]:
        """Pan and tilt as it counts them."""
        return self.pan.position - self._home[0], self.tilt.position - self._home[1]

    @property
    def finds_home(self) -> bool:
        """Whether it is on the way to find its home position."""
        return bool(self._way_home)

    @property
    def turns(self) -> bool:
        """Whether pan or tilt runs."""
        return self.pan.runs or self.tilt.runs or self.finds_home

    def go(self, pan: float, tilt: float) -> None:
        """Turn to counted steps."""
        self.pan.go(self._home[0] + pan, self.pan_speed)
        self.tilt.go(self._home[1] + tilt, self.tilt_speed)

    def halt(self) -> None:
        """Brake pan and tilt."""
        self.pan.halt()
        self.tilt.halt()

    def set_speeds(self, pan: float, tilt: float) -> None:
        """For what runs now as well, but the way home."""
        self.pan_speed, self.tilt_speed = pan, tilt
        if not self.finds_home:
            self.pan.speed, self.tilt.speed = pan, tilt

    def find_home(self, *, then_back: bool) -> None:
        """Run past the home position, approach it slowly, and perhaps come back."""
        if not self.finds_home:
            self._home = tuple(self._rng.normal(0.0, HOME_SIGMA, 2).tolist())
            back = [Leg(self.pan.position, self.tilt.position, fast=True)] if then_back else []
            self._way_home = [
                Leg(OVERSHOOT, OVERSHOOT, fast=True),
                Leg(*self._home, fast=False),
                *back,
            ]
            self._start_leg()

    def lose_power(self) -> None:
        """It stands where it is, and does not know where that is."""
        for axis in (self.pan, self.tilt, self.lens):
            axis.cut()
        self._way_home.clear()
        self.knows_home = False
        self.pan_speed, self.tilt_speed = self.limits.pan_speed, self.limits.tilt_speed

    def advance(self, now: float) -> None:
        """Move on to `now`."""
        axes = (self.pan, self.tilt, self.lens)
        while self._now < now and not all(axis.rests for axis in axes):
            dt = min(TICK, now - self._now)
            for axis in axes:
                axis.advance(dt)
            self._now += dt
            if self.finds_home and not (self.pan.runs or self.tilt.runs):
                self._way_home.pop(0)
                self.knows_home = not self.finds_home
                self._start_leg()
        self._now = max(self._now, now)

    def _start_leg(self) -> None:
        if self._way_home:
            leg = self._way_home[0]
            self.pan.go(leg.pan, self.limits.pan_speed if leg.fast else SLOWEST)
            self.tilt.go(leg.tilt, self.limits.tilt_speed if leg.fast else SLOWEST)
