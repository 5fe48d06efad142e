"""Where the followed person will be seen, by one of the predictors, from the images' sights."""

from math import radians

import numpy as np
from pydantic import Field

from followerd.estimation.direction import Look, Predictor
from followerd.estimation.predictors import Kind, predictor
from followerd.geometry import wrap_angle
from followerd.messages import Sight
from followerd.settings import Settings

FOCAL = 686.0  # px, of an imagined camera that always points at the person (Motai's)


class ForesightSettings(Settings):
    """What is believed about the directions in which a tracker sees the person."""

    predictor: Kind = Field("imm_pda", description="foresees the person's direction")
    sigma_deg: float = Field(0.7, gt=0, le=10, description="noise of a seen direction")
    agreeing: int = Field(
        4, ge=1, description="sights in a row elsewhere that are believed, by imm_pda"
    )
    reach_s: float = Field(
        0.27,
        gt=0,
        le=1,
        description="farther ahead nobody is foreseen: they are looked for where last seen",
    )
    forget_s: float = Field(1.0, gt=0, le=3, description="until nobody is looked for any more")


class Foresight:
    """The direction of one person in `odom`, rad, left positive."""

    def __init__(self, settings: ForesightSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self._rng = rng
        self.forget()

    def forget(self) -> None:
        """Somebody else is followed now."""
        self._predictor: Predictor | None = None
        self.newest: Sight | None = None

    def see(self, stamp: float, pan: float) -> None:
        """The person was seen at `pan`; what is not newer than the last sight is left out."""
        last = self.newest
        if last is not None:
            if stamp <= last.stamp:
                return
            pan = last.pan + wrap_angle(pan - last.pan)
            if stamp - last.stamp > self.settings.forget_s:
                self._predictor = None
        if self._predictor is None:
            sigma = radians(self.settings.sigma_deg)
            self._predictor = predictor(
                self.settings.predictor, sigma, self._rng, self.settings.agreeing
            )
        self.newest = Sight(stamp, pan)
        self._predictor.step(Look(stamp, 0.0, 0.0, pan, 0.0, FOCAL))

    def at(self, stamp: float) -> float | None:
        """The direction at `stamp`; None when the person was not seen lately."""
        if self.newest is None or self._predictor is None:
            return None
        dt = stamp - self.newest.stamp
        if dt > self.settings.forget_s:
            return None
        # the newest sight may have been a wrong one: the predictor knows better
        return self._predictor.ahead(dt if dt <= self.settings.reach_s else 0.0)[0]
