"""Microsoft's Kinect v1: colour with depth registered to it, a tilt motor and a lamp."""

import threading
from collections.abc import Callable
from dataclasses import replace
from math import degrees, nan, radians
from typing import Any, ClassVar, Literal

import cv2
import numpy as np
import numpy.typing as npt
import structlog
from pydantic import Field, model_validator

from followerd.errors import LinkLost, OpenError
from followerd.hw.camera.driver import CameraDriver
from followerd.hw.camera.freenect import LIBRARY, Freenect, Functions, loaded
from followerd.hw.camera.grabber import GrabberSource, Latest, Session, as_lost
from followerd.hw.camera.protocol import Frame
from followerd.hw.camera.registration import Raw, Registration, RegistrationTables
from followerd.hw.camera.settings import CameraMount, CameraSettings
from followerd.hw.camera.source import FrameSource

READOUT = 1 / 30  # s from the middle of the exposure to the frame in memory; assumed
PAIRED = 0.05  # s that a colour image's depth may be older; the two are not synchronised
SILENT = 1.0  # s without a colour image: its power supply is gone
TILT_PERIOD = 1.0  # s between looks at the motor
TILT_TOLERANCE = 2.0  # degrees
MAX_TILT = 27.0  # degrees

log = structlog.get_logger()


class KinectSettings(CameraSettings):
    """Frames are 640x480 at 30 Hz; the tilt motor is driven to the mount's elevation."""

    sees: ClassVar[Literal["colour", "depth", "thermal"]] = "depth"

    width: Literal[640] = 640
    height: Literal[480] = 480
    rate_hz: float = Field(30.0, ge=30, le=30)
    hfov_deg: float = Field(62.7, gt=5, lt=150, description="of the colour camera")
    mount: CameraMount = CameraMount(elevation_deg=0.0)
    tilt_motor: bool = Field(True, description="drive it to mount.elevation_deg above the horizon")
    led: Literal["off", "green", "red", "yellow", "blink_green"] = "green"

    @model_validator(mode="after")
    def _within_reach(self) -> "KinectSettings":
        if self.tilt_motor and abs(self.mount.elevation_deg) > MAX_TILT:
            raise ValueError(
                f"the tilt motor reaches {MAX_TILT:.0f} degrees up and down, mount.elevation_deg"
                f" is {self.mount.elevation_deg:g}; mount it level, or say tilt_motor: false"
            )
        return self


class KinectSource(GrabberSource):
    """`kinect:0`, `kinect:LIBRARY` or `kinect:LIBRARY#0`; also the remote control of its tilt."""

    def __init__(
        self,
        link: str,
        settings: KinectSettings,
        load: Callable[[str, str], Functions] = loaded,
    ) -> None:
        super().__init__(link, self._open)
        self._load = load
        place = link.removeprefix("kinect:")
        library, _, index = ("", "", place) if place.isdecimal() else place.partition("#")
        self._library = library or LIBRARY
        self._index = index or "0"
        self._settings = settings
        self.wanted_tilt = settings.mount.elevation_deg if settings.tilt_motor else None  # degrees
        self.tilt = nan  # degrees above the horizon, as read last

    def _open(self, session: Session) -> "KinectGrabber":
        if not self._index.isdecimal():
            remedy = "write kinect:0, kinect:LIBRARY or kinect:LIBRARY#0"
            raise OpenError(session.device, f"{self.name}: no number of a Kinect", remedy)
        library = self._load(session.device, self._library)
        unit = Freenect(session.device, library, int(self._index))
        try:
            return KinectGrabber(session, unit, self._settings, self)
        except BaseException:
            unit.close()
            raise


class KinectGrabber:
    """An open Kinect: one thread lives with libfreenect, the caller's turns raw into metres."""

    def __init__(
        self, session: Session, unit: Freenect, settings: KinectSettings, remote: KinectSource
    ) -> None:
        self._session = session
        self._unit = unit
        self._remote = remote
        tables = unit.registration() or RegistrationTables.of_pinholes(settings.camera)
        self._register = Registration(tables)
        self._count = 0
        self._raw: tuple[float, Raw] | None = None
        self._latest: Latest[tuple[int, float, npt.NDArray[np.uint8], Raw | None]] = Latest()
        self._asked: float | None = None
        self._is_locked = self._is_wanted_locked = False
        self._look_at = 0.0
        self._stop = threading.Event()
        unit.start(self._on_video, self._on_depth)
        unit.set_automatic(True)
        if unit.has_motor:
            unit.set_led(settings.led)
        self._thread = threading.Thread(target=self._live, name="kinect", daemon=True)
        self._thread.start()

    def grab(self) -> Frame:
        """The newest colour image, with depth registered to it; raises LinkLost."""
        newest = self._latest.take(SILENT)
        if newest is None:
            device = self._session.device
            raise LinkLost(device, "the Kinect sends no images", "check its power supply")
        number, stamp, rgb, raw = newest
        pixels = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), np.uint8)
        return Frame(number, stamp, pixels, None if raw is None else self._register(raw))

    def lock_exposure(self, locked: bool = True) -> None:
        """See Grabber."""
        self._is_wanted_locked = locked

    def close(self) -> None:
        """Release it."""
        self._stop.set()
        self._thread.join()
        self._unit.close()

    def _live(self) -> None:
        try:
            while not self._stop.is_set():
                self._unit.process_events()
                if self._is_locked is not self._is_wanted_locked:
                    self._is_locked = self._is_wanted_locked
                    self._unit.set_automatic(not self._is_locked)
                if self._unit.has_motor and self._session.now() >= self._look_at:
                    self._look_at = self._session.now() + TILT_PERIOD
                    self._keep_tilt()
        except Exception as error:  # whatever ends the thread, its reader must learn of it
            self._latest.fail(as_lost(error, self._session.device, "kinect"))

    def _on_depth(self, raw: npt.NDArray[Any], _ticks: int) -> None:
        self._raw = self._session.now(), raw

    def _on_video(self, rgb: npt.NDArray[Any], _ticks: int) -> None:
        now, raw = self._session.now(), None
        if self._raw is not None and now - self._raw[0] <= PAIRED:
            raw = self._raw[1]
        self._latest.put((self._count, now - READOUT, rgb, raw))
        self._count += 1

    def _keep_tilt(self) -> None:
        wanted = self._remote.wanted_tilt
        if wanted is not None and wanted != self._asked:
            self._unit.set_tilt(wanted)
            self._asked = wanted
            return
        tilt = self._unit.tilt()
        if tilt is None or tilt == self._remote.tilt:
            return
        self._remote.tilt = tilt
        if wanted is not None and abs(tilt - wanted) > TILT_TOLERANCE:
            device = self._session.device
            log.warning("tilt is not as configured", device=device, tilt=tilt, wanted=wanted)


class Kinect(CameraDriver):
    """A Kinect v1 (or its twin) as a camera whose images carry depth."""

    Settings: type[CameraSettings] = KinectSettings

    def __init__(self, settings: KinectSettings, source: FrameSource, name: str = "camera") -> None:
        super().__init__(settings, source, name)

    def set_tilt(self, elevation: float) -> None:
        """Tilt to `elevation` (rad above the horizon); images carry it from now on."""
        if isinstance(self._source, KinectSource):
            self._source.wanted_tilt = max(-MAX_TILT, min(MAX_TILT, degrees(elevation)))
            self._camera = replace(self._camera, elevation=radians(self._source.wanted_tilt))
