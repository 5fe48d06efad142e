"""`followerd track`: one row per frame, honest about loss, one clear line for every wrong thing."""

import csv
import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from followerd.bench.overlay import RED, WHITE, YELLOW, draw
from followerd.bench.scores import read_truth
from followerd.bench.track import COLUMNS, Region, TrackRow, follow, parse_region, scores_of
from followerd.bench.trackers import build
from followerd.bench.video import VideoWriter
from followerd.cli.track import track
from followerd.config import ChoiceSection, load
from followerd.errors import DeviceError, FollowerdError, UsageError
from followerd.geometry import Camera, Pose2
from followerd.messages import (
    Box,
    Image,
    Odometry,
    Pixels,
    Place,
    Scan,
    TrackPhase,
    TrackState,
)
from followerd.trackers.hpf import Hpf

WIDTH, HEIGHT = 96, 72
CAMERA = Camera.from_hfov(WIDTH, HEIGHT, 0.8)
FIRST = Box(20, 15, 14, 40)


def picture(index: int) -> Pixels:
    """A red person on a grey noisy ground, walking right."""
    pixels = np.random.default_rng(index).integers(100, 130, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    x = int(FIRST.x) + index
    pixels[15:55, x : x + 14] = (30, 30, 200)
    return pixels


def images(count: int) -> Iterator[Image]:
    for index in range(count):
        stamp = index / 15
        yield Image(index, stamp, stamp, picture(index), CAMERA)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "walk" / "img").mkdir(parents=True)
    for index in range(20):
        cv2.imwrite(str(tmp_path / "walk" / "img" / f"{index + 1:04d}.png"), picture(index))
    lines = [f"{21 + index},16,14,40" for index in range(20)]
    (tmp_path / "walk" / "groundtruth_rect.txt").write_text("\n".join(lines))
    return tmp_path / "walk"


class Scripted:
    """A tracker that answers from a list."""

    needs = frozenset({"image"})
    sees = frozenset({"colour", "depth"})

    def __init__(self, *answers: TrackState | None) -> None:
        self._answers = list(answers)

    def enrol(self, seen: Image | Scan, region: Region, ego: Pose2 | None) -> TrackState:
        assert isinstance(seen, Image)
        assert isinstance(region, Box)
        return TrackState(seen.stamp, TrackPhase.TENTATIVE, 1.0, seen.id, region)

    def step(
        self,
        measurement: Image | Scan | Odometry,
        ego: Pose2 | None,
        place: Place | None = None,
    ) -> TrackState | None:
        return self._answers.pop(0)

    def forget(self) -> None:
        self._answers.clear()


def lines_of(path: Path) -> list[str]:
    return path.read_text().splitlines()


def test_the_csv_holds_every_frame_and_no_position_where_lost(tmp_path: Path, folder: Path) -> None:
    out = tmp_path / "rows.csv"
    track(folder, tracker="hpf/paper", init="20,15,14,40", out=out)
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert [int(row["index"]) for row in rows] == list(range(20))
    assert {row["status"] for row in rows} <= {"tracked", "occluded", "lost"}
    assert float(rows[-1]["x"]) == pytest.approx(39, abs=3)


def test_what_a_tracker_says_becomes_the_row() -> None:
    box = Box(1.0, 2.0, 3.0, 4.0)
    tracker = Scripted(
        TrackState(0, TrackPhase.CONFIRMED, 0.9, box=box),
        TrackState(0, TrackPhase.OCCLUDED, 0.5, box=box),
        TrackState(0, TrackPhase.LOST, 0.1),
        None,
    )
    rows = [step.row for step in follow(tracker, images(5), FIRST)]
    assert [row.status for row in rows] == ["tracked", "tracked", "occluded", "lost", "lost"]
    assert [row.box for row in rows[1:]] == [box, box, None, None]
    assert rows[1].cells() == (
        "1",
        "0.0667",
        "1.000",
        "2.000",
        "3.000",
        "4.000",
        "tracked",
        "0.900",
    )
    assert rows[3].cells()[2:6] == ("",) * 4


@pytest.mark.parametrize("name", ["hpf/paper", "hpf/default"])
def test_the_rows_of_a_cut_source_are_the_first_rows_of_the_whole(
    tmp_path: Path, folder: Path, name: str
) -> None:
    track(folder, tracker=name, init="20,15,14,40", out=tmp_path / "whole.csv")
    for extra in sorted((folder / "img").iterdir())[12:]:
        extra.unlink()
    track(folder, tracker=name, init="20,15,14,40", out=tmp_path / "cut.csv")
    assert lines_of(tmp_path / "cut.csv") == lines_of(tmp_path / "whole.csv")[:13]


def test_frames_before_the_start_give_no_rows() -> None:
    rows = [step.row for step in follow(Scripted(None, None), images(10), FIRST, start=7)]
    assert [row.index for row in rows] == [7, 8, 9]


def test_with_a_truth_the_first_box_and_the_scores_come_from_it(
    tmp_path: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth, summary = folder / "groundtruth_rect.txt", tmp_path / "s.json"
    track(folder, tracker="hpf/paper", out=tmp_path / "o.csv", truth=truth, summary=summary)
    figures = json.loads(summary.read_text())
    assert figures["frames"] == figures["visible_frames"] == 20
    assert figures["auc"] > 0.6
    assert figures["claims_when_absent"] is None
    assert figures["frame_ms"]["p50"] > 0
    assert "auc: " in capsys.readouterr().out


def test_scores_count_from_the_first_tracked_frame() -> None:
    truth = np.array([[0.0, 0, 9, 9], [5, 5, 10, 10], [6, 5, 10, 10]])
    rows = [TrackRow(i, 0.0, Box(4.0 + i, 5, 10, 10), "tracked", 1.0, 0.0) for i in (1, 2)]
    scores = scores_of(rows, truth)
    assert (scores.visible_frames, scores.iou) == (2, 1.0)


def test_a_video_is_a_source_and_the_rendering_is_one(tmp_path: Path, folder: Path) -> None:
    with VideoWriter(tmp_path / "walk.mp4", 15.0) as video:
        for index in range(6):
            video.write(picture(index))
    render = tmp_path / "seen.mp4"
    track(
        tmp_path / "walk.mp4",
        tracker="hpf/paper",
        init="20,15,14,40",
        out=tmp_path / "o.csv",
        render=render,
    )
    assert len(lines_of(tmp_path / "o.csv")) == 7
    capture = cv2.VideoCapture(str(render))
    drawn = []
    while (answer := capture.read())[0]:
        drawn.append(answer[1])
    assert len(drawn) == 6
    assert drawn[0].shape[1] >= 480  # enlarged, so that lines can be told apart


def test_the_overlay_shows_candidates_particles_and_the_box() -> None:
    state = TrackState(
        0.0,
        TrackPhase.CONFIRMED,
        0.8,
        frame_id=1,
        box=Box(20, 15, 14, 40),
        candidates=(Box(60, 10, 20, 30),),
        particles=np.array([[80.0, 50.0, 0.0, 0.0], [np.nan, 1.0, 0.0, 0.0], [500.0, 1, 0, 0]]),
    )
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    canvas = draw(pixels, state)
    zoom = canvas.shape[1] // WIDTH
    assert tuple(canvas[10 * zoom, 70 * zoom]) == WHITE
    assert tuple(canvas[50 * zoom, 80 * zoom]) == YELLOW
    assert tuple(canvas[15 * zoom, 27 * zoom]) == RED
    assert not pixels.any()  # the frame itself is left alone


def test_a_profile_names_where_the_time_goes(
    tmp_path: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    track(folder, tracker="hpf/paper", init="20,15,14,40", out=tmp_path / "o.csv", profile=True)
    assert "cumtime" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "region"),
    [("1,2,3,4", Box(1, 2, 3, 4)), ("-5,2.5,30,40", Box(-5, 2.5, 30, 40)), ("7,8", (7.0, 8.0))],
)
def test_a_region_is_a_box_or_a_point(text: str, region: Region) -> None:
    assert parse_region(text) == region


@pytest.mark.parametrize("text", ["", "1", "1,2,3", "1,2,3,0", "1,2,-3,4", "a,b", "nan,1", "1;2"])
def test_anything_else_is_no_region(text: str) -> None:
    with pytest.raises(UsageError, match=r"--init .*X,Y,W,H"):
        parse_region(text)


@pytest.mark.parametrize("init", ["200,10,10,10", "90,10,40,40", "-30,5,20,20", "10,72", "96,1"])
def test_a_region_outside_the_image_is_refused(tmp_path: Path, folder: Path, init: str) -> None:
    with pytest.raises(UsageError, match=r"--init.*outside the 96x72 image"):
        track(folder, init=init, out=tmp_path / "o.csv")


def wrong_things(folder: Path, out: Path) -> dict[str, tuple[Callable[[], None], str]]:
    (folder / "empty").mkdir()
    (folder / "no.mp4").write_bytes(b"not a video")
    none = folder / "none"
    run = partial(track, init="20,15,14,40", out=out)
    good = partial(run, folder)
    return {
        "source": (partial(run, none), "does not exist"),
        "video": (partial(run, folder / "no.mp4"), "cannot be opened as a video"),
        "images": (partial(run, folder / "empty"), "holds no images"),
        "tracker": (partial(good, tracker="csrt"), "--tracker csrt: unknown; there are head, hpf"),
        "profile": (partial(good, tracker="hpf/best"), "--tracker hpf/best: profile"),
        "nobody": (partial(good, init=None), "--init X,Y,W,H"),
        "start": (partial(good, start=20), "--start 20: the source has only 20 frames"),
        "negative": (partial(good, start=-1), "--start -1"),
        "out": (partial(good, out=none / "o.csv"), "--out .*cannot be written"),
        "render": (partial(good, render=none / "v.mp4"), "--render .*no such folder"),
        "codec": (partial(good, render=folder / "v.xyz"), "--render .*mp4"),
        "summary": (partial(good, summary=none / "s.json"), "--summary .*cannot be"),
        "config": (partial(good, config=str(folder / "none.yaml")), r"none\.yaml"),
    }


WRONG = (
    """source video images tracker profile nobody start negative out render codec summary config"""
)


@pytest.mark.parametrize("thing", WRONG.split())
def test_a_wrong_thing_is_one_clear_line(tmp_path: Path, folder: Path, thing: str) -> None:
    call, line = wrong_things(folder, tmp_path / "o.csv")[thing]
    with pytest.raises(FollowerdError, match=line) as error:
        call()
    assert "\n" not in str(error.value)
    assert error.value.exit_code == (3 if isinstance(error.value, DeviceError) else 2)


def test_the_settings_come_from_the_config_but_the_profile_from_the_name() -> None:
    rng = np.random.default_rng(0)
    config = load("hpf-sim", {"tracker.particles": 300})
    chosen = build("hpf/paper", rng, config)
    assert isinstance(chosen, Hpf)
    assert (chosen.settings.particles, chosen.settings.profile) == (300, "paper")
    other = config.model_copy(update={"tracker": ChoiceSection(kind="kf")})
    with pytest.raises(UsageError, match="the config is for kf"):
        build("hpf", rng, other)


def test_the_shared_recordings_are_read(tmp_path: Path) -> None:
    sequence = Path(__file__).parent.parent.parent / "shared" / "data" / "colour" / "otb_man"
    if not sequence.is_dir():
        pytest.skip("the shared recordings are not beside the checkout")
    truth = read_truth(sequence / "groundtruth_rect.txt")
    assert truth.shape == (134, 4)
    assert truth[0].tolist() == [68, 47, 26, 39]
