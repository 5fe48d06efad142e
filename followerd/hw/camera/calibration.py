"""What `followerd calibrate camera` finds out of a camera, and straight images made with it."""

from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo

from followerd.errors import ConfigError
from followerd.geometry import Array
from followerd.hw.camera.grabber import Grabber, OpenGrabber
from followerd.hw.camera.protocol import Frame
from followerd.messages import Pixels
from followerd.settings import Settings, load

Focal = Annotated[float, Field(gt=0, description="px")]


class Calibration(Settings):
    """Pinhole and distortion of one camera at one size of frames, as OpenCV has them."""

    width: int = Field(gt=0, description="px")
    height: int = Field(gt=0, description="px")
    fx: Focal
    fy: Focal
    cx: float = Field(description="px, of the centre of the left column's pixel counted from 0")
    cy: float = Field(description="px")
    distortion: tuple[float, float, float, float, float] = Field(
        (0.0, 0.0, 0.0, 0.0, 0.0), description="k1, k2, p1, p2, k3"
    )
    rms_px: float | None = Field(None, ge=0, description="reprojection error it was found with")

    @property
    def intrinsics(self) -> Array:
        """K (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


def from_file(value: Any, info: ValidationInfo) -> Any:
    """Where a config says the path of a calibration file: what stands in it.

    A relative path starts at the config's folder.
    """
    if not isinstance(value, str):
        return value
    folder = (info.context or {}).get("folder", Path())
    try:
        return load(folder / value, Calibration)
    except ConfigError as error:
        raise ValueError("; ".join(error.problems)) from None


CalibrationFile = Annotated[
    Calibration, BeforeValidator(from_file, json_schema_input_type=str | Calibration)
]


class Lens:
    """Undoes a lens's distortion; the pinhole stays that of the calibration. 1.5 ms at 640x480."""

    def __init__(self, calibration: Calibration) -> None:
        k, size = calibration.intrinsics, (calibration.width, calibration.height)
        distortion = np.array(calibration.distortion)
        self._maps = cv2.initUndistortRectifyMap(k, distortion, np.eye(3), k, size, cv2.CV_16SC2)

    def straight(self, pixels: Pixels) -> Pixels:
        """The image (H, W[, 3]) as a pinhole sees it; black where the lens saw nothing."""
        return np.asarray(cv2.remap(pixels, *self._maps, cv2.INTER_LINEAR), np.uint8)

    def __call__(self, frame: Frame) -> Frame:
        """A frame, its depth too: not blended across edges, nan where nothing was seen."""
        depth = frame.depth
        if depth is not None:
            unseen = (float("nan"),) * 4
            edge = cv2.BORDER_CONSTANT
            straight = cv2.remap(depth, *self._maps, cv2.INTER_NEAREST, None, edge, unseen)
            depth = np.asarray(straight, np.float32)
        return frame._replace(pixels=self.straight(frame.pixels), depth=depth)


class Undistorted:
    """A camera whose images are made straight before they are handed on."""

    def __init__(self, grabber: Grabber, lens: Lens) -> None:
        self._grabber = grabber
        self._lens = lens
        self.lock_exposure = grabber.lock_exposure
        self.close = grabber.close

    def grab(self) -> Frame:
        """See Grabber."""
        return self._lens(self._grabber.grab())


def straightened(open_grabber: OpenGrabber, calibration: Calibration) -> OpenGrabber:
    """Opens the same camera, its images undistorted."""
    lens = Lens(calibration)
    return lambda session: Undistorted(open_grabber(session), lens)
