"""Recordings as cameras, thermal images, and straight images by a calibration file."""

import asyncio
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydantic import ValidationError
from structlog.testing import capture_logs

from followerd import clock, config
from followerd.errors import ConfigError, LinkLost, OpenError
from followerd.hw.camera.calibration import Calibration, Lens
from followerd.hw.camera.driver import CameraDriver
from followerd.hw.camera.files import open_recording
from followerd.hw.camera.grabber import Grabber, GrabberSource, Session
from followerd.hw.camera.playback import is_recording, playback
from followerd.hw.camera.protocol import Frame
from followerd.hw.camera.settings import CameraSettings
from followerd.hw.camera.sources import open_camera
from followerd.hw.camera.thermal import ThermalCamera, ThermalSettings
from followerd.hw.camera.tone import GainWatch, Tone
from followerd.messages import Image, Measurement, Pixels
from tests.test_camera import write_video

THERMAL = Path(__file__).parents[2] / "shared/data/thermal/ltir_birds/img"


class Pace(threading.Event):
    """Time that passes only by waiting."""

    now = 7.0

    def wait(self, timeout: float | None = None) -> bool:
        self.now += timeout or 0.0
        return False


def player(source: GrabberSource, pace: Pace) -> Grabber:
    return source.open_grabber(Session("camera", lambda: pace.now, pace))


def folder_of(path: Path, levels: list[int]) -> Path:
    path.mkdir()
    for n, level in enumerate(levels):
        cv2.imwrite(str(path / f"{n}.png"), np.full((48, 64, 3), level, np.uint8))
    return path


# files as cameras


def test_a_folder_plays_at_the_configured_rate_again_and_again(tmp_path: Path) -> None:
    pace = Pace()
    camera = player(playback(str(folder_of(tmp_path / "walk", [5, 6])), 10.0, True, None), pace)
    frames = [camera.grab() for _ in range(5)]
    assert [frame.id for frame in frames] == [0, 1, 2, 3, 4]
    assert [int(frame.pixels[0, 0, 0]) for frame in frames] == [5, 6, 5, 6, 5]
    assert [frame.stamp for frame in frames] == pytest.approx([7.0, 7.1, 7.2, 7.3, 7.4])
    assert pace.now == pytest.approx(7.4)


def test_frames_whose_time_has_passed_are_left_out(tmp_path: Path) -> None:
    pace = Pace()
    camera = player(playback(str(folder_of(tmp_path / "walk", [5, 6, 7, 8])), 10, True, None), pace)
    camera.grab()
    pace.now += 0.25
    frame = camera.grab()
    assert (frame.id, frame.pixels[0, 0, 0]) == (2, 7)
    assert frame.stamp == pytest.approx(7.2)


def test_a_video_plays_at_its_own_rate_and_ends_if_it_must(tmp_path: Path) -> None:
    write_video(tmp_path / "walk.avi", 3)
    pace = Pace()
    camera = player(playback(str(tmp_path / "walk.avi"), 30.0, False, None), pace)
    stamps = [camera.grab().stamp for _ in range(3)]
    assert stamps == pytest.approx([7.0, 7.1, 7.2])
    with pytest.raises(LinkLost, match=r"camera: .*walk.avi has ended; say loop: true"):
        camera.grab()


async def test_a_recording_is_a_camera_like_any_other(tmp_path: Path) -> None:
    settings = CameraSettings(width=64, height=48, rate_hz=100)
    source = open_camera(str(folder_of(tmp_path / "walk", [5, 6])), settings)
    for _ in range(2):  # opened anew, it is free again
        stream = await source.open("camera")
        frames = [await stream.read() for _ in range(3)]
        assert frames[0].id < frames[1].id < frames[2].id
        assert 0 <= clock.now() - frames[2].stamp < 1
        stream.close()
        with pytest.raises(LinkLost, match="closed"):
            await stream.read()


async def test_recordings_that_cannot_be_played_name_the_file_and_the_remedy(
    tmp_path: Path,
) -> None:
    settings = CameraSettings(width=64, height=48, rate_hz=100)
    with pytest.raises(OpenError, match=r"camera: .*walk.mp4 does not exist: give a folder"):
        await open_camera(str(tmp_path / "walk.mp4"), settings).open("camera")
    (tmp_path / "walk.avi").write_bytes(b"no video" * 100)
    with pytest.raises(OpenError, match=r"camera: .*walk.avi cannot be opened as a video; conv"):
        await open_camera(str(tmp_path / "walk.avi"), settings).open("camera")
    folder = folder_of(tmp_path / "walk", [5, 6, 7])
    (folder / "1.png").write_bytes(b"no image")
    camera = CameraDriver(settings, open_camera(str(folder), settings))
    with pytest.raises(LinkLost, match=r"camera: .*1.png: cannot be read as an image; is the"):
        await camera.run(lambda _: None)


def test_folders_and_videos_are_told_from_devices(tmp_path: Path) -> None:
    assert is_recording(str(tmp_path))
    assert is_recording("walk.MP4")
    assert not is_recording("/dev/video0")
    assert not is_recording("ring:links/camera")


def test_a_kinects_link_needs_its_kind() -> None:
    with pytest.raises(ConfigError, match="kinect:0 needs kind: kinect"):
        open_camera("kinect:0", CameraSettings())


class Broken:
    """A camera with a bug."""

    released = False

    def grab(self) -> Frame:
        raise ZeroDivisionError("division by zero")

    def lock_exposure(self, locked: bool = True) -> None:
        """Nothing to lock."""

    def close(self) -> None:
        self.released = True


async def test_whatever_ends_a_cameras_thread_its_reader_learns_of_it() -> None:
    broken = Broken()
    stream = await GrabberSource("broken", lambda _: broken).open("camera")
    with pytest.raises(LinkLost, match="camera: broken: division by zero"):
        await stream.read()
    stream.join()
    assert broken.released


def test_a_camera_that_nobody_closed_does_not_outlive_the_loop(tmp_path: Path) -> None:
    settings = CameraSettings(width=64, height=48, rate_hz=200)
    source = open_camera(str(folder_of(tmp_path / "walk", [5, 6])), settings)
    assert isinstance(source, GrabberSource)
    stream = clock.run(source.open("camera"))
    stream.join()


async def test_a_camera_whose_opening_is_given_up_is_released() -> None:
    broken, begun, go = Broken(), threading.Event(), threading.Event()

    def slowly(_: Session) -> Grabber:
        begun.set()
        go.wait(5)
        return broken

    opening = asyncio.create_task(GrabberSource("slow", slowly).open("camera"))
    await asyncio.to_thread(begun.wait)
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening
    go.set()
    async with asyncio.timeout(5):
        while not broken.released:
            await clock.sleep(0.001)


# thermal


def test_sixteen_bit_greys_are_mapped_linearly_between_the_levels() -> None:
    raw = np.array([[0, 1000, 1500, 2000, 65535]], np.uint16)
    assert Tone((1000, 2000))(raw).tolist() == [[0, 0, 128, 255, 255]]
    assert np.array_equal(Tone()(np.array([[3, 200]], np.uint8)), [[3, 200]])


def test_without_levels_the_first_frame_sets_them_for_good() -> None:
    rng = np.random.default_rng(0)
    tone = Tone()
    first = tone(rng.integers(20_000, 21_000, (48, 64)).astype(np.uint16))
    assert first.min() > 40
    assert first.max() < 215
    body = np.full((48, 64), 21_200, np.uint16)
    grey = tone(body)[0, 0]
    assert 200 < grey < 255
    tone(np.full((48, 64), 30_000, np.uint16))
    assert tone(body)[0, 0] == grey


def test_a_folder_of_sixteen_bit_images_is_read_as_grey(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), np.full((48, 64), 1500, np.uint16))
    cv2.imwrite(str(tmp_path / "1.png"), np.full((48, 64, 3), 77, np.uint8))
    frames = list(open_recording(tmp_path, Tone((1000, 2000))))
    assert [frame.pixels.shape for frame in frames] == [(48, 64), (48, 64)]
    assert [int(frame.pixels[0, 0]) for frame in frames] == [128, 77]


def test_levels_must_rise() -> None:
    with pytest.raises(ValidationError, match="black must lie below white"):
        ThermalSettings(levels_counts=(2000, 1000))


def scene(seed: int = 0) -> Pixels:
    """A thermal view: ground, sky, noise."""
    rng = np.random.default_rng(seed)
    rows = np.linspace(60, 150, 240)[:, None] + rng.normal(0, 2, (240, 320))
    return np.clip(rows, 0, 255).astype(np.uint8)


def with_person(image: Pixels, column: int, width: int = 90) -> Pixels:
    image = image.copy()
    image[40:230, column : column + width] = 230
    return image


def test_a_gain_jump_is_told_from_a_person_who_walks_in() -> None:
    watch = GainWatch()
    assert watch.jumped(scene(0)) == 0.0
    assert watch.jumped(scene(1)) == 0.0
    assert watch.jumped(with_person(scene(2), 100)) == 0.0
    assert watch.jumped(scene(3)) == 0.0
    assert watch.jumped(np.roll(with_person(scene(3), 100), 6, 1)) == 0.0
    assert watch.jumped(scene(3)) == 0.0
    brighter = np.clip(scene(4).astype(int) + 20, 0, 255).astype(np.uint8)
    assert watch.jumped(brighter) == pytest.approx(20, abs=3)
    assert watch.jumped(brighter) == 0.0
    contrast = np.clip((brighter.astype(float) - 125) * 1.6 + 125, 0, 255).astype(np.uint8)
    assert watch.jumped(contrast) > 8
    turned = np.random.default_rng(1).integers(0, 255, (24, 40)).astype(np.uint8).repeat(10, 1)
    wide = np.asarray(turned.repeat(10, 0), np.uint8)
    watch.jumped(wide[:, :320])
    assert watch.jumped(wide[:, 10:330]) == 0.0


async def test_a_thermal_camera_gives_grey_images_and_reports_gain_jumps(tmp_path: Path) -> None:
    folder = tmp_path / "heat"
    folder.mkdir()
    for n in range(4):
        image = np.tile(np.arange(64, dtype=np.uint8), (48, 1)) + (60 if n > 1 else 0)
        cv2.imwrite(str(folder / f"{n}.png"), cv2.merge([image.astype(np.uint8)] * 3))
    settings = ThermalSettings(width=64, height=48, rate_hz=100, loop=False)
    camera = ThermalCamera(settings, open_camera(str(folder), settings))
    images: list[Measurement] = []
    with capture_logs() as logs, pytest.raises(LinkLost, match="has ended"):
        await camera.run(images.append)
    assert all(isinstance(image, Image) and image.pixels.shape == (48, 64) for image in images)
    assert camera.gain_changes == 1
    assert [(line["event"], line["device"]) for line in logs] == [("gain changed", "camera")]


@pytest.mark.skipif(not THERMAL.is_dir(), reason="the thermal recording is not there")
@pytest.mark.slow
def test_in_a_real_thermal_recording_just_the_jumps_put_in_are_reported() -> None:
    watch, jumps = GainWatch(), []
    for frame in open_recording(THERMAL, Tone()):
        grey = frame.pixels.astype(float)
        if frame.id >= 150:
            grey = 1.15 * (grey - 100) + 110
        if watch.jumped(np.clip(grey, 0, 255).astype(np.uint8)):
            jumps.append(frame.id)
    assert jumps == [150]


# calibration files

GOOD = """\
width: 64
height: 48
fx: 60.5
fy: 61
cx: 30
cy: 25
distortion: [-0.3, 0.1, 0, 0, 0]
"""

CONFIG = """\
base: {kind: p2os, link: sim}
laser: {kind: lms200, link: sim, baud: 38400, resolution_deg: 1}
camera:
  kind: camera
  link: sim
  width: 64
  height: 48
  calibration: lens.yaml
tracker: {kind: hpf}
controller: {kind: image_centering}
"""


def load_config(folder: Path, lens: str) -> CameraSettings:
    (folder / "lens.yaml").write_text(lens)
    (folder / "robot.yaml").write_text(CONFIG)
    camera: object = config.load(folder / "robot.yaml").camera
    assert isinstance(camera, CameraSettings)
    return camera


def test_a_config_takes_the_pinhole_from_a_calibration_file_beside_it(tmp_path: Path) -> None:
    settings = load_config(tmp_path, GOOD)
    camera = settings.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (60.5, 61, 30, 25)
    assert camera.z == settings.mount.z_m
    again = CameraSettings.model_validate(settings.model_dump(exclude={"kind", "link"}))
    assert again.calibration == settings.calibration


@pytest.mark.parametrize(
    ("lens", "problem"),
    [
        (
            GOOD.replace("fx: 60.5\n", ""),
            r"robot.yaml:8:3: camera.calibration: .*lens.yaml:1:1: fx",
        ),
        (GOOD.replace("60.5", "-2"), r"lens.yaml:3:1: fx: .*greater than 0.*got -2"),
        (GOOD.replace("0, 0, 0]", "0]"), r"lens.yaml:7:1: distortion.*is required"),
        (GOOD.replace("cx", "cX"), r"lens.yaml:5:1: cX: unknown key"),
        (GOOD.replace("width: 64", "width: 640"), r"robot.yaml:.*is of 640x48 images.*calibrate"),
    ],
)
def test_faults_of_a_calibration_file_are_named_with_their_place(
    tmp_path: Path, lens: str, problem: str
) -> None:
    with pytest.raises(ConfigError, match=problem):
        load_config(tmp_path, lens)


def test_a_fault_of_a_whole_camera_section_is_placed_at_the_section(tmp_path: Path) -> None:
    kinect = CONFIG.replace("kind: camera", "kind: kinect").replace(
        "  calibration: lens.yaml\n", ""
    )
    wrong = kinect.replace("  width: 64\n  height: 48\n", "  mount: {elevation_deg: 40}\n")
    (tmp_path / "robot.yaml").write_text(wrong)
    with pytest.raises(ConfigError, match=r"robot.yaml:3:1: camera: the tilt motor reaches 27"):
        config.load(tmp_path / "robot.yaml")


def test_a_calibration_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(CONFIG)
    with pytest.raises(ConfigError, match=r"robot.yaml:8:3: camera.calibration: .*no such file"):
        config.load(tmp_path / "robot.yaml")


CALIBRATION = Calibration(
    width=320, height=240, fx=300, fy=300, cx=160, cy=120, distortion=(-0.3, 0.1, 0, 0, 0)
)


def bent(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Pixels:
    """Dots of a pinhole's points (N, 2), as the lens shows them."""
    rays = np.column_stack([(points - (160, 120)) / 300, np.ones(len(points))])
    none = np.zeros(3)
    seen, _ = cv2.projectPoints(
        rays, none, none, CALIBRATION.intrinsics, np.array(CALIBRATION.distortion)
    )
    image = np.zeros((240, 320), np.uint8)
    for x, y in np.asarray(seen).reshape(-1, 2):
        cv2.circle(image, (round(x * 16), round(y * 16)), 3 * 16, 255, -1, cv2.LINE_AA, 4)
    return image


def test_a_lens_is_made_straight() -> None:
    points = np.array([(40.0, 30.0), (160.0, 120.0), (280.0, 60.0), (60.0, 200.0)])
    image = bent(points)
    straight = Lens(CALIBRATION).straight(image)
    _, _, _, bent_centres = cv2.connectedComponentsWithStats((image > 128).astype(np.uint8))
    _, _, _, centres = cv2.connectedComponentsWithStats((straight > 128).astype(np.uint8))
    found = sorted(centres[1:].tolist())
    assert np.abs(np.array(found) - np.array(sorted(points.tolist()))).max() < 0.7
    assert np.abs(np.array(sorted(bent_centres[1:].tolist())) - found).max() > 5


def test_depth_is_straightened_without_blending() -> None:
    depth = np.full((240, 320), 1.0, np.float32)
    depth[:, 200:] = 4.0
    frame = Lens(CALIBRATION)(Frame(0, 0.0, np.zeros((240, 320, 3), np.uint8), depth))
    assert frame.depth is not None
    assert set(np.unique(frame.depth[np.isfinite(frame.depth)])) == {1.0, 4.0}


async def test_a_calibrated_camera_sends_straight_images(tmp_path: Path) -> None:
    points = np.array([(40.0, 30.0)])
    folder = tmp_path / "walk"
    folder.mkdir()
    cv2.imwrite(str(folder / "0.png"), cv2.merge([bent(points)] * 3))
    settings = CameraSettings(width=320, height=240, rate_hz=100, calibration=CALIBRATION)
    stream = await open_camera(str(folder), settings).open("camera")
    pixels = (await stream.read()).pixels
    stream.close()
    rows, columns = np.nonzero(pixels[..., 0] > 128)
    assert (columns.mean(), rows.mean()) == pytest.approx((40, 30), abs=0.7)
