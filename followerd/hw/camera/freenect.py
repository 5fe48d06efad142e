"""libfreenect (0.5) by ctypes: what of its callback API a Kinect v1 needs.

Types and names are those of libfreenect.h. All calls for one context come from one thread; the
callbacks run inside `process_events` and may only copy.
"""

import ctypes
from collections.abc import Callable
from ctypes import POINTER, byref, c_double, c_int, c_int8, c_int16, c_int32, c_uint32, c_void_p
from typing import Any

import numpy as np
import numpy.typing as npt

from followerd.errors import LinkLost, OpenError, SetupError
from followerd.geometry import Array
from followerd.hw.camera.registration import HEIGHT, RAW_VALUES, WIDTH, RegistrationTables

LIBRARY = "libfreenect.so.0.5"
MOTOR, CAMERA = 1, 2  # freenect_device_flags
MEDIUM = 1  # freenect_resolution: 640x480
RGB = 0  # freenect_video_format
DEPTH_11BIT = 0  # freenect_depth_format
AUTOMATICS = 1 << 14, 1 << 1  # freenect_flag: exposure, white balance
LOG_FATAL = 0
LEDS = {"off": 0, "green": 1, "red": 2, "yellow": 3, "blink_green": 4}
MOVING = 4  # freenect_tilt_status_code
POLL_US = 100_000  # how long process_events waits
INTERRUPTED = -10  # libusb: a signal came
SCALE = 256.0  # REG_X_VAL_SCALE of the registration tables
MM = 10_000  # entries of the shift table


class FrameMode(ctypes.Structure):
    """freenect_frame_mode, passed by value."""

    _fields_ = (
        ("reserved", c_uint32),
        ("resolution", c_int32),
        ("format", c_int32),
        ("bytes", c_int32),
        ("width", c_int16),
        ("height", c_int16),
        ("data_bits_per_pixel", c_int8),
        ("padding_bits_per_pixel", c_int8),
        ("framerate", c_int8),
        ("is_valid", c_int8),
    )


class TiltState(ctypes.Structure):
    """freenect_raw_tilt_state."""

    _fields_ = (
        ("accelerometer", c_int16 * 3),
        ("tilt_angle", c_int8),  # half degrees
        ("tilt_status", c_int32),
    )


class UnitRegistration(ctypes.Structure):
    """freenect_registration; of what the unit says, only the tables made from it are used."""

    _fields_ = (
        ("reg_info", c_int32 * 29),
        ("reg_pad_info", ctypes.c_uint16 * 3),
        ("zero_plane_info", ctypes.c_float * 4),
        ("const_shift", c_double),
        ("raw_to_mm_shift", POINTER(ctypes.c_uint16)),
        ("depth_to_rgb_shift", POINTER(c_int32)),
        ("registration_table", POINTER(c_int32)),
    )

    def tables(self) -> RegistrationTables:
        """The unit's own tables, as `Registration` takes them."""
        mm = np.ctypeslib.as_array(self.raw_to_mm_shift, (RAW_VALUES,)).astype(float)
        shift = np.ctypeslib.as_array(self.depth_to_rgb_shift, (MM,)) / SCALE
        table = np.ctypeslib.as_array(self.registration_table, (HEIGHT, WIDTH, 2)).astype(float)
        known = (mm > 0) & (mm < MM)
        to_the_left: Array = -shift[np.where(known, mm, 0).astype(int)]
        metres: Array = np.where(known, mm / 1000.0, np.inf)
        return RegistrationTables(table[..., 0] / SCALE, table[..., 1], to_the_left, metres)


class _Timeval(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_usec", ctypes.c_long))


Functions = dict[str, Callable[..., Any]]  # by name, `freenect_` left out
FrameCallback = ctypes.CFUNCTYPE(None, c_void_p, c_void_p, c_uint32)
OnFrame = Callable[[npt.NDArray[Any], int], None]  # a copy of the frame, the device's ticks

PROTOTYPES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "init": (c_int, (POINTER(c_void_p), c_void_p)),
    "shutdown": (c_int, (c_void_p,)),
    "set_log_level": (None, (c_void_p, c_int)),
    "select_subdevices": (None, (c_void_p, c_int)),
    "num_devices": (c_int, (c_void_p,)),
    "open_device": (c_int, (c_void_p, POINTER(c_void_p), c_int)),
    "close_device": (c_int, (c_void_p,)),
    "find_video_mode": (FrameMode, (c_int, c_int)),
    "find_depth_mode": (FrameMode, (c_int, c_int)),
    "set_video_mode": (c_int, (c_void_p, FrameMode)),
    "set_depth_mode": (c_int, (c_void_p, FrameMode)),
    "set_video_callback": (None, (c_void_p, FrameCallback)),
    "set_depth_callback": (None, (c_void_p, FrameCallback)),
    "start_video": (c_int, (c_void_p,)),
    "start_depth": (c_int, (c_void_p,)),
    "stop_video": (c_int, (c_void_p,)),
    "stop_depth": (c_int, (c_void_p,)),
    "process_events_timeout": (c_int, (c_void_p, POINTER(_Timeval))),
    "set_tilt_degs": (c_int, (c_void_p, c_double)),
    "update_tilt_state": (c_int, (c_void_p,)),
    "get_tilt_state": (POINTER(TiltState), (c_void_p,)),
    "set_led": (c_int, (c_void_p, c_int)),
}
OPTIONAL: dict[str, tuple[Any, tuple[Any, ...]]] = {  # not in the library that plays dumps
    "copy_registration": (UnitRegistration, (c_void_p,)),
    "destroy_registration": (c_int, (POINTER(UnitRegistration),)),
    "set_flag": (c_int, (c_void_p, c_int, c_int)),
}


class Freenect:
    """One Kinect, open; raises OpenError or SetupError, each with its remedy."""

    def __init__(self, device: str, library: Functions, index: int) -> None:
        self._name = device
        self._library = library
        self._context, self._device = c_void_p(), c_void_p()
        self.has_motor = False
        if self._call("init", byref(self._context), None) < 0:
            raise OpenError(device, "libfreenect cannot use USB", "is USB passed to this system?")
        try:
            self._library["set_log_level"](self._context, LOG_FATAL)
            self._open(index)
        except OpenError:
            self._call("shutdown", self._context)
            raise

    def _open(self, index: int) -> None:
        count = self._call("num_devices", self._context)
        if count <= index:
            problem = f"there is no Kinect {index}" if count > 0 else "no Kinect is plugged in"
            remedy = "plug in its USB and its power supply (without power only the motor answers)"
            raise OpenError(self._name, problem, remedy)
        for parts in (CAMERA | MOTOR, CAMERA):  # later models have the motor at the microphones
            self._library["select_subdevices"](self._context, parts)
            if self._call("open_device", self._context, byref(self._device), index) >= 0:
                self.has_motor = bool(parts & MOTOR)
                return
        remedy = "close the program that uses it; join the group plugdev; unload gspca_kinect"
        raise OpenError(self._name, f"Kinect {index} cannot be opened", remedy)

    def start(self, on_video: OnFrame, on_depth: OnFrame) -> None:
        """Stream RGB (480, 640, 3) uint8 and raw depth (480, 640) uint16 into the callbacks."""
        self._callbacks = (
            _copying(on_video, (HEIGHT, WIDTH, 3), np.uint8),
            _copying(on_depth, (HEIGHT, WIDTH), np.uint16),
        )
        for part, what, callback in zip(
            ("video", "depth"), (RGB, DEPTH_11BIT), self._callbacks, strict=True
        ):
            mode = self._library[f"find_{part}_mode"](MEDIUM, what)
            self._library[f"set_{part}_callback"](self._device, callback)
            failed = not mode.is_valid or self._call(f"set_{part}_mode", self._device, mode) < 0
            if failed or self._call(f"start_{part}", self._device) < 0:
                remedy = "plug it into a USB port of its own (it needs more than half of the bus)"
                raise SetupError(self._name, f"the Kinect does not start its {part}", remedy)

    def registration(self) -> RegistrationTables | None:
        """The unit's own tables; None where the library cannot read them."""
        if "copy_registration" not in self._library:
            return None
        unit = self._library["copy_registration"](self._device)
        try:
            return unit.tables() if unit.registration_table else None
        finally:
            self._call("destroy_registration", byref(unit))

    def process_events(self) -> None:
        """Wait for USB, and run callbacks; raises LinkLost when the device is gone."""
        timeout = _Timeval(0, POLL_US)
        result = self._call("process_events_timeout", self._context, byref(timeout))
        if result < 0 and result != INTERRUPTED:
            raise LinkLost(self._name, "the Kinect is gone", "check its plug and its power supply")

    def set_tilt(self, degrees: float) -> None:
        """Drive the motor to an angle above the horizon."""
        self._call("set_tilt_degs", self._device, degrees)

    def tilt(self) -> float | None:
        """Angle above the horizon, degrees; None while it moves or is not known."""
        if self._call("update_tilt_state", self._device) < 0:
            return None
        state = self._library["get_tilt_state"](self._device)
        if not state or state.contents.tilt_status == MOVING:
            return None
        return float(state.contents.tilt_angle) / 2.0

    def set_automatic(self, on: bool) -> None:
        """Let it choose exposure and white balance, or hold them; nothing without such flags."""
        if "set_flag" in self._library:
            for flag in AUTOMATICS:
                self._call("set_flag", self._device, flag, int(on))

    def set_led(self, colour: str) -> None:
        """One of LEDS."""
        self._call("set_led", self._device, LEDS[colour])

    def close(self) -> None:
        """Stop and release it."""
        for part in ("video", "depth"):
            self._call(f"stop_{part}", self._device)
        self._call("close_device", self._device)
        self._call("shutdown", self._context)

    def _call(self, name: str, *arguments: Any) -> int:
        return int(self._library[name](*arguments))


def loaded(device: str, library: str) -> Functions:
    """A library by name or path; raises OpenError with the remedy."""
    try:
        loaded = ctypes.CDLL(library)
    except OSError as error:
        remedy = "apt install libfreenect0.5, or say where it is: link: kinect:/path/to/library"
        raise OpenError(device, f"{library} cannot be loaded ({error})", remedy) from error
    functions: Functions = {}
    for name, (result, arguments) in (PROTOTYPES | OPTIONAL).items():
        function = getattr(loaded, f"freenect_{name}", None)
        if function is not None:
            function.restype, function.argtypes = result, arguments
            functions[name] = function
        elif name in PROTOTYPES:
            raise OpenError(device, f"{library} has no freenect_{name}", "use libfreenect 0.5")
    return functions


def _copying(on_frame: OnFrame, shape: tuple[int, ...], kind: type[np.generic]) -> Any:
    size = int(np.prod(shape)) * np.dtype(kind).itemsize

    def callback(_device: int, address: int, ticks: int) -> None:
        on_frame(np.frombuffer(ctypes.string_at(address, size), kind).reshape(shape), ticks)

    return FrameCallback(callback)
