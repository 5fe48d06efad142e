"""The predictors of a direction that a config can name."""

from typing import Literal

import numpy as np

from followerd.estimation.arbitration import OfKf
from followerd.estimation.direction import Predictor
from followerd.estimation.direction_flow import Of
from followerd.estimation.direction_kf import Kf
from followerd.estimation.direction_pf import Pf
from followerd.estimation.imm_pda import ImmPda

Kind = Literal["kf", "of", "ofkf", "pf", "pf_paper", "imm_pda"]


def predictor(kind: Kind, sigma: float, rng: np.random.Generator, agreeing: int = 4) -> Predictor:
    """One of Motai's predictors, or ours, for looks with deviation `sigma`, rad.

    So many doubted looks in a row that are `agreeing` make imm_pda start anew.
    """
    match kind:
        case "kf":
            return Kf(sigma=sigma)
        case "of":
            return Of()
        case "ofkf":
            return OfKf(sigma=sigma)
        case "pf":
            return Pf(rng, sigma=sigma)
        case "pf_paper":
            return Pf(rng, sigma=sigma, floor=0.0, fresh=0)
        case "imm_pda":
            return ImmPda(sigma=sigma, agreeing=agreeing)
