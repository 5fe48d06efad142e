"""Motai's targets: how they turn (slow, moderate, fast), and how they are seen (A, B, C)."""

from math import pi

import numpy as np

from followerd.geometry import Array

FRAMES = 98
PERIOD = 1 / 15  # s
SUBSTEPS = 10  # of the target's motion, per frame

# rate, deg/s; acceleration, deg/s²; time between reversals, s
SPEEDS = {
    "slow": ((3.0, 8.0), 10.0, (2.5, 4.5)),
    "moderate": ((12.0, 25.0), 60.0, (1.2, 2.2)),
    "fast": ((30.0, 55.0), 500.0, (0.6, 1.4)),
}
SIGMA = {"A": 0.15, "B": 0.7, "C": 0.8}  # deg, what the predictors are told of the looks' noise


def target_motion(rng: np.random.Generator, speed: str) -> tuple[Array, Array]:
    """Angle, deg, and acceleration, deg/s², (FRAMES + 2,) of a target that reverses at times."""
    (slowest, fastest), most, pause = SPEEDS[speed]
    dt = PERIOD / SUBSTEPS
    angle, rate, time = 0.0, 0.0, 0.0
    wanted = rng.uniform(slowest, fastest) * rng.choice([-1.0, 1.0])
    reversal = rng.uniform(*pause)
    angles, accels = [], []
    for k in range((FRAMES + 2) * SUBSTEPS):
        if time >= reversal:
            wanted = -np.sign(wanted) * rng.uniform(slowest, fastest)
            reversal = time + rng.uniform(*pause)
        accel = min(max((wanted - rate) / dt, -most), most)
        rate, angle, time = rate + accel * dt, angle + rate * dt, time + dt
        if k % SUBSTEPS == 0:
            angles.append(angle)
            accels.append(accel)
    return np.array(angles), np.array(accels)


def looks(rng: np.random.Generator, true: Array, target: str) -> Array:
    """The measured angles, deg: jitter, sway of the gait, and looks at something else."""
    n, seen = true.size, true.astype(float)
    sway = 0.5 * np.sin(2 * pi * 1.8 * PERIOD * np.arange(n) + rng.uniform(0.0, 2 * pi))
    if target == "A":
        seen += 0.1 * rng.standard_normal(n)
        return seen
    if target == "B":
        seen += 0.45 * rng.standard_normal(n) + sway
        wild = rng.random(n) < 0.01
        seen[wild] += rng.uniform(-40.0, 40.0, wild.sum())
        return seen
    seen += 0.6 * rng.standard_normal(n) + sway
    source = rng.uniform(-20.0, 20.0)
    k = 0
    while k < n:
        if rng.random() < 0.03:
            burst = slice(k, k + int(rng.integers(1, 4)))
            seen[burst] = source + 0.6 * rng.standard_normal(seen[burst].size)
            k = burst.stop
        k += 1
    return seen
