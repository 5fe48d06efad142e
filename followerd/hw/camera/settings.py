"""What a config says of a camera."""

from math import radians
from typing import Annotated

from pydantic import Field

from followerd.geometry import Camera
from followerd.settings import Settings

PRESETS = {  # width px, height px, frames a second
    "192x144@15": (192, 144, 15.0),
    "320x240@30": (320, 240, 30.0),
    "640x480@30": (640, 480, 30.0),
}


class CameraMount(Settings):
    """Where the camera sits on the robot."""

    x_m: float = Field(0.0, description="forward of the robot's centre of turning")
    y_m: float = Field(0.0, description="left of it")
    z_m: float = Field(0.6, gt=0, description="height of the lens above the floor")
    yaw_deg: float = Field(0.0, ge=-180, le=180, description="turned left of straight ahead")
    elevation_deg: float = Field(-5.0, gt=-90, lt=90, description="tilted up; negative is down")


class CameraSettings(Settings):
    """Size and rate of the frames, field of view, mount."""

    width: Annotated[int, Field(ge=32, le=4096, description="px")] = 192
    height: Annotated[int, Field(ge=24, le=4096, description="px")] = 144
    rate_hz: float = Field(15.0, gt=0, le=240, description="frames a second")
    hfov_deg: float = Field(48.0, gt=5, lt=150, description="horizontal field of view")
    mount: CameraMount = CameraMount()

    @classmethod
    def preset(cls, name: str) -> "CameraSettings":
        """One of PRESETS on the usual mount; raises KeyError."""
        width, height, rate = PRESETS[name]
        return cls(width=width, height=height, rate_hz=rate)

    @property
    def camera(self) -> Camera:
        """The pinhole model of these settings."""
        mount = self.mount
        return Camera.from_hfov(
            self.width,
            self.height,
            radians(self.hfov_deg),
            x=mount.x_m,
            y=mount.y_m,
            z=mount.z_m,
            yaw=radians(mount.yaw_deg),
            elevation=radians(mount.elevation_deg),
        )
