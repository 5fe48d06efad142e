"""Of the kernel's videodev2.h (V4L2): structures, requests and numbers, named as there."""

import ctypes
from ctypes import Union, c_char, c_int32, c_long, c_uint8, c_uint32, c_uint64

BUF_TYPE_VIDEO_CAPTURE = 1
MEMORY_MMAP = 1

CAP_VIDEO_CAPTURE = 0x0000_0001
CAP_STREAMING = 0x0400_0000
CAP_DEVICE_CAPS = 0x8000_0000

FIELD_ANY, FIELD_NONE, FIELD_TOP, FIELD_BOTTOM, FIELD_INTERLACED = range(5)
FIELD_SEQ_TB, FIELD_SEQ_BT, FIELD_ALTERNATE, FIELD_INTERLACED_TB, FIELD_INTERLACED_BT = range(5, 10)

FRMSIZE_DISCRETE = 1

BUF_FLAG_ERROR = 0x40
BUF_FLAG_TIMESTAMP_MASK = 0xE000
BUF_FLAG_TIMESTAMP_MONOTONIC = 0x2000
BUF_FLAG_TSTAMP_SRC_MASK = 0x7_0000
BUF_FLAG_TSTAMP_SRC_SOE = 0x1_0000  # start of exposure; else the frame's end

STANDARDS = {"PAL": 0x00FF, "NTSC": 0xB000, "SECAM": 0xFF_0000}

CID_AUTO_WHITE_BALANCE = 0x0098_090C
CID_RED_BALANCE = 0x0098_090E
CID_BLUE_BALANCE = 0x0098_090F
CID_EXPOSURE = 0x0098_0911
CID_AUTOGAIN = 0x0098_0912
CID_GAIN = 0x0098_0913
CID_WHITE_BALANCE_TEMPERATURE = 0x0098_091A
CID_EXPOSURE_AUTO = 0x009A_0901
CID_EXPOSURE_ABSOLUTE = 0x009A_0902
CID_EXPOSURE_AUTO_PRIORITY = 0x009A_0903
EXPOSURE_MANUAL = 1

CTRL_FLAG_DISABLED = 0x01
CTRL_FLAG_READ_ONLY = 0x04


class Capability(ctypes.Structure):
    """struct v4l2_capability."""

    _fields_ = (
        ("driver", c_char * 16),
        ("card", c_char * 32),
        ("bus_info", c_char * 32),
        ("version", c_uint32),
        ("capabilities", c_uint32),
        ("device_caps", c_uint32),
        ("reserved", c_uint32 * 3),
    )


class FormatDescription(ctypes.Structure):
    """struct v4l2_fmtdesc."""

    _fields_ = (
        ("index", c_uint32),
        ("type", c_uint32),
        ("flags", c_uint32),
        ("description", c_char * 32),
        ("pixelformat", c_uint32),
        ("reserved", c_uint32 * 4),
    )


class PixelFormat(ctypes.Structure):
    """struct v4l2_pix_format."""

    _fields_ = tuple(
        (name, c_uint32)
        for name in (
            "width", "height", "pixelformat", "field", "bytesperline", "sizeimage", "colorspace",
            "priv", "flags", "ycbcr_enc", "quantization", "xfer_func",
        )
    )  # fmt: skip


class FrameSize(ctypes.Structure):
    """struct v4l2_frmsizeenum."""

    _fields_ = (
        ("index", c_uint32),
        ("pixel_format", c_uint32),
        ("type", c_uint32),
        # width, height; or of a range: width's min, max, step, height's min, max, step
        ("size", c_uint32 * 6),
        ("reserved", c_uint32 * 2),
    )


class _FormatUnion(Union):
    # the kernel's union holds a pointer, which aligns it to 8 bytes
    _fields_ = (("pix", PixelFormat), ("raw_data", c_uint8 * 200), ("align", c_uint64))


class Format(ctypes.Structure):
    """struct v4l2_format."""

    _fields_ = (("type", c_uint32), ("fmt", _FormatUnion))


class Fraction(ctypes.Structure):
    """struct v4l2_fract."""

    _fields_ = (("numerator", c_uint32), ("denominator", c_uint32))


class FrameInterval(ctypes.Structure):
    """struct v4l2_frmivalenum."""

    _fields_ = (
        ("index", c_uint32),
        ("pixel_format", c_uint32),
        ("width", c_uint32),
        ("height", c_uint32),
        ("type", c_uint32),
        ("shortest", Fraction),  # the interval; or the shortest of a range
        ("rest", c_uint32 * 4),
        ("reserved", c_uint32 * 2),
    )


class StreamParameters(ctypes.Structure):
    """struct v4l2_streamparm, its capture part."""

    _fields_ = (
        ("type", c_uint32),
        ("capability", c_uint32),
        ("capturemode", c_uint32),
        ("timeperframe", Fraction),
        ("extendedmode", c_uint32),
        ("readbuffers", c_uint32),
        ("reserved", c_uint8 * 176),
    )


class RequestBuffers(ctypes.Structure):
    """struct v4l2_requestbuffers."""

    _fields_ = (
        ("count", c_uint32),
        ("type", c_uint32),
        ("memory", c_uint32),
        ("capabilities", c_uint32),
        ("flags", c_uint32),
    )


class _Timeval(ctypes.Structure):
    _fields_ = (("tv_sec", c_long), ("tv_usec", c_long))


class _Timecode(ctypes.Structure):
    _fields_ = (("type", c_uint32), ("flags", c_uint32), ("rest", c_uint8 * 8))


class _Where(Union):
    _fields_ = (("offset", c_uint32), ("userptr", ctypes.c_ulong), ("planes", ctypes.c_void_p))


class Buffer(ctypes.Structure):
    """struct v4l2_buffer."""

    _fields_ = (
        ("index", c_uint32),
        ("type", c_uint32),
        ("bytesused", c_uint32),
        ("flags", c_uint32),
        ("field", c_uint32),
        ("timestamp", _Timeval),
        ("timecode", _Timecode),
        ("sequence", c_uint32),
        ("memory", c_uint32),
        ("m", _Where),
        ("length", c_uint32),
        ("reserved2", c_uint32),
        ("request_fd", c_int32),
    )


class Input(ctypes.Structure):
    """struct v4l2_input."""

    _fields_ = (
        ("index", c_uint32),
        ("name", c_char * 32),
        ("type", c_uint32),
        ("audioset", c_uint32),
        ("tuner", c_uint32),
        ("std", c_uint64),
        ("status", c_uint32),
        ("capabilities", c_uint32),
        ("reserved", c_uint32 * 3),
    )


class QueryControl(ctypes.Structure):
    """struct v4l2_queryctrl."""

    _fields_ = (
        ("id", c_uint32),
        ("type", c_uint32),
        ("name", c_uint8 * 32),
        ("minimum", c_int32),
        ("maximum", c_int32),
        ("step", c_int32),
        ("default_value", c_int32),
        ("flags", c_uint32),
        ("reserved", c_uint32 * 2),
    )


class Control(ctypes.Structure):
    """struct v4l2_control."""

    _fields_ = (("id", c_uint32), ("value", c_int32))


class Number(ctypes.Structure):
    """An int argument."""

    _fields_ = (("value", c_int32),)


class Standard(ctypes.Structure):
    """A v4l2_std_id argument."""

    _fields_ = (("value", c_uint64),)


def _request(direction: int, number: int, argument: type[ctypes.Structure]) -> int:
    """As the macros _IOR (2), _IOW (1) and _IOWR (3) make it."""
    return direction << 30 | ctypes.sizeof(argument) << 16 | ord("V") << 8 | number


VIDIOC_QUERYCAP = _request(2, 0, Capability)
VIDIOC_ENUM_FMT = _request(3, 2, FormatDescription)
VIDIOC_S_FMT = _request(3, 5, Format)
VIDIOC_REQBUFS = _request(3, 8, RequestBuffers)
VIDIOC_QUERYBUF = _request(3, 9, Buffer)
VIDIOC_QBUF = _request(3, 15, Buffer)
VIDIOC_DQBUF = _request(3, 17, Buffer)
VIDIOC_STREAMON = _request(1, 18, Number)
VIDIOC_STREAMOFF = _request(1, 19, Number)
VIDIOC_S_PARM = _request(3, 22, StreamParameters)
VIDIOC_S_STD = _request(1, 24, Standard)
VIDIOC_ENUMINPUT = _request(3, 26, Input)
VIDIOC_G_CTRL = _request(3, 27, Control)
VIDIOC_S_CTRL = _request(3, 28, Control)
VIDIOC_QUERYCTRL = _request(3, 36, QueryControl)
VIDIOC_S_INPUT = _request(3, 39, Number)
VIDIOC_ENUM_FRAMESIZES = _request(3, 74, FrameSize)
VIDIOC_ENUM_FRAMEINTERVALS = _request(3, 75, FrameInterval)


def fourcc(name: str) -> int:
    """A pixel format's number."""
    return int.from_bytes(name.encode("ascii"), "little")


def fourcc_name(number: int) -> str:
    """A pixel format's name."""
    return number.to_bytes(4, "little").decode("ascii", "replace")
