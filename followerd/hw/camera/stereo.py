"""A stereo pair: the left image, rectified, with depth registered to it."""

import threading
from math import radians
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from followerd.errors import ConfigError, DeviceError, LinkLost
from followerd.geometry import Camera
from followerd.hw.camera.driver import CameraDriver
from followerd.hw.camera.grabber import Grabber, GrabberSource, Latest, Session, as_lost
from followerd.hw.camera.protocol import Frame
from followerd.hw.camera.rectification import Matcher, Rectification, StereoGeometry
from followerd.hw.camera.settings import CameraSettings

SILENT = 1.0  # s without a frame of one side
APART = 30  # frames in a row without a pair: they never fit


class StereoSettings(CameraSettings):
    """Two cameras with a calibration; field of view and pinhole follow from it."""

    sees: ClassVar[Literal["colour", "depth", "thermal"]] = "depth"

    right_link: str = Field(description="of the right camera; `link` is the left one")
    stereo_calibration: str = Field(
        description="file in OpenCV's FileStorage format with M1 D1 M2 D2 R T, T in m"
    )
    matcher: Literal["sgbm", "bm"] = "sgbm"
    nearest_m: float = Field(0.7, gt=0.1, description="depth is searched from here on")
    shrink: Literal[1, 2, 4] = Field(2, description="images are matched so many times smaller")
    max_skew_s: float = Field(0.01, gt=0, description="between the stamps of a pair")

    @field_validator("stereo_calibration")
    @classmethod
    def _readable(cls, name: str, info: ValidationInfo) -> str:
        path = (info.context or {}).get("folder", Path()) / name
        try:
            StereoGeometry.read(path)
        except ConfigError as error:
            raise ValueError("; ".join(error.problems)) from None
        return str(path)

    @model_validator(mode="after")
    def _of_these_cameras(self) -> "StereoSettings":
        if self.calibration is not None:
            raise ValueError("a stereo pair has stereo_calibration, not calibration")
        m1 = StereoGeometry.read(Path(self.stereo_calibration)).m1
        if not (0.3 < m1[0, 2] / self.width < 0.7 and 0.3 < m1[1, 2] / self.height < 0.7):
            centre = f"({m1[0, 2]:.0f}, {m1[1, 2]:.0f})"
            raise ValueError(
                f"the stereo calibration's centre {centre} is none of {self.width}x{self.height}"
                " images; calibrate at the size that is used"
            )
        return self

    @property
    def rectification(self) -> Rectification:
        """Of images of this size."""
        pair = StereoGeometry.read(Path(self.stereo_calibration))
        return Rectification(pair, (self.width, self.height))

    @property
    def camera(self) -> Camera:
        """The rectified left camera; `mount` is where it looks."""
        straight, mount = self.rectification, self.mount
        f, (cx, cy) = straight.focal, straight.centre
        place = (mount.x_m, mount.y_m, mount.z_m)
        angles = radians(mount.yaw_deg), radians(mount.elevation_deg)
        return Camera(self.width, self.height, f, f, cx, cy, *place, *angles)


class StereoSource(GrabberSource):
    """Both cameras of a pair."""

    def __init__(self, left: GrabberSource, right: GrabberSource, settings: StereoSettings) -> None:
        super().__init__(f"{left.name} and {right.name}", self._open)
        self._sources = left, right
        self._settings = settings

    def _open(self, session: Session) -> "StereoGrabber":
        left, right = self._sources
        first = Side(session, left.name, left.open_grabber(session))
        try:
            second = Side(session, right.name, right.open_grabber(session))
        except DeviceError:
            first.close()
            raise
        return StereoGrabber(session, first, second, self._settings)


class Side:
    """One camera of a pair, in a thread of its own."""

    def __init__(self, session: Session, name: str, grabber: Grabber) -> None:
        self._session = session
        self._name = name
        self._grabber = grabber
        self._latest: Latest[Frame] = Latest()
        self._stop = threading.Event()
        self.lock_exposure = grabber.lock_exposure
        self._thread = threading.Thread(target=self._work, name=f"camera {name}", daemon=True)
        self._thread.start()

    def newest(self) -> Frame:
        """The newest frame; raises LinkLost."""
        frame = self._latest.take(SILENT)
        if frame is None:
            raise LinkLost(self._session.device, f"{self._name} sends no frames", "check the plug")
        return frame

    def close(self) -> None:
        """Release it, once its frame has come."""
        self._stop.set()
        self._thread.join()
        self._grabber.close()

    def _work(self) -> None:
        try:
            while not self._stop.is_set():
                self._latest.put(self._grabber.grab())
        except Exception as error:  # whatever ends the thread, its reader must learn of it
            self._latest.fail(as_lost(error, self._session.device, self._name))


class StereoGrabber:
    """Pairs frames by their stamps and finds depth."""

    def __init__(self, session: Session, left: Side, right: Side, settings: StereoSettings) -> None:
        self._session = session
        self._sides = left, right
        self._skew = settings.max_skew_s
        self._straight = settings.rectification
        self._matcher = Matcher(
            settings.matcher, self._straight, settings.nearest_m, settings.shrink
        )

    def grab(self) -> Frame:
        """The newest pair as one frame, numbered and stamped by the left; raises LinkLost."""
        left, right = self._pair()
        straight = self._straight.rectify(left.pixels, right.pixels)
        return Frame(left.id, left.stamp, straight[0], self._matcher.depth(*straight))

    def lock_exposure(self, locked: bool = True) -> None:
        """See Grabber."""
        for side in self._sides:
            side.lock_exposure(locked)

    def close(self) -> None:
        """Release both."""
        for side in self._sides:
            side.close()

    def _pair(self) -> tuple[Frame, Frame]:
        frames = [side.newest() for side in self._sides]
        for _ in range(APART):
            later = frames[0].stamp - frames[1].stamp
            if abs(later) <= self._skew:
                return frames[0], frames[1]
            older = 0 if later < 0 else 1
            frames[older] = self._sides[older].newest()
        raise LinkLost(
            self._session.device,
            f"the two cameras are never within {self._skew * 1e3:.0f} ms of each other",
            "trigger them together, raise their rate, or raise max_skew_s",
        )


class StereoPair(CameraDriver):
    """A stereo pair as a camera whose images carry depth."""

    Settings: type[CameraSettings] = StereoSettings
