"""A stereo pair: its calibration file, its depth, and two cameras that must see at one time."""

import asyncio
import threading
from math import radians
from pathlib import Path
from time import process_time, sleep

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from followerd.errors import ConfigError, LinkLost, OpenError
from followerd.geometry import Array
from followerd.hw.camera.grabber import Grabber, GrabberSource, Session
from followerd.hw.camera.protocol import Frame
from followerd.hw.camera.rectification import Matcher, Rectification, StereoGeometry
from followerd.hw.camera.settings import CameraMount
from followerd.hw.camera.sources import open_camera
from followerd.hw.camera.stereo import StereoPair, StereoSettings, StereoSource
from followerd.messages import Image, Measurement, Pixels

WIDTH, HEIGHT = 320, 240
K = np.array([[260.0, 0, 158.0], [0, 260.0, 122.0], [0, 0, 1]])
BENT = np.array([-0.1, 0.05, 0.0, 0.0, 0.0])
R = np.asarray(cv2.Rodrigues(np.radians([0.5, 1.0, -0.3]))[0], float)
T = np.array([[-0.12], [0.002], [0.001]])
GOOD = {"M1": K, "D1": BENT, "M2": K, "D2": BENT, "R": R, "T": T}


def write(path: Path, **changes: Array | None) -> str:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, matrix in (GOOD | changes).items():
        if matrix is not None:
            storage.write(name, matrix)
    storage.release()
    return str(path)


def textures() -> tuple[Pixels, Pixels]:
    """Of a wall and of a near board; their grains are two pixels wide in the image."""
    rng = np.random.default_rng(0)
    noise = [cv2.resize(rng.integers(0, 256, (300, 300), np.uint8), (900, 900)) for _ in "ab"]
    return np.asarray(noise[0], np.uint8), np.asarray(noise[1][:200, :300], np.uint8)


def seen(rotation: Array, place: Array, pinhole: Array = K, bent: Array = BENT) -> Pixels:
    """What a camera at x = rotation X + place sees: a board at 1.5 m before a wall at 4 m."""
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    wall, board = textures()
    for texture, z, scale, x, y in ((wall, 4.0, 0.01, -4.5, -4.5), (board, 1.5, 0.004, -0.6, -0.4)):
        corner = rotation @ np.array([x, y, z]) + place.ravel()
        plane = pinhole @ np.column_stack([rotation[:, 0] * scale, rotation[:, 1] * scale, corner])
        layer = cv2.warpPerspective(texture, plane, (WIDTH, HEIGHT), flags=cv2.INTER_AREA)
        mask = cv2.warpPerspective(np.full_like(texture, 255), plane, (WIDTH, HEIGHT))
        image[mask > 127] = layer[mask > 127]
    rays = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).astype(np.float32)
    undone = cv2.undistortPoints(rays.reshape(-1, 1, 2), pinhole, bent, P=pinhole)
    straight = np.asarray(undone, np.float32).reshape(HEIGHT, WIDTH, 2)
    return np.asarray(
        cv2.remap(image, straight[..., 0], straight[..., 1], cv2.INTER_LINEAR), np.uint8
    )


LEFT, RIGHT = seen(np.eye(3), np.zeros(3)), seen(R, T)


@pytest.fixture
def calibration(tmp_path: Path) -> str:
    return write(tmp_path / "stereo.yaml")


def settings(calibration: str, **more: object) -> StereoSettings:
    size = {"width": WIDTH, "height": HEIGHT, "rate_hz": 100}
    pair = {"right_link": "right", "stereo_calibration": calibration}
    return StereoSettings.model_validate(size | pair | more)


# depth


@pytest.mark.parametrize(("kind", "shrink"), [("sgbm", 1), ("sgbm", 2), ("bm", 1)])
def test_depth_of_a_board_before_a_wall(calibration: str, kind: str, shrink: int) -> None:
    straight = Rectification(StereoGeometry.read(Path(calibration)), (WIDTH, HEIGHT))
    assert straight.baseline == pytest.approx(0.12, rel=1e-3)
    left, right = straight.rectify(LEFT, RIGHT)
    depth = Matcher(kind, straight, 0.7, shrink).depth(left, right)
    assert depth.shape == (HEIGHT, WIDTH)
    assert depth.dtype == np.float32
    board, wall = depth[80:140, 90:140], depth[60:180, 240:300]
    assert np.isfinite(board).mean() > 0.9
    assert np.nanmedian(board) == pytest.approx(1.5, rel=0.03)
    assert np.isfinite(wall).mean() > 0.8
    assert np.nanmedian(wall) == pytest.approx(4.0, rel=0.08)


@pytest.mark.slow
def test_depth_at_640x480_takes_less_than_a_frame() -> None:
    size = (640, 480)
    double = np.diag([2.0, 2.0, 1.0])
    pair = StereoGeometry(double @ K, BENT, double @ K, BENT, R, T.ravel())
    straight = Rectification(pair, size)
    left, right = (np.asarray(cv2.resize(side, size), np.uint8) for side in (LEFT, RIGHT))
    matcher = Matcher("sgbm", straight, 0.7, 2)

    def cpu() -> float:
        began = process_time()
        matcher.depth(*straight.rectify(left, right))
        return process_time() - began

    assert min(cpu() for _ in range(5)) < 0.033


# calibration


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"M2": None}, "M2 is missing; M1 D1 M2 D2 R T are needed"),
        ({"T": T * 1000}, "are 120.* m apart; T must be in m"),
        ({"T": -T}, "are they swapped"),
        ({"R": R * 2}, "R is no rotation"),
        ({"R": np.eye(2)}, r"R is \(2, 2\), expected \(3, 3\)"),
        ({"D1": BENT * np.nan}, "D1 is not finite"),
    ],
)
def test_faults_of_a_stereo_calibration_are_named(
    tmp_path: Path, changes: dict[str, Array | None], problem: str
) -> None:
    path = write(tmp_path / "stereo.yaml", **changes)
    with pytest.raises(ConfigError, match=f"stereo.yaml: .*{problem}"):
        StereoGeometry.read(Path(path))
    with pytest.raises(ValidationError, match=problem):
        settings(path)


def test_what_is_no_stereo_calibration_is_refused(tmp_path: Path, calibration: str) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        StereoGeometry.read(tmp_path / "nothing.yaml")
    (tmp_path / "text.yaml").write_text("hello: [")
    with pytest.raises(ConfigError, match=r"text.yaml: (is not in OpenCV|M1 is missing)"):
        StereoGeometry.read(tmp_path / "text.yaml")
    with pytest.raises(ValidationError, match=r"centre \(158, 122\) is none of 640x480"):
        settings(calibration, width=640, height=480)


def test_the_camera_of_a_pair_is_the_rectified_left_one(calibration: str) -> None:
    camera = settings(calibration, mount=CameraMount(z_m=0.8, elevation_deg=-3)).camera
    straight = settings(calibration).rectification
    assert (camera.fx, camera.cx, camera.cy) == (straight.focal, *straight.centre)
    assert camera.z == 0.8
    assert camera.elevation == pytest.approx(radians(-3))


# two cameras


class Script:
    """A camera whose frames have given stamps; one comes every 2 ms."""

    def __init__(self, name: str, image: Pixels, stamps: list[float]) -> None:
        self.image = image
        self.stamps = stamps
        self.count = 0
        self.locked = False
        self.closed = False
        self.source = GrabberSource(name, lambda _: self)

    def grab(self) -> Frame:
        sleep(0.002)
        if self.count == len(self.stamps):
            raise LinkLost("camera", "the script is over", "write more")
        self.count += 1
        return Frame(self.count - 1, self.stamps[self.count - 1], self.image)

    def lock_exposure(self, locked: bool = True) -> None:
        self.locked = locked

    def close(self) -> None:
        self.closed = True


def grabber_of(calibration: str, left: Script, right: Script) -> Grabber:
    source = StereoSource(left.source, right.source, settings(calibration))
    return source.open_grabber(Session("camera", lambda: 0.0, threading.Event()))


def test_frames_are_paired_by_their_stamps(calibration: str) -> None:
    left = Script("left", LEFT, [n * 0.1 for n in range(400)])
    right = Script("right", RIGHT, [n * 0.1 + 0.004 for n in range(3, 403)])
    pair = grabber_of(calibration, left, right)
    frames = [pair.grab() for _ in range(3)]
    ids = [frame.id for frame in frames]
    assert ids == sorted(set(ids))
    for frame in frames:
        assert frame.stamp == left.stamps[frame.id]
        assert frame.depth is not None
        assert np.nanmedian(frame.depth[80:140, 90:140]) == pytest.approx(1.5, rel=0.03)
    pair.lock_exposure()
    pair.close()
    assert (left.locked, right.locked) == (True, True)
    assert (left.closed, right.closed) == (True, True)


def test_cameras_that_never_see_at_one_time_are_told_apart(calibration: str) -> None:
    left = Script("left", LEFT, [n * 0.1 for n in range(900)])
    right = Script("right", RIGHT, [n * 0.1 + 0.05 for n in range(900)])
    pair = grabber_of(calibration, left, right)
    with pytest.raises(LinkLost, match="never within 10 ms of each other; trigger them together"):
        pair.grab()
    pair.close()


def test_one_camera_gone_is_the_pair_gone(calibration: str) -> None:
    left = Script("left", LEFT, [n * 0.1 for n in range(900)])
    pair = grabber_of(calibration, left, Script("right", RIGHT, []))
    with pytest.raises(LinkLost, match="camera: the script is over; write more"):
        pair.grab()
    pair.close()


async def test_two_folders_are_a_stereo_pair(tmp_path: Path, calibration: str) -> None:
    for name, view in (("left", LEFT), ("right", RIGHT)):
        (tmp_path / name).mkdir()
        cv2.imwrite(str(tmp_path / name / "0.png"), view)
    right = str(tmp_path / "right")
    # the two folders start to play one after the other
    chosen = settings(calibration, right_link=right, rate_hz=20, max_skew_s=0.03)
    driver = StereoPair(chosen, open_camera(str(tmp_path / "left"), chosen))
    images: list[Measurement] = []
    enough = asyncio.Event()

    def sink(image: Measurement) -> None:
        images.append(image)
        enough.set()

    running = asyncio.create_task(driver.run(sink))
    async with asyncio.timeout(10):
        await enough.wait()
    running.cancel()
    image = images[0]
    assert isinstance(image, Image)
    assert image.camera == chosen.camera
    assert image.pixels.shape == (HEIGHT, WIDTH, 3)
    assert image.depth is not None


async def test_a_pair_whose_right_camera_is_missing_is_not_open(
    tmp_path: Path, calibration: str
) -> None:
    (tmp_path / "left").mkdir()
    cv2.imwrite(str(tmp_path / "left" / "0.png"), LEFT)
    chosen = settings(calibration, right_link=str(tmp_path / "right.avi"))
    with pytest.raises(OpenError, match=r"right.avi does not exist"):
        await open_camera(str(tmp_path / "left"), chosen).open("camera")
