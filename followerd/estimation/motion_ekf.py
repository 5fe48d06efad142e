"""The followed person in the robot's own axes: a Kalman filter that takes out the robot's motion.

Jia et al. 2015, eq. 9 and 10, repaired. The printed matrix turns the position where it should turn
the velocity; here the state is [x, y, z, vx, vy, ax, ay] in `base`, v and a the person's velocity
over ground and its change, along the robot's present axes, and between two looks the robot moves by
odometry. That is linear in the state; what the odometry errs by (the paper's control noise) comes
in by its derivative. Who walks a bend goes on in it for a while, and nobody keeps their pace for
ever: acceleration and velocity fade (Singer 1970), which foresees better than a steady velocity.
"""

from collections import deque
from dataclasses import dataclass
from math import cos, exp, hypot, radians, sin

import numpy as np
from pydantic import Field

from followerd.geometry import Array, Pose2
from followerd.settings import Settings

CHI_SQUARE_99 = 11.3  # 3 degrees of freedom
HISTORY = 16  # looks that a late one may be sorted in between
PAIRS = slice(0, 2), slice(3, 5), slice(5, 7)  # of the state, that turn with the robot
SLOPE = np.array([[0.0, 1.0], [-1.0, 0.0]])  # of a vector seen from a robot that turns left


class MotionEkfSettings(Settings):
    """What is believed of the person's motion, of the odometry and of the camera's depth."""

    accel_mps2: float = Field(0.3, gt=0, description="deviation of the walking person's")
    bend_s: float = Field(1.0, gt=0, description="time in which an acceleration fades")
    pace_s: float = Field(3.0, gt=0, description="time in which a velocity fades")
    rise_m: float = Field(0.05, gt=0, description="deviation of the height, after a second")
    odometry_speed_mps: float = Field(0.03, ge=0, description="deviation of the robot's speed")
    odometry_turn_degps: float = Field(2.0, ge=0, description="deviation of its turn rate")
    depth_sigma_m: float = Field(0.02, gt=0, description="along the line of sight")
    depth_sigma_per_m: float = Field(0.003, ge=0, description="and per square metre of range")
    aside_sigma_m: float = Field(0.03, gt=0, description="across the line of sight")
    doubt_mps: float = Field(1.0, ge=0, description="of the speed, after a look not believed")
    unsure_after_s: float = Field(0.5, gt=0, description="unseen that long, people turn off")
    unsure_factor: float = Field(2.0, ge=1, description="by which their acceleration then grows")


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A place measured at a time, or only the time."""

    stamp: float  # s
    ego: Pose2 | None  # odom_from_base then; None = the robot stands
    z: Array | None = None  # (3,) m, in `base`
    R: Array | None = None  # (3, 3) m², its covariance; None = as measured by depth


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Where the person is, and how fast."""

    x: Array  # (7,) x, y, z m, vx, vy m/s, ax, ay m/s², in `base`
    P: Array  # (7, 7)


class MotionEkf:
    """One person, from a first place on. Looks may come late, but not before the first."""

    def __init__(self, first: Look, settings: MotionEkfSettings | None = None) -> None:
        if first.z is None:
            raise ValueError("the first look must say where the person is")
        self.settings = settings or MotionEkfSettings()
        x = np.array([*first.z, 0.0, 0.0, 0.0, 0.0])
        change = self.settings.accel_mps2**2
        self.estimate = Estimate(x, np.diag([0.01, 0.01, 0.01, 1.0, 1.0, change, change]))
        self.look = first
        self.seen = first.stamp  # s, of the newest measurement that was believed
        self._past: deque[tuple[Look, Estimate, float]] = deque(maxlen=HISTORY)

    def step(self, look: Look) -> bool:
        """Take a look; whether its measurement, if any, was believed.

        One that is older than the newest is taken where it belongs, and the later ones again.
        """
        later: list[Look] = []
        while look.stamp < self.look.stamp and self._past:
            later.append(self.look)
            self.look, self.estimate, self.seen = self._past.pop()
        if look.stamp < self.look.stamp:
            for again in reversed(later):
                self._take(again)
            return False
        believed = self._take(look)
        for again in reversed(later):
            self._take(again)
        return believed

    def foreseen(self, stamp: float, ego: Pose2 | None) -> Estimate:
        """Where the person should be at a later `stamp`."""
        dt = max(stamp - self.look.stamp, 0.0)
        before = self.look.ego
        move = Pose2() if before is None or ego is None else ~before @ ego
        unsure = stamp - self.seen > self.settings.unsure_after_s
        return predicted(self.estimate, dt, move, self.settings, unsure)

    def noise(self, z: Array) -> Array:
        """Covariance (3, 3) of a place measured by depth."""
        s, away = self.settings, hypot(z[0], z[1])
        return sight_noise(z, s.depth_sigma_m + s.depth_sigma_per_m * away**2, s.aside_sigma_m)

    def _take(self, look: Look) -> bool:
        self._past.append((self.look, self.estimate, self.seen))
        self.estimate = self.foreseen(look.stamp, look.ego)
        self.look = look
        if look.z is None:
            return False
        R = self.noise(look.z) if look.R is None else look.R
        if nis(self.estimate, look.z, R) > CHI_SQUARE_99:
            # it is somebody else, or they have turned on their heel: the next looks will tell
            doubt = np.diag([0.0, 0.0, 0.0, *[self.settings.doubt_mps**2] * 2, 0.0, 0.0])
            self.estimate = Estimate(self.estimate.x, self.estimate.P + doubt)
            return False
        self.estimate = updated(self.estimate, look.z, R)
        self.seen = look.stamp
        return True


def sight_noise(z: Array, deep: float, aside: float) -> Array:
    """Covariance (3, 3) of a place that errs by `deep` along the line of sight, `aside` across."""
    away = max(hypot(z[0], z[1]), 1e-3)
    c, s = z[0] / away, z[1] / away
    R = np.diag([0.0, 0.0, aside**2])
    turn = np.array([[c, -s], [s, c]])
    R[:2, :2] = (turn * (deep**2, aside**2)) @ turn.T
    return R


def predicted(
    now: Estimate, dt: float, move: Pose2, settings: MotionEkfSettings, unsure: bool = False
) -> Estimate:
    """`dt` seconds later (eq. 9), the robot having moved by `move` in its old axes."""
    c, s = cos(move.theta), sin(move.theta)
    turn = np.array([[c, s], [-s, c]])  # old axes into new ones
    pace, bend = exp(-dt / settings.pace_s), exp(-dt / settings.bend_s)
    path, gain = settings.pace_s * (1.0 - pace), settings.bend_s * (1.0 - bend)
    F = np.zeros((7, 7))
    F[:2, :2], F[:2, 3:5], F[:2, 5:] = turn, path * turn, settings.bend_s * (dt - gain) * turn
    F[2, 2], F[3:5, 3:5], F[3:5, 5:], F[5:, 5:] = 1.0, pace * turn, gain * turn, bend * turn
    x = F @ now.x
    x[:2] -= turn @ (move.x, move.y)
    B = np.zeros((7, 2))  # by the robot's speed and turn rate
    half = 0.5 * move.theta
    B[:2, 0] = -dt * cos(half), dt * sin(half)
    for pair in PAIRS:
        B[pair, 1] = dt * SLOPE @ x[pair]
    control = settings.odometry_speed_mps**2, radians(settings.odometry_turn_degps) ** 2
    accel = settings.accel_mps2 * (settings.unsure_factor if unsure else 1.0)
    G = np.zeros((7, 2))
    G[:2], G[3:5], G[5:] = 0.5 * dt * dt * np.eye(2), dt * np.eye(2), np.eye(2)
    Q = (B * control) @ B.T + accel**2 * (1.0 - bend**2) * (G @ G.T)
    Q[2, 2] += settings.rise_m**2 * dt
    return Estimate(x, F @ now.P @ F.T + Q)


def nis(prior: Estimate, z: Array, R: Array) -> float:
    """Squared distance of a place (3,) from where it should be (chi-square, 3)."""
    y = z - prior.x[:3]
    return float(y @ np.linalg.solve(prior.P[:3, :3] + R, y))


def updated(prior: Estimate, z: Array, R: Array) -> Estimate:
    """With a place `z` (3,) of covariance `R` (eq. 10; Joseph form)."""
    H = np.eye(3, 7)
    K = prior.P[:, :3] @ np.linalg.inv(prior.P[:3, :3] + R)
    rest = np.eye(7) - K @ H
    P = rest @ prior.P @ rest.T + K @ R @ K.T
    return Estimate(prior.x + K @ (z - prior.x[:3]), 0.5 * (P + P.T))
