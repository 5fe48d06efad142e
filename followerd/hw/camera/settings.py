"""What a config says of a camera."""

from dataclasses import replace
from math import radians
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from followerd.geometry import Camera
from followerd.hw.camera.calibration import CalibrationFile
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


class VideoInput(Settings):
    """What a video device (/dev/videoN) is asked for."""

    pixel_format: Literal["auto", "MJPG", "YUYV", "UYVY", "GREY", "Y16"] = Field(
        "auto", description="on the wire; auto: the first of these that it offers"
    )
    input: str | None = Field(None, description="of an analogue grabber, by name or number")
    standard: Literal["PAL", "NTSC", "SECAM"] | None = Field(
        None, description="of the analogue signal"
    )
    exposure: Literal["auto", "as_found"] = Field(
        "auto",
        description="auto: automatic until a person is enrolled, then locked with gain and white"
        " balance; as_found: never touched",
    )


class CameraSettings(Settings):
    """Size and rate of the frames, field of view or calibration, mount."""

    sees: ClassVar[Literal["colour", "depth", "thermal"]] = "colour"

    width: Annotated[int, Field(ge=32, le=4096, description="px")] = 192
    height: Annotated[int, Field(ge=24, le=4096, description="px")] = 144
    rate_hz: float = Field(15.0, gt=0, le=240, description="frames a second")
    hfov_deg: float = Field(48.0, gt=5, lt=150, description="horizontal field of view")
    calibration: CalibrationFile | None = Field(
        None,
        description="file that `followerd calibrate camera` wrote; hfov_deg is then not used,"
        " and images are made straight",
    )
    mount: CameraMount = CameraMount()
    video: VideoInput = VideoInput()
    loop: bool = Field(True, description="begin a recording anew at its end")

    @model_validator(mode="after")
    def _calibrated_at_this_size(self) -> "CameraSettings":
        found = self.calibration
        if found and (found.width, found.height) != (self.width, self.height):
            size = f"{found.width}x{found.height}"
            raise ValueError(
                f"the calibration is of {size} images, the camera's are {self.width}x{self.height};"
                " calibrate at the size that is used"
            )
        return self

    @classmethod
    def preset(cls, name: str) -> "CameraSettings":
        """One of PRESETS on the usual mount; raises KeyError."""
        width, height, rate = PRESETS[name]
        return cls(width=width, height=height, rate_hz=rate)

    @property
    def camera(self) -> Camera:
        """The pinhole model of these settings."""
        mount = self.mount
        lens = self.calibration
        camera = Camera.from_hfov(self.width, self.height, radians(self.hfov_deg))
        if lens is not None:
            camera = replace(camera, fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy)
        return replace(
            camera,
            x=mount.x_m,
            y=mount.y_m,
            z=mount.z_m,
            yaw=radians(mount.yaw_deg),
            elevation=radians(mount.elevation_deg),
        )
