"""Recorded pairs of colour and depth."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from followerd.bench.recorded import camera_of, images, open_source
from followerd.cli.track import track
from followerd.errors import DeviceError, UsageError
from followerd.hw.camera.rgbd import RgbdFolder

RECORDING = Path(__file__).parents[2] / "shared" / "data" / "rgbd" / "ist_lab_people"
FOCAL, SHIFT = 100.0, -0.1  # px, m: a point at 2 m is seen 5 px farther left in colour
K = [[FOCAL, 0, 40], [0, FOCAL, 30], [0, 0, 1]]


def folder(place: Path, *, calibrated: bool, count: int = 2) -> Path:
    """Pairs of 80x60 px: a square at 2 m before a wall at 4 m, and a hole."""
    for name in ("rgb", "depth"):
        (place / name).mkdir()
    depth = np.full((60, 80), 4000, np.uint16)
    depth[20:40, 30:50], depth[0, 0] = 2000, 0
    for k in range(1, count + 1):
        cv2.imwrite(str(place / "rgb" / f"{k:04d}.png"), np.full((60, 80, 3), 9 * k, np.uint8))
        cv2.imwrite(str(place / "depth" / f"{k:04d}.png"), depth)
    if calibrated:
        table = {"Kdepth": K, "Krgb": K, "R": np.eye(3).tolist(), "T": [[SHIFT], [0], [0]]}
        (place / "calib.json").write_text(json.dumps(table))
    return place


def test_pairs_come_in_order_with_metres_and_holes(tmp_path: Path) -> None:
    source = open_source(folder(tmp_path, calibrated=False))
    frames = list(images(source, camera_of(source, None)))
    assert [frame.pixels[0, 0, 0] for frame in frames] == [9, 18]
    first = frames[0].depth
    assert first is not None
    assert first[30, 40] == pytest.approx(2.0)
    assert np.isnan(first[0, 0])


def test_depth_is_laid_where_the_colour_camera_sees_it(tmp_path: Path) -> None:
    source = RgbdFolder(folder(tmp_path, calibrated=True))
    depth = next(iter(source)).depth
    assert depth is not None
    assert (depth[20:40, 25:45] == 2.0).all()
    assert np.isnan(depth[25:35, 45:47]).all()  # behind the square: the depth camera saw nothing
    assert camera_of(source, None).fx == FOCAL


def test_a_damaged_recording_is_named(tmp_path: Path) -> None:
    place = folder(tmp_path, calibrated=False)
    (place / "calib.json").write_text('{"Kdepth": 3}')
    with pytest.raises(UsageError, match=r"calib\.json"):
        RgbdFolder(place)
    (place / "calib.json").unlink()
    cv2.imwrite(str(place / "depth" / "0001.png"), np.zeros((60, 80), np.uint8))
    with pytest.raises(DeviceError, match="16-bit"):
        list(RgbdFolder(place))
    (place / "depth" / "0002.png").unlink()
    with pytest.raises(UsageError, match="every image"):
        RgbdFolder(place)


@pytest.mark.slow
@pytest.mark.skipif(not RECORDING.is_dir(), reason="../shared/data/rgbd is not there")
def test_a_real_person_is_followed_until_they_leave_the_view(tmp_path: Path) -> None:
    """Two snapshots a second from a camera that looks down; they turn round and are hidden."""
    for name in ("rgb", "depth"):
        (tmp_path / name).mkdir()
        for path in sorted((RECORDING / name).iterdir())[:51]:
            (tmp_path / name / path.name).symlink_to(path)
    (tmp_path / "calib.json").symlink_to(RECORDING / "calib.json")
    config = tmp_path / "down.yaml"
    config.write_text(
        "base: {kind: p2os, link: sim}\nlaser: {kind: lms200, link: sim}\n"
        "camera: {kind: kinect, link: sim, mount: {z_m: 2.33, elevation_deg: -26.7}}\n"
        "tracker: {kind: patches}\ncontroller: {kind: fuzzy_gears}\nsim: {scenario: jia-paths}\n"
    )
    out = tmp_path / "rows.csv"
    init = "190,120,130,330"
    track(tmp_path, tracker="patches", init=init, start=30, config=str(config), out=out)
    rows = [line.split(",") for line in out.read_text().splitlines()[1:]]
    assert len(rows) == 21
    assert sum(row[6] == "tracked" for row in rows) >= 15
    assert "lost" not in [row[6] for row in rows]
    last = rows[-1]
    assert 0 < float(last[2]) < 60
    assert 100 < float(last[3]) < 160
