"""The base of every settings class; each stands beside the code it configures.

Keys carry their unit (`max_speed_mps`, `yaw_deg`, `stale_after_s`); values are converted to SI
(m, rad, s) where they are used. Unknown keys, infinities and NaN are errors.
"""

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """Frozen, closed (no unknown keys), finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
