"""A kernel that answers like one with a camera: every answer is bytes at the header's offsets.

Request numbers and offsets are written out here from videodev2.h (64-bit), apart from the
structures of the driver: what the two disagree in fails.
"""

import ctypes
import errno
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic, sleep

MONOTONIC, START_OF_EXPOSURE, DAMAGED = 0x2000, 0x1_0000, 0x40

Handler = Callable[[bytearray], None]


@dataclass
class Shot:
    """One frame that waits in the kernel."""

    data: bytes
    sequence: int
    stamp: float  # s
    flags: int = MONOTONIC | START_OF_EXPOSURE


@dataclass
class VideoKernel:
    """A UVC camera, as it answered; the fields are what tests change."""

    capabilities: int = 0x84A0_0001
    device_caps: int = 0x0420_0001
    formats: tuple[str, ...] = ("MJPG", "YUYV")
    inputs: tuple[str, ...] = ("Camera 1",)
    size: tuple[int, int] | None = None  # what it offers instead of what is asked for
    field_order: int = 1  # progressive
    stride: int = 0
    standards: bool = False
    controls: dict[int, list[int]] = field(default_factory=dict)  # id -> [value, default]
    refuse: dict[int, int] = field(default_factory=dict)  # request -> errno
    shots: list[Shot] = field(default_factory=list)
    gone: bool = False
    one_by_one: bool = False  # a frame comes when the one before was taken
    patience: float = 0.0  # s that `wait` really waits for a frame
    length: int = 64 * 48 * 2

    def __post_init__(self) -> None:
        self.log: list[str] = []
        self.set_controls: list[tuple[int, int]] = []
        self.queued: list[int] = []
        self.chosen_format = ""
        self._ready = 0  # shots that the kernel hands out before the next `wait`
        self.memory = [bytearray(self.length) for _ in range(4)]
        self.handlers: dict[int, Handler] = {
            0x80685600: self._querycap,
            0xC0405602: self._enum_fmt,
            0xC0D05605: self._s_fmt,
            0xC0CC5616: self._s_parm,
            0xC050561A: self._enuminput,
            0xC0045627: lambda raw: self.log.append(f"input {struct.unpack('i', raw)[0]}"),
            0x40085618: self._s_std,
            0xC0445624: self._queryctrl,
            0xC008561B: self._g_ctrl,
            0xC008561C: self._s_ctrl,
            0xC0145608: lambda raw: self.log.append(f"buffers {struct.unpack_from('I', raw)[0]}"),
            0xC0585609: self._querybuf,
            0xC058560F: lambda raw: self.queued.append(struct.unpack_from("I", raw)[0]),
            0xC0585611: self._dqbuf,
            0x40045612: lambda _: self.log.append("on"),
            0x40045613: lambda _: self.log.append("off"),
        }

    def open(self, path: str) -> int:
        if path == "/dev/video9":
            raise OSError(errno.EACCES, os.strerror(errno.EACCES))
        return os.open(path, os.O_RDONLY) if path == "/dev/video77" else 100

    def ioctl(self, fd: int, request: int, argument: ctypes.Structure) -> None:
        assert fd == 100
        number = errno.ENODEV if self.gone else self.refuse.get(request, 0)
        if number:
            raise OSError(number, os.strerror(number))
        raw = bytearray(bytes(argument))
        assert len(raw) == request >> 16 & 0x3FFF
        self.handlers[request](raw)
        ctypes.memmove(ctypes.addressof(argument), bytes(raw), len(raw))

    def map(self, fd: int, length: int, offset: int) -> memoryview:
        assert length == self.length
        return memoryview(self.memory[offset // 4096])

    def wait(self, fd: int, timeout: float) -> bool:
        began = monotonic()
        while not self.gone and not self.shots and monotonic() - began < self.patience:
            sleep(0.001)
        self._ready = 1 if self.one_by_one else len(self.shots)
        return self.gone or bool(self.shots)

    def close(self, fd: int) -> None:
        self.log.append("closed")

    def _querycap(self, raw: bytearray) -> None:
        names = (b"uvcvideo", b"HD Webcam", b"usb-0000:00:14.0-1")
        caps = (0x060119, self.capabilities, self.device_caps)
        raw[:] = struct.pack("16s32s32sIII12x", *names, *caps)

    def _enum_fmt(self, raw: bytearray) -> None:
        index = struct.unpack_from("I", raw)[0]
        if index >= len(self.formats):
            raise OSError(errno.EINVAL, "")
        raw[44:48] = self.formats[index].ljust(4).encode()

    def _s_fmt(self, raw: bytearray) -> None:
        asked = struct.unpack_from("2I4sI", raw, 8)
        self.chosen_format = asked[2].decode()
        self.log.append(f"format {self.chosen_format.strip()} field {asked[3]}")
        struct.pack_into("2I", raw, 8, *(self.size or asked[:2]))
        struct.pack_into("2I", raw, 20, self.field_order, self.stride)

    def _s_parm(self, raw: bytearray) -> None:
        period = struct.unpack_from("2I", raw, 12)
        self.log.append(f"rate {period[1] / period[0]:g}")

    def _enuminput(self, raw: bytearray) -> None:
        index = struct.unpack_from("I", raw)[0]
        if index >= len(self.inputs):
            raise OSError(errno.EINVAL, "")
        raw[4:36] = self.inputs[index].encode().ljust(32, b"\0")

    def _s_std(self, raw: bytearray) -> None:
        if not self.standards:
            raise OSError(errno.ENOTTY, "")
        self.log.append(f"standard {struct.unpack('Q', raw)[0]:x}")

    def _queryctrl(self, raw: bytearray) -> None:
        control = struct.unpack_from("I", raw)[0]
        if control not in self.controls:
            raise OSError(errno.EINVAL, "")
        struct.pack_into("i", raw, 52, self.controls[control][1])

    def _g_ctrl(self, raw: bytearray) -> None:
        control = struct.unpack_from("I", raw)[0]
        if control not in self.controls:
            raise OSError(errno.EINVAL, "")
        struct.pack_into("i", raw, 4, self.controls[control][0])

    def _s_ctrl(self, raw: bytearray) -> None:
        control, value = struct.unpack("Ii", raw)
        if control not in self.controls:
            raise OSError(errno.EINVAL, "")
        self.controls[control][0] = value
        self.set_controls.append((control, value))

    def _querybuf(self, raw: bytearray) -> None:
        index = struct.unpack_from("I", raw)[0]
        struct.pack_into("I", raw, 64, 4096 * index)
        struct.pack_into("I", raw, 72, self.length)

    def _dqbuf(self, raw: bytearray) -> None:
        if not self._ready:
            raise BlockingIOError(errno.EAGAIN, "")
        self._ready -= 1
        shot, index = self.shots.pop(0), self.queued.pop(0)
        self.memory[index][: len(shot.data)] = shot.data
        struct.pack_into("I", raw, 0, index)
        struct.pack_into("2I", raw, 8, len(shot.data), shot.flags)
        seconds, micro = divmod(round(shot.stamp * 1e6), 1_000_000)
        struct.pack_into("2q", raw, 24, seconds, micro)
        struct.pack_into("I", raw, 56, shot.sequence)
