"""The localizer `scan_histogram`: Kwolek 2004, section 5.

Profile `paper` is the published system (its motion model repaired), `default` starts and recovers
by a search of the whole table, and knows when it does not know.
"""

from typing import Literal

import numpy as np
from pydantic import Field

from followerd.estimation.mcl import Mcl, MclSettings
from followerd.estimation.scan_histogram import HistogramSensor
from followerd.geometry import Pose2
from followerd.localizers.fine_lines import FineLines, FineSettings
from followerd.maps.floor import FloorMap
from followerd.maps.scan_table import Progress, ScanTable, TableShape
from followerd.maps.table_cache import table_for
from followerd.messages import RobotPose, Scan

BINS = {"paper": 4, "default": 8}
PAPER = {  # what the published filter has not
    "seeded_share": 0.0,
    "injected_share": 0.0,
    "cubes": 1,
    "misfit": 0.0,
    "misfit_drop": 1.0,
}


class ScanHistogramSettings(MclSettings):
    """Of filter and table; profile `paper` sets aside what the paper has not."""

    profile: Literal["default", "paper"] = "default"
    bins: Literal[4, 8] | None = Field(None, description="null: 8, in profile paper 4")
    beta: float = Field(20.0, gt=0, description="how sharply a scan that fits better is preferred")
    max_range_m: float = Field(8.0, gt=0, description="farther echoes are not used")
    max_table_mb: float = Field(100.0, gt=0, description="a larger map gets coarser cells, or none")
    fine: FineSettings | None = Field(None, description="lines for the fine pose; {} to have them")

    @property
    def shape(self) -> TableShape:
        """Of the table."""
        bins = self.bins or BINS[self.profile]
        return TableShape(bins, self.max_range_m, round(1e6 * self.max_table_mb))


class ScanHistogram:
    """See Localizer. Raises ConfigError for a map too large for its table."""

    Settings = ScanHistogramSettings

    def __init__(
        self,
        settings: ScanHistogramSettings,
        floor: FloorMap,
        rng: np.random.Generator,
        progress: Progress | None = None,
    ) -> None:
        is_paper = settings.profile == "paper"
        self.table: ScanTable = table_for(floor.grid, settings.shape, progress=progress)
        sensor = HistogramSensor(self.table, settings.beta, bridges=not is_paper)
        filter_ = settings.model_copy(update=PAPER) if is_paper else settings
        self.mcl = Mcl(sensor, filter_, rng)
        self._whole = FineLines(self.mcl, floor.walls, settings.fine) if settings.fine else self.mcl

    def start(self, at: Pose2 | None) -> None:
        """See Localizer."""
        self._whole.start(at)

    def step(
        self, scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        """See Localizer."""
        return self._whole.step(scan, ego, person)
