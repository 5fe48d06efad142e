"""The robot on a map of walls: lines of each scan, and the extended Kalman filter that takes them.

Tseng and Tang 2009, Algorithm 1, lines 3-12. Where it is lost, or is told nothing, poses that fit
two walls at once are tried on the whole map.
"""

from dataclasses import replace
from math import hypot, radians

import numpy as np
from pydantic import Field

from followerd.estimation.line_ekf import LineEkf, LineEkfSettings, Walls
from followerd.geometry import Array, Pose2, wrap_angle
from followerd.localizers.line_search import LineSearch, LineSearchSettings
from followerd.maps.floor import FloorMap
from followerd.messages import Line, RobotPose, Scan, Twist
from followerd.perception.deskew import deskewed
from followerd.perception.lines import LineSettings, find_lines
from followerd.settings import Settings

LONGEST_STEP = 1.0  # s between scans, over which a velocity is believed
AGREE, AGREE_TURN = 0.3, radians(10.0)  # m, rad, between two finds in a row


class LineLocalizerSettings(Settings):
    """Lines, filter and start."""

    lines: LineSettings = LineSettings()
    ekf: LineEkfSettings = LineEkfSettings()
    search: LineSearchSettings = LineSearchSettings()
    start_sigma_m: float = Field(0.2, gt=0, description="of the start, per axis")
    start_sigma_deg: float = Field(7.0, gt=0)
    period_s: float = Field(0.09, ge=0, description="scans that come sooner tell nothing new")
    jitter_deg: float = Field(0.3, ge=0, description="of the heading between the base's reports")
    delay_s: float = Field(0.03, ge=0, description="by which they may be late, in a turn")
    doubt_s: float = Field(
        0.8, ge=0, description="of walls unknown, before the start's doubt again"
    )
    person_m: float = Field(0.5, ge=0, description="around the person no return counts")


class LineLocalizer:
    """The localizer `line_ekf`."""

    Settings = LineLocalizerSettings

    def __init__(
        self, settings: LineLocalizerSettings, floor: FloorMap, rng: np.random.Generator
    ) -> None:
        del rng  # nothing is drawn here
        self.settings = settings
        self._ekf = LineEkf(Walls.of(floor.walls), settings.ekf)
        self._search = LineSearch(floor, settings.search)
        self._before: tuple[float, Pose2] | None = None  # stamp and `odom_from_base`
        self._pose: RobotPose | None = None  # of the newest scan that was looked at
        self.start(None)

    def start(self, at: Pose2 | None) -> None:
        """See Localizer."""
        self._found: Pose2 | None = None  # `map_from_odom` of a find that the next one may bear out
        self._searching = at is None
        self._doubted = False
        if at is not None:
            self._ekf.start(at, np.zeros((3, 3)))
            self._ekf.widen(self.settings.start_sigma_m, radians(self.settings.start_sigma_deg))
            self._before = self._pose = None

    def step(
        self, scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        """See Localizer."""
        if self._before is not None and scan.stamp - self._before[0] < self.settings.period_s:
            return self._moved_on(scan.stamp, ego)
        twist = self._twist(scan.stamp, ego)
        points = deskewed(scan, twist)
        if person is not None:
            off = points - person
            near = np.einsum("ij,ij->i", off, off) < self.settings.person_m**2
            points[near] = np.nan
        lines = find_lines(points, self.settings.lines)
        before, self._before = self._before, (scan.stamp, ego)
        if self._searching:
            self._look_for(lines, points, ego)
        elif before is not None:
            self._predict(~before[1] @ ego, twist)
        if self._searching:
            self._pose = None
            return None
        self._ekf.update(lines, scan.stamp)
        self._doubt(scan.stamp)
        here, lost = self._ekf.pose, self._ekf.is_lost(scan.stamp)
        self._pose = RobotPose(scan.stamp, here, here @ ~ego, self._ekf.P, lost)
        return self._pose

    def _moved_on(self, stamp: float, ego: Pose2) -> RobotPose | None:
        """The newest pose, by odometry since."""
        if self._pose is None:
            return None
        return replace(self._pose, stamp=stamp, map_from_base=self._pose.map_from_odom @ ego)

    def _predict(self, step: Pose2, twist: Twist) -> None:
        """Move on; where a base was between its reports is known to a jitter."""
        s = self.settings
        self._ekf.predict(step)
        self._ekf.widen(0.0, radians(s.jitter_deg) + s.delay_s * abs(twist.omega))

    def _doubt(self, now: float) -> None:
        """Before it is lost for good a filter that is too sure gets a second chance."""
        s = self.settings
        doubtful = self._ekf.unmatched_for(now) > s.doubt_s
        if doubtful and not self._doubted:
            self._ekf.widen(s.start_sigma_m, radians(s.start_sigma_deg))
        self._doubted = doubtful

    def _twist(self, stamp: float, ego: Pose2) -> Twist:
        """The robot's velocity since the scan before."""
        if self._before is None or not 0.0 < stamp - self._before[0] < LONGEST_STEP:
            return Twist()
        dt, step = stamp - self._before[0], ~self._before[1] @ ego
        return Twist(step.x / dt, step.theta / dt)

    def _look_for(self, lines: list[Line], points: Array, ego: Pose2) -> None:
        """Two finds in a row that agree are where the robot is."""
        find = self._search.pose(lines, points)
        if find is None:
            self._found = None
            return
        before, self._found = self._found, find @ ~ego
        if before is None:
            return
        off = ~find @ (before @ ego)
        if hypot(off.x, off.y) < AGREE and abs(wrap_angle(off.theta)) < AGREE_TURN:
            self._searching = False
            self._ekf.start(find, np.diag(np.square([0.1, 0.1, radians(3.0)])))
