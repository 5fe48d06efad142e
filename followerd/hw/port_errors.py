"""Why a serial port does not open, and what a person can do about it."""

import os
from contextlib import suppress
from errno import EACCES, EAGAIN, EBUSY, ENOENT, EPERM
from pathlib import Path

from serial.tools import list_ports

from followerd.errors import OpenError


def explained(device: str, path: str, error: Exception) -> OpenError:
    """What a person can do about a port that does not open."""
    number = getattr(error, "errno", None)
    if number == ENOENT:
        ports = ", ".join(sorted(port.device for port in list_ports.comports()))
        remedy = f"there are: {ports}" if ports else "no serial port is plugged in"
        return OpenError(device, f"{path} does not exist", remedy)
    if number in (EACCES, EPERM):
        remedy = f"`sudo usermod -aG {_group(path)} $USER`, then log in again"
        return OpenError(device, f"{path}: permission denied", remedy)
    if number in (EAGAIN, EBUSY):
        users = ", ".join(users_of(path))
        return OpenError(device, f"{path} is busy", f"used by {users}" if users else "close it")
    return OpenError(device, f"{path} is no usable serial port ({error})", "choose another link")


def _group(path: str) -> str:
    try:
        return Path(path).group()
    except (OSError, KeyError):
        return "dialout"


def users_of(path: str) -> list[str]:
    """Programs that hold `path` open, as `name (pid N)`; only those we may look into."""
    target = os.path.realpath(path)
    users = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if any(os.path.realpath(fd) == target for fd in (process / "fd").iterdir()):
                users.append(f"{(process / 'comm').read_text().strip()} (pid {process.name})")
    return users
