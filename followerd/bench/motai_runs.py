"""Suite `motai`, open loop: one predictor on the looks at one target."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians
from time import perf_counter

import numpy as np
import numpy.typing as npt

from followerd.bench.motai_target import FRAMES, PERIOD, SIGMA, SPEEDS, looks, target_motion
from followerd.estimation.direction import Look
from followerd.estimation.predictors import Kind, predictor
from followerd.geometry import Array

FOCAL = 686.0  # px: 640 px over 50 degrees
TURNING = 5.0  # deg/s², of the target
HEAD_LAG = 2  # frames that the camera's pan is behind the target


@dataclass(frozen=True, slots=True)
class Job:
    """One run of one predictor."""

    target: str  # A, B or C
    speed: str
    kind: Kind
    seed: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """What is kept of it; angles in deg, (FRAMES,)."""

    job: Job
    true: Array
    foreseen: Array
    turning: npt.NDArray[np.bool_]
    columns: Array  # px, where it was seen from the image's middle
    times: Array  # us, of each step

    @property
    def step_us(self) -> float:
        """Median time of a step."""
        return float(np.median(self.times))

    @property
    def errors(self) -> Array:
        """Absolute, one step ahead."""
        errors: Array = np.abs(self.foreseen - self.true)
        return errors


def run_all(jobs: Sequence[Job]) -> list[Outcome]:
    """Several runs in one worker."""
    return [run(job) for job in jobs]


def run(job: Job) -> Outcome:
    """One run; the target and its noise depend on the seed alone, so predictors are paired."""
    rng = np.random.default_rng([job.seed, "ABC".index(job.target), list(SPEEDS).index(job.speed)])
    true, accel = target_motion(rng, job.speed)
    seen = looks(rng, true, job.target)
    head = np.concatenate([np.full(HEAD_LAG, true[0]), true[:-HEAD_LAG]])
    columns = np.round(-FOCAL * np.tan(np.radians(seen[:FRAMES] - head[:FRAMES])))  # whole pixels
    filter_ = predictor(job.kind, radians(SIGMA[job.target]), np.random.default_rng(job.seed))
    foreseen, times = np.empty(FRAMES), np.empty(FRAMES)
    for k in range(FRAMES):
        look = Look(k * PERIOD, float(columns[k]), 0.0, radians(head[k]), 0.0, FOCAL)
        start = perf_counter()
        filter_.step(look)
        pan, _ = filter_.ahead(PERIOD)
        times[k] = perf_counter() - start
        foreseen[k] = degrees(pan)
    turning = np.abs(accel[1 : FRAMES + 1]) > TURNING
    turning[2:] |= turning[:-2] | turning[1:-1]
    return Outcome(job, true[1 : FRAMES + 1], foreseen, turning, columns, 1e6 * times)
