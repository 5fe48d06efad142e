"""What a video device says of itself: name, inputs, formats, sizes, rates."""

import ctypes
import errno
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from followerd.hw.camera import videodev2 as v4l2
from followerd.hw.camera.kernel import Kernel, VideoKernel
from followerd.hw.camera.pixels import COLOUR_FIRST

USUAL = ((320, 240), (640, 480))  # px
MOST = 64  # entries of a list, should a driver never end it

Entry = TypeVar("Entry", bound=ctypes.Structure)
Ioctl = Callable[[int, ctypes.Structure], None]  # asks; the answer overwrites the argument


@dataclass(frozen=True, slots=True)
class VideoMode:
    """A pixel format at a size, and how fast."""

    pixel_format: str
    width: int  # px
    height: int  # px
    rate: float  # Hz, the highest; 0 = it does not tell


@dataclass(frozen=True, slots=True)
class CameraFound:
    """A camera and what it can do."""

    name: str
    modes: tuple[VideoMode, ...]

    def __str__(self) -> str:
        kinds = dict.fromkeys(mode.pixel_format for mode in self.modes)
        shown = (" ".join([kind, *self._sizes(kind)]) for kind in kinds)
        return f"camera {self.name}: {'; '.join(shown) or 'no modes'}"

    def nearest(self, width: int, height: int) -> VideoMode | None:
        """The mode that we can read and that is nearest in size; None = there is none."""
        readable = [mode for mode in self.modes if mode.pixel_format in COLOUR_FIRST]
        return min(
            readable,
            key=lambda mode: (
                abs(mode.width - width) + abs(mode.height - height),
                COLOUR_FIRST.index(mode.pixel_format),
            ),
            default=None,
        )

    def _sizes(self, kind: str) -> list[str]:
        return [
            f"{mode.width}x{mode.height}" + (f"@{mode.rate:g}" if mode.rate else "")
            for mode in self.modes
            if mode.pixel_format == kind
        ]


def survey(path: str, kernel: VideoKernel | None = None) -> CameraFound | None:
    """What is at `path`, None when it captures no video; raises OSError. Nothing is changed."""
    calls = kernel or Kernel()
    fd = calls.open(path)

    def ask(request: int, argument: ctypes.Structure) -> None:
        calls.ioctl(fd, request, argument)

    try:
        capability = v4l2.Capability()
        ask(v4l2.VIDIOC_QUERYCAP, capability)
        if not can_capture(capability):
            return None
        modes = [mode for name in formats(ask) for mode in _modes(ask, name)]
        return CameraFound(capability.card.decode(errors="replace"), tuple(modes))
    finally:
        calls.close(fd)


def can_capture(capability: v4l2.Capability) -> bool:
    """Whether it streams images to us; a camera has nodes that do not."""
    can = capability.capabilities
    if can & v4l2.CAP_DEVICE_CAPS:
        can = capability.device_caps
    return bool(can & v4l2.CAP_VIDEO_CAPTURE and can & v4l2.CAP_STREAMING)


def inputs(ask: Ioctl) -> list[str]:
    """Names of its inputs, in their order."""
    return [
        entry.name.decode(errors="replace")
        for entry in _list(ask, v4l2.VIDIOC_ENUMINPUT, lambda n: v4l2.Input(index=n))
    ]


def formats(ask: Ioctl) -> list[str]:
    """Names of its pixel formats, its favourite first."""
    kind = v4l2.BUF_TYPE_VIDEO_CAPTURE
    return [
        v4l2.fourcc_name(entry.pixelformat).strip()
        for entry in _list(
            ask, v4l2.VIDIOC_ENUM_FMT, lambda n: v4l2.FormatDescription(index=n, type=kind)
        )
    ]


def is_offered(ask: Ioctl, request: int, argument: ctypes.Structure) -> bool:
    """Whether a question that may be refused was answered; raises OSError otherwise."""
    try:
        ask(request, argument)
    except OSError as error:
        if error.errno in (errno.EINVAL, errno.ENOTTY):
            return False
        raise
    return True


def _modes(ask: Ioctl, name: str) -> Iterator[VideoMode]:
    number = v4l2.fourcc(name.ljust(4))
    for entry in _list(
        ask, v4l2.VIDIOC_ENUM_FRAMESIZES, lambda n: v4l2.FrameSize(index=n, pixel_format=number)
    ):
        for width, height in _sizes(entry):
            yield VideoMode(name, width, height, _rate(ask, number, width, height))


def _sizes(entry: v4l2.FrameSize) -> list[tuple[int, int]]:
    """The size, or of a range the usual ones and the largest."""
    if entry.type == v4l2.FRMSIZE_DISCRETE:
        return [(entry.size[0], entry.size[1])]
    least_w, most_w, step_w, least_h, most_h, step_h = entry.size
    widths, heights = (
        range(least_w, most_w + 1, step_w or 1),
        range(least_h, most_h + 1, step_h or 1),
    )
    usual = [(w, h) for w, h in USUAL if w in widths and h in heights]
    return [*usual, *({(most_w, most_h)} - set(usual))]


def _rate(ask: Ioctl, number: int, width: int, height: int) -> float:
    intervals = _list(
        ask,
        v4l2.VIDIOC_ENUM_FRAMEINTERVALS,
        lambda n: v4l2.FrameInterval(index=n, pixel_format=number, width=width, height=height),
    )
    shortest = (interval.shortest for interval in intervals)
    return max((s.denominator / s.numerator for s in shortest if s.numerator), default=0.0)


def _list(ask: Ioctl, request: int, entry_of: Callable[[int], Entry]) -> Iterator[Entry]:
    """Entries 0, 1, … of one of the kernel's lists, to its end."""
    for index in range(MOST):
        entry = entry_of(index)
        if not is_offered(ask, request, entry):
            return
        yield entry
