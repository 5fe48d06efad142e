"""The fine pose: walls in the scan, as long as they agree with the cloud they started from."""

from math import hypot, radians

import numpy as np
from pydantic import Field

from followerd.estimation.line_ekf import LineEkf, LineEkfSettings, Walls
from followerd.estimation.localizer import Localizer
from followerd.geometry import Array, Pose2, wrap_angle
from followerd.messages import RobotPose, Scan
from followerd.perception.lines import LineSettings, find_lines
from followerd.settings import Settings

START = np.diag([0.1, 0.1, radians(2.0)]) ** 2
FEWEST = 2  # walls found on the map: one alone leaves the pose free along it


class FineSettings(Settings):
    """Of the lines, and how far they may lead away from the cloud."""

    apart_m: float = Field(0.2, gt=0, description="from the cloud; beyond it the cloud is right")
    apart_deg: float = Field(4.0, gt=0)
    # looser than for a tape-measured map: real corridors are broken by doors and plants
    lines: LineSettings = LineSettings(gap_share=0.2, min_points=6, split_m=0.05, min_length_m=0.3)
    ekf: LineEkfSettings = LineEkfSettings(map_sigma_m=0.03, map_sigma_deg=0.5)


class FineLines:
    """A Localizer around another one: its pose, made finer by a line EKF that it watches over."""

    def __init__(self, coarse: Localizer, walls: Array, settings: FineSettings) -> None:
        self.coarse, self.settings = coarse, settings
        self._ekf = LineEkf(Walls.of(walls), settings.ekf)
        self._ego: Pose2 | None = None  # of the EKF's last step; None while it stands aside

    def start(self, at: Pose2 | None) -> None:
        """See Localizer."""
        self.coarse.start(at)
        self._ego = None

    def step(
        self, scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        """See Localizer: the coarse pose, unless enough walls tell a finer one near it."""
        coarse = self.coarse.step(scan, ego, person)
        if coarse is None or coarse.lost:
            self._ego = None
            return coarse
        if self._ego is None:
            self._ekf.start(coarse.map_from_base, START)
        else:
            self._ekf.predict(~self._ego @ ego)
        self._ego = ego
        lines = find_lines(scan.points(), self.settings.lines)
        found = self._ekf.update(lines, scan.stamp)
        fine = self._ekf.pose
        if self._ekf.is_lost(scan.stamp) or not self._agree(fine, coarse.map_from_base):
            self._ego = None
            return coarse
        if found < FEWEST:
            return coarse
        return RobotPose(scan.stamp, fine, fine @ ~ego, self._ekf.P.copy())

    def _agree(self, fine: Pose2, coarse: Pose2) -> bool:
        s, off = self.settings, ~coarse @ fine
        near = hypot(off.x, off.y) < s.apart_m
        return near and abs(wrap_angle(off.theta)) < radians(s.apart_deg)
