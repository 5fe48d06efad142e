"""Monte Carlo localisation: a cloud of poses, moved by the odometry, weighed by scans.

What a scan says of a pose is a Sensor's: scan_histogram (Kwolek 2004) or likelihood_field.
"""

from math import hypot, radians
from typing import Protocol

import numpy as np
from pydantic import Field

from followerd.estimation.particles import resample
from followerd.estimation.pose_cloud import (
    MotionNoise,
    array_of,
    covariance,
    cube_estimate,
    mean_pose,
    moved,
    perturbed,
)
from followerd.geometry import Array, Pose2
from followerd.messages import RobotPose, Scan
from followerd.settings import Settings

START_M, START_RAD = 0.1, radians(3.0)  # deviation of a start that was told
FIT_MEMORY = 0.1  # of the usual fit, per update
HALVINGS = 10  # to find a power
FEWEST_BEAMS = 10  # a scan with fewer echoes says nothing


class Sensor(Protocol):
    """What one scan says about poses (3, N) on the map."""

    def see(self, scan: Scan, person: tuple[float, float] | None) -> int:
        """Take a scan without the beams on the person (in `base`); how many echoes are left."""

    def log_likelihood(self, poses: Array) -> Array:
        """Of the scan (N,), up to a constant."""

    def fit(self, pose: Pose2) -> float:
        """How much of the scan the map explains from there, 0..1."""

    def search(self, count: int, rng: np.random.Generator) -> Array:
        """Poses (3, count) drawn around those of the whole map that fit best."""

    def anywhere(self, count: int, rng: np.random.Generator) -> Array:
        """Poses (3, count), each as likely as the other before a scan was seen."""


class MclSettings(Settings):
    """The filter, whatever weighs it."""

    particles: int = Field(1000, ge=10, le=100_000)
    motion: MotionNoise = MotionNoise()
    min_move_m: float = Field(0.05, ge=0, description="since the last scan used; a standing")
    min_turn_deg: float = Field(3.0, ge=0, description="robot's scans tell the same again")
    seeded_share: float = Field(0.9, ge=0, le=1, description="of a start at large, by search")
    injected_share: float = Field(0.02, ge=0, le=0.5, description="drawn anew when resampling")
    shake_m: float = Field(0.08, ge=0, description="of unlikely particles after resampling")
    shake_deg: float = Field(5.0, ge=0)
    least_effective: float = Field(
        0.02, ge=0, le=0.5, description="share of the particles that one scan must leave"
    )
    cubes: int = Field(8, ge=1, description="best particles tried as middle of the estimate")
    draws: int = Field(0, ge=0, le=10_000, description="round the estimate, to sharpen it")
    draw_m: float = Field(0.08, gt=0, description="their deviation")
    draw_deg: float = Field(1.5, gt=0)
    misfit: float = Field(0.7, ge=0, le=1, description="fit below which a search is worth while")
    misfit_drop: float = Field(0.07, gt=0, le=1, description="below the usual fit, likewise")
    misfit_updates: int = Field(1, ge=1, description="in a row, before one is made")
    search_pause: int = Field(3, ge=0, description="updates from one search to the next")
    search_gain: float = Field(0.0, ge=0, le=1, description="of the fit, or it found nothing")
    search_weight: float = Field(0.3, gt=0, lt=1, description="of all that a search found")
    sure_share: float = Field(0.8, ge=0, le=1, description="of the weight near the estimate")
    sure_updates: int = Field(3, ge=1, description="in a row, before the pose is relied on")


class Mcl:
    """A Localizer: the cloud and what is thought of it."""

    def __init__(self, sensor: Sensor, settings: MclSettings, rng: np.random.Generator) -> None:
        self.sensor, self.settings, self._rng = sensor, settings, rng
        self.start(None)

    def start(self, at: Pose2 | None) -> None:
        """See Localizer."""
        n = self.settings.particles
        self.poses: Array | None = None
        self.weights: Array = np.full(n, 1.0 / n)
        if at is not None:
            scale = np.array([[START_M], [START_M], [START_RAD]])
            self.poses = array_of(at) + scale * self._rng.standard_normal((3, n))
        self._ego: Pose2 | None = None
        self._sure = self.settings.sure_updates if at is not None else 0
        self._misfits = 0
        self._usual_fit = 0.0
        self._last: RobotPose | None = None

    def step(
        self, scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        """See Localizer. Scans of a robot that has not moved only carry the pose on."""
        if self._last is not None and self._ego is not None and not self._has_moved(ego):
            return self._carried(self._last, scan.stamp, ego)
        if self.poses is not None and self._ego is not None:
            self.poses = moved(self.poses, ~self._ego @ ego, self.settings.motion, self._rng)
        self._ego = ego
        if self.sensor.see(scan, person) < FEWEST_BEAMS:
            return self._carried(self._last, scan.stamp, ego) if self._last else None
        self._last = self._updated(scan.stamp, ego)
        return self._last

    def _has_moved(self, ego: Pose2) -> bool:
        s = self.settings
        assert self._ego is not None
        step = ~self._ego @ ego
        return hypot(step.x, step.y) >= s.min_move_m or abs(step.theta) >= radians(s.min_turn_deg)

    def _carried(self, last: RobotPose, stamp: float, ego: Pose2) -> RobotPose:
        pose = last.map_from_odom @ ego
        return RobotPose(stamp, pose, last.map_from_odom, last.covariance, last.lost)

    def _updated(self, stamp: float, ego: Pose2) -> RobotPose:
        """Weigh, estimate, resample."""
        s = self.settings
        if self.poses is None:
            self.poses = self._seeded(s.particles, s.seeded_share)
        if self._misfits >= s.misfit_updates:
            self._search()
        log = self.sensor.log_likelihood(self.poses)
        log -= log.max()
        is_sure = self._sure >= s.sure_updates
        least = 0.0 if is_sure else s.least_effective * log.size
        self.weights = tempered(self.weights, log, least)
        pose, share = cube_estimate(self.poses, self.weights, s.cubes)
        pose = self._sharpened(pose)
        spread = covariance(self.poses, self.weights, pose)
        fits = self._fits(self.sensor.fit(pose))
        self._misfits = 0 if fits else self._misfits + 1
        self._sure = min(self._sure + 1, s.sure_updates) if fits and share > s.sure_share else 0
        if 1.0 / float(self.weights @ self.weights) < 0.5 * self.weights.size:
            self._resample(np.exp(log))
        lost = self._sure < s.sure_updates
        return RobotPose(stamp, pose, pose @ ~ego, spread, lost)

    def _sharpened(self, pose: Pose2) -> Pose2:
        """The mean of fresh draws round `pose`: after a long step few of the cloud are so near."""
        s = self.settings
        if not s.draws:
            return pose
        scale = np.array([[s.draw_m], [s.draw_m], [radians(s.draw_deg)]])
        draws = array_of(pose) + scale * self._rng.standard_normal((3, s.draws))
        log = self.sensor.log_likelihood(draws)
        return mean_pose(draws, np.exp(log - log.max()))

    def _fits(self, fit: float) -> bool:
        """Whether the scan fits as well as scans did while the pose was relied on."""
        s = self.settings
        fits = fit >= max(s.misfit, self._usual_fit - s.misfit_drop)
        if fits and self._sure >= s.sure_updates:
            self._usual_fit += FIT_MEMORY * (fit - self._usual_fit)
        return fits

    def _seeded(self, count: int, share: float) -> Array:
        """Poses (3, count), a share of them where the scan fits."""
        best = int(share * count)
        found = [self.sensor.search(best, self._rng)] if best else []
        return np.concatenate([*found, self.sensor.anywhere(count - best, self._rng)], axis=1)

    def _search(self) -> None:
        """What fits the scan much better elsewhere replaces the lighter half of the cloud."""
        s = self.settings
        assert self.poses is not None
        self._misfits = -s.search_pause
        half = self.weights.size // 2
        found = self._seeded(half, s.seeded_share)
        best = found[:, self.sensor.log_likelihood(found).argmax()]
        here, _ = cube_estimate(self.poses, self.weights, s.cubes)
        if self.sensor.fit(Pose2(*best.tolist())) < self.sensor.fit(here) + s.search_gain:
            return
        light = self.weights.argpartition(half)[:half]
        self.poses[:, light] = found
        self.weights[light] = 0.0
        self.weights *= (1.0 - s.search_weight) / float(self.weights.sum())
        self.weights[light] = s.search_weight / half

    def _resample(self, likelihood: Array) -> None:
        s, n = self.settings, self.weights.size
        assert self.poses is not None
        chosen = resample(self.weights, self._rng)
        turn = radians(s.shake_deg)
        self.poses = perturbed(
            self.poses[:, chosen], likelihood[chosen], s.shake_m, turn, self._rng
        )
        injected = int(s.injected_share * n)
        if injected:
            picked = self._rng.integers(0, n, injected)
            self.poses[:, picked] = self.sensor.anywhere(injected, self._rng)
        self.weights = np.full(n, 1.0 / n)


def tempered(weights: Array, log_likelihood: Array, least: float) -> Array:
    """Weights (N,) times the likelihood, or the power of it that leaves `least` effective ones.

    One scan that a wrong pose explains a little better must not end the right one.
    """
    kept, low, high, power = weights, 0.0, 1.0, 1.0
    for _ in range(HALVINGS):
        product: Array = weights * np.exp(power * log_likelihood)
        product /= product.sum()
        if 1.0 / float(product @ product) >= least:
            kept, low = product, power
            if power == 1.0:
                break
        else:
            high = power
        power = 0.5 * (low + high)
    return kept
