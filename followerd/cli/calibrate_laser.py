"""`followerd calibrate laser`: how the laser is turned on the robot, by a push straight ahead."""

from math import degrees
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter, validators

from followerd import app, clock
from followerd.config import load
from followerd.errors import Stopped, UsageError
from followerd.estimation.laser_yaw import LEAST_WAY, LaserYaw, find_yaw
from followerd.geometry import Array
from followerd.hw.interfaces import Sensor
from followerd.messages import Measurement, Scan
from followerd.runtime import logs
from followerd.runtime.watching import watch

PERIOD = 0.15  # s, between scans that are kept
ODD = 45.0  # deg from what was configured: pushed backward, perhaps


def laser(
    config: str,
    *,
    links: Annotated[
        Path | None,
        Parameter(help="use what `followerd sim --links` offers for links that say sim"),
    ] = None,
    seconds: Annotated[float, Parameter(validator=validators.Number(gt=0))] = 20.0,
) -> None:
    """Find the laser's yaw while a person pushes the robot straight ahead by a metre or two.

    The base is switched off or its motors are; the push is slow, from behind, in a room with
    something to see ahead and aside, where nobody moves. Standing, or turning on the spot, would
    tell nothing.
    """
    settings = load(config)
    if links is not None:
        settings = app.plugged_into(settings, links)
    if settings.simulated:
        raise UsageError(f"{config} has links that say sim; give --links of followerd sim")
    logs.configure("error")
    sensor, _ = app.laser_and_camera(settings, app.hardware(settings))
    scans = clock.run(pushed(sensor, seconds))
    was = degrees(scans[0].base_from_laser.theta)
    found = yaw_of(scans)
    now, sigma = degrees(found.yaw), degrees(found.sigma)
    print(f"pushed {found.way:.2f} m; yaw_deg: {now:.2f}° +- {sigma:.2f} (was {was:.2f})")
    if abs((now - was + 180) % 360 - 180) > ODD:
        print("that is far from the configured one: was the robot pushed ahead, not back?")
    print(f"put `yaw_deg: {now:.2f}` into laser.mount, then calibrate the camera's mount")


async def pushed(sensor: Sensor, seconds: float) -> list[Scan]:
    """The scans of a push, thinned."""
    scans: list[Scan] = []

    def take(measurement: Measurement) -> None:
        due = scans[-1].stamp + PERIOD if scans else 0.0
        if isinstance(measurement, Scan) and measurement.stamp >= due:
            scans.append(measurement)

    def tell(left: float) -> None:
        print(f"{left:.0f} s: push it slowly straight ahead, {LEAST_WAY:g} m at least", flush=True)

    await watch([sensor], take, lambda: bool(scans), seconds, tell)
    return scans


def yaw_of(scans: list[Scan]) -> LaserYaw:
    """The yaw by a push; raises Stopped when it tells nothing."""
    mount = scans[0].base_from_laser
    found = find_yaw([_points(scan) for scan in scans], mount.x, mount.y)
    if found is None:
        raise Stopped(
            f"no way of {LEAST_WAY:g} m straight ahead was seen: push farther and more slowly, in"
            " a room with corners ahead"
        )
    return found


def _points(scan: Scan) -> Array:
    """End points (N, 2) in the laser's frame."""
    seen = np.isfinite(scan.ranges)
    angles, ranges = scan.angles[seen], scan.ranges[seen]
    return np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])
