"""The localizer `likelihood_field`: how near the echoes lie to the map's walls, for maps of any
size."""

import numpy as np
from pydantic import Field

from followerd.estimation.likelihood_field import FieldSensor, FieldSettings
from followerd.estimation.mcl import Mcl, MclSettings
from followerd.geometry import Pose2
from followerd.localizers.fine_lines import FineLines, FineSettings
from followerd.maps.distance_field import DistanceField
from followerd.maps.floor import FloorMap
from followerd.messages import RobotPose, Scan


class LikelihoodFieldSettings(FieldSettings, MclSettings):
    """Of filter and field. The field is sharp: little shaking, and no particle at random."""

    injected_share: float = Field(0.0, ge=0, le=0.5, description="drawn anew when resampling")
    shake_m: float = Field(0.02, ge=0, description="of unlikely particles after resampling")
    shake_deg: float = Field(0.5, ge=0)
    draws: int = Field(300, ge=0, le=10_000, description="round the estimate, to sharpen it")
    misfit: float = Field(0.5, ge=0, le=1, description="fit below which a search is worth while")
    misfit_drop: float = Field(0.25, gt=0, le=1, description="below the usual fit, likewise")
    search_gain: float = Field(0.15, ge=0, le=1, description="of the fit, or it found nothing")
    search_weight: float = Field(0.1, gt=0, lt=1, description="of all that a search found")
    misfit_updates: int = Field(2, ge=1, description="in a row, before one is made")
    sure_updates: int = Field(2, ge=1, description="in a row, before the pose is relied on")
    fine: FineSettings | None = Field(None, description="lines for the fine pose; {} to have them")


class LikelihoodField:
    """See Localizer."""

    Settings = LikelihoodFieldSettings

    def __init__(
        self, settings: LikelihoodFieldSettings, floor: FloorMap, rng: np.random.Generator
    ) -> None:
        sensor = FieldSensor(DistanceField.of(floor.grid), settings)
        self.mcl = Mcl(sensor, settings, rng)
        self._whole = FineLines(self.mcl, floor.walls, settings.fine) if settings.fine else self.mcl

    def start(self, at: Pose2 | None) -> None:
        """See Localizer."""
        self._whole.start(at)

    def step(
        self, scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        """See Localizer."""
        return self._whole.step(scan, ego, person)
