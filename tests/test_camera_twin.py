"""Twins of a Kinect and of a thermal camera: the same drivers, in memory and through a ring."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

from followerd import app, clock
from followerd.config import Config, load
from followerd.hw.camera.ring import RingSource
from followerd.hw.registry import DRIVERS
from followerd.messages import Image, Measurement
from followerd.sim.serve import on_ring

SMALL = {"camera.width": 160, "camera.height": 120}


def config_of(kind: str) -> Config:
    changes: dict[str, object] = {"camera.kind": kind, "base.link": "sim"}
    if kind == "kinect":
        camera = {"kind": "kinect", "link": "sim", "mount": {"z_m": 0.6, "elevation_deg": -5}}
        return load("hpf-sim", {"camera": camera})
    return load("hpf-sim", changes | SMALL)


def images_of(config: Config, count: int) -> list[Image]:
    """What the driver yields in virtual time."""
    images: list[Image] = []
    enough = asyncio.Event()

    def sink(image: Measurement) -> None:
        assert isinstance(image, Image)
        images.append(image)
        if len(images) == count:
            enough.set()

    async def main() -> None:
        rig = app.rig(config)
        settings = DRIVERS.load(config.camera.kind).Settings.model_validate(
            config.camera.model_dump(exclude={"kind", "link"})
        )
        driver = DRIVERS.load(config.camera.kind)(settings, rig.camera.link)
        running = asyncio.create_task(clock.together(rig.run(), driver.run(sink)))
        await enough.wait()
        running.cancel()

    clock.run_virtual(main())
    return images


def test_a_simulated_kinect_sees_depth_in_register_with_colour() -> None:
    image = images_of(config_of("kinect"), 2)[-1]
    assert image.pixels.shape == (480, 640, 3)
    assert image.depth is not None
    assert image.depth.shape == (480, 640)
    rows = np.arange(470, 480)
    ground = [image.camera.ground_point(20.0, float(row)) for row in rows]
    for row, point in zip(rows, ground, strict=True):
        assert point is not None
        depth = image.camera.project(np.array([[*point, 0.0]]))[0, 2]
        assert image.depth[row, 20] == pytest.approx(depth, rel=0.03)


def test_a_simulated_thermal_camera_sees_grey() -> None:
    image = images_of(config_of("thermal"), 2)[-1]
    assert image.pixels.shape == (120, 160)
    assert image.depth is None
    assert image.pixels.max() > image.pixels.mean() + 40  # somebody warm stands there


@pytest.mark.slow
async def test_depth_and_grey_pass_a_frame_ring(tmp_path: Path) -> None:
    for kind, channels in (("kinect", 3), ("thermal", 1)):
        rig = app.rig(config_of(kind))
        running = asyncio.create_task(rig.run())
        with on_ring(rig.camera, tmp_path / kind):
            stream = await RingSource(str(tmp_path / kind)).open("camera")
            frame = await stream.read()
            stream.close()
        running.cancel()
        assert frame.pixels.ndim == (3 if channels == 3 else 2)
        assert (frame.depth is not None) == (kind == "kinect")
