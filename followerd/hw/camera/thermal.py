"""Thermal cameras: grey images, and a word when the camera changes its gain by itself."""

from typing import ClassVar, Literal

import cv2
import numpy as np
import structlog
from pydantic import Field, model_validator

from followerd.hw.camera.driver import CameraDriver
from followerd.hw.camera.protocol import Frame
from followerd.hw.camera.settings import CameraSettings
from followerd.hw.camera.source import FrameSource
from followerd.hw.camera.tone import GainWatch
from followerd.messages import Image, Pixels

log = structlog.get_logger()


class ThermalSettings(CameraSettings):
    """A thermal camera: 8-bit or 16-bit grey, or a grabber's colour made grey."""

    sees: ClassVar[Literal["colour", "depth", "thermal"]] = "thermal"

    levels_counts: tuple[float, float] | None = Field(
        None,
        description="16-bit counts that become black and white; default: from the first frame",
    )

    @model_validator(mode="after")
    def _rising(self) -> "ThermalSettings":
        if self.levels_counts and self.levels_counts[0] >= self.levels_counts[1]:
            raise ValueError("levels_counts: black must lie below white")
        return self


class ThermalCamera(CameraDriver):
    """Images (H, W) grey; `gain_changes` counts the camera's gain jumps."""

    Settings: type[CameraSettings] = ThermalSettings

    def __init__(
        self, settings: ThermalSettings, source: FrameSource, name: str = "camera"
    ) -> None:
        super().__init__(settings, source, name)
        self.gain_changes = 0
        self._watch = GainWatch()

    def _image(self, frame: Frame, now: float) -> Image:
        image = super()._image(frame, now)
        if change := self._watch.jumped(image.pixels):
            self.gain_changes += 1
            log.warning("gain changed", device=self.name, frame=image.id, grey_levels=change)
        return image

    def _toned(self, pixels: Pixels) -> Pixels:
        if pixels.ndim == 2:
            return pixels
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8)
