"""What can be said of the tracker `head`."""

from typing import Literal

from pydantic import Field

from followerd.settings import Settings


class HeadSettings(Settings):
    """Lengths in px are scaled by the head's size."""

    profile: Literal["default", "paper"] = "default"
    particles: int | None = Field(
        None, ge=10, le=100_000, description="null is 400, and 800 in profile paper"
    )
    depth: bool = Field(True, description="size from the depth image, if the camera gives one")
    cues: Literal["both", "colour", "gradient"] = Field(
        "both", description="of the ellipse; one alone only for the ablation"
    )
    adaptation: float = Field(
        0.15, ge=0.0, le=1.0, description="of the colours to those seen, in a tenth of a second"
    )
    template: bool = Field(True, description="default profile: use the template cue too")
    compensate_ego_motion: bool = Field(True, description="False only for the ablation")
    lost_after_s: float = Field(1.0, gt=0, le=10, description="of not being sure")

    @property
    def count(self) -> int:
        """How many particles there are."""
        return self.particles or (800 if self.profile == "paper" else 400)
