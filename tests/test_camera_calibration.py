"""`followerd calibrate camera`: what it finds of a camera that is known, and what it refuses."""

import threading
from itertools import count
from pathlib import Path

import cv2
import numpy as np
import pytest

from followerd.__main__ import call
from followerd.errors import UsageError
from followerd.geometry import Array
from followerd.hw.camera.calibration import Calibration
from followerd.hw.camera.chessboard import Board, find
from followerd.hw.camera.protocol import Frame, RingLayout
from followerd.messages import Pixels
from followerd.settings import load
from followerd.sim.serve import RingPort

SIZE = WIDTH, HEIGHT = 320, 240
K = np.array([[280.0, 0, 165.0], [0, 282.0, 116.0], [0, 0, 1]])
BENT = np.array([-0.25, 0.08, 0.001, -0.0005, 0.0])
SQUARE, CELL = 0.03, 24  # m, px of the drawn board
POSES = [  # turned about x, y, z (degrees), place of the board's middle (m)
    (30, 0, 0, 0.0, 0.0, 0.45), (-30, 5, 10, 0.05, 0.03, 0.5), (5, 35, -5, -0.06, 0.0, 0.5),
    (0, -35, 5, 0.06, -0.04, 0.5), (25, 25, 20, -0.05, 0.04, 0.55), (-25, 25, 0, 0.0, -0.05, 0.6),
    (20, -25, -20, 0.05, 0.05, 0.55), (-20, -30, 40, -0.03, -0.02, 0.5),
]  # fmt: skip


FINE = 2  # a pixel is the mean of FINE x FINE
FINE_K = np.diag([FINE, FINE, 1.0]) @ K + np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])


def rays() -> Array:
    """Where a pinhole would see what the lens shows at each fine pixel (H, W, 2)."""
    bent = np.indices((HEIGHT * FINE, WIDTH * FINE))[::-1].reshape(2, -1).T.astype(np.float64)
    straight = cv2.undistortPoints(bent.reshape(-1, 1, 2), FINE_K, BENT, P=FINE_K)
    return np.asarray(straight, np.float32).reshape(HEIGHT * FINE, WIDTH * FINE, 2)


RAYS = rays()


def drawn(columns: int, rows: int) -> Pixels:
    """A board of so many inner corners with a white edge, CELL px a square."""
    squares = np.indices((rows + 3, columns + 3)).sum(0) % 2
    squares[[0, -1]], squares[:, [0, -1]] = 1, 1
    return np.asarray(60 + 160 * np.kron(squares, np.ones((CELL, CELL))), np.uint8)


def view(pose: tuple[float, ...], columns: int = 7, rows: int = 5) -> Pixels:
    """What the camera sees of a board, blurred by its pixels, with noise."""
    board = drawn(columns, rows)
    turn = np.asarray(cv2.Rodrigues(np.radians(pose[:3]))[0], float)
    metres = SQUARE / CELL
    middle = np.array([board.shape[1], board.shape[0]]) * metres / 2
    corner = np.array(pose[3:]) - turn[:, :2] @ middle
    edge = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # centres of the drawn pixels
    plane = FINE_K @ np.column_stack([turn[:, :2] * metres, corner]) @ edge
    where = np.asarray(cv2.perspectiveTransform(RAYS, np.linalg.inv(plane)), np.float32)
    large = cv2.remap(
        board,
        where[..., 0],
        where[..., 1],
        cv2.INTER_LINEAR,
        None,
        cv2.BORDER_CONSTANT,
        (120.0, 120.0, 120.0, 120.0),
    )
    image = np.asarray(cv2.resize(large, SIZE, None, 0, 0, cv2.INTER_AREA), float)
    noise = np.random.default_rng(round(pose[0]) % 360).normal(0, 2, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def views() -> list[Pixels]:
    return [view(pose) for pose in POSES]


def folder(path: Path, images: list[Pixels]) -> Path:
    path.mkdir()
    for n, image in enumerate(images):
        cv2.imwrite(str(path / f"board{n}.png"), image)
    return path


def run(*words: object) -> int:
    return call(["calibrate", "camera", *(str(word) for word in words)])


def test_the_corners_are_found_to_a_tenth_of_a_pixel(views: list[Pixels]) -> None:
    board = Board.parse("7x5", SQUARE)
    pose = POSES[1]
    turn = np.radians(pose[:3])
    middle = np.array([3.0, 2.0, 0.0]) * SQUARE
    place = np.array(pose[3:]) - np.asarray(cv2.Rodrigues(turn)[0]) @ middle
    seen = cv2.projectPoints(board.points, turn, place, K, BENT)[0]
    expected = np.asarray(seen, float).reshape(-1, 2)
    corners = find(views[1], board)
    assert corners is not None
    assert errors_of(corners, expected) < 0.1


def errors_of(corners: Array, expected: Array) -> float:
    """Mean distance, whichever corner is called the first."""
    ways = (corners, corners[::-1])
    return float(min(np.linalg.norm(way - expected, axis=1).mean() for way in ways))


def test_a_known_camera_is_found_again(
    tmp_path: Path, views: list[Pixels], capsys: pytest.CaptureFixture[str]
) -> None:
    images = [*views, views[0], np.full((HEIGHT, WIDTH), 90, np.uint8)]
    boards = folder(tmp_path / "boards", images)
    out, picture = tmp_path / "lens.yaml", tmp_path / "lens.png"
    words = ("--board", "7x5", "--square-m", SQUARE, "--out", out, "--picture", picture)
    assert run(boards, *words) == 0
    found = load(out, Calibration)
    assert (found.width, found.height) == SIZE
    assert (found.fx, found.fy) == pytest.approx((K[0, 0], K[1, 1]), rel=0.01)
    assert (found.cx, found.cy) == pytest.approx((K[0, 2], K[1, 2]), abs=2)
    assert found.distortion[0] == pytest.approx(BENT[0], abs=0.03)
    assert found.rms_px is not None
    assert found.rms_px < 0.15
    said = capsys.readouterr().out
    assert "no board found in board9.png" in said
    assert "8 different views of the board, 1 more alike" in said
    assert "board3.png: 0." in said
    assert "reprojection error 0." in said
    assert "distortion near the edges is guessed" in said
    drawn_picture = cv2.imread(str(picture))
    assert drawn_picture is not None
    assert drawn_picture.shape == (HEIGHT, 3 * WIDTH, 3)


@pytest.mark.parametrize(
    ("chosen", "words", "problem"),
    [
        ([0, 1, 2], (), "3 different views of the board, at least 5 are needed"),
        ([0, 0, 0, 0, 0, 0], (), "1 different views of the board, at least 5"),
        ([0, 1], ("--board", "9x6"), "no 9x6 board found in board0.png, board1.png; --board"),
        ([0], ("--board", "9"), "--board 9: give inner corners, COLUMNSxROWS"),
    ],
)
def test_views_that_do_not_suffice_are_refused(
    tmp_path: Path,
    views: list[Pixels],
    capsys: pytest.CaptureFixture[str],
    chosen: list[int],
    words: tuple[str, ...],
    problem: str,
) -> None:
    boards = folder(tmp_path / "boards", [views[n] for n in chosen])
    out = tmp_path / "lens.yaml"
    assert run(boards, *(words or ("--board", "7x5")), "--out", out) == 2
    assert problem in capsys.readouterr().err
    assert not out.exists()


def test_a_board_held_flat_before_the_camera_does_not_tell_the_focal_length(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flat = [(0, 0, 0, 0.03 * n - 0.06, 0.02 * n - 0.04, 0.5) for n in range(5)]
    boards = folder(tmp_path / "boards", [view(pose) for pose in flat])
    assert run(boards, "--board", "7x5", "--out", tmp_path / "lens.yaml") == 2
    assert "leans the same way in all views" in capsys.readouterr().err


def test_a_source_that_is_not_there_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path / "boards", "--out", tmp_path / "lens.yaml") == 2
    assert "boards does not exist: give a folder" in capsys.readouterr().err
    assert run(tmp_path, "--out", tmp_path / "no" / "lens.yaml") == 2
    assert "no is no folder" in capsys.readouterr().err
    assert run("/dev/video77", "--out", tmp_path / "lens.yaml") == 3
    assert "/dev/video77 does not exist" in capsys.readouterr().err


@pytest.mark.slow
def test_a_live_camera_is_calibrated_while_the_board_moves(
    tmp_path: Path, views: list[Pixels], capsys: pytest.CaptureFixture[str]
) -> None:
    port = RingPort(RingLayout(WIDTH, HEIGHT, channels=1), tmp_path / "ring")
    done = threading.Event()

    def show() -> None:
        for n in count():
            if done.wait(0.01):
                return
            port.deliver(Frame(n, 0.0, views[n // 8 % len(views)]))

    showing = threading.Thread(target=show)
    showing.start()
    words = ("--board", "7x5", "--square-m", SQUARE, "--size", "320x240", "--views", 8)
    try:
        assert run(f"ring:{tmp_path / 'ring'}", *words, "--out", tmp_path / "lens.yaml") == 0
    finally:
        done.set()
        showing.join()
        port.unplug()
    assert "view 8 of 8" in capsys.readouterr().out
    assert load(tmp_path / "lens.yaml", Calibration).fx == pytest.approx(K[0, 0], rel=0.01)


def test_images_of_two_sizes_are_refused(
    tmp_path: Path, views: list[Pixels], capsys: pytest.CaptureFixture[str]
) -> None:
    large = np.asarray(cv2.resize(views[1], (640, 480)), np.uint8)
    boards = folder(tmp_path / "boards", [views[0], large])
    assert run(boards, "--board", "7x5", "--out", tmp_path / "lens.yaml") == 2
    assert "board1.png has another size than board0.png" in capsys.readouterr().err


def test_too_small_a_board_is_refused() -> None:
    with pytest.raises(UsageError, match="give inner corners"):
        Board.parse("2x7", 0.025)
