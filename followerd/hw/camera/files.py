"""Recorded frames: a folder of images or a video file, in order, with nominal stamps.

They are read as colour (BGR), or as grey where a tone says how 16-bit greys become 8-bit ones.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from followerd.errors import DeviceError, UsageError
from followerd.geometry import Array
from followerd.hw.camera.protocol import Frame
from followerd.hw.camera.tone import Tone
from followerd.messages import Pixels

NOMINAL_RATE = 25.0  # frames a second where a recording does not say
SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".ppm", ".pgm", ".tif", ".tiff", ".webp"}


class Recording(Protocol):
    """Frames from 0 in order, each time it is iterated anew."""

    rate: float  # Hz
    count: int  # frames, as far as is known before reading
    width: int  # px
    height: int  # px

    def __iter__(self) -> Iterator[Frame]:
        """The frames, BGR or grey; raises DeviceError where one cannot be read."""


def open_recording(path: Path, tone: Tone | None = None) -> Recording:
    """A folder of images or a video; raises UsageError or DeviceError."""
    if not path.exists():
        raise UsageError(f"{path} does not exist: give a folder of images or a video file")
    return ImageFolder(path, tone=tone) if path.is_dir() else Video(path, tone)


class ImageFolder:
    """The images of a folder in the order of the numbers in their names."""

    def __init__(self, folder: Path, rate: float = NOMINAL_RATE, tone: Tone | None = None) -> None:
        self.rate = rate
        self._tone = tone
        self._paths = sorted(
            (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES), key=_by_number
        )
        if not self._paths:
            raise UsageError(f"{folder} holds no images ({' '.join(sorted(SUFFIXES))})")
        self.names = [path.name for path in self._paths]
        self.count = len(self._paths)
        self.height, self.width = _read(self._paths[0], None).shape[:2]

    def __iter__(self) -> Iterator[Frame]:
        for index, path in enumerate(self._paths):
            yield Frame(index, index / self.rate, _read(path, self._tone))


class Video:
    """A video file; frames past a damaged place are not reached."""

    def __init__(self, path: Path, tone: Tone | None = None) -> None:
        self._path = path
        self._tone = tone
        capture = self._open()
        try:
            rate = capture.get(cv2.CAP_PROP_FPS)
            self.rate = rate if 1.0 <= rate <= 1000.0 else NOMINAL_RATE
            self.count = max(0, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)))
            self.width = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
            self.height = int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        finally:
            capture.release()

    def __iter__(self) -> Iterator[Frame]:
        capture = self._open()
        try:
            index = 0
            while (answer := capture.read())[0]:
                pixels = np.asarray(answer[1], np.uint8)
                if self._tone is not None:
                    pixels = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8)
                yield Frame(index, index / self.rate, pixels)
                index += 1
        finally:
            capture.release()

    def _open(self) -> cv2.VideoCapture:
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # the one line below says it all
        capture = cv2.VideoCapture(str(self._path))
        if not capture.isOpened():
            raise DeviceError(
                str(self._path),
                "cannot be opened as a video",
                "convert it (ffmpeg), or give a folder of images",
            )
        return capture


def _read(path: Path, tone: Tone | None) -> Pixels:
    grey = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH
    colour = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
    pixels = cv2.imread(str(path), colour if tone is None else grey)
    if pixels is None:
        raise DeviceError(str(path), "cannot be read as an image", "is the file damaged?")
    if tone is None:
        deep = pixels.dtype != np.uint8
        return np.asarray(_stretched(np.asarray(pixels, float)) if deep else pixels, np.uint8)
    if pixels.dtype not in (np.uint8, np.uint16):
        remedy = "give 8-bit or 16-bit grey images"
        raise DeviceError(str(path), f"has {pixels.dtype} pixels", remedy)
    return tone(np.asarray(pixels, np.uint8 if pixels.dtype == np.uint8 else np.uint16))


def _stretched(pixels: Array) -> Array:
    """Deeper pixels in 8 bits, by the image's own range, as a thermal camera's automatic gain
    does; a few dead or burning pixels have no say in it."""
    low, high = np.percentile(pixels[::4, ::4], (0.1, 99.9)).tolist()
    scaled: Array = (pixels - low) * (255.0 / max(high - low, 1.0))
    return np.clip(scaled, 0.0, 255.0)


def _by_number(path: Path) -> list[tuple[int, str]]:
    """Sorts img2 before img10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]
