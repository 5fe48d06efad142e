"""Frames: from a twin in memory, through the ring to another process, from files, from a device."""

import asyncio
import os
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from math import degrees
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import ValidationError

from followerd import clock
from followerd.errors import DeviceError, LinkLost, OpenError, SetupError, UsageError
from followerd.geometry import Array, Camera, Pose2
from followerd.hw.camera.driver import CameraDriver
from followerd.hw.camera.files import NOMINAL_RATE, open_recording
from followerd.hw.camera.protocol import ALIGN, Frame, Ring, RingLayout, wake_path
from followerd.hw.camera.ring import RingSource
from followerd.hw.camera.settings import PRESETS, CameraSettings
from followerd.hw.camera.sources import open_camera
from followerd.messages import Image, Measurement, Pixels
from followerd.sim.faults import Fault
from followerd.sim.serve import on_ring
from followerd.sim.twins.camera import READOUT, CameraTwin

SMALL = CameraSettings(width=64, height=48, rate_hz=10.0)


class Flicker:
    """A scene whose brightness is the world's time in hundredths of a second."""

    def __init__(self) -> None:
        self.now = 0.0

    def advance(self, now: float) -> None:
        self.now = max(self.now, now)

    def ranges(self, base_from_laser: Pose2, bearings: Array, ages: Array) -> Array:
        raise AssertionError("a camera asks for no ranges")

    def render(self, camera: Camera) -> Pixels:
        return np.full((camera.height, camera.width, 3), round(100 * self.now) % 256, np.uint8)


def twin(*faults: str, settings: CameraSettings = SMALL) -> CameraTwin:
    parsed = tuple(Fault.parse(fault) for fault in faults)
    rng = np.random.default_rng(0)
    return CameraTwin(Flicker(), settings.camera, settings.rate_hz, rng, parsed)


def images_of(camera: CameraTwin, seconds: float) -> list[Image]:
    """What the driver yields in virtual time."""
    images: list[Image] = []

    def sink(image: Measurement) -> None:
        assert isinstance(image, Image)
        images.append(image)

    async def main() -> None:
        async with asyncio.TaskGroup() as tasks:
            services = [camera.run(), CameraDriver(SMALL, camera.link).run(sink)]
            running = [tasks.create_task(service) for service in services]
            await clock.sleep(seconds)
            for task in running:
                task.cancel()

    clock.run_virtual(main())
    return images


def ignore(image: Measurement) -> None:
    """A sink."""


def in_virtual_time(camera: CameraTwin, host: Callable[[], Awaitable[None]]) -> None:
    async def main() -> None:
        async with asyncio.TaskGroup() as tasks:
            exposing = tasks.create_task(camera.run())
            await host()
            exposing.cancel()

    clock.run_virtual(main())


# settings


@pytest.mark.parametrize("name", PRESETS)
def test_presets_have_the_size_and_field_of_view_they_say(name: str) -> None:
    settings = CameraSettings.preset(name)
    camera = settings.camera
    assert name == f"{camera.width}x{camera.height}@{settings.rate_hz:.0f}"
    sides = camera.bearing(-0.5) - camera.bearing(camera.width - 0.5)
    assert degrees(sides) == pytest.approx(48, abs=0.2)
    assert (camera.z, degrees(camera.elevation)) == pytest.approx((0.6, -5))


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(ValidationError):
        CameraSettings(hfov_deg=200)
    with pytest.raises(ValidationError):
        CameraSettings.model_validate({"mount": {"z_m": -1}})


# the twin in virtual time


def test_images_carry_the_time_of_their_exposure_and_come_after_the_readout() -> None:
    images = images_of(twin(), 1.0)
    assert [image.id for image in images] == list(range(10))
    assert [image.stamp for image in images] == pytest.approx([n / 10 for n in range(10)])
    for image in images:
        assert image.received - image.stamp == pytest.approx(READOUT)
        assert image.pixels[0, 0, 0] == round(100 * image.stamp)
        assert image.camera == SMALL.camera


def test_the_newest_frame_wins_and_the_others_are_counted() -> None:
    camera = twin()
    driver = CameraDriver(SMALL, camera.link)
    ids: list[int] = []

    def sink(image: Measurement) -> None:
        assert isinstance(image, Image)
        ids.append(image.id)

    async def main() -> None:
        task = asyncio.create_task(driver.run(sink))
        await clock.sleep(0.1)
        for n in (0, 1, 2, 5):  # 3 and 4 were lost on the way; 0 and 1 nobody had time for
            camera.ports[0].deliver(Frame(n, n / 10, np.zeros((48, 64, 3), np.uint8)))
            if n == 2:
                await clock.sleep(0.1)
        await clock.sleep(0.1)
        task.cancel()

    clock.run_virtual(main())
    assert ids == [2, 5]
    assert driver.dropped == 2


def test_a_pulled_camera_is_a_lost_link_and_can_be_opened_again() -> None:
    camera = twin("camera:disconnect@0.45+1")

    async def host() -> None:
        with pytest.raises(LinkLost, match="camera: unplugged"):
            await CameraDriver(SMALL, camera.link).run(ignore)
        assert clock.now() == pytest.approx(0.5)  # noticed at the next frame
        with pytest.raises(OpenError, match="does not exist"):
            await camera.link.open("camera")
        await clock.sleep(1.1)
        frames = await camera.link.open("camera")
        assert (await frames.read()).stamp > 1.4

    in_virtual_time(camera, host)


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("off", []),
        ("stuck", [0.9] * 10),
        ("slow", [1.2, 1.6]),
        ("delay", [1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6]),
    ],
)
def test_faults_of_a_camera(fault: str, expected: list[float]) -> None:
    images = images_of(twin(f"camera:{fault}@0.95+1"), 2.0)
    during = [image for image in images if 0.95 < image.stamp < 1.65 or fault == "stuck"]
    seen = [image.pixels[0, 0, 0] / 100 for image in during if image.stamp > 0.95]
    assert seen[: len(expected)] == pytest.approx(expected)
    assert bool(seen) == bool(expected)


def test_garbage_is_noise_and_drop_leaves_gaps() -> None:
    garbage = images_of(twin("camera:garbage@0+9"), 1.0)
    assert all(np.unique(image.pixels).size > 100 for image in garbage)
    ids = [image.id for image in images_of(twin("camera:drop@0+9"), 9.0)]
    assert 50 < len(ids) < 88
    assert ids == sorted(ids)


def test_a_camera_has_every_fault_that_a_line_has() -> None:
    clean = {image.stamp: image.pixels for image in images_of(twin(), 9.0)}

    def spoilt(fault: str) -> list[tuple[int, int]]:
        """Pixels, rows that differ in each picture that is not as it should be."""
        images = images_of(twin(f"camera:{fault}@0.95+9"), 9.0)
        off = [image.pixels != clean[image.stamp] for image in images]
        return [(int(d.sum()), int(d.any(axis=(1, 2)).sum())) for d in off if d.any()]

    assert set(spoilt("flip")) == {(1, 1)}
    assert len({rows for _, rows in spoilt("split")}) > 20
    assert not spoilt("wrong")  # turned round, which does not show on an even picture
    twice = [image.stamp for image in images_of(twin("camera:duplicate@0+9"), 9.0)]
    assert 95 < len(twice) < 130
    assert len(set(twice)) == 90


def test_frames_of_another_size_than_configured_are_refused() -> None:
    camera = twin()
    wrong = CameraSettings(width=192, height=144)

    async def host() -> None:
        with pytest.raises(SetupError, match="sends 64x48 frames, the config says 192x144"):
            await CameraDriver(wrong, camera.link).run(ignore)

    in_virtual_time(camera, host)


# the ring

layouts = st.builds(
    RingLayout,
    width=st.integers(1, 40),
    height=st.integers(1, 40),
    channels=st.sampled_from([1, 3]),
    depth=st.booleans(),
    slots=st.integers(3, 6),
)


def ring_of(layout: RingLayout) -> Ring:
    return Ring(layout, memoryview(bytearray(layout.header().ljust(layout.size, b"\0"))))


def frame_of(layout: RingLayout, n: int) -> Frame:
    shape = (layout.height, layout.width)
    pixels = np.full(shape if layout.channels == 1 else (*shape, 3), n % 256, np.uint8)
    return Frame(n, 0.1 * n, pixels, np.full(shape, n, np.float32) if layout.depth else None)


@given(layouts)
def test_the_header_says_the_layout(layout: RingLayout) -> None:
    assert RingLayout.from_header(layout.header()) == layout


@pytest.mark.parametrize(
    ("raw", "problem"),
    [
        (b"", "no frame ring"),
        (b"hello" * 20, "no frame ring"),
        (RingLayout(4, 4).header()[:8] + b"\7\0\0\0" + bytes(60), "version 7, expected 1"),
        (RingLayout(0, 4).header(), "impossible"),
        (RingLayout(4, 4, channels=2).header(), "impossible"),
        (RingLayout(4, 4, slots=2).header(), "impossible"),
    ],
)
def test_what_is_no_ring_is_refused(raw: bytes, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        RingLayout.from_header(raw)


def test_a_ring_shorter_than_its_header_says_is_refused() -> None:
    layout = RingLayout(8, 8)
    with pytest.raises(ValueError, match="its header says"):
        Ring(layout, memoryview(bytearray(layout.size - 1)))


@example(RingLayout(4, 3, depth=True), [1, 4])
@example(RingLayout(4, 3, channels=1), [2])
@given(layouts, st.lists(st.integers(1, 5), max_size=20))
def test_a_reader_gets_the_newest_frame_whole_and_each_only_once(
    layout: RingLayout, bursts: list[int]
) -> None:
    ring = ring_of(layout)
    assert ring.newest() is None
    n = 0
    for burst in bursts:
        for _ in range(burst):
            ring.write(frame_of(layout, n))
            n += 1
        frame, written = ring.newest(n - 1 - burst), frame_of(layout, n - 1)
        assert frame is not None
        assert (frame.id, frame.stamp) == (written.id, written.stamp)
        assert np.array_equal(frame.pixels, written.pixels)
        assert layout.depth == (frame.depth is not None)
        if frame.depth is not None and written.depth is not None:
            assert np.array_equal(frame.depth, written.depth)
        assert ring.newest(n - 1) is None


def test_a_frame_overwritten_while_it_is_copied_is_not_taken() -> None:
    layout = RingLayout(4, 4)
    memory = bytearray(layout.header().ljust(layout.size, b"\0"))
    ring = Ring(layout, memoryview(memory))
    for n in range(4):
        ring.write(frame_of(layout, n))
    newest = ALIGN + 3 * layout.slot_bytes
    memory[newest : newest + 8] = (2 * 7 + 1).to_bytes(8, "little")  # frame 7 goes there now
    assert ring.newest() is None


def test_a_frame_of_another_shape_does_not_fit() -> None:
    ring = ring_of(RingLayout(4, 4))
    with pytest.raises(ValueError, match="into"):
        ring.write(frame_of(RingLayout(4, 5), 0))
    with pytest.raises(ValueError, match="into"):
        ring.write(frame_of(RingLayout(4, 4, depth=True), 0))


@asynccontextmanager
async def serving(camera: CameraTwin, path: Path) -> AsyncIterator[None]:
    exposing = asyncio.create_task(camera.run())
    try:
        with on_ring(camera, path):
            yield
    finally:
        exposing.cancel()


async def test_images_come_through_a_ring_in_a_file_which_disappears_at_the_end(
    tmp_path: Path,
) -> None:
    path = tmp_path / "links" / "camera"
    fast = SMALL.model_copy(update={"rate_hz": 100.0})
    async with serving(twin(settings=fast), path):
        stream = await open_camera(f"ring:{path}", fast).open("camera")
        for _ in range(3):
            frame = await stream.read()
            assert frame.pixels.shape == (48, 64, 3)
            assert READOUT <= clock.now() - frame.stamp < 1.0
        stream.close()
        stream.close()
        with pytest.raises(LinkLost, match="closed"):
            await stream.read()
    assert not list(path.parent.iterdir())


async def test_a_ring_whose_writer_goes_away_is_a_lost_link(tmp_path: Path) -> None:
    camera = twin()
    async with serving(camera, tmp_path / "camera"):
        stream = await RingSource(str(tmp_path / "camera")).open("camera")
        camera.unplug()
        with pytest.raises(LinkLost, match=r"the writer of .* is gone"):
            await stream.read()
        with pytest.raises(OpenError, match="does not exist"):
            await RingSource(str(tmp_path / "camera")).open("camera")
        camera.replug()
        again = await RingSource(str(tmp_path / "camera")).open("camera")
        await again.read()
        again.close()


async def test_rings_that_cannot_be_read_say_why(tmp_path: Path) -> None:
    path = tmp_path / "camera"
    with pytest.raises(OpenError, match="camera does not exist; start the simulation"):
        await RingSource(str(path)).open("camera")
    path.write_bytes(b"mine")
    with pytest.raises(OpenError, match="no frame ring"):
        await RingSource(str(path)).open("camera")
    with pytest.raises(UsageError, match="in the way"), on_ring(twin(), path):
        pass
    assert path.read_bytes() == b"mine"
    layout = RingLayout(8, 8)
    path.write_bytes(layout.header().ljust(layout.size, b"\0"))  # left by a killed simulation
    os.mkfifo(wake_path(path))
    with pytest.raises(OpenError, match="nobody writes to"):
        await RingSource(str(path)).open("camera")


WRITER = """
import sys
import numpy as np
from pathlib import Path
from followerd.hw.camera.protocol import Frame, RingLayout
from followerd.sim.serve import RingPort

port = RingPort(RingLayout(320, 240), Path(sys.argv[1]))
sys.stdin.readline()
for n in range(int(sys.argv[2])):
    port.deliver(Frame(n, 0.0, np.full((240, 320, 3), n % 251, np.uint8)))
port.unplug()
"""


async def test_no_frame_from_another_process_is_ever_torn(tmp_path: Path) -> None:
    path = tmp_path / "camera"
    command = [sys.executable, "-c", WRITER, str(path), "3000"]
    writer = await asyncio.create_subprocess_exec(*command, stdin=asyncio.subprocess.PIPE)
    while not path.exists():
        await clock.sleep(0.01)
    stream = await RingSource(str(path)).open("camera")
    frames: list[Frame] = []
    reading = asyncio.create_task(read_into(frames, stream.read))
    await writer.communicate(b"go\n")
    with pytest.raises(LinkLost):
        await reading
    ids = [frame.id for frame in frames]
    assert len(ids) > 5
    assert ids == sorted(set(ids))
    for frame in frames:
        assert np.all(frame.pixels == frame.id % 251)


async def read_into(frames: list[Frame], read: Callable[[], Awaitable[Frame]]) -> None:
    while True:
        frames.append(await read())


# files and devices


def test_a_folder_of_images_is_read_in_the_order_of_its_numbers(tmp_path: Path) -> None:
    for n in (10, 2, 1):
        cv2.imwrite(str(tmp_path / f"img{n}.png"), np.full((6, 8, 3), n, np.uint8))
    (tmp_path / "notes.txt").write_text("not an image")
    recording = open_recording(tmp_path)
    assert (recording.count, recording.width, recording.height) == (3, 8, 6)
    for _ in range(2):  # from the start each time
        frames = list(recording)
        assert [frame.id for frame in frames] == [0, 1, 2]
        assert [int(frame.pixels[0, 0, 0]) for frame in frames] == [1, 2, 10]
        assert [frame.stamp for frame in frames] == [n / NOMINAL_RATE for n in range(3)]


def write_video(path: Path, count: int) -> None:
    """Frames of 64x48 at 10 Hz, of grey level 0, 40, 80, …"""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (64, 48))
    for n in range(count):
        writer.write(np.full((48, 64, 3), 40 * n % 256, np.uint8))
    writer.release()


def test_a_video_has_its_own_rate(tmp_path: Path) -> None:
    path = tmp_path / "walk.avi"
    write_video(path, 5)
    recording = open_recording(path)
    assert (recording.count, recording.width, recording.height) == (5, 64, 48)
    frames = list(recording)
    assert [frame.stamp for frame in frames] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert [float(frame.pixels.mean()) for frame in frames] == pytest.approx(
        [0, 40, 80, 120, 160], abs=3
    )


def test_recordings_that_cannot_be_read_say_why(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nothing does not exist: give a folder"):
        open_recording(tmp_path / "nothing")
    with pytest.raises(UsageError, match="holds no images"):
        open_recording(tmp_path)
    (tmp_path / "broken.mp4").write_bytes(b"no video" * 100)
    with pytest.raises(DeviceError, match=r"broken.mp4: cannot be opened as a video; convert"):
        open_recording(tmp_path / "broken.mp4")
    (tmp_path / "broken.png").write_bytes(b"no image" * 100)
    with pytest.raises(DeviceError, match=r"broken.png: cannot be read as an image"):
        open_recording(tmp_path)
