"""What a follow law is to the pipeline, and what it is told."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array, Pose2
from followerd.messages import Clusters, LookAt, Odometry, Scan, Sight, TrackPhase, Twist, Wish


@dataclass(frozen=True, slots=True)
class Target:
    """The followed person, seen from `base` now."""

    bearing: float  # rad, left positive
    range: float | None = None  # m; None = unknown
    velocity: tuple[float, float] = (0.0, 0.0)  # m/s over the ground, along the axes of `base`
    sigma: float = inf  # m, of the position
    phase: TrackPhase = TrackPhase.CONFIRMED


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A scan, and where it was taken."""

    scan: Scan
    points: Array  # (N, 2) m, end points in `base` then, nan where nothing was seen
    clusters: Clusters
    base: Pose2  # odom_from_base then
    mapped: npt.NDArray[np.bool_] | None = None  # (K,) clusters that the map's walls explain
    map_from_odom: Pose2 | None = None  # then; None without a map, and while lost


def unforeseen(stamp: float) -> float | None:
    """Nobody is in sight."""
    del stamp
    return None


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What a follow law may look at besides its target."""

    now: float  # s
    base: Pose2  # odom_from_base now
    twist: Twist  # of the robot now
    odometry: Odometry | None = None  # newest report of the base
    view: View | None = None  # newest scan
    claimed: tuple[slice, ...] = ()  # beams of the view that show the followed person
    sight: Sight | None = None  # newest sight of the person
    foresee: Callable[[float], float | None] = unforeseen  # s -> rad in `odom`, their direction


class Controller(Protocol):
    """A follow law: it only wishes; the modes and the guard decide."""

    def wish(self, target: Target, scene: Scene, /) -> Wish:
        """The motion that follows `target`."""


@runtime_checkable
class HeadController(Controller, Protocol):
    """A follow law that turns the camera's head too."""

    def look(self, scene: Scene, /) -> LookAt | None:
        """Where the head is to point; None = as before."""


@runtime_checkable
class Sketched(Protocol):
    """A follow law that can show what it is after."""

    def sketch(self) -> Array:
        """The way it means to take, (N, 2) m in `odom`, the goal last; empty: straight on."""

    def lines(self) -> Array:
        """Stream lines (K, N, 2) that it goes with, m in `odom`."""
