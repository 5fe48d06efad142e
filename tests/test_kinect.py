"""Kinect v1: raw depth to metres in the colour image, and libfreenect by Debian's fakenect."""

import ctypes
import json
import os
import subprocess
import sys
from functools import partial
from math import radians
from pathlib import Path
from time import process_time, sleep
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from followerd.errors import LinkLost, OpenError, SetupError
from followerd.geometry import Array
from followerd.hw.camera.freenect import (
    MM,
    PROTOTYPES,
    FrameMode,
    Freenect,
    Functions,
    TiltState,
    UnitRegistration,
)
from followerd.hw.camera.kinect import Kinect, KinectSettings, KinectSource
from followerd.hw.camera.registration import (
    HEIGHT,
    NO_DEPTH,
    RAW_VALUES,
    WIDTH,
    Raw,
    Registration,
    RegistrationTables,
    metres_of_raw,
)
from followerd.hw.camera.settings import CameraMount
from followerd.messages import Image, Measurement

FAKENECT = next(Path("/usr/lib").glob("*/fakenect/libfreenect.so.0.5"), None)
needs_fakenect = pytest.mark.skipif(
    FAKENECT is None, reason="fakenect is not installed: apt install libfreenect0.5"
)
COLOUR = KinectSettings().camera

# depth


@pytest.mark.parametrize(
    ("raw", "metres"), [(400, 0.501), (600, 0.706), (800, 1.194), (1000, 3.864), (1050, 8.767)]
)
def test_raw_depth_in_metres_agrees_with_libfreenect(raw: int, metres: float) -> None:
    assert metres_of_raw()[raw] == pytest.approx(metres, abs=6e-4)


def test_no_data_and_depths_beyond_ten_metres_are_unknown() -> None:
    table = metres_of_raw()
    assert np.isinf(table[[NO_DEPTH, 1090, 1500]]).all()
    known = table[np.isfinite(table)]
    assert (np.diff(known) > 0).all()
    assert known.max() <= 10.0


def by_hand(raw: Raw, tables: RegistrationTables) -> Array:
    """The slow way: pixel by pixel, the nearest wins."""
    depth = np.full((HEIGHT, WIDTH), np.inf)
    for v, u in zip(*np.nonzero(np.isfinite(tables.metres[raw])), strict=True):
        value = raw[v, u]
        column = round(float(tables.columns[v, u] - tables.shifts[value]))
        row = round(float(tables.rows[v, u]))
        if 0 <= column < WIDTH and 0 <= row < HEIGHT:
            depth[row, column] = min(depth[row, column], tables.metres[value])
    return np.where(np.isinf(depth), np.nan, depth)


def blocks(seed: int) -> Raw:
    """Raw depth with near and far surfaces, edges and holes."""
    rng = np.random.default_rng(seed)
    raw = np.kron(rng.integers(450, 1080, (12, 16)), np.ones((40, 40))).astype(np.uint16)
    raw[rng.random(raw.shape) < 0.1] = NO_DEPTH
    return raw


def test_registration_puts_the_nearest_surface_where_the_colour_camera_sees_it() -> None:
    tables = RegistrationTables.of_pinholes(COLOUR)
    raw = blocks(0)
    raw[:200], raw[230:] = NO_DEPTH, NO_DEPTH  # by hand is slow
    depth, expected = Registration(tables)(raw), by_hand(raw, tables)
    same = np.isclose(depth, expected, rtol=1e-5) | (np.isnan(depth) & np.isnan(expected))
    assert same[203:232].mean() > 0.997  # columns are rounded in 64ths of a pixel
    assert np.isnan(depth[:203]).all()
    assert np.isnan(depth[232:]).all()
    assert 0.5 < np.isfinite(depth[210]).mean() < 0.95


def test_a_wall_keeps_its_distance_and_a_near_ball_moves_left_in_the_colour_image() -> None:
    raw = np.full((HEIGHT, WIDTH), 1000, np.uint16)
    raw[200:281, 300:381] = 600
    depth = Registration(RegistrationTables.of_pinholes(COLOUR))(raw)
    near, far = metres_of_raw()[[600, 1000]]
    rows, columns = np.nonzero(depth < 1.0)
    assert set(np.unique(depth[rows, columns])) == {np.float32(near)}
    f, g = COLOUR.fx, 575.8
    assert columns.mean() == pytest.approx(
        COLOUR.cx + f * ((340 - 319.5) / g - 0.024 / near), abs=0.6
    )
    assert rows.mean() == pytest.approx(COLOUR.cy + f * (240 - 239.5) / g, abs=0.6)
    assert np.nanmedian(depth) == np.float32(far)


@settings(max_examples=3, deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 1 << 16))
def test_no_raw_frame_and_no_table_of_a_unit_leads_outside_the_image(seed: int, top: int) -> None:
    rng = np.random.default_rng(seed)
    tables = RegistrationTables(
        rng.uniform(-3000, 3000, (HEIGHT, WIDTH)),
        rng.uniform(-100, 600, (HEIGHT, WIDTH)),
        rng.uniform(-200, 200, RAW_VALUES),
        np.where(rng.random(RAW_VALUES) < 0.5, 1.0, np.inf),
    )
    depth = Registration(tables)(rng.integers(0, top + 1, (HEIGHT, WIDTH)).astype(np.uint16))
    assert depth.shape == (HEIGHT, WIDTH)
    assert set(np.unique(depth[np.isfinite(depth)])) <= {np.float32(1.0)}


# libfreenect's structures


def test_structures_are_as_large_as_in_libfreenect_h() -> None:
    sizes = [ctypes.sizeof(kind) for kind in (FrameMode, TiltState, UnitRegistration)]
    assert sizes == [24, 12, 176]
    assert UnitRegistration.raw_to_mm_shift.offset == 152


def test_a_units_own_tables_are_used_as_they_are() -> None:
    mm = np.zeros(RAW_VALUES, np.uint16)
    mm[700] = 2000
    shift = np.zeros(MM, np.int32)
    shift[2000] = -5 * 256
    table = np.empty((HEIGHT, WIDTH, 2), np.int32)
    table[..., 0] = 256 * np.arange(WIDTH)
    table[..., 1] = np.arange(HEIGHT)[:, None] + 3
    unit = UnitRegistration(
        raw_to_mm_shift=mm.ctypes.data_as(ctypes.POINTER(ctypes.c_uint16)),
        depth_to_rgb_shift=shift.ctypes.data_as(ctypes.POINTER(ctypes.c_int32)),
        registration_table=table.ctypes.data_as(ctypes.POINTER(ctypes.c_int32)),
    )
    raw = np.full((HEIGHT, WIDTH), NO_DEPTH, np.uint16)
    raw[100, 300] = 700
    depth = Registration(unit.tables())(raw)
    assert np.argwhere(np.isfinite(depth)).tolist() == [[103, 295]]
    assert depth[103, 295] == 2.0


# set-up


def test_settings_of_a_kinect() -> None:
    assert (COLOUR.width, COLOUR.height) == (640, 480)
    assert COLOUR.fx == pytest.approx(525, abs=1)
    with pytest.raises(ValidationError, match="reaches 27 degrees"):
        KinectSettings(mount=CameraMount(elevation_deg=30))
    KinectSettings(mount=CameraMount(elevation_deg=30), tilt_motor=False)
    with pytest.raises(ValidationError):
        KinectSettings.model_validate({"width": 320})


async def test_a_missing_library_is_said_with_the_package_that_has_it() -> None:
    source = KinectSource("kinect:/nowhere/libfreenect.so", KinectSettings())
    with pytest.raises(OpenError, match=r"camera: /nowhere/.* apt install libfreenect0.5"):
        await source.open("camera")
    with pytest.raises(OpenError, match=r"no number of a Kinect; write kinect:0"):
        await KinectSource("kinect:x#one", KinectSettings()).open("camera")


async def test_a_library_that_is_no_libfreenect_is_refused() -> None:
    with pytest.raises(OpenError, match="has no freenect_init; use libfreenect"):
        await KinectSource("kinect:libc.so.6", KinectSettings()).open("camera")


def test_tilt_is_bounded_and_images_carry_it() -> None:
    source = KinectSource("kinect:0", KinectSettings())
    kinect = Kinect(KinectSettings(), source)
    kinect.set_tilt(radians(10))
    assert source.wanted_tilt == pytest.approx(10)
    kinect.set_tilt(radians(-40))
    assert source.wanted_tilt == -27


# libfreenect as it answers


class Library:
    """A library of functions as libfreenect has them, and one Kinect behind them."""

    def __init__(self, frames: int = 3) -> None:
        self.frames = frames  # that come before the Kinect is gone
        self.devices = 1
        self.opens_motor = True
        self.has_tables = True
        self.refuses = ""  # a function that fails
        self.moves = 0  # how many looks at the tilt see it move
        self.log: list[str] = []
        self.callbacks: dict[str, Any] = {}
        self.state = TiltState(tilt_angle=0)
        self.raw = np.full((HEIGHT, WIDTH), 900, np.uint16)
        self.rgb = np.full((HEIGHT, WIDTH, 3), (10, 20, 30), np.uint8)
        self.mm = np.full(RAW_VALUES, 1500, np.uint16)
        self.shift = np.zeros(MM, np.int32)
        self.table = np.zeros((HEIGHT, WIDTH, 2), np.int32)
        self.table[..., 0] = 256 * np.arange(WIDTH)
        self.table[..., 1] = np.arange(HEIGHT)[:, None]

    def load(self, device: str, library: str) -> Functions:
        """Instead of the loader."""
        assert (device, library) == ("camera", "libfreenect.so.0.5")
        functions: Functions = {name: partial(self._note, name) for name in PROTOTYPES}
        functions["set_flag"] = lambda _, flag, on: self._note(f"flag {flag:#x} {on}")
        if self.has_tables:
            functions |= {"copy_registration": self._tables, "destroy_registration": self._note}
        return functions | {
            "num_devices": lambda _: self.devices,
            "open_device": self._open,
            "find_video_mode": lambda *_: FrameMode(is_valid=1),
            "find_depth_mode": lambda *_: FrameMode(is_valid=1),
            "set_video_callback": lambda _, call: self.callbacks.update(video=call),
            "set_depth_callback": lambda _, call: self.callbacks.update(depth=call),
            "process_events_timeout": self._process,
            "set_tilt_degs": self._tilt,
            "get_tilt_state": lambda _: ctypes.pointer(self.state),
            "update_tilt_state": self._look,
        }

    def _note(self, name: object, *_: object) -> int:
        self.log.append(str(name))
        return -1 if name == self.refuses else 0

    def _open(self, *_: object) -> int:
        self.log.append("open_device")
        alone = self.log.count("open_device") > 1
        return 0 if self.opens_motor or alone else -1

    def _tables(self, _: object) -> UnitRegistration:
        short, number = ctypes.POINTER(ctypes.c_uint16), ctypes.POINTER(ctypes.c_int32)
        return UnitRegistration(
            raw_to_mm_shift=self.mm.ctypes.data_as(short),
            depth_to_rgb_shift=self.shift.ctypes.data_as(number),
            registration_table=self.table.ctypes.data_as(number),
        )

    def _process(self, *_: object) -> int:
        sleep(0.002)
        if self.frames == 0:
            return -1
        self.frames -= 1
        if self.frames % 2:
            return -10  # a signal came
        self.callbacks["depth"](None, self.raw.ctypes.data, 0)
        self.callbacks["video"](None, self.rgb.ctypes.data, 0)
        return 0

    def _tilt(self, _: object, degrees: float) -> int:
        self.log.append(f"tilt {degrees:g}")
        self.state.tilt_angle = round(2 * degrees)
        return 0

    def _look(self, _: object) -> int:
        self.moves -= 1
        self.state.tilt_status = 4 if self.moves >= 0 else 0
        return 0


def unit(library: Library) -> Freenect:
    return Freenect("camera", library.load("camera", "libfreenect.so.0.5"), 0)


async def images_of(library: Library) -> tuple[list[Image], KinectSource]:
    settings = KinectSettings()
    source = KinectSource("kinect:0", settings, library.load)
    images: list[Image] = []

    def sink(image: Measurement) -> None:
        assert isinstance(image, Image)
        images.append(image)

    with pytest.raises(LinkLost, match="the Kinect is gone; check its plug"):
        await Kinect(settings, source).run(sink)
    await source.released()
    return images, source


async def test_a_kinect_is_opened_played_and_left_in_order() -> None:
    library = Library(frames=30)
    images, source = await images_of(library)
    assert images[0].pixels[0, 0].tolist() == [30, 20, 10]
    assert images[0].depth is not None
    assert np.nanmean(images[0].depth) == 1.5  # by the unit's own table
    assert library.log.count("tilt 0") == 1
    assert library.log[-4:] == ["stop_video", "stop_depth", "close_device", "shutdown"]
    assert source.wanted_tilt == 0


@pytest.mark.slow
async def test_exposure_and_white_balance_are_held_when_a_person_is_enrolled() -> None:
    library = Library(frames=100)
    kinect = Kinect(KinectSettings(), KinectSource("kinect:0", KinectSettings(), library.load))
    kinect.lock_exposure()
    with pytest.raises(LinkLost):
        await kinect.run(lambda _: None)
    flags = [entry for entry in library.log if entry.startswith("flag")]
    assert flags == ["flag 0x4000 1", "flag 0x2 1", "flag 0x4000 0", "flag 0x2 0"]


async def test_without_tables_of_the_unit_two_pinholes_are_assumed() -> None:
    library = Library(frames=20)
    library.has_tables = False
    images, _ = await images_of(library)
    assert images[0].depth is not None
    assert np.nanmedian(images[0].depth) == pytest.approx(metres_of_raw()[900], abs=1e-4)


async def test_a_later_model_runs_without_its_motor() -> None:
    library = Library(frames=20)
    library.opens_motor = False
    images, source = await images_of(library)
    assert images
    assert not any(entry.startswith(("tilt", "set_led")) for entry in library.log)
    assert np.isnan(source.tilt)


def test_a_kinect_that_cannot_be_used_says_why_and_what_to_do() -> None:
    library = Library()
    library.devices = 0
    with pytest.raises(OpenError, match="no Kinect is plugged in; plug in its USB and its power"):
        unit(library)
    assert library.log[-1] == "shutdown"
    library.devices = 1
    with pytest.raises(OpenError, match="there is no Kinect 3"):
        Freenect("camera", library.load("camera", "libfreenect.so.0.5"), 3)
    library.refuses = "init"
    with pytest.raises(OpenError, match="libfreenect cannot use USB"):
        unit(library)
    library = Library()
    library.refuses = "start_depth"
    with pytest.raises(SetupError, match="does not start its depth; plug it into a USB port of"):
        unit(library).start(lambda *_: None, lambda *_: None)


def test_the_tilt_is_not_known_while_it_moves() -> None:
    library = Library()
    library.moves = 1
    kinect = unit(library)
    kinect.set_tilt(-12.5)
    assert kinect.tilt() is None
    assert kinect.tilt() == -12.5


# fakenect: one process each, for it has one device per process and ends it when in trouble

PLAY = """
import asyncio, json, sys, time
import numpy as np
from followerd import clock
from followerd.errors import LinkLost
from followerd.hw.camera.kinect import Kinect, KinectSettings
from followerd.hw.camera.sources import open_camera

settings = KinectSettings()
source = open_camera(sys.argv[1], settings)
kinect = Kinect(settings, source)
seen, lost = [], ""

def sink(image):
    spots = np.argwhere(image.depth < 1.0) if image.depth is not None else np.empty((0, 2))
    seen.append(dict(
        id=image.id, late=image.received - image.stamp, bgr=image.pixels[0, 0].tolist(),
        depth=None if image.depth is None else float(np.nanmedian(image.depth)),
        spot=spots.mean(0).tolist() if len(spots) else None,
    ))

async def main():
    global lost, lag
    task = asyncio.create_task(kinect.run(sink))
    lags = []
    while not task.done():
        due = clock.now() + 0.005
        await clock.sleep_until(due)
        lags.append(clock.now() - due)
    lag = float(np.median(lags))
    try:
        await task
    except LinkLost as error:
        lost = str(error)

cpu = time.process_time()
clock.run(main())
print("RESULT", json.dumps(dict(
    seen=seen, lost=lost, tilt=source.tilt, lag=lag, dropped=kinect.dropped,
    cpu_ms_per_image=1e3 * (time.process_time() - cpu) / len(seen))))
"""


def dump(folder: Path, frames: int, rate: float = 30.0) -> None:
    """What fakenect plays: a wall with a near square that moves, brighter from image to image."""
    folder.mkdir()
    names = []

    def write(kind: str, time: float, suffix: str, content: bytes) -> None:
        names.append(f"{kind}-{time:f}-{round(time * 6e7) % 2**32}.{suffix}")
        (folder / names[-1]).write_bytes(content)

    for n in range(frames):
        time = 1000.0 + n / rate
        raw = np.full((HEIGHT, WIDTH), 900, np.uint16)
        raw[200:240, 100 + 10 * n % 400 : 140 + 10 * n % 400] = 600
        write("a", time, "dump", b"\0\0\x33\x03\0\0" + bytes([10, 0]) + bytes(4))
        write("d", time, "pgm", b"P5 640 480 65535\n" + raw.tobytes())
        rgb = np.full((HEIGHT, WIDTH, 3), (n, 100, 200), np.uint8)
        write("r", time + 0.002, "ppm", b"P6 640 480 255\n" + rgb.tobytes())
    (folder / "INDEX.txt").write_text("".join(f"{name}\n" for name in names))


def play(folder: Path) -> dict[str, Any]:
    """Run the driver on a dump in a process of its own; what it saw."""
    environment = os.environ | {"FAKENECT_PATH": str(folder)}
    run = subprocess.run(
        [sys.executable, "-c", PLAY, f"kinect:{FAKENECT}"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    results = [line for line in run.stdout.splitlines() if line.startswith("RESULT ")]
    assert results, run.stderr
    played: dict[str, Any] = json.loads(results[0].removeprefix("RESULT "))
    return played | {"stdout": run.stdout}


@needs_fakenect
@pytest.mark.slow
def test_a_kinect_streams_colour_with_registered_depth_until_it_is_gone(tmp_path: Path) -> None:
    dump(tmp_path / "dump", 6)
    played = play(tmp_path / "dump")
    seen = played["seen"]
    assert [image["id"] for image in seen] == sorted({image["id"] for image in seen})
    assert len(seen) >= 3
    for image in seen:
        n = image["id"]
        assert image["bgr"] == [200, 100, n]
        assert image["depth"] == pytest.approx(metres_of_raw()[900], abs=1e-4)
        expected = COLOUR.cx + COLOUR.fx * (
            (119.5 + 10 * n - 319.5) / 575.8 - 0.024 / metres_of_raw()[600]
        )
        assert image["spot"] == pytest.approx([221.3, expected], abs=1.0)
    assert played["lost"] == ("camera: the Kinect is gone; check its plug and its power supply")


@needs_fakenect
@pytest.mark.slow
def test_thirty_images_a_second_with_depth_and_the_loop_stays_free(tmp_path: Path) -> None:
    dump(tmp_path / "dump", 90)
    played = play(tmp_path / "dump")
    seen = played["seen"]
    assert len(seen) >= 85  # of 90, also on a busy computer
    assert all(image["depth"] is not None for image in seen)
    assert played["cpu_ms_per_image"] < 25
    assert played["lag"] < 0.01
    assert played["tilt"] == 5.0  # the dump's motor does not do as it is told, which is said
    assert "tilt is not as configured" in played["stdout"]


@pytest.mark.slow
def test_registered_depth_takes_six_milliseconds_at_most() -> None:
    register, raw = Registration(RegistrationTables.of_pinholes(COLOUR)), blocks(1)

    def cpu() -> float:
        began = process_time()
        register(raw)
        return process_time() - began

    assert min(cpu() for _ in range(20)) < 0.006
