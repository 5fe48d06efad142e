"""What a user may set about a P2OS base."""

from typing import Literal

from pydantic import Field

from followerd.settings import Settings

Baud = Literal[9600, 19200, 38400, 57600, 115200]
Extra = Literal["gyro", "encoders", "io", "joystick"]


class P2osSettings(Settings):
    """A P2OS, AROS or ARCOS base; the limits are set in the base and hold below the guard's."""

    model: str | None = Field(None, description="subtype to assume instead of the reported one")
    baud: Baud = Field(9600, description="line rate to try first")
    raised_baud: Baud | None = Field(38400, description="line rate to switch to where possible")
    max_speed_mps: float = Field(0.7, gt=0, le=2.2)
    max_turn_dps: float = Field(100.0, gt=0, le=500)
    acceleration_mps2: float = Field(0.5, gt=0, le=4)
    deceleration_mps2: float = Field(0.5, gt=0, le=4)
    turn_acceleration_dps2: float = Field(100.0, gt=0, le=600)
    turn_deceleration_dps2: float = Field(100.0, gt=0, le=600)
    blind_distance_m: float = Field(
        1.4, gt=0, description="longest way until the firmware's watchdog stops a lost robot"
    )
    sonar: bool = Field(True, description="whether the sonar discs fire")
    extra_packets: tuple[Extra, ...] = Field((), description="reports to ask the base for")
    low_battery_v: float | None = Field(
        None, gt=5, le=60, description="say so below this; default: what the base's flash says"
    )
    shutdown_v: float | None = Field(
        None, gt=5, le=60, description="the base goes off here; default: what its flash says"
    )
