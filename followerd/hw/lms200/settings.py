"""What the config says about a laser."""

from math import radians
from typing import Literal

from pydantic import Field, model_validator

from followerd.geometry import Pose2
from followerd.hw.lms200.variant import VARIANTS, Variant, line_time
from followerd.settings import Settings

MISSED = 2.3  # periods without a scan: two are missing, not one that is a little late
LEAST_STALE = 0.2  # s; a busy computer may hold up the fast scans of 500000 baud by more


class Mount(Settings):
    """Where the scanner sits on the robot."""

    x_m: float = Field(0.02, ge=-2, le=2, description="forward of the robot's centre")
    y_m: float = Field(0.0, ge=-2, le=2, description="left of the robot's centre")
    yaw_deg: float = Field(0.0, ge=-180, le=180, description="turned to the left")
    upside_down: bool = False

    @property
    def base_from_laser(self) -> Pose2:
        """The mount as a transform."""
        return Pose2(self.x_m, self.y_m, radians(self.yaw_deg))


class Lms200Settings(Settings):
    """A SICK LMS200 on a serial line."""

    baud: Literal[9600, 19200, 38400, 500000] = Field(
        500000, description="line rate to stream at; 500000 needs an RS-422 adapter"
    )
    field_deg: Literal[100, 180] = 180
    resolution_deg: float = Field(0.5, description="0.25 (field of 100 degrees only), 0.5 or 1")
    unit: Literal["mm", "cm"] = Field("mm", description="mm: up to 8 m; cm: up to 80 m")
    mount: Mount = Mount()

    @model_validator(mode="after")
    def _has_variant(self) -> "Lms200Settings":
        if self.variant not in VARIANTS:
            known = ", ".join(f"{v.field}/{v.resolution / 100:g}" for v in VARIANTS)
            raise ValueError(
                f"an LMS200 has no field_deg {self.field_deg} with resolution_deg"
                f" {self.resolution_deg:g}; it has {known}"
            )
        return self

    @property
    def variant(self) -> Variant:
        """Field and resolution as the device names them."""
        return Variant(self.field_deg, round(self.resolution_deg * 100))


def oldest(settings: Lms200Settings) -> float:
    """Age in s of a scan's first beam when the next scan is complete: what a stop reckons."""
    variant = settings.variant
    return variant.age + _on_the_line(settings) + variant.delivered_period(settings.baud)


def stale_after(settings: Lms200Settings) -> float:
    """Age in s of the first beam at which two scans in a row are missing."""
    missed = MISSED * delivered_period(settings)
    return max(settings.variant.age + _on_the_line(settings) + missed, LEAST_STALE)


def _on_the_line(settings: Lms200Settings) -> float:
    return line_time(settings.variant.telegram_bytes, settings.baud)


def delivered_period(settings: Lms200Settings) -> float:
    """Seconds between the scans that arrive, whatever the mirror measures meanwhile."""
    return settings.variant.delivered_period(settings.baud)
