"""A config to start from, of what was found plugged in."""

from collections.abc import Mapping

from followerd.hw.camera.modes import CameraFound
from followerd.hw.lms200.probe import LaserFound
from followerd.hw.p2os.probe import RobotFound
from followerd.hw.probe import Found
from followerd.hw.vcc50i.probe import HeadFound

WIDTH, HEIGHT, RATE = 320, 240, 30.0  # of images, where the camera leaves the choice
RS422 = 500000  # baud; a laser met there is wired for it
MISSING = "not found: put your link here"


def starter(devices: Mapping[str, Found], cameras: Mapping[str, CameraFound]) -> str:
    """The YAML for devices and cameras by their links; of each kind the first."""
    return "\n".join(
        (
            "# Written by followerd probe. Check every line, measure the mounts, then:",
            "#   followerd check, followerd calibrate, followerd drive-check; docs/first_drive.md",
            *_base(devices),
            *_laser(devices),
            *_camera(cameras),
            *_ptz(devices),
            "tracker: {kind: hpf, profile: default}",
            "controller: {kind: image_centering, profile: default}",
            "",
        )
    )


def _base(devices: Mapping[str, Found]) -> list[str]:
    lines = ["base:", "  kind: p2os"]
    for link, found in devices.items():
        if isinstance(found, RobotFound):
            lines += [f"  link: {link}", f"  baud: {found.baud}"]
            if not found.is_known:
                kind = found.identity.subclass
                lines += [f"  # it calls itself {kind!r}: an unknown type; say the nearest",
                          "  model: p3dx-sh"]  # fmt: skip
            return lines
    return [*lines, f"  link: /dev/robot # {MISSING}"]


def _laser(devices: Mapping[str, Found]) -> list[str]:
    lines = ["laser:", "  kind: lms200"]
    mount = "  mount: {x_m: 0.02, y_m: 0.0, yaw_deg: 0} # measure it"
    for link, found in devices.items():
        if isinstance(found, LaserFound):
            fast = found.baud == RS422
            lines += [
                f"  link: {link}",
                f"  baud: {RS422 if fast else 38400}" + ("" if fast else f" # {RS422} with RS-422"),
                f"  resolution_deg: {0.5 if fast else 1}",
            ]
            if found.unit == "cm":
                lines.append("  unit: cm # as found; mm is finer, up to 8 m")
            return [*lines, mount]
    return [
        *lines,
        f"  link: /dev/laser # {MISSING}",
        "  baud: 38400",
        "  resolution_deg: 1",
        mount,
    ]


def _camera(cameras: Mapping[str, CameraFound]) -> list[str]:
    link, width, height, rate = f"/dev/video0 # {MISSING}", WIDTH, HEIGHT, RATE
    for name, found in cameras.items():
        mode = found.nearest(WIDTH, HEIGHT)
        if mode is not None:
            link, width, height, rate = name, mode.width, mode.height, mode.rate or RATE
            break
    return [
        "camera:",
        "  kind: camera",
        f"  link: {link}",
        f"  width: {width}",
        f"  height: {height}",
        f"  rate_hz: {min(rate, RATE):g}",
        "  hfov_deg: 48 # or calibration: FILE of followerd calibrate camera",
        "  mount: {x_m: 0.1, z_m: 0.6, elevation_deg: -5} # followerd calibrate mount",
    ]


def _ptz(devices: Mapping[str, Found]) -> list[str]:
    for link, found in devices.items():
        if isinstance(found, HeadFound):
            return ["ptz:", "  kind: vcc50i", f"  link: {link}", f"  baud: {found.baud}"]
    return []
