"""A recording as if it were a camera: at its rate, from the start again at its end."""

from collections.abc import Iterator
from pathlib import Path

from followerd.errors import DeviceError, LinkLost, OpenError, UsageError
from followerd.hw.camera.files import Recording, open_recording
from followerd.hw.camera.grabber import GrabberSource, Session
from followerd.hw.camera.protocol import Frame
from followerd.hw.camera.tone import Tone

VIDEOS = {".mp4", ".avi", ".mkv", ".mov", ".m4v", ".mpg", ".mpeg", ".webm"}


def is_recording(link: str) -> bool:
    """Whether a camera's link names a folder of images or a video file."""
    path = Path(link)
    return path.is_dir() or path.suffix.lower() in VIDEOS


def playback(path: str, rate: float, loop: bool, tone: Tone | None) -> GrabberSource:
    """A folder plays at `rate` (Hz), a video at its own; `tone` None: in colour."""

    def open_player(session: Session) -> Player:
        try:
            recording = open_recording(Path(path), tone)
        except UsageError as error:
            raise OpenError(session.device, str(error)) from error
        except DeviceError as error:
            problem = f"{error.device} {error.problem}"
            raise OpenError(session.device, problem, error.remedy) from error
        if Path(path).is_dir():
            recording.rate = rate
        return Player(session, path, recording, loop)

    return GrabberSource(path, open_player)


class Player:
    """A recording being played; frames whose time has passed are left out."""

    def __init__(self, session: Session, name: str, recording: Recording, loop: bool) -> None:
        self._session = session
        self._name = name
        self._recording = recording
        self._frames: Iterator[Frame] = iter(recording)
        self._loop = loop
        self._start = session.now()
        self._next = 0  # counts frames, through all turns

    def grab(self) -> Frame:
        """The frame that is due next, when it is due; raises LinkLost at the end."""
        period = 1.0 / self._recording.rate
        while True:
            frame = self._read()
            index, self._next = self._next, self._next + 1
            due = self._start + index * period
            if due + period > self._session.now():
                self._session.stop.wait(max(0.0, due - self._session.now()))
                return Frame(index, due, frame.pixels)

    def lock_exposure(self, locked: bool = True) -> None:
        """What is recorded is recorded."""

    def close(self) -> None:
        """Nothing is held."""

    def _read(self) -> Frame:
        frame = next(self._frames, None)
        if frame is None and self._loop:
            self._frames = iter(self._recording)
            frame = next(self._frames, None)
        if frame is None:
            remedy = "say loop: true to begin anew"
            raise LinkLost(self._session.device, f"{self._name} has ended", remedy)
        return frame
