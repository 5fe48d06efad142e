"""What a config says of the pan-tilt head."""

from typing import Literal

from pydantic import Field

from followerd.settings import Settings


class Vcc50iSettings(Settings):
    """A Canon VC-C50i or VC-C4, on a port of its own or (`link: aux`) on the base's AUX port."""

    model: Literal["vc-c50i", "vc-c4"] = Field(
        "vc-c50i", description="for what the camera does not say of itself, and for the twin"
    )
    baud: Literal[4800, 9600, 14400, 19200] = Field(9600, description="as its switches say")
    rate_hz: float = Field(20.0, gt=0, le=30, description="how often its angles are asked for")
    pan_speed_dps: float = Field(90.0, ge=1, le=90)
    tilt_speed_dps: float = Field(70.0, ge=1, le=75)
    home_at_start: bool = Field(
        True,
        description="let a head that was switched on since find its home position when followerd"
        " starts; else it does so when first asked to look somewhere",
    )
