"""Localizers by the names that the command line uses: `likelihood_field`, `KIND/PROFILE`."""

import numpy as np
from pydantic import ValidationError

from followerd.errors import UsageError
from followerd.estimation.localizer import Localizer
from followerd.estimation.registry import LOCALIZERS
from followerd.maps.floor import FloorMap


def build(name: str, floor: FloorMap, rng: np.random.Generator) -> Localizer:
    """The localizer `KIND` or `KIND/PROFILE` on a map; raises UsageError for an unknown name."""
    kind, _, profile = name.partition("/")
    if kind not in LOCALIZERS.names():
        raise UsageError(f"--localizer {name}: unknown; there are {', '.join(LOCALIZERS.names())}")
    cls = LOCALIZERS.load(kind)
    try:
        settings = cls.Settings(**({"profile": profile} if profile else {}))
    except ValidationError as error:
        raise UsageError(f"--localizer {name}: {error.errors()[0]['msg']}") from None
    localizer: Localizer = cls(settings, floor, rng)
    return localizer
