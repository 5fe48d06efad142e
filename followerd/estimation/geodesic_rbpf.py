"""The person walks to one of many goals by the shortest way; free floor with nobody on it counts.

What became of Tseng and Tang 2009 once two things are added: goals are places of the map, reached
over precomputed shortest ways instead of along a stream field, and a scan that looks past a
particle's place and sees nobody speaks against that particle (negative information). Given goal
and speed, place and velocity are linear and Gaussian: a Kalman filter per particle, whose
covariance is the same for all. While the person is hidden it is sampled, so that it can be looked
for where it may be.
"""

from math import exp, pi, sqrt

import numpy as np
from pydantic import Field

from followerd.estimation.geodesic import Ways
from followerd.estimation.occluded import Complex, Sweep
from followerd.estimation.person_filters import Cloud
from followerd.geometry import Array
from followerd.settings import Settings


class GeodesicSettings(Settings):
    """How people walk between goals, and how surely they are seen."""

    particles: int = Field(300, ge=1)
    relax_s: float = Field(0.4, gt=0, description="to take up the wanted velocity")
    heading_rad: float = Field(0.1, ge=0, description="noise of the way's direction")
    velocity_noise: float = Field(0.6, gt=0, description="of the velocity, m/s per root second")
    start_m: float = Field(0.1, gt=0, description="deviation of the first place, per axis")
    arrived_m: float = Field(0.4, gt=0, description="from a goal, when another is taken")
    new_goal_s: float = Field(3.0, gt=0, description="mean time after which minds are changed")
    wander_share: float = Field(0.1, ge=0, le=1, description="of new goals that are none")
    wander_rad: float = Field(0.35, ge=0, description="turn of who has no goal, per 0.25 s")
    fastest_mps: float = Field(1.2, gt=0)
    speed_noise_mps: float = Field(0.3, ge=0, description="per 0.25 s")
    stop_s: float = Field(30.0, gt=0, description="mean time between two stops")
    stand_s: float = Field(1.0, gt=0, description="mean length of a stop")
    body_m: float = Field(0.16, gt=0, description="half width of a person")
    margin_m: float = Field(0.05, ge=0, description="a beam this much longer went past them")
    all_seen: float = Field(0.97, ge=0, lt=1, description="chance to detect who is in full view")
    part_seen: float = Field(0.88, ge=0, lt=1, description="and who is in view for two thirds")


STEP = 0.25  # s, to which noise per step refers
MEDIAN_STEPS = 6
COURSE_STEP, COURSE_STEPS = 0.15, 24  # m, of ways that are drawn
NEAREST = 0.01  # m, from the median: nearer counts as this


class GeodesicRbpf:
    """Places z, velocities v, goals (an index into `ways`, the last for none) and speeds."""

    def __init__(
        self, ways: Ways, rng: np.random.Generator, settings: GeodesicSettings | None = None
    ) -> None:
        self.ways = ways
        self.settings = s = settings or GeodesicSettings()
        self.cloud = Cloud(s.particles, rng)
        self.nowhere = ways.goals.size
        self.v: Complex = np.zeros(s.particles, complex)
        self.goal = np.zeros(s.particles, np.intp)
        self.speed: Array = np.zeros(s.particles)
        self.standing = np.zeros(s.particles, np.bool_)
        self.P = (0.0, 0.0, 0.0)  # of z, of z with v, of v: per axis, of every particle
        self._position: complex | None = None

    def start(self, at: complex) -> None:
        """About `at`, bound for anywhere."""
        s, cloud = self.settings, self.cloud
        cloud.z = np.full(cloud.count, at)
        cloud.w = np.full(cloud.count, 1.0 / cloud.count)
        self.speed = cloud.rng.uniform(0.0, s.fastest_mps, cloud.count)
        self.standing = cloud.rng.random(cloud.count) < s.stand_s / (s.stand_s + s.stop_s)
        self.goal = self._new_goals(cloud.count)
        self.v = self.speed * np.exp(1j * cloud.rng.uniform(-pi, pi, cloud.count))
        self.v = self._wanted(1.0)
        self.P = s.start_m**2, 0.0, 0.3**2
        self._position = None

    def predict(self, dt: float) -> None:
        """Sample minds, then walk."""
        s, cloud, steps = self.settings, self.cloud, sqrt(dt / STEP)
        self._change_minds(dt)
        self.speed = self.speed + steps * s.speed_noise_mps * cloud.rng.standard_normal(cloud.count)
        self.speed = np.abs(self.speed)
        np.minimum(self.speed, s.fastest_mps, out=self.speed)
        wanted = self._wanted(steps)
        keep = exp(-dt / s.relax_s)
        reach = s.relax_s * (1.0 - keep)
        cloud.z = cloud.z + reach * self.v + (dt - reach) * wanted
        self.v = keep * self.v + (1.0 - keep) * wanted
        zz, zv, vv = self.P
        q = s.velocity_noise**2
        self.P = (
            zz + 2.0 * reach * zv + reach**2 * vv + q * dt**3 / 3.0,
            keep * (zv + reach * vv) + q * dt**2 / 2.0,
            keep**2 * vv + q * dt,
        )
        self._position = None

    def nearness(self, at: complex, variance: float) -> tuple[float, float]:
        """Of the mixture."""
        return self.cloud.nearness(at, self.P[0] + variance)

    def correct(self, at: complex, variance: float) -> None:
        """Weigh by the predictive likelihood, then correct places and velocities."""
        zz, zv, vv = self.P
        S = zz + variance
        weighed = self.cloud.weigh(np.exp(-0.5 * self.cloud.offsets2(at) / S))
        off = at - self.cloud.z
        self.cloud.z = self.cloud.z + (zz / S) * off
        self.v = self.v + (zv / S) * off
        self.P = zz * variance / S, zv * variance / S, vv - zv * zv / S
        if weighed:
            self._thin()
        self._position = None

    def miss(self, sweep: Sweep) -> None:
        """Sample what the Kalman filters leave open, then weigh by who should have been seen."""
        self._sample()
        if self.cloud.weigh(1.0 - self.detectable(sweep)):
            self._thin()
        self._position = None

    def detectable(self, sweep: Sweep) -> Array:
        """The chance (N,) that somebody at each particle's place would have been detected.

        Three bearings across the body are looked up in the ranges that were measured, so that what
        is on no map hides people as well.
        """
        s, pose = self.settings, sweep.map_from_laser
        off = (self.cloud.z - complex(pose.x, pose.y)) * np.exp(-1j * pose.theta)
        away = np.maximum(np.abs(off), s.body_m)
        bearing = np.angle(off) - sweep.angle_min
        aside = s.body_m / away
        beams = np.stack([bearing - aside, bearing, bearing + aside]) / sweep.angle_increment
        index = np.rint(beams).astype(np.intp)
        inside = (index >= 0) & (index < sweep.ranges.size)
        past = sweep.ranges[index.clip(0, sweep.ranges.size - 1)] > away + s.margin_m
        count = (past & inside).sum(axis=0)
        chance = np.array([0.0, 0.0, s.part_seen, s.all_seen])[count]
        trusted: Array = chance * np.exp(-np.square(sweep.heading_sigma * away / s.body_m))
        return trusted

    def courses(self, count: int) -> Complex:
        """Ways (count, N) that the person may take, for drawing: to the likeliest goals."""
        weight = np.bincount(self.goal, self.cloud.w, self.nowhere + 1)[: self.nowhere]
        goals = np.argsort(-weight, kind="stable")[:count]
        points = [np.full(goals.size, self.position())]
        for _ in range(COURSE_STEPS):
            cells = self.ways.floor.cells(points[-1])
            way = self.ways.direction[goals, cells]
            left = np.minimum(COURSE_STEP, self.ways.distance[goals, cells])
            points.append(points[-1] + left * way)
        return np.stack(points, axis=1)

    def position(self) -> complex:
        """The weighted geometric median: the least mean distance, also between two ways round."""
        if self._position is None:
            median = self.cloud.mean()
            for _ in range(MEDIAN_STEPS):
                pull = self.cloud.w / np.maximum(np.abs(self.cloud.z - median), NEAREST)
                median = complex((pull * self.cloud.z).sum() / pull.sum())
            self._position = median
        return self._position

    def covariance(self) -> Array:
        """Of the mixture, about `position`."""
        covariance: Array = self.cloud.covariance(self.position()) + self.P[0] * np.eye(2)
        return covariance

    def _new_goals(self, count: int) -> np.ndarray:
        goals = self.cloud.rng.integers(0, self.nowhere, count)
        aimless = self.cloud.rng.random(count) < self.settings.wander_share
        return np.where(aimless, self.nowhere, goals)

    def _change_minds(self, dt: float) -> None:
        """New goals for who arrived or thought better of it; stops, and their ends."""
        s, cloud = self.settings, self.cloud
        chance = cloud.rng.random(cloud.count)
        fickle = chance < 1.0 - exp(-dt / s.new_goal_s)
        cells = self.ways.floor.cells(cloud.z)
        there = self.ways.distance[np.minimum(self.goal, self.nowhere - 1), cells] < s.arrived_m
        change = np.flatnonzero(fickle | (there & (self.goal < self.nowhere)))
        self.goal[change] = self._new_goals(change.size)
        turn = cloud.rng.random(cloud.count)
        stops, goes = 1.0 - exp(-dt / s.stop_s), 1.0 - exp(-dt / s.stand_s)
        self.standing ^= turn < np.where(self.standing, goes, stops)

    def _wanted(self, steps: float) -> Complex:
        """The velocities (N,) that the particles are after: who has no goal walks on."""
        s, cloud = self.settings, self.cloud
        way = self.ways.direction[self.goal, self.ways.floor.cells(cloud.z)]
        on = (self.goal == self.nowhere) & (way == 0.0)
        noise = np.where(on, steps * s.wander_rad, s.heading_rad)
        turn = np.exp(1j * noise * cloud.rng.standard_normal(cloud.count))
        wanted: Complex = np.where(on, self.v, self.speed * way) * turn
        wanted[self.standing] = 0.0
        return wanted

    def _sample(self) -> None:
        """Draw (z, v) of every particle from its Gaussian."""
        zz, zv, vv = self.P
        root = sqrt(max(zz, 1e-12))
        first = self.cloud.noise(1.0)
        self.cloud.z = self.cloud.z + root * first
        rest = sqrt(max(vv - (zv / root) ** 2, 0.0))
        self.v = self.v + (zv / root) * first + self.cloud.noise(rest)
        self.P = 0.0, 0.0, 0.0

    def _thin(self) -> None:
        kept = self.cloud.thin()
        if kept is not None:
            self.cloud.z, self.v = self.cloud.z[kept], self.v[kept]
            self.goal, self.speed = self.goal[kept], self.speed[kept]
            self.standing = self.standing[kept]
