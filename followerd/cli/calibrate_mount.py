"""`followerd calibrate mount`: where the camera sits, by a person who walks about."""

from math import degrees, hypot
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from followerd import app, clock
from followerd.config import Config, load
from followerd.errors import Stopped, UsageError
from followerd.estimation.mount import FEWEST, Mount, find_mount
from followerd.geometry import Camera
from followerd.runtime import logs
from followerd.runtime.mount_session import MountSession

CENTIMETRE = 100.0
SHOWN = {  # name in the config, factor from SI, unit
    "yaw": ("yaw_deg", degrees(1.0), "°"),
    "elevation": ("elevation_deg", degrees(1.0), "°"),
    "z": ("z_m", CENTIMETRE, " cm"),
}


def mount(
    config: str,
    *,
    links: Annotated[
        Path | None,
        Parameter(help="use what `followerd sim --links` offers for links that say sim"),
    ] = None,
    seconds: Annotated[float, Parameter(validator=validators.Number(gt=0))] = 60.0,
    out: Annotated[Path | None, Parameter(help="write the camera's mount, YAML")] = None,
) -> None:
    """Find the camera's yaw, elevation and height from a person walking about before the robot.

    The robot stands still, base switched off or not; one person, with both feet in the picture,
    walks from 1.5 m to 5 m and back, to the left and to the right. Nothing else moves. Whoever
    moves is the person: nobody is enrolled. The camera's place (x_m, y_m) and the laser's mount
    are those of the config: measure them with a ruler, the laser's yaw by `calibrate laser`.
    """
    settings = load(config)
    if links is not None:
        settings = app.plugged_into(settings, links)
    if settings.simulated:
        raise UsageError(f"{config} has links that say sim; give --links of followerd sim")
    if out is not None and not out.parent.is_dir():
        raise UsageError(f"--out {out}: no such folder")
    if settings.ptz is not None:
        print("the camera's head must look straight ahead, as it does in its home position")
    logs.configure("error")
    found, before = measured(settings, seconds)
    _report(found, before)
    if out is not None:
        out.write_text(as_yaml(found), encoding="utf-8")
        print(f"{out}: written; put it into the config's camera section")


def measured(settings: Config, seconds: float) -> tuple[Mount, Camera]:
    """The mount found by a live session, and the camera as configured; raises Stopped."""
    session = MountSession(*app.laser_and_camera(settings, app.hardware(settings)))
    clock.run(session.watch(seconds, _guide))
    pairs = session.pairs()
    distances = [hypot(*pair.nearest) for pair in pairs]
    if distances:
        print(f"seen together {len(pairs)} times, {min(distances):.1f} to {max(distances):.1f} m")
    camera = session.images[0].camera
    found = find_mount(pairs, camera)
    if found is None:
        raise Stopped(
            f"a person, whole in the picture and alone in the laser, was seen {len(pairs)} times,"
            f" both legs at least {FEWEST} times are needed: is it light, is the laser free, are"
            " the feet in the picture?"
        )
    return found, camera


def _guide(left: float) -> None:
    print(f"{left:.0f} s: walk about, near and far, left and right; nobody else", flush=True)


def as_yaml(found: Mount) -> str:
    """The `mount` block of a camera section."""
    camera = found.camera
    lines = ["# by followerd calibrate mount; x_m and y_m as they were"]
    lines += ["mount:", f"  x_m: {camera.x:.3f}", f"  y_m: {camera.y:.3f}"]
    for name, (key, factor, _) in SHOWN.items():
        factor = 1.0 if name == "z" else factor
        told = "not told by the data" if name in found.kept else ""
        sigma = found.sigma.get(name)
        comment = told if sigma is None else f"+- {factor * sigma:.3f}"
        lines.append(f"  {key}: {factor * getattr(camera, name):.3f} # {comment}")
    return "\n".join([*lines, ""])


def _report(found: Mount, before: Camera) -> None:
    print(
        f"residuals {found.column_rms:.1f} px across, {found.row_rms:.1f} px along;"
        f" {found.used} used, {found.outliers} outliers"
    )
    for name, (key, factor, unit) in SHOWN.items():
        was, now = factor * getattr(before, name), factor * getattr(found.camera, name)
        if name in found.kept:
            advice = "walk nearer and farther" if name != "yaw" else "walk longer"
            print(f"{key}: {was:.2f}{unit} kept: the data do not tell it; {advice}")
        else:
            print(f"{key}: {now:.2f}{unit} +- {factor * found.sigma[name]:.2f} (was {was:.2f})")
    print("x_m, y_m and the laser's mount cannot be told by a person who walks: as configured")
