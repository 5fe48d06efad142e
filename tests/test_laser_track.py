"""`followerd track` over scans: one row per scan, honest about loss, never ahead of its time."""

import csv
import gzip
import json
from collections.abc import Callable
from functools import partial
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest

from followerd.bench.laser import LaserRecording
from followerd.bench.laser_track import LASER_COLUMNS, labelled
from followerd.bench.scores import read_people, score_places
from followerd.cli.track import track
from followerd.errors import UsageError
from followerd.geometry import Array, Pose2
from tests.laser_scenes import legs, scan_of

COUNT = 40
MOUNT = Pose2(0.2, 0.0, 0.0)


def walk(index: int) -> tuple[float, float]:
    """Where the person is in scan `index`, m in the world."""
    return 1.5 + 0.04 * index, 0.2


def robot(index: int) -> Pose2:
    return Pose2(0.02 * index, 0.0, 0.01 * index)


def write(folder: Path, count: int = COUNT, moving: bool = False) -> Path:
    """A recording of somebody walking away, from a robot that may drive after them."""
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(6)
    scans = [
        scan_of(
            legs(walk(index), 0.0, 0.04 * index),
            0.1 * index,
            pose=robot(index) if moving else None,
            mount=MOUNT if moving else None,
            rng=rng,
        )
        for index in range(count)
    ]
    np.savez(
        folder / "scans.npz",
        t=np.array([scan.stamp for scan in scans]),
        ranges=np.array([scan.ranges for scan in scans], np.float32),
        angle_min=scans[0].angle_min,
        angle_inc=scans[0].angle_increment,
    )
    if moving:
        lines = ["t_header,x,y,theta,v,w"]
        for index in range(count):
            pose = robot(index)
            lines.append(f"{0.1 * index - 0.01},{pose.x},{pose.y},{pose.theta},0,0")
        with gzip.open(folder / "odom.csv.gz", "wt") as file:
            file.write("\n".join(lines))
    return folder


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


follow = partial(track, tracker="legs", init="1.5,0.2")


def test_the_csv_holds_every_scan_in_the_lasers_frame(tmp_path: Path) -> None:
    out = tmp_path / "rows.csv"
    follow(write(tmp_path / "walk") / "scans.npz", out=out)
    rows = rows_of(out)
    assert tuple(rows[0]) == LASER_COLUMNS
    assert [int(row["index"]) for row in rows] == list(range(COUNT))
    assert {row["frame"] for row in rows} == {"laser"}
    assert rows[-1]["status"] == "tracked"
    assert (float(rows[-1]["x"]), float(rows[-1]["y"])) == pytest.approx(walk(39), abs=0.15)
    assert float(rows[-1]["vx"]) == pytest.approx(0.4, abs=0.5)


def test_with_odometry_rows_are_in_odom(tmp_path: Path) -> None:
    out, folder = tmp_path / "rows.csv", write(tmp_path / "walk", moving=True)
    follow(folder, init="1.3,0.2", laser="0.2,0,0", out=out)
    rows = rows_of(out)
    assert {row["frame"] for row in rows} == {"odom"}
    assert (float(rows[-1]["x"]), float(rows[-1]["y"])) == pytest.approx(walk(39), abs=0.15)


@pytest.mark.parametrize("moving", [False, True])
def test_the_rows_of_a_cut_source_are_the_first_rows_of_the_whole(
    tmp_path: Path, moving: bool
) -> None:
    follow(write(tmp_path / "walk", moving=moving), out=tmp_path / "whole.csv")
    follow(write(tmp_path / "walk", 25, moving=moving), out=tmp_path / "cut.csv")
    whole = (tmp_path / "whole.csv").read_text().splitlines()
    assert (tmp_path / "cut.csv").read_text().splitlines() == whole[:26]


def test_a_later_start_gives_rows_from_there_and_none_where_lost(tmp_path: Path) -> None:
    folder, out = write(tmp_path / "walk"), tmp_path / "rows.csv"
    with np.load(folder / "scans.npz") as archive:
        content = dict(archive)
    content["ranges"][20:] = inf
    np.savez(folder / "scans.npz", **content)
    follow(folder, init="1.7,0.2", start=5, out=out)
    rows = rows_of(out)
    assert rows[0]["index"] == "5"
    assert [rows[-1][name] for name in ("status", "x", "vx")] == ["lost", "", ""]


def labels_file(folder: Path, *ids: int) -> Path:
    file = folder / "people_gt.csv"
    lines = ["scan_index,t_bag,id,x,y"]
    for index in range(COUNT):
        x, y = walk(index)
        lines += [f"{index},0,{name},{x + 1.5 * number},{y}" for number, name in enumerate(ids)]
    file.write_text("\n".join(lines))
    return file


def test_with_labels_the_start_and_the_scores_come_from_them(tmp_path: Path) -> None:
    folder, summary = write(tmp_path / "walk"), tmp_path / "s.json"
    track(folder, tracker="legs", out=tmp_path / "o.csv", truth=labels_file(folder, 2),
          summary=summary)  # fmt: skip
    figures = json.loads(summary.read_text())
    assert figures["scans"] == figures["labels"] == COUNT
    assert figures["tracking_rate"] == 1.0
    assert figures["error_median_m"] < 0.1
    assert figures["claims_when_unlabelled"] is None


def test_of_several_labelled_people_the_point_says_which(tmp_path: Path) -> None:
    people = read_people(labels_file(tmp_path, 2, 7), COUNT)
    assert labelled(people, 3, (3.0, 0.2))[1] is people[7]
    with pytest.raises(UsageError, match="labels 2 people; give --init"):
        labelled(people, 3, None)


def broken(folder: Path, name: str) -> Path:
    """A recording with one thing wrong."""
    file = write(folder) / "scans.npz"
    with np.load(file) as archive:
        content = dict(archive)
    if name == "text":
        file.write_text("no scans")
    elif name == "keys":
        del content["angle_inc"]
        np.savez(file, **content)
    elif name == "rows":
        np.savez(file, **(content | {"t": content["t"][:-1]}))
    elif name == "order":
        np.savez(file, **(content | {"angle_inc": -0.01}))
    elif name == "odometry":
        (folder / "odom.csv").write_text("t,x,y\n1,2,3\n")
    return folder


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f, o: follow(f / "none.npz", out=o), "not readable as scans"),
        (lambda f, o: follow(broken(f, "text"), out=o), "not readable as scans"),
        (lambda f, o: follow(broken(f, "keys"), out=o), "lacks angle_inc"),
        (lambda f, o: follow(broken(f, "rows"), out=o), "one row of beams for each"),
        (lambda f, o: follow(broken(f, "order"), out=o), "angle_inc must be above 0"),
        (lambda f, o: follow(broken(f, "odometry"), out=o), "a time, x, y, theta, v and w"),
        (lambda f, o: follow(write(f), init="1,2,3,4", out=o), "--init 1,2,3,4: give X,Y"),
        (lambda f, o: follow(write(f), init="a,b", out=o), "--init a,b: give X,Y in metres"),
        (lambda f, o: follow(write(f), init="6,6", out=o), "nothing stands within"),
        (lambda f, o: follow(write(f), init=None, out=o), "--init X,Y, or --truth"),
        (lambda f, o: follow(write(f), start=COUNT, out=o), "has only 40 scans"),
        (lambda f, o: follow(write(f), start=-1, out=o), "counted from 0"),
        (lambda f, o: follow(write(f), laser="1,2", out=o), "--laser 1,2: give X,Y,YAW"),
        (lambda f, o: track(f, tracker="hpf", laser="0,0,0", out=o), "--laser is for trackers of"),
        (lambda f, o: follow(write(f), render=o, out=o), "--render draws on images"),
        (lambda f, o: follow(write(f), out=o.parent), "cannot be written"),
        (lambda f, o: follow(write(f), truth=f / "no", out=o), "--truth"),
        (lambda f, o: follow(write(f), truth=labels_file(f), out=o), "labels nobody there"),
    ],
)  # fmt: skip
def test_every_wrong_thing_is_one_clear_line(
    tmp_path: Path, call: Callable[[Path, Path], None], message: str
) -> None:
    folder = tmp_path / "walk"
    folder.mkdir()
    with pytest.raises(UsageError) as caught:
        call(folder, tmp_path / "rows.csv")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_zero_is_not_measured_and_inf_has_no_echo(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", t=[0.0], ranges=[[0.0, inf, nan, 2.0]], angle_min=0, angle_inc=0.1)
    (step,) = LaserRecording(tmp_path / "a.npz")
    assert step.scan.ranges.tolist() == pytest.approx([nan, inf, nan, 2.0], nan_ok=True)
    assert step.scan.range_max == 2.0
    assert step.ego is None


STAMPS = 0.1 * np.arange(100)
STILL = np.zeros((100, 2))


def changed(rows: Array, first: int, last: int, value: float) -> Array:
    rows = rows.copy()
    rows[first:last] = value
    return rows


@pytest.mark.parametrize(
    ("places", "labels", "expected"),
    [
        (STILL, STILL, {"tracking_rate": 1.0, "losses": 0, "error_median_m": 0.0}),
        (changed(STILL, 10, 30, 5.0), STILL, {"tracking_rate": 0.8, "losses": 1}),
        (changed(STILL, 10, 18, 5.0), STILL, {"tracking_rate": 0.92, "losses": 0}),
        (changed(STILL, 10, 30, nan), STILL, {"tracking_rate": 0.8, "losses": 1}),
        (changed(STILL, 10, 90, 0.6), STILL, {"tracking_rate": 0.2, "losses": 0}),
        (
            changed(STILL, 26, 64, nan),
            changed(STILL, 20, 60, nan),
            {
                "tracking_rate": 56 / 60,
                "claims_when_unlabelled": 6 / 40,
                "lost_after_s": 0.7,
                "back_after_s": 0.4,
                "losses": 0,
            },
        ),
        (STILL, changed(STILL, 0, 100, nan), {"tracking_rate": None, "labels": 0}),
    ],
)
def test_scores(places: Array, labels: Array, expected: dict[str, float | None]) -> None:
    scores = score_places(places, labels, STAMPS)
    assert {name: getattr(scores, name) for name in expected} == pytest.approx(expected)
