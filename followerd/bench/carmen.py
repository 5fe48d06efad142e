"""CARMEN logs: scans with the odometry of that moment, and corrected poses where they stand there.

Known are FLASER, ROBOTLASER1, ODOM and PARAM lines, and the L and O lines (cm) of Wean Hall's
recordings; other lines are passed over. Where poses were corrected by a mapper that wrote them
over the odometry (an ODOM line of time 0 begins anew from each of them), the odometry is chained
from the steps between.
"""

import gzip
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import hypot, pi
from pathlib import Path
from typing import NamedTuple

import numpy as np

from followerd.bench.laser import LaserStep
from followerd.errors import UsageError
from followerd.geometry import Array, Pose2
from followerd.messages import Scan

NO_ECHO = 50.0  # m; recordings mark it as 50.00, 51.1, 81.83 or 81.91
GZIP = b"\x1f\x8b"
SAME = 1e-3  # m and rad within which two poses of a log are the same


class Sweep(NamedTuple):
    """One laser line as it stands in the log."""

    stamp: float  # s
    first: float  # rad, bearing of the first beam
    step: float  # rad
    ranges: Array  # m
    range_max: float  # m
    laser: Pose2  # of the laser, as logged: corrected or by odometry
    robot: Pose2  # of the robot, as logged


@dataclass(slots=True)
class Chain:
    """Odometry as the steps between ODOM lines tell it, whatever poses they begin anew from."""

    pose: Pose2 = field(default_factory=Pose2)
    last: Pose2 | None = None  # as logged

    def move_to(self, logged: Pose2) -> None:
        """The odometry counts on to `logged`."""
        step = ~self.last @ logged if self.last is not None else logged
        self.pose, self.last = self.pose @ step, logged

    def restart(self, logged: Pose2) -> None:
        """The odometry was set to `logged`; the robot did not move."""
        if self.last is None:
            self.pose = logged
        self.last = logged


class CarmenLog:
    """The scans of a log, counted from 0 in file order; raises UsageError naming the line."""

    frame = "odom"

    def __init__(self, path: Path) -> None:
        self._path = path
        self._sweeps: list[Sweep] = []
        self._chained: list[Pose2] = []
        self._chain, self._is_rewritten = Chain(), False
        self._laser_ahead = 0.0  # m, as PARAM robot_frontlaser_offset says
        for number, line in enumerate(_lines(path), 1):
            try:
                self._read(line.split())
            except (ValueError, IndexError) as error:
                raise UsageError(f"{path}:{number}: broken line: {error}") from None
        if not self._sweeps:
            raise UsageError(f"{path}: not a CARMEN log: it holds no FLASER or ROBOTLASER1 line")
        self.count = len(self._sweeps)
        self.stamps: Array = np.array([sweep.stamp for sweep in self._sweeps])
        self.base_from_laser, self._has_corrected = self._mount()

    @property
    def is_corrected(self) -> bool:
        """Whether the scans have corrected poses."""
        return self._has_corrected

    def __iter__(self) -> Iterator[LaserStep]:
        laser_from_base = ~self.base_from_laser
        for index, sweep in enumerate(self._sweeps):
            scan = Scan(
                sweep.stamp,
                sweep.stamp,
                sweep.first,
                sweep.step,
                sweep.ranges,
                sweep.range_max,
                np.zeros(sweep.ranges.size),
                self.base_from_laser,
            )
            ego = self._chained[index] if self._is_rewritten else sweep.robot
            corrected = sweep.laser @ laser_from_base if self._has_corrected else None
            yield LaserStep(index, scan, ego, corrected)

    def _mount(self) -> tuple[Pose2, bool]:
        """Where the laser sits on the robot, and whether the laser's poses are corrected ones.

        A laser that keeps its place on the robot was not corrected.
        """
        if self._is_rewritten:
            return Pose2(), True
        first, *others = (~sweep.robot @ sweep.laser for sweep in self._sweeps)
        apart = (~first @ other for other in others)
        if all(hypot(p.x, p.y) < SAME and abs(p.theta) < SAME for p in apart):
            return first, False
        return Pose2(self._laser_ahead), True

    def _read(self, words: list[str]) -> None:
        """Take one line in; raises ValueError or IndexError when it is broken."""
        match words[:1]:
            case ["ODOM"]:
                self._read_odometry(words)
            case ["FLASER"]:
                self._take(_flaser(words))
            case ["ROBOTLASER1"]:
                self._take(_robotlaser(words))
            case ["L"]:
                self._take(_wean(words))
            case ["PARAM"] if words[1:2] == ["robot_frontlaser_offset"]:
                self._laser_ahead = float(words[2])

    def _read_odometry(self, words: list[str]) -> None:
        pose, stamp = _pose(words[1:4]), float(words[7])
        if stamp == 0.0 and self._sweeps and pose == self._sweeps[-1].robot:
            self._is_rewritten = True
            self._chain.restart(pose)
        else:
            self._chain.move_to(pose)

    def _take(self, sweep: Sweep) -> None:
        # in a rewritten log the next steps begin here, whether an ODOM line says so or not
        self._chain.restart(sweep.robot)
        self._sweeps.append(sweep)
        self._chained.append(self._chain.pose)


def _lines(path: Path) -> list[str]:
    try:
        content = path.read_bytes()
        if content.startswith(GZIP):
            content = gzip.decompress(content)
        return content.decode().splitlines()
    except FileNotFoundError:
        raise UsageError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: not a CARMEN log: it is no text") from None
    except (OSError, EOFError) as error:
        raise UsageError(f"{path}: cannot be read: {error}") from None


def _flaser(words: list[str]) -> Sweep:
    """FLASER n r1..rn x y theta odom_x odom_y odom_theta t host t."""
    count = _count(words[1])
    _check(words, count + 11)
    poses = words[count + 2 : count + 8]
    first, step = _half_circle(count)
    ranges = _ranges(words[2 : count + 2], NO_ECHO)
    return Sweep(
        _number(words[-3]), first, step, ranges, NO_ECHO, _pose(poses[:3]), _pose(poses[3:])
    )


def _robotlaser(words: list[str]) -> Sweep:
    """ROBOTLASER1 type start fov step max accuracy mode n r1..rn m i1..im poses ... t host t."""
    first, step, range_max = (_number(words[i]) for i in (2, 4, 5))
    count = _count(words[8])
    after = 9 + count
    poses = after + 1 + int(words[after])
    if len(words) < poses + 9:
        raise ValueError(f"{len(words)} words, too few for {count} ranges and two poses")
    if not step > 0.0:
        raise ValueError(f"angular resolution {step:g}, must be above 0")
    ranges = _ranges(words[9:after], range_max)
    laser, robot = _pose(words[poses : poses + 3]), _pose(words[poses + 3 : poses + 6])
    return Sweep(_number(words[-3]), first, step, ranges, range_max, laser, robot)


def _wean(words: list[str]) -> Sweep:
    """L x y theta laser_x laser_y laser_theta r1..rn t, in cm."""
    count = len(words) - 8
    if count < 2:
        raise ValueError(f"{len(words)} words, too few for two poses, ranges and a time")
    first, step = _half_circle(count)
    ranges = _ranges(words[7:-1], 100.0 * NO_ECHO) / 100.0
    robot, laser = _pose(words[1:4], 0.01), _pose(words[4:7], 0.01)
    return Sweep(_number(words[-1]), first, step, ranges, NO_ECHO, laser, robot)


def _half_circle(count: int) -> tuple[float, float]:
    """First bearing and step of a SICK's 180 degrees: 180 beams leave out the last of 181."""
    return -0.5 * pi, pi / (count - count % 2)


def _ranges(words: list[str], farthest: float) -> Array:
    ranges = np.array(words, float)
    ranges[ranges >= farthest] = np.inf
    ranges[ranges <= 0.0] = np.nan
    return ranges


def _pose(words: list[str], scale: float = 1.0) -> Pose2:
    x, y, theta = (_number(word) for word in words)
    return Pose2(scale * x, scale * y, theta)


def _number(word: str) -> float:
    value = float(word)
    if not np.isfinite(value):
        raise ValueError(f"{word} is no finite number")
    return value


def _count(word: str) -> int:
    count = int(word)
    if count < 2:
        raise ValueError(f"{count} ranges, must be at least 2")
    return count


def _check(words: list[str], expected: int) -> None:
    if len(words) != expected:
        raise ValueError(f"{len(words)} words where {expected} are expected")
