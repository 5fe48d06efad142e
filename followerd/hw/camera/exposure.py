"""Exposure, gain and white balance of a video device: automatic, or held as they are.

A person's colours are learned at enrolment; a camera that re-balances itself afterwards changes
them. So the automatics run until then and are off from then on.
"""

import structlog

from followerd.hw.camera import videodev2 as v4l2
from followerd.hw.camera.modes import Ioctl

AUTOMATICS = {  # control -> (value that switches it off, what it controls)
    v4l2.CID_EXPOSURE_AUTO: (
        v4l2.EXPOSURE_MANUAL, (v4l2.CID_EXPOSURE_ABSOLUTE, v4l2.CID_EXPOSURE),
    ),
    v4l2.CID_AUTOGAIN: (0, (v4l2.CID_GAIN,)),
    v4l2.CID_AUTO_WHITE_BALANCE: (
        0, (v4l2.CID_WHITE_BALANCE_TEMPERATURE, v4l2.CID_RED_BALANCE, v4l2.CID_BLUE_BALANCE),
    ),
}  # fmt: skip

log = structlog.get_logger()


class Exposure:
    """What is wanted, and what it was locked to; outlives the open device."""

    def __init__(self, touch: bool) -> None:
        self.wanted = False  # locked
        self._touch = touch
        self._held: dict[int, int] | None = None  # control -> value, in the order of setting

    def prepare(self, ioctl: Ioctl) -> None:
        """A device was opened: as it was locked before, or automatic at a constant rate."""
        if not self._touch:
            return
        if self._held is None:
            self._automatic(ioctl)
        else:
            self._hold(ioctl, self._held)

    def work(self, ioctl: Ioctl, device: str) -> None:
        """Lock or free it where that was asked for."""
        if not self._touch or self.wanted is (self._held is not None):
            return
        if not self.wanted:
            self._held = None
            self._automatic(ioctl)
            return
        self._held = self._found(ioctl)
        self._hold(ioctl, self._held)
        if v4l2.CID_EXPOSURE_AUTO not in self._held:
            log.warning("the camera's exposure cannot be locked", device=device)

    def _automatic(self, ioctl: Ioctl) -> None:
        for control in AUTOMATICS:
            default = _default(ioctl, control)
            if default is not None:
                _set(ioctl, control, default)
        if _default(ioctl, v4l2.CID_EXPOSURE_AUTO_PRIORITY) is not None:
            _set(ioctl, v4l2.CID_EXPOSURE_AUTO_PRIORITY, 0)  # else a dark room halves the rate

    def _found(self, ioctl: Ioctl) -> dict[int, int]:
        """The automatics that are there, off, each followed by the values they chose."""
        held: dict[int, int] = {}
        for automatic, (off, controlled) in AUTOMATICS.items():
            if _default(ioctl, automatic) is None:
                continue
            held[automatic] = off
            for control in controlled:
                value = _value(ioctl, control)
                if value is not None:
                    held[control] = value
        return held

    def _hold(self, ioctl: Ioctl, held: dict[int, int]) -> None:
        for control, value in held.items():
            _set(ioctl, control, value)


def _default(ioctl: Ioctl, control: int) -> int | None:
    """A control's default; None when the device has no such control that can be set."""
    query = v4l2.QueryControl(id=control)
    try:
        ioctl(v4l2.VIDIOC_QUERYCTRL, query)
    except OSError:
        return None
    if query.flags & (v4l2.CTRL_FLAG_DISABLED | v4l2.CTRL_FLAG_READ_ONLY):
        return None
    return int(query.default_value)


def _value(ioctl: Ioctl, control: int) -> int | None:
    wanted = v4l2.Control(control, 0)
    try:
        ioctl(v4l2.VIDIOC_G_CTRL, wanted)
    except OSError:
        return None
    return int(wanted.value)


def _set(ioctl: Ioctl, control: int, value: int) -> None:
    try:
        ioctl(v4l2.VIDIOC_S_CTRL, v4l2.Control(control, value))
    except OSError as error:
        log.debug("camera refuses a control", control=hex(control), value=value, error=str(error))
