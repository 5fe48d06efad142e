"""Scenes for the stream-field follow law: what a laser sees of walls and pillars, and a drive."""

from dataclasses import dataclass, field
from itertools import pairwise
from math import atan2, hypot, pi

import numpy as np

from followerd.control.clearance import Footprint
from followerd.control.interfaces import Scene, Target, View
from followerd.control.stream_follow import StreamFollow
from followerd.geometry import Array, Pose2
from followerd.messages import Scan, TrackPhase, Twist
from followerd.perception.clusters import ClusterSettings, find_clusters
from followerd.sim.raycast import cast

BEAMS = np.radians(np.arange(-90.0, 90.5, 1.0))
BODY = Footprint(0.21, 0.30, 0.213)
DT = 0.05  # s
NOTHING = np.empty((0, 4))


def walls(*corners: tuple[float, float]) -> Array:
    """A line of walls (M, 4) from point to point."""
    return np.array([(*a, *b) for a, b in pairwise(corners)])


def view_of(base: Pose2, stamp: float, segments: Array, circles: Array) -> View:
    """What a noiseless laser in the robot's middle sees."""
    angles = base.theta + BEAMS
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    ranges = cast(np.array([base.x, base.y]), rays, segments, circles)
    ranges[ranges > 8.0] = np.inf
    scan = Scan(stamp, stamp, -0.5 * pi, pi / 180, ranges, 8.0, np.zeros(BEAMS.size), Pose2())
    points = scan.points()
    return View(scan, points, find_clusters(scan, points, ClusterSettings()), base)


@dataclass
class Drive:
    """A robot that does what the law wishes, at most at 0.7 m/s."""

    segments: Array = field(default_factory=lambda: NOTHING)
    circles: Array = field(default_factory=lambda: np.empty((0, 3)))
    base: Pose2 = field(default_factory=Pose2)
    law: StreamFollow = field(default_factory=StreamFollow)
    now: float = 1.0
    trace: list[Pose2] = field(default_factory=list)
    touched: bool = False

    def sees(self, x: float, y: float) -> bool:
        """Whether nothing stands between the robot and a point."""
        way = np.array([x - self.base.x, y - self.base.y])
        distance = float(np.hypot(*way))
        here = np.array([self.base.x, self.base.y])
        found = cast(here, (way / distance)[None], self.segments, self.circles)
        return bool(found[0] > distance)

    def target(
        self,
        x: float,
        y: float,
        velocity: tuple[float, float] = (0.0, 0.0),
        sigma: float = 0.1,
        phase: TrackPhase = TrackPhase.CONFIRMED,
    ) -> Target:
        """The person at (x, y), seen from the robot now."""
        bx, by = (~self.base).apply_point(x, y)
        along = Pose2(theta=-self.base.theta).apply_point(*velocity)
        return Target(atan2(by, bx), hypot(bx, by), along, sigma, phase)

    def wish(self, target: Target) -> Twist:
        """What the law wishes now."""
        view = view_of(self.base, self.now, self.segments, self.circles)
        return self.law.wish(target, Scene(self.now, self.base, Twist(), view=view))

    def step(self, target: Target) -> Twist:
        """Wish, and drive so for a moment."""
        wish = self.wish(target)
        slower = min(1.0, 0.7 / abs(wish.v)) if wish.v else 1.0
        self.base = self.base.moved(slower * wish.v, wish.omega, DT)
        self.now += DT
        self.trace.append(self.base)
        everywhere = self.base.theta + np.linspace(-pi, pi, 240)
        rays = np.column_stack([np.cos(everywhere), np.sin(everywhere)])
        here = np.array([self.base.x, self.base.y])
        ranges = cast(here, rays, self.segments, self.circles)
        points = (here + ranges[:, None] * rays)[np.isfinite(ranges)]
        self.touched |= bool(BODY.covers((~self.base).apply(points)).any())
        return wish
