"""`followerd probe`: what is plugged in, what it answers, and a config to start from."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from followerd import clock
from followerd.cli.starter import starter
from followerd.config import load
from followerd.errors import DeviceError, OpenError, UsageError
from followerd.hw.camera.modes import CameraFound, survey
from followerd.hw.ports import Port, serial_ports, video_devices
from followerd.hw.probe import LIMIT, Found, Unidentified, why_closed
from followerd.hw.probe import probe as identify
from followerd.hw.serial import open_link
from followerd.runtime import logs


def probe(
    *,
    port: Annotated[
        tuple[str, ...],
        Parameter(help="/dev/NAME or socket://HOST:PORT; default: all serial ports"),
    ] = (),
    out: Annotated[Path | None, Parameter(help="write a config to start from")] = None,
) -> None:
    """Say what is plugged in: the base, the laser, the camera's head, cameras.

    Ports are listened to before anything is said. Nothing moves: a base is stopped, its session
    closed, its motors stay off; a streaming laser is stopped. Do not run it beside a daemon.
    """
    if out is not None and (out.exists() or not out.parent.is_dir()):
        raise UsageError(f"--out {out}: {'exists already' if out.exists() else 'no such folder'}")
    logs.configure("error")
    ports = [Port(link, link, "") for link in port] or serial_ports()
    devices = clock.run(_all(ports))
    cameras = {} if port else _cameras()
    if out is not None:
        out.write_text(starter(devices, cameras), encoding="utf-8")
        load(out)
        print(f"{out}: written; check every line of it")
    if port and len(devices) < len(ports):
        raise DeviceError("probe", "not every port given has a device that answers")


async def _all(ports: list[Port]) -> dict[str, Found]:
    """The devices by the names of their ports; all ports at once."""
    if not ports:
        print("no serial port is plugged in")
    else:
        print(f"asking {len(ports)} serial port{'s'[: len(ports) - 1]}, {LIMIT:.0f} s at most")
    found: dict[str, Found] = {}

    async def ask(port: Port) -> None:
        device = await _one(port)
        if device is not None:
            found[port.name] = device

    await clock.together(*(ask(port) for port in ports))
    return {port.name: found[port.name] for port in ports if port.name in found}


async def _one(port: Port) -> Found | None:
    """The device on a port; says so, or why there is none."""
    name = port.name if port.name == port.device else f"{port.name} ({port.device})"
    link = open_link(port.device)
    try:
        found = await identify(link, lambda text: print(f"  {port.device}: {text}", flush=True))
    except OpenError as error:
        print(why_closed(error), flush=True)
    except Unidentified as reason:
        print(f"{name}: {reason}", flush=True)
    else:
        print(f"{name}: {found}", flush=True)
        return found
    return None


def _cameras() -> dict[str, CameraFound]:
    cameras: dict[str, CameraFound] = {}
    for device in video_devices():
        try:
            found = survey(device.device)
        except OSError as error:
            print(f"{device.device}: cannot be asked ({error.strerror}); is it in use?")
            continue
        if found is not None:
            print(f"{device.name}: {found}")
            cameras[device.name] = found
    if not cameras:
        print("no camera is plugged in")
    return cameras
