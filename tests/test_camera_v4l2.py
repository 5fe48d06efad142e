"""V4L2 against answers of a kernel, byte for byte; a live camera was not at hand."""

import asyncio
import errno
import os
import threading
from itertools import count
from pathlib import Path

import cv2
import numpy as np
import pytest

from followerd import clock
from followerd.errors import LinkLost, OpenError, SetupError
from followerd.hw.camera.driver import CameraDriver
from followerd.hw.camera.grabber import Grabber, Session
from followerd.hw.camera.kernel import Kernel
from followerd.hw.camera.pixels import top_field
from followerd.hw.camera.settings import CameraSettings, VideoInput
from followerd.hw.camera.sources import open_camera
from followerd.hw.camera.tone import Tone
from followerd.hw.camera.v4l2 import V4l2Source
from followerd.messages import Image, Measurement, Pixels
from tests.test_daemon import Story, tell
from tests.video_kernel import DAMAGED, MONOTONIC, START_OF_EXPOSURE, Shot, VideoKernel

WIDTH, HEIGHT = 64, 48
S_FMT, REQBUFS, S_PARM, QUERYCAP = 0xC0D05605, 0xC0145608, 0xC0CC5616, 0x80685600
EXPOSURE_AUTO, EXPOSURE, GAIN = 0x009A0901, 0x009A0902, 0x00980913
AUTO_WHITE, WHITE, CONSTANT_RATE = 0x0098090C, 0x0098091A, 0x009A0903
NOW = 50.0


def source(kernel: VideoKernel, video: VideoInput | None = None, grey: bool = False) -> V4l2Source:
    settings = CameraSettings(width=WIDTH, height=HEIGHT, rate_hz=25, video=video or VideoInput())
    return V4l2Source("/dev/video0", settings, Tone((0, 65535)), grey, kernel)


def session() -> Session:
    return Session("camera", lambda: NOW, threading.Event())


def opened(kernel: VideoKernel, video: VideoInput | None = None, grey: bool = False) -> Grabber:
    return source(kernel, video, grey).open_grabber(session())


def jpeg(level: int) -> bytes:
    good, data = cv2.imencode(".jpg", np.full((HEIGHT, WIDTH, 3), level, np.uint8))
    assert good
    return data.tobytes()


def shot(level: int, sequence: int, stamp: float = NOW - 0.03) -> Shot:
    return Shot(jpeg(level), sequence, stamp)


# negotiation


def test_a_webcam_is_asked_for_what_the_config_says_and_starts() -> None:
    kernel = VideoKernel()
    opened(kernel).close()
    assert kernel.log == ["format MJPG field 0", "rate 25", "buffers 4", "on", "off", "closed"]
    assert kernel.queued == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("formats", "video", "grey", "chosen"),
    [
        (("YUYV", "MJPG"), VideoInput(), False, "MJPG"),
        (("YUYV", "MJPG"), VideoInput(pixel_format="YUYV"), False, "YUYV"),
        (("UYVY", "H264"), VideoInput(), False, "UYVY"),
        (("GREY", "Y16"), VideoInput(), True, "Y16 "),
        (("YUYV", "GREY"), VideoInput(), True, "GREY"),
    ],
)
def test_the_best_format_is_chosen(
    formats: tuple[str, ...], video: VideoInput, grey: bool, chosen: str
) -> None:
    kernel = VideoKernel(formats=formats)
    opened(kernel, video, grey)
    assert kernel.chosen_format == chosen


@pytest.mark.parametrize(
    ("kernel", "video", "problem"),
    [
        (VideoKernel(device_caps=0x0420_0000), VideoInput(), "HD Webcam.*no video; a camera has"),
        (VideoKernel(formats=("H264",)), VideoInput(), "offers H264; needed is MJPG or YUYV"),
        (VideoKernel(), VideoInput(pixel_format="GREY"), "offers MJPG, YUYV; needed is GREY"),
        (VideoKernel(size=(640, 480)), VideoInput(), "no 64x48; it offers 640x480 instead"),
        (VideoKernel(field_order=7), VideoInput(), "sends single fields"),
        (VideoKernel(), VideoInput(input="S-Video"), "no input 'S-Video'; it has: Camera 1"),
        (VideoKernel(), VideoInput(standard="PAL"), "refuses PAL; only analogue grabbers"),
        (VideoKernel(refuse={S_FMT: errno.EBUSY}), VideoInput(), "used by another program"),
        (VideoKernel(refuse={QUERYCAP: errno.ENOTTY}), VideoInput(), "is no video device"),
        (VideoKernel(refuse={REQBUFS: errno.EIO}), VideoInput(), "fails: .*; unplug it"),
    ],
)
def test_a_device_that_cannot_do_it_says_why(
    kernel: VideoKernel, video: VideoInput, problem: str
) -> None:
    with pytest.raises((OpenError, SetupError), match=f"camera: .*{problem}"):
        opened(kernel, video)
    assert kernel.log[-1] == "closed"


def test_a_grabber_gets_its_input_and_its_standard() -> None:
    kernel = VideoKernel(
        formats=("YUYV",),
        inputs=("Composite1", "S-Video"),
        standards=True,
        field_order=4,
        refuse={S_PARM: errno.ENOTTY},
    )
    opened(kernel, VideoInput(input="s-video", standard="PAL"))
    expected = ["input 1", "standard ff", "format YUYV field 4", "buffers 4", "on"]
    assert kernel.log == expected


# frames


def test_the_newest_frame_wins_and_the_kernels_numbers_tell_what_was_lost() -> None:
    kernel = VideoKernel()
    device = opened(kernel)
    kernel.shots = [shot(10, 7), shot(20, 8), shot(30, 9)]
    first = device.grab()
    assert (first.id, round(first.pixels.mean())) == (0, 30)
    assert first.jpeg == jpeg(30)  # to be recorded as it came
    assert sorted(kernel.queued) == [0, 1, 2, 3]  # every buffer went back
    kernel.shots = [shot(40, 14)]
    assert device.grab().id == 5


def test_a_driver_that_does_not_count_is_counted_for() -> None:
    kernel = VideoKernel()
    device = opened(kernel)
    ids = []
    for _ in range(3):
        kernel.shots = [shot(10, 0)]
        ids.append(device.grab().id)
    assert ids == [0, 1, 2]


@pytest.mark.parametrize(
    ("stamp", "flags", "expected"),
    [
        (NOW - 0.06, MONOTONIC | START_OF_EXPOSURE, NOW - 0.06),
        (NOW - 0.01, MONOTONIC, NOW - 0.03),  # end of frame: less half a period
        (1.7e9, 0, NOW - 0.02),  # wall time
        (NOW - 5.0, MONOTONIC, NOW - 0.02),  # of another age
        (NOW + 1.0, MONOTONIC, NOW - 0.02),
    ],
)
def test_stamps_are_the_kernels_where_it_has_our_clock(
    stamp: float, flags: int, expected: float
) -> None:
    kernel = VideoKernel()
    device = opened(kernel)
    kernel.shots = [Shot(jpeg(10), 0, stamp, flags)]
    assert device.grab().stamp == pytest.approx(expected, abs=1e-6)


def test_damaged_frames_are_left_out() -> None:
    kernel = VideoKernel(one_by_one=True)
    device = opened(kernel)
    kernel.shots = [
        Shot(jpeg(10), 0, NOW, MONOTONIC | DAMAGED),
        Shot(b"", 1, NOW),
        Shot(b"no jpeg at all", 2, NOW),
        shot(50, 3),
    ]
    frame = device.grab()
    assert (frame.id, round(frame.pixels.mean())) == (3, 50)


def test_a_silent_camera_and_a_pulled_one_are_lost() -> None:
    kernel = VideoKernel()
    device = opened(kernel)
    with pytest.raises(LinkLost, match="/dev/video0 sends no frames; check the plug"):
        device.grab()
    kernel.gone = True
    with pytest.raises(LinkLost, match="/dev/video0 is gone: No such device; check the plug"):
        device.grab()
    device.close()
    assert kernel.log[-1] == "closed"


def yuyv(image: Pixels) -> bytes:
    """Grey as YUYV."""
    packed = np.full((*image.shape, 2), 128, np.uint8)
    packed[..., 0] = image
    return packed.tobytes()


RAMP = np.tile(np.arange(16, 16 + 3 * WIDTH, 3, dtype=np.uint8), (HEIGHT, 1))


def test_packed_colour_grey_and_sixteen_bits_are_decoded() -> None:
    kernel = VideoKernel(formats=("YUYV",))
    device = opened(kernel)
    kernel.shots = [Shot(yuyv(RAMP), 0, NOW)]
    pixels = device.grab().pixels
    assert pixels.shape == (HEIGHT, WIDTH, 3)
    assert np.abs(pixels[..., 1] - 1.164 * (RAMP - 16.0)).max() <= 2
    kernel = VideoKernel(formats=("Y16",))
    device = opened(kernel)
    kernel.shots = [Shot((RAMP.astype("<u2") * 257).tobytes(), 0, NOW)]
    assert np.array_equal(device.grab().pixels, RAMP)


def test_rows_with_padding_are_cut_and_short_buffers_refused() -> None:
    kernel = VideoKernel(formats=("GREY",), stride=WIDTH + 32)
    device = opened(kernel)
    padded = np.pad(RAMP, ((0, 0), (0, 32)), constant_values=255)
    kernel.shots = [Shot(padded.tobytes(), 0, NOW)]
    assert np.array_equal(device.grab().pixels, RAMP)
    kernel.shots = [Shot(padded.tobytes()[:-1], 1, NOW)]
    with pytest.raises(LinkLost, match="sends no frames"):
        device.grab()


def test_an_interlaced_image_is_made_of_one_field() -> None:
    moving = np.zeros((HEIGHT, WIDTH), np.uint8)
    moving[0::2, 10:20] = 200  # the upper field
    moving[1::2, 15:25] = 200  # the lower, 20 ms later: a comb
    kernel = VideoKernel(formats=("GREY",), field_order=4, standards=True)
    device = opened(kernel, VideoInput(standard="NTSC"))
    kernel.shots = [Shot(moving.tobytes(), 0, NOW)]
    pixels = device.grab().pixels
    assert np.array_equal(pixels, np.tile(moving[0], (HEIGHT, 1)))


def test_lines_between_those_of_a_field_are_averaged() -> None:
    image = np.zeros((5, 1, 3), np.uint8)
    image[0::2] = np.array([10, 30, 50], np.uint8)[:, None, None]
    assert top_field(image)[:, 0, 0].tolist() == [10, 20, 30, 40, 50]


# exposure


def with_controls() -> VideoKernel:
    return VideoKernel(
        controls={
            EXPOSURE_AUTO: [1, 3],
            EXPOSURE: [157, 250],
            GAIN: [12, 0],
            AUTO_WHITE: [0, 1],
            WHITE: [4600, 4600],
            CONSTANT_RATE: [1, 0],
        }
    )


def test_a_camera_starts_automatic_at_a_constant_rate() -> None:
    kernel = with_controls()
    opened(kernel)
    expected = {(EXPOSURE_AUTO, 3), (AUTO_WHITE, 1), (CONSTANT_RATE, 0)}
    assert set(kernel.set_controls) == expected


def test_locked_it_keeps_the_values_it_found_and_does_so_again_when_replugged() -> None:
    kernel = with_controls()
    camera = source(kernel)
    device = camera.open_grabber(session())
    device.lock_exposure()
    kernel.controls[EXPOSURE][0], kernel.controls[WHITE][0] = 300, 5200
    kernel.set_controls.clear()
    kernel.shots = [shot(10, 0), shot(10, 1)]
    device.grab()
    held = [(EXPOSURE_AUTO, 1), (EXPOSURE, 300), (AUTO_WHITE, 0), (WHITE, 5200)]
    assert kernel.set_controls == held
    kernel.set_controls.clear()
    camera.open_grabber(session())
    assert kernel.set_controls == held
    kernel.set_controls.clear()
    device.lock_exposure(False)
    kernel.shots = [shot(10, 2)]
    device.grab()
    assert (EXPOSURE_AUTO, 3) in kernel.set_controls


def test_a_camera_that_is_set_by_hand_is_never_touched() -> None:
    kernel = with_controls()
    device = opened(kernel, VideoInput(exposure="as_found"))
    device.lock_exposure()
    kernel.shots = [shot(10, 0)]
    device.grab()
    assert kernel.set_controls == []


async def test_the_driver_passes_the_lock_on_and_remembers_it() -> None:
    kernel = with_controls()
    kernel.patience = 1.0
    driver = CameraDriver(CameraSettings(width=WIDTH, height=HEIGHT), source(kernel))
    driver.lock_exposure()
    images: list[Measurement] = []
    running = asyncio.create_task(driver.run(images.append))
    async with asyncio.timeout(5):
        for n in count():
            kernel.shots.append(shot(10, n))
            await clock.sleep(0.005)
            if images and kernel.controls[EXPOSURE_AUTO][0] == 1:
                break
    kernel.gone = True
    with pytest.raises(LinkLost, match="is gone"):
        await running


@pytest.mark.slow
def test_exposure_is_locked_from_enrolment_on_and_free_while_disarmed() -> None:
    locked: list[bool] = []

    async def script(story: Story) -> None:
        camera = next(each for each in story.daemon.sensors if isinstance(each, CameraDriver))
        locked.append(camera.exposure_locked)
        await story.enrol_and_arm()
        locked.append(camera.exposure_locked)
        await story.ask("disarm")
        locked.append(camera.exposure_locked)
        await story.ask("arm")
        locked.append(camera.exposure_locked)

    tell(script)
    assert locked == [False, True, False, True]


async def test_a_grey_camera_is_made_colour_for_trackers_that_expect_it() -> None:
    shots = [Shot(RAMP.tobytes(), 0, NOW)]
    kernel = VideoKernel(formats=("GREY",), shots=shots, patience=0.1)
    driver = CameraDriver(CameraSettings(width=WIDTH, height=HEIGHT), source(kernel))
    images: list[Measurement] = []
    with pytest.raises(LinkLost, match="sends no frames"):
        await driver.run(images.append)
    assert isinstance(images[0], Image)
    assert np.array_equal(images[0].pixels, np.dstack([RAMP] * 3))


# the running kernel


def test_buffers_are_mapped_and_waited_for(tmp_path: Path) -> None:
    kernel = Kernel()
    path = tmp_path / "buffers"
    path.write_bytes(bytes(4096) + b"frame" + bytes(4091))
    fd = kernel.open(str(path))
    assert bytes(kernel.map(fd, 4096, 4096)[:5]) == b"frame"
    kernel.close(fd)
    there, here = os.pipe()
    assert not kernel.wait(there, 0.001)
    os.write(here, b"x")
    assert kernel.wait(there, 1.0)
    os.close(here)
    kernel.close(there)


def test_a_camera_that_may_not_be_opened_says_so() -> None:
    settings = CameraSettings(width=WIDTH, height=HEIGHT)
    camera = V4l2Source("/dev/video9", settings, Tone(), False, VideoKernel())
    with pytest.raises(
        OpenError, match=r"cannot be opened: Permission denied; close .* group video"
    ):
        camera.open_grabber(session())


async def test_a_camera_that_is_not_there_says_so(tmp_path: Path) -> None:
    settings = CameraSettings(width=WIDTH, height=HEIGHT)
    with pytest.raises(OpenError, match=r"/dev/video77 does not exist; (there are|no camera)"):
        await open_camera("/dev/video77", settings).open("camera")
    (tmp_path / "video0").write_bytes(b"")
    with pytest.raises(OpenError, match="video0 is no video device; choose another link"):
        await open_camera(str(tmp_path / "video0"), settings).open("camera")
    (tmp_path / "video1").mkdir()
    with pytest.raises(OpenError, match="holds no images"):
        await open_camera(str(tmp_path / "video1"), settings).open("camera")
