"""Ports by names that last, cameras by what they offer, and the config that probing writes."""

import errno
import os
import struct
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from followerd.__main__ import call
from followerd.cli.starter import starter
from followerd.config import load
from followerd.hw.camera.modes import CameraFound, VideoMode, survey
from followerd.hw.lms200.probe import LaserFound
from followerd.hw.lms200.telegrams import Command, Status
from followerd.hw.p2os.config import Identity
from followerd.hw.p2os.probe import RobotFound
from followerd.hw.ports import serial_ports, video_devices
from followerd.hw.probe import Found
from followerd.hw.vcc50i.commands import Status as HeadStatus
from followerd.hw.vcc50i.probe import HeadFound
from tests import lms200_bench
from tests.video_kernel import VideoKernel


@dataclass
class Adapter:
    """What pyserial tells of one."""

    device: str
    serial_number: str | None = None
    vid: int | None = 0x0403
    pid: int | None = 0x6001
    description: str = "USB serial"


def names(root: Path, **links: str) -> Path:
    """A /dev/serial whose `folder__name` links to a device."""
    for place, device in links.items():
        folder, _, name = place.partition("__")
        (root / folder.replace("_", "-")).mkdir(exist_ok=True)
        (root / folder.replace("_", "-") / name).symlink_to(device)
    return root


def named(ports: list[Adapter], root: Path) -> list[str]:
    return [str(Path(p.name).name) for p in serial_ports(ports, root)]


def test_an_adapter_with_a_number_is_named_by_it(tmp_path: Path) -> None:
    root = names(
        tmp_path, by_id__A="/dev/ttyUSB0", by_path__p="/dev/ttyUSB0", by_id__B="/dev/ttyUSB1"
    )
    ports = [Adapter("/dev/ttyUSB1", "B"), Adapter("/dev/ttyUSB0", "A")]
    assert named(ports, root) == ["A", "B"]


def test_identical_adapters_are_named_by_their_sockets(tmp_path: Path) -> None:
    root = names(
        tmp_path, by_id__same="/dev/ttyUSB1", by_path__left="/dev/ttyUSB0",
        by_path__right="/dev/ttyUSB1", by_id__other="/dev/ttyUSB2",
    )  # fmt: skip
    ports = [Adapter("/dev/ttyUSB0"), Adapter("/dev/ttyUSB1"), Adapter("/dev/ttyUSB2", "other")]
    assert named(ports, root) == ["left", "right", "other"]


def test_the_ports_of_one_adapter_keep_their_own_names(tmp_path: Path) -> None:
    root = names(tmp_path, by_id__if00="/dev/ttyUSB0", by_id__if01="/dev/ttyUSB1")
    assert named([Adapter("/dev/ttyUSB0", "F"), Adapter("/dev/ttyUSB1", "F")], root) == [
        "if00",
        "if01",
    ]


def test_a_built_in_port_keeps_the_kernels_name(tmp_path: Path) -> None:
    ports = [Adapter("/dev/ttyS0", vid=None, pid=None), Adapter("/dev/ttyS1", vid=None, pid=None)]
    assert [port.name for port in serial_ports(ports, tmp_path)] == ["/dev/ttyS0", "/dev/ttyS1"]


def test_cameras_come_in_the_kernels_order_by_names_that_last(tmp_path: Path) -> None:
    for number in (0, 2, 10):
        (tmp_path / f"video{number}").touch()
    found = video_devices(tmp_path, names(tmp_path, by_id__webcam=str(tmp_path / "video2")))
    assert [Path(port.device).name for port in found] == ["video0", "video2", "video10"]
    assert [Path(port.name).name for port in found] == ["video0", "webcam", "video10"]


class Listing(VideoKernel):
    """A kernel that also lists sizes and intervals, at the header's offsets."""

    sizes = ((640, 480), (320, 240))
    stepwise = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self.handlers |= {0xC02C564A: self._framesizes, 0xC034564B: self._intervals}

    def _framesizes(self, raw: bytearray) -> None:
        index = struct.unpack_from("I", raw)[0]
        if index >= (1 if self.stepwise else len(self.sizes)):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        if self.stepwise:
            struct.pack_into("7I", raw, 8, 3, 32, 2592, 2, 32, 1944, 2)
        else:
            struct.pack_into("3I", raw, 8, 1, *self.sizes[index])

    def _intervals(self, raw: bytearray) -> None:
        index, _, width = struct.unpack_from("3I", raw)
        if index >= 2:
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        struct.pack_into("3I", raw, 16, 1, 1, (30 if width < 400 else 15) // (index + 1))


def test_a_camera_lists_its_formats_sizes_and_fastest_rates() -> None:
    found = survey("/dev/video0", Listing())
    assert str(found) == (
        "camera HD Webcam: MJPG 640x480@15 320x240@30; YUYV 640x480@15 320x240@30"
    )


def test_of_a_range_of_sizes_the_usual_ones_are_listed() -> None:
    kernel = Listing(formats=("YUYV",))
    kernel.stepwise = True
    found = survey("/dev/video0", kernel)
    assert found is not None
    assert [(mode.width, mode.height) for mode in found.modes] == [
        (320, 240),
        (640, 480),
        (2592, 1944),
    ]
    assert found.nearest(320, 240) == VideoMode("YUYV", 320, 240, 30.0)


def test_a_video_device_that_captures_nothing_is_no_camera() -> None:
    assert survey("/dev/video1", Listing(device_caps=0x0080_0000)) is None


ROBOT = RobotFound(Identity("r2", "Pioneer", "p3dx-sh"), 19200, 12.5, stop_button=False)
CAMERA = CameraFound("cam", (VideoMode("H264", 320, 240, 60), VideoMode("YUYV", 352, 288, 25.0)))
HEAD = HeadFound("C50i", HeadStatus(0), 9600)


def laser_found(baud: int, unit: int) -> LaserFound:
    told = lms200_bench.Bench(lms200_bench.twin()).told(Command.STATUS)
    status = Status.from_data(told.data)
    words = {500000: 0x8001, 38400: 0x8019}
    return LaserFound(
        "LMS200", replace(status, baud_word=words[baud], unit=unit), 0,
        was_streaming=False, complaint=None,
    )  # fmt: skip


@pytest.mark.parametrize(
    "devices",
    [
        {},
        {"/dev/serial/by-path/pci-0000:00:14.0-usb-0:1.2:1.0": ROBOT},
        {"/dev/r": ROBOT, "/dev/l": laser_found(500000, 1), "/dev/p": HEAD},
        {"socket://10.0.0.2:4000": laser_found(38400, 0)},
        {"/dev/r": replace(ROBOT, identity=Identity("x", "Pioneer", "zoomer"))},
    ],
)
@pytest.mark.parametrize("cameras", [{}, {"/dev/v4l/by-id/cam": CAMERA}])
def test_whatever_was_found_the_config_is_accepted(
    devices: dict[str, Found],
    cameras: dict[str, CameraFound],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(starter(devices, cameras), encoding="utf-8")
    assert call(["check", str(path)]) == 0
    said = capsys.readouterr().out
    assert all(f" at {link}\n" in said for link in (*devices, *cameras))


def test_the_config_says_what_was_found(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(
        starter({"/dev/r": ROBOT, "/dev/l": laser_found(500000, 1)}, {"/dev/v": CAMERA}),
        encoding="utf-8",
    )
    config = load(path)
    assert config.base.model_dump()["baud"] == 19200
    assert config.laser.model_dump()["baud"] == 500000
    size = config.camera.model_dump()
    assert (size["width"], size["height"], size["rate_hz"]) == (352, 288, 25.0)
    assert config.operator == "manual"
