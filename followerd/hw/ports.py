"""Which serial ports and cameras are plugged in, by names that are still theirs tomorrow.

`/dev/ttyUSB0` is whoever came first. udev names adapters by their serial number (by-id) and by
their socket (by-path); identical adapters without a number share one by-id name, which then says
nothing.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple, Protocol

from serial.tools import list_ports

SERIAL, VIDEO = Path("/dev/serial"), Path("/dev/v4l")


class Adapter(Protocol):
    """What pyserial tells of a port."""

    device: str
    description: str
    vid: int | None
    pid: int | None
    serial_number: str | None


class Port(NamedTuple):
    """A port that is there."""

    device: str  # as the kernel calls it now
    name: str  # to be written into a config
    description: str


def serial_ports(adapters: Iterable[Adapter] | None = None, names: Path = SERIAL) -> list[Port]:
    """All serial ports with their stable names."""
    found = sorted(adapters or list_ports.comports(), key=lambda port: port.device)
    by_id = _links(names / "by-id")
    unclear = {_kind(port) for port in found if port.device not in by_id}
    ports = []
    for port in found:
        wanted = by_id if _kind(port) not in unclear else {}
        name = wanted.get(port.device) or _links(names / "by-path").get(port.device, port.device)
        ports.append(Port(port.device, name, port.description))
    return ports


def video_devices(devices: Path = Path("/dev"), names: Path = VIDEO) -> list[Port]:
    """All video devices with their stable names; not each of them captures."""
    found = sorted((str(path) for path in devices.glob("video[0-9]*")), key=_numbered)
    by_id, by_path = _links(names / "by-id"), _links(names / "by-path")
    return [Port(path, by_id.get(path) or by_path.get(path, path), "") for path in found]


def _kind(port: Adapter) -> tuple[int | None, int | None, str | None, str]:
    """What identical adapters share; ports that are no adapters share nothing."""
    alone = port.device if port.vid is None else ""
    return port.vid, port.pid, port.serial_number, alone


def _links(folder: Path) -> dict[str, str]:
    """Device -> its name in a folder of symlinks."""
    if not folder.is_dir():
        return {}
    return {str(link.resolve()): str(link) for link in sorted(folder.iterdir(), reverse=True)}


def _numbered(path: str) -> tuple[int, str]:
    return len(path), path
