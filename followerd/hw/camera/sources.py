"""Which source of frames a camera's link names."""

from pathlib import Path

from followerd.errors import ConfigError
from followerd.hw.camera.calibration import straightened
from followerd.hw.camera.grabber import GrabberSource
from followerd.hw.camera.kinect import KinectSettings, KinectSource
from followerd.hw.camera.playback import is_recording, playback
from followerd.hw.camera.ring import RingSource
from followerd.hw.camera.settings import CameraSettings
from followerd.hw.camera.source import FrameSource
from followerd.hw.camera.stereo import StereoSettings, StereoSource
from followerd.hw.camera.thermal import ThermalSettings
from followerd.hw.camera.tone import Tone
from followerd.hw.camera.v4l2 import V4l2Source


def open_camera(link: str, settings: CameraSettings) -> FrameSource:
    """The source behind a link; raises ConfigError where it does not fit the kind.

    `/dev/videoN` (or a symlink to it), a folder of images, a video file, `kinect:0`, or the frame
    ring of a twin: `ring:FILE` or its path. A stereo pair has a second link in its settings.
    """
    if link.startswith("kinect:") and not isinstance(settings, KinectSettings):
        raise ConfigError(f"camera: link {link} needs kind: kinect")
    ring = RingSource(link.removeprefix("ring:"))
    if isinstance(settings, StereoSettings):
        left = grabber_source(link, settings)
        right = grabber_source(settings.right_link, settings)
        return ring if left is None or right is None else StereoSource(left, right, settings)
    return grabber_source(link, settings) or ring


def grabber_source(link: str, settings: CameraSettings) -> GrabberSource | None:
    """The real camera or recording that a link names; None for a frame ring."""
    if isinstance(settings, KinectSettings) and link.startswith("kinect:"):
        return _straight(KinectSource(link, settings), settings)
    tone = Tone(settings.levels_counts) if isinstance(settings, ThermalSettings) else None
    if Path(link).resolve().name.startswith("video") and not is_recording(link):
        return _straight(V4l2Source(link, settings, tone or Tone(), tone is not None), settings)
    if is_recording(link):
        return _straight(playback(link, settings.rate_hz, settings.loop, tone), settings)
    return None


def _straight(source: GrabberSource, settings: CameraSettings) -> GrabberSource:
    """The source, its images undistorted where a calibration says how."""
    calibration = settings.calibration
    if calibration is not None and any(calibration.distortion):
        source.open_grabber = straightened(source.open_grabber, calibration)
    return source
