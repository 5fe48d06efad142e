"""Recorded frames as images with a camera model."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from followerd.bench.recorded_source import RecordedFrames, is_recording
from followerd.config import Config
from followerd.geometry import Camera
from followerd.hw.camera.files import Recording, open_recording
from followerd.hw.camera.rgbd import RgbdFolder
from followerd.hw.camera.settings import CameraSettings
from followerd.messages import Image


def open_source(path: Path) -> Recording:
    """A video, a folder of images (or with the images in `img/`), or of pairs in `rgb/`, `depth/`.

    Or a recording, or a ROS bag. Raises UsageError or DeviceError when it cannot be opened.
    """
    if is_recording(path):
        return RecordedFrames(path)
    if (path / "rgb").is_dir() and (path / "depth").is_dir():
        return RgbdFolder(path)
    inner = path / "img"
    return open_recording(inner if inner.is_dir() else path)


def camera_of(recording: Recording, config: Config | None) -> Camera:
    """The recorded camera, else the config's or a usual one, at the recording's size."""
    if isinstance(recording, RecordedFrames):
        return recording.camera
    settings = config.camera if config is not None else CameraSettings()
    size = {"width": recording.width, "height": recording.height}
    camera = CameraSettings(**(settings.model_dump(include={"hfov_deg", "mount"}) | size)).camera
    lens = recording.lens if isinstance(recording, RgbdFolder) else None
    if lens is None:
        return camera
    fx, fy, cx, cy = lens
    return replace(camera, fx=fx, fy=fy, cx=cx, cy=cy)


def images(recording: Recording, camera: Camera) -> Iterator[Image]:
    """The frames one after another, none read before it is asked for."""
    for frame in recording:
        yield Image(frame.id, frame.stamp, frame.stamp, frame.pixels, camera, frame.depth)
