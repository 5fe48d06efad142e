"""`followerd calibrate`: what a camera sees, measured instead of looked up."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from cyclopts import App, Parameter, validators

from followerd import clock
from followerd.errors import UsageError
from followerd.hw.camera.calibration import Calibration, Lens
from followerd.hw.camera.chessboard import (
    ROUGH,
    Board,
    Fit,
    View,
    calibrate,
    coverage,
    find,
    is_another,
)
from followerd.hw.camera.files import ImageFolder, open_recording
from followerd.hw.camera.kinect import KinectSettings
from followerd.hw.camera.playback import is_recording
from followerd.hw.camera.settings import CameraSettings
from followerd.hw.camera.sources import open_camera
from followerd.messages import Pixels

LIVE = ("/dev/", "kinect:", "ring:")
COVERED = 0.6  # of the image, to know its edges
NAMED = 5  # images that an error lists
STRETCH = 20  # times longer than they are, residuals are drawn

app = App(name="calibrate", help="Measure a camera, and where it sits.")
app.command(
    "followerd.cli.calibrate_mount:mount",
    name="mount",
    help="Find where the camera sits from a person who walks about.",
)
app.command(
    "followerd.cli.calibrate_laser:laser",
    name="laser",
    help="Find how the laser is turned from a push straight ahead.",
)

Positive = validators.Number(gt=0)


class Shown(NamedTuple):
    """An image of the source."""

    name: str
    image: Pixels


@app.command
def camera(
    source: str,
    *,
    board: str = "9x6",
    square_m: Annotated[float, Parameter(validator=Positive)] = 0.025,
    out: Path,
    picture: Path | None = None,
    size: str = "640x480",
    views: Annotated[int, Parameter(validator=Positive)] = 20,
    seconds: Annotated[float, Parameter(validator=Positive)] = 120.0,
) -> None:
    """Find focal length, centre and distortion from views of a chessboard.

    Hold the board in all parts of the image, near and far, tilted by 30 to 45 degrees each time.

    Parameters
    ----------
    source
        A folder of images, a video, or a live camera: /dev/video0, kinect:0, a frame ring.
    board
        Inner corners, COLUMNSxROWS: one less than squares.
    square_m
        Side of a square.
    out
        YAML file to write; in a config it stands as the camera's calibration.
    picture
        PNG file: all corners found, the worst view with its errors, and that view made straight.
    size
        Of a live camera's images, WIDTHxHEIGHT; calibrate at the size that is used.
    views
        Different views to take of a live camera.
    seconds
        How long to look for them.
    """
    for path in (out, picture):
        if path is not None and not path.parent.is_dir():
            raise UsageError(f"{path.parent} is no folder")
    chessboard = Board.parse(board, square_m)
    if is_recording(source) or not (source.startswith(LIVE) or Path(source).exists()):
        found = _views(_recorded(Path(source)), chessboard)
    else:
        found = clock.run(_live(source, _size(size), chessboard, views, seconds))
    fit = calibrate(found, chessboard)
    _report(fit, found, chessboard)
    out.write_text(_text(fit.calibration, len(found), chessboard), encoding="utf-8")
    print(f"{out}: written; in the config: camera: {{calibration: {out}}}")
    if picture is not None:
        cv2.imwrite(str(picture), _picture(fit, found))
        print(f"{picture}: written")


def _recorded(path: Path) -> Iterator[Shown]:
    recording = open_recording(path)
    names = recording.names if isinstance(recording, ImageFolder) else None
    for frame in recording:
        yield Shown(names[frame.id] if names else f"frame {frame.id}", frame.pixels)


def _views(images: Iterable[Shown], board: Board) -> list[View]:
    """The different views of a recording; raises UsageError."""
    views: list[View] = []
    without: list[str] = []
    alike = 0
    for name, image in images:
        if views and views[0].image.shape != image.shape:
            raise UsageError(f"{name} has another size than {views[0].name}: use one size")
        corners = find(image, board)
        if corners is None:
            without.append(name)
        elif is_another(corners, views, image.shape[1]):
            views.append(View(name, corners, image))
        else:
            alike += 1
    if not views:
        raise UsageError(
            f"no {board} board found in {_some(without)}; --board counts inner corners, columns x"
            " rows; is it whole in view, flat and sharp, with a white edge?"
        )
    if without:
        print(f"no board found in {_some(without)}")
    print(f"{len(views)} different views of the board" + (f", {alike} more alike" if alike else ""))
    return views


async def _live(
    link: str, size: tuple[int, int], board: Board, count: int, seconds: float
) -> list[View]:
    """Different views of a live camera, until there are enough; raises OpenError, UsageError."""
    settings = CameraSettings(width=size[0], height=size[1], rate_hz=30)
    if link.startswith("kinect:"):
        settings = KinectSettings()
    stream = await open_camera(link, settings).open("camera")
    views: list[View] = []
    until = clock.now() + seconds
    try:
        while len(views) < count and clock.now() < until:
            frame = await stream.read()
            corners = find(frame.pixels, board)
            if corners is not None and is_another(corners, views, frame.pixels.shape[1]):
                views.append(View(f"frame {frame.id}", corners, frame.pixels))
                print(f"view {len(views)} of {count}: now hold the board another way")
    finally:
        stream.close()
    if not views:
        remedy = "--board counts inner corners, columns x rows"
        raise UsageError(f"no {board} board seen in {seconds:g} s; {remedy}")
    return views


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise UsageError(f"--size {text}: give WIDTHxHEIGHT, such as 640x480")
    return int(width), int(height)


def _some(names: list[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def _report(fit: Fit, views: list[View], board: Board) -> None:
    found = fit.calibration
    for view, rms in zip(views, fit.view_rms, strict=True):
        print(f"  {view.name}: {rms:.2f} px rms")
    print(f"fx {found.fx:.1f} fy {found.fy:.1f} cx {found.cx:.1f} cy {found.cy:.1f} px")
    print("distortion " + " ".join(f"{value:.4f}" for value in found.distortion))
    print(f"reprojection error {fit.rms:.2f} px rms")
    if fit.rms > ROUGH:
        print(f"that is much: is the {board} board flat, are the images sharp?")
    covered = coverage(views)
    print(f"the views cover {100 * covered:.0f} % of the image")
    if covered < COVERED:
        print("distortion near the edges is guessed: hold the board there too")


def _text(found: Calibration, views: int, board: Board) -> str:
    head = (
        f"# followerd calibrate camera: {views} views of a {board} board,"
        f" squares of {board.square:g} m\n"
    )
    values = found.model_dump()
    distortion = ", ".join(f"{value:.6g}" for value in values.pop("distortion"))
    lines = [f"{key}: {value:.6g}" for key, value in values.items() if value is not None]
    return head + "\n".join(lines) + f"\ndistortion: [{distortion}] # k1, k2, p1, p2, k3\n"


def _picture(fit: Fit, views: list[View]) -> Pixels:
    """Side by side: corners of all views; the worst view's errors, drawn longer; it straight."""
    worst = int(np.argmax(fit.view_rms))
    image = views[worst].image
    if image.ndim == 2:
        image = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
    cover = image // 3
    for view in views:
        for x, y in np.round(view.corners).astype(int).tolist():
            cv2.circle(cover, (x, y), 2, (80, 220, 80), -1)
    errors = image.copy()
    for seen, model in zip(views[worst].corners, fit.expected[worst], strict=True):
        end = seen + STRETCH * (model - seen)
        (x, y), (u, v) = np.round(seen).astype(int).tolist(), np.round(end).astype(int).tolist()
        cv2.circle(errors, (x, y), 3, (80, 220, 80), 1)
        cv2.line(errors, (x, y), (u, v), (60, 60, 255), 1)
    straight = Lens(fit.calibration).straight(image)
    for panel, text in (
        (cover, f"corners of {len(views)} views"),
        (errors, f"{views[worst].name}: {fit.view_rms[worst]:.2f} px rms, errors x{STRETCH}"),
        (straight, "made straight"),
    ):
        cv2.rectangle(panel, (0, 0), (panel.shape[1] - 1, 24), (40, 40, 40), -1)
        cv2.putText(panel, text, (6, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1)
    return np.hstack([cover, errors, straight])
