"""A live camera or grabber of the kernel (V4L2): negotiation, streaming, exposure.

The newest frame wins. Frames are numbered by the kernel, so that lost ones are counted, and
stamped by it where its stamps are CLOCK_MONOTONIC.
"""

import ctypes
import errno
from pathlib import Path

import structlog

from followerd.errors import LinkLost, OpenError, SetupError
from followerd.hw.camera import videodev2 as v4l2
from followerd.hw.camera.exposure import Exposure
from followerd.hw.camera.grabber import GrabberSource, Session
from followerd.hw.camera.kernel import Kernel, VideoKernel
from followerd.hw.camera.modes import can_capture, formats, inputs, is_offered
from followerd.hw.camera.pixels import COLOUR_FIRST, GREY_FIRST, decode, top_field
from followerd.hw.camera.protocol import Frame
from followerd.hw.camera.settings import CameraSettings
from followerd.hw.camera.tone import Tone

BUFFERS = 4
SILENT = 1.0  # s without a frame: gone
DAMAGED = 30  # frames in a row that cannot be decoded: something is wrong
OLDEST = 1.0  # s, a kernel's stamp older than this is not believed
INTERLACED = (v4l2.FIELD_INTERLACED, v4l2.FIELD_INTERLACED_TB, v4l2.FIELD_INTERLACED_BT)

log = structlog.get_logger()


class V4l2Source(GrabberSource):
    """A video device by its path; what its exposure was locked to outlives an unplugging."""

    def __init__(
        self,
        path: str,
        settings: CameraSettings,
        tone: Tone,
        grey: bool = False,
        kernel: VideoKernel | None = None,
    ) -> None:
        super().__init__(path, self._open)
        self._settings = settings
        self._tone = tone
        self._wanted = GREY_FIRST if grey else COLOUR_FIRST
        self._kernel = kernel or Kernel()
        self._exposure = Exposure(settings.video.exposure == "auto")

    def _open(self, session: Session) -> "V4l2Device":
        fd = self._descriptor(session.device)
        try:
            return V4l2Device(
                session, self.name, fd, self._kernel, self._settings, self._wanted, self._tone,
                self._exposure,
            )  # fmt: skip
        except OSError as error:
            self._kernel.close(fd)
            if error.errno == errno.EBUSY:
                problem, remedy = "is used by another program", "close that program"
            elif error.errno in (errno.ENOTTY, errno.EINVAL):
                problem, remedy = "is no video device", "choose another link"
            else:
                problem, remedy = f"fails: {error.strerror}", "unplug it and plug it in again"
            raise OpenError(session.device, f"{self.name} {problem}", remedy) from error
        except BaseException:
            self._kernel.close(fd)
            raise

    def _descriptor(self, device: str) -> int:
        try:
            return self._kernel.open(self.name)
        except FileNotFoundError as error:
            there = ", ".join(sorted(str(path) for path in Path("/dev").glob("video*")))
            remedy = f"there are: {there}" if there else "no camera is plugged in"
            raise OpenError(device, f"{self.name} does not exist", remedy) from error
        except OSError as error:
            remedy = "close the program that uses it, or join the group video"
            problem = f"{self.name} cannot be opened: {error.strerror}"
            raise OpenError(device, problem, remedy) from error


class V4l2Device:
    """An open video device that streams; raises OpenError, SetupError, OSError when opened."""

    def __init__(
        self,
        session: Session,
        name: str,
        fd: int,
        kernel: VideoKernel,
        settings: CameraSettings,
        wanted: tuple[str, ...],
        tone: Tone,
        exposure: Exposure,
    ) -> None:
        self._session = session
        self._name = name
        self._fd = fd
        self._kernel = kernel
        self._settings = settings
        self._tone = tone
        self._exposure = exposure
        self._period = 1.0 / settings.rate_hz
        self._first: int | None = None  # the kernel's number of our frame 0
        self._last = -1
        self.damaged = 0
        self._be_a_camera()
        self._choose_input()
        self._choose_format(wanted)
        self._choose_rate()
        exposure.prepare(self._ioctl)
        self._start()

    def grab(self) -> Frame:
        """The newest frame; raises LinkLost when it is unplugged or silent."""
        for _ in range(DAMAGED):
            self._exposure.work(self._ioctl, self._session.device)
            try:
                frame = self._frame()
            except OSError as error:
                problem = f"{self._name} is gone: {error.strerror}"
                raise LinkLost(self._session.device, problem, "check the plug") from error
            if frame is not None:
                return frame
            self.damaged += 1
        problem = f"{self._name} sends damaged frames only"
        raise LinkLost(self._session.device, problem, "use another cable or pixel_format")

    def lock_exposure(self, locked: bool = True) -> None:
        """See Grabber."""
        self._exposure.wanted = locked

    def close(self) -> None:
        """Stop and release it."""
        try:
            self._ioctl(v4l2.VIDIOC_STREAMOFF, v4l2.Number(v4l2.BUF_TYPE_VIDEO_CAPTURE))
        except OSError as error:
            log.debug("camera does not stop", device=self._session.device, error=str(error))
        self._memory.clear()
        self._kernel.close(self._fd)

    def _be_a_camera(self) -> None:
        capability = v4l2.Capability()
        self._ioctl(v4l2.VIDIOC_QUERYCAP, capability)
        if not can_capture(capability):
            card = capability.card.decode(errors="replace")
            remedy = "a camera has several: use the first, for instance /dev/video0"
            problem = f"{self._name} ({card}) captures no video"
            raise OpenError(self._session.device, problem, remedy)

    def _choose_input(self) -> None:
        wanted = self._settings.video.input
        if wanted is not None:
            names = inputs(self._ioctl)
            lower = [name.lower() for name in names]
            index = int(wanted) if wanted.isdecimal() else _position(lower, wanted.lower())
            if not 0 <= index < len(names):
                remedy = f"it has: {', '.join(names) or 'none'}"
                problem = f"{self._name} has no input {wanted!r}"
                raise SetupError(self._session.device, problem, remedy)
            self._ioctl(v4l2.VIDIOC_S_INPUT, v4l2.Number(index))
        standard = self._settings.video.standard
        if standard is not None:
            try:
                self._ioctl(v4l2.VIDIOC_S_STD, v4l2.Standard(v4l2.STANDARDS[standard]))
            except OSError as error:
                problem = f"{self._name} refuses {standard}"
                remedy = "only analogue grabbers have a standard; leave it out"
                raise SetupError(self._session.device, problem, remedy) from error

    def _choose_format(self, wanted: tuple[str, ...]) -> None:
        offered = formats(self._ioctl)
        asked = self._settings.video.pixel_format
        known = wanted if asked == "auto" else (asked,)
        self._kind = next((name for name in known if name in offered), "")
        if not self._kind:
            problem = f"{self._name} offers {', '.join(offered) or 'no format'}"
            raise SetupError(self._session.device, problem, f"needed is {' or '.join(known)}")
        size = self._settings.width, self._settings.height
        analogue = self._settings.video.standard is not None
        answer = v4l2.Format(type=v4l2.BUF_TYPE_VIDEO_CAPTURE)
        answer.fmt.pix.width, answer.fmt.pix.height = size
        answer.fmt.pix.pixelformat = v4l2.fourcc(self._kind.ljust(4))
        answer.fmt.pix.field = v4l2.FIELD_INTERLACED if analogue else v4l2.FIELD_ANY
        self._ioctl(v4l2.VIDIOC_S_FMT, answer)
        pix = answer.fmt.pix
        if (pix.width, pix.height) != size:
            problem = f"{self._name} has no {size[0]}x{size[1]}"
            remedy = f"it offers {pix.width}x{pix.height} instead: set width and height to that"
            raise SetupError(self._session.device, problem, remedy)
        if pix.pixelformat != v4l2.fourcc(self._kind.ljust(4)):
            problem = f"{self._name} gives {v4l2.fourcc_name(pix.pixelformat)}, not {self._kind}"
            raise SetupError(self._session.device, problem, "set video.pixel_format to another")
        if pix.field not in (v4l2.FIELD_NONE, *INTERLACED):
            problem = f"{self._name} sends single fields (field {pix.field})"
            raise SetupError(self._session.device, problem, "set video.standard, or halve height")
        self._is_interlaced = pix.field in INTERLACED
        self._stride = pix.bytesperline

    def _choose_rate(self) -> None:
        answer = v4l2.StreamParameters(type=v4l2.BUF_TYPE_VIDEO_CAPTURE)
        answer.timeperframe.numerator = 1000
        answer.timeperframe.denominator = round(1000 * self._settings.rate_hz)
        if not is_offered(
            self._ioctl, v4l2.VIDIOC_S_PARM, answer
        ):  # grabbers run at their standard's rate
            return
        if answer.timeperframe.numerator and answer.timeperframe.denominator:
            self._period = answer.timeperframe.numerator / answer.timeperframe.denominator

    def _start(self) -> None:
        asked = v4l2.RequestBuffers(BUFFERS, v4l2.BUF_TYPE_VIDEO_CAPTURE, v4l2.MEMORY_MMAP)
        self._ioctl(v4l2.VIDIOC_REQBUFS, asked)
        self._memory: list[memoryview] = []
        for index in range(asked.count):
            buffer = self._buffer(index)
            self._ioctl(v4l2.VIDIOC_QUERYBUF, buffer)
            self._memory.append(self._kernel.map(self._fd, buffer.length, buffer.m.offset))
            self._ioctl(v4l2.VIDIOC_QBUF, buffer)
        self._ioctl(v4l2.VIDIOC_STREAMON, v4l2.Number(v4l2.BUF_TYPE_VIDEO_CAPTURE))

    def _frame(self) -> Frame | None:
        """The newest frame that waits, or the next; None when it is damaged."""
        if not self._kernel.wait(self._fd, SILENT):
            raise LinkLost(self._session.device, f"{self._name} sends no frames", "check the plug")
        arrived = self._session.now()
        newest: v4l2.Buffer | None = None
        while (buffer := self._filled()) is not None:
            if newest is not None:
                self._ioctl(v4l2.VIDIOC_QBUF, newest)
            newest = buffer
        if newest is None:
            return None
        size = self._settings.width, self._settings.height
        data = self._memory[newest.index][: newest.bytesused]
        pixels, jpeg = None, None
        if self._kind == "MJPG" and not self._is_interlaced:
            jpeg = bytes(data)
        if not newest.flags & v4l2.BUF_FLAG_ERROR:
            pixels = decode(self._kind, data, size, self._stride, self._tone)
        number, stamp = self._number(newest), self._stamp(newest, arrived)
        self._ioctl(v4l2.VIDIOC_QBUF, newest)
        if pixels is None:
            return None
        shown = top_field(pixels) if self._is_interlaced else pixels
        return Frame(number, stamp, shown, jpeg=jpeg)

    def _filled(self) -> v4l2.Buffer | None:
        buffer = self._buffer(0)
        try:
            self._ioctl(v4l2.VIDIOC_DQBUF, buffer)
        except BlockingIOError:
            return None
        return buffer

    def _number(self, buffer: v4l2.Buffer) -> int:
        """By the kernel's count; some drivers do not count."""
        if self._first is None:
            self._first = buffer.sequence
        self._last = max(self._last + 1, buffer.sequence - self._first)
        return self._last

    def _stamp(self, buffer: v4l2.Buffer, arrived: float) -> float:
        """Middle of the exposure: the kernel's, or half a frame before the frame's end."""
        flags = buffer.flags
        stamp = buffer.timestamp.tv_sec + 1e-6 * buffer.timestamp.tv_usec
        monotonic = flags & v4l2.BUF_FLAG_TIMESTAMP_MASK == v4l2.BUF_FLAG_TIMESTAMP_MONOTONIC
        if not monotonic or not 0.0 <= arrived - stamp < OLDEST:
            return arrived - 0.5 * self._period
        if flags & v4l2.BUF_FLAG_TSTAMP_SRC_MASK == v4l2.BUF_FLAG_TSTAMP_SRC_SOE:
            return float(stamp)
        return float(stamp) - 0.5 * self._period

    def _buffer(self, index: int) -> v4l2.Buffer:
        return v4l2.Buffer(index=index, type=v4l2.BUF_TYPE_VIDEO_CAPTURE, memory=v4l2.MEMORY_MMAP)

    def _ioctl(self, request: int, argument: ctypes.Structure) -> None:
        self._kernel.ioctl(self._fd, request, argument)


def _position(names: list[str], name: str) -> int:
    return names.index(name) if name in names else -1
