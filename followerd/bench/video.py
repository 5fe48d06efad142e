"""Video files written through OpenCV."""

from pathlib import Path
from types import TracebackType

import cv2

from followerd.errors import UsageError
from followerd.messages import Pixels


class VideoWriter:
    """Writes BGR frames into an MP4 file (MPEG-4 part 2: the codec every OpenCV build carries).

    The first frame sets the size. Raises UsageError when the file cannot be written.
    """

    def __init__(self, path: Path, rate: float) -> None:
        self._path = path
        self._rate = rate  # frames/s
        self._file: cv2.VideoWriter | None = None

    def write(self, frame: Pixels) -> None:
        """Append one frame (H, W, 3)."""
        if self._file is None:
            self._file = self._open(frame.shape[1], frame.shape[0])
        self._file.write(frame)

    def _open(self, width: int, height: int) -> cv2.VideoWriter:
        if not self._path.parent.is_dir():
            raise UsageError(f"--render {self._path}: no such folder")
        codec = cv2.VideoWriter.fourcc(*"mp4v")
        file = cv2.VideoWriter(str(self._path), codec, self._rate, (width, height))
        if not file.isOpened():
            raise UsageError(f"--render {self._path}: cannot be written as MP4; name it *.mp4")
        return file

    def close(self) -> None:
        """Finish the file."""
        if self._file is not None:
            self._file.release()

    def __enter__(self) -> "VideoWriter":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class Still:
    """Keeps the last frame, as a picture file. Raises UsageError when it cannot be written."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._last: Pixels | None = None

    def write(self, frame: Pixels) -> None:
        """Take the place of the frame before."""
        self._last = frame

    def close(self) -> None:
        """Write the file, if there was a frame."""
        if self._last is not None and not cv2.imwrite(str(self._path), self._last):
            raise UsageError(f"--render {self._path}: cannot be written")
