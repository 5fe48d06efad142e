"""A film shows every camera frame once, with what was decided on it."""

from math import inf, radians
from pathlib import Path

import cv2
import numpy as np
import pytest

from followerd.bench import overlay
from followerd.bench.film import Film
from followerd.bench.top_view import CLAIM, ROBOT, TARGET, TopView
from followerd.geometry import Camera, Pose2
from followerd.messages import (
    Box,
    Command,
    Decision,
    Image,
    Mode,
    Pixels,
    Scan,
    TrackPhase,
    TrackState,
    Twist,
)
from followerd.sim.scenarios import load
from followerd.sim.truth import Actor, Truth

CAMERA = Camera.from_hfov(192, 144, radians(48))
SIZE = 450  # px, of 9 m: 50 px a metre


def truth() -> Truth:
    """The robot at (3, 0), looking along x; the person 2 m ahead and 1 m left."""
    target = Actor("", 5.0, 1.0, 0.0, (0.0, 0.0), 2.2, 0.46, True)
    return Truth(0.0, Pose2(3.0, 0.0, 0.0), Twist(), target, (), 0, 0, inf, inf)


def image(number: int) -> Image:
    pixels = np.full((144, 192, 3), 90, np.uint8)
    return Image(number, number / 15, number / 15, pixels, CAMERA)


def decision(number: int) -> Decision:
    box = Box(80, 20, 30, 90)
    track = TrackState(0.0, TrackPhase.CONFIRMED, 0.9, number, box, bearing=0.46, range=2.2)
    return Decision(0, 0.1, Mode.FOLLOWING, track, None, Command(0.1, Twist(0.3, 0.1)))


def frames_in(path: Path) -> list[Pixels]:
    capture = cv2.VideoCapture(str(path))
    frames = []
    while (answer := capture.read())[0]:
        frames.append(np.asarray(answer[1], np.uint8))
    return frames


def test_from_above_everybody_is_where_they_are_around_the_robot() -> None:
    view = TopView(load("corridor"), SIZE).draw(truth(), CAMERA, None, None)
    assert tuple(view[225, 225]) == ROBOT
    assert tuple(view[225 - 50, 225 + 100]) == TARGET


def test_the_claim_is_drawn_where_the_daemon_believes_the_person() -> None:
    track = TrackState(0.0, TrackPhase.CONFIRMED, 0.9, bearing=0.0, range=2.0)
    view = TopView(load("corridor"), SIZE).draw(truth(), CAMERA, None, track)
    assert tuple(view[225, 225 + 100]) == CLAIM


def test_beams_without_echo_are_not_drawn() -> None:
    ranges = np.array([1.0, inf, np.nan])
    scan = Scan(0.0, 0.0, 0.0, 1.0, ranges, 30.0, np.zeros(3), Pose2())
    above = TopView(load("corridor"), SIZE)
    plain, seen = (above.draw(truth(), CAMERA, s, None) for s in (None, scan))
    changed = np.argwhere((plain != seen).any(axis=2))
    assert np.abs(changed - (225, 275)).max() <= 1


def test_every_frame_is_filmed_once_and_in_order(tmp_path: Path) -> None:
    film = Film(tmp_path / "film.mp4", 15.0, load("corridor"), truth)
    for number in range(6):
        film.measured(image(number))
        if number % 2:  # the tracker takes every other frame
            film.decided(decision(number))
            film.decided(decision(number))  # the same track again, for a scan
    film.close()
    frames = frames_in(tmp_path / "film.mp4")
    assert len(frames) == 6
    height, width = frames[0].shape[:2]
    assert width == 576 + 432  # the enlarged picture and the view from above
    assert height > 432  # the caption below


def test_frames_that_nobody_decides_on_are_filmed_too(tmp_path: Path) -> None:
    film = Film(tmp_path / "film.mp4", 15.0, load("corridor"), lambda: None)
    for number in range(20):
        film.measured(image(number))
    film.close()
    assert len(frames_in(tmp_path / "film.mp4")) == 20


def test_a_track_of_scans_is_written_on_the_frames_it_has_overtaken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = Film(tmp_path / "film.png", 15.0, load("corridor"), truth)
    drawn: list[tuple[int, Decision | None]] = []
    monkeypatch.setattr(film, "_write", lambda seen, decision: drawn.append((seen.id, decision)))
    for number in range(3):
        film.measured(image(number))
    track = TrackState(1.5 / 15, TrackPhase.OCCLUDED, 0.7, bearing=0.4, range=2.2)
    decided = Decision(0, 0.1, Mode.FOLLOWING, track, None, Command(0.1, None))
    film.decided(decided)
    assert drawn == [(0, decided), (1, decided)]


def test_particles_on_the_floor_are_not_drawn_into_the_picture() -> None:
    track = TrackState(0.1, TrackPhase.CONFIRMED, 0.9, particles=np.array([[60.0, 40.0]]))
    without = TrackState(0.1, TrackPhase.CONFIRMED, 0.9)
    pixels = image(0).pixels
    assert (overlay.draw(pixels, track) == overlay.draw(pixels, without)).all()
