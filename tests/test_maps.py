"""Maps on disk, from a plan, and the walls of a grid."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from followerd.errors import ConfigError, UsageError
from followerd.geometry import Array
from followerd.maps.files import load, save
from followerd.maps.floor import FloorMap, OccupancyGrid
from followerd.maps.plan import from_segments, read_plan
from followerd.maps.walls import walls_of

ROOM = """\
walls_m:
  - [0, 0, 6, 0]
  - [6, 0, 6, 4]
  - [6, 4, 0, 4]
  - [0, 4, 0, 0]
boards_m:
  - [2, 1, 2, 3, 0.06]
"""


def room(tmp_path: Path) -> FloorMap:
    file = tmp_path / "room.yaml"
    file.write_text(ROOM, encoding="utf-8")
    return read_plan(file)


def occupied_at(grid: OccupancyGrid, x: float, y: float) -> bool:
    i, j = ((np.array([x, y]) - grid.origin) / grid.cell).astype(int)
    return bool(grid.occupied[j, i])


def test_a_plan_measured_by_hand_becomes_a_map(tmp_path: Path) -> None:
    floor = room(tmp_path)
    assert floor.walls.shape == (8, 2, 2)
    assert occupied_at(floor.grid, 3.0, 0.0)
    assert occupied_at(floor.grid, 2.03, 2.0)
    assert not floor.grid.occupied[floor.grid.free].any()
    # 6 by 4 m, less the walls
    assert floor.grid.free.sum() * floor.grid.cell**2 == pytest.approx(24.0, rel=0.06)


def test_a_map_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    floor = room(tmp_path)
    save(tmp_path / "m", floor)
    for name in ("m", "m.yaml", "m.pgm"):
        again = load(tmp_path / name)
        assert np.array_equal(again.grid.occupied, floor.grid.occupied)
        assert np.array_equal(again.grid.free, floor.grid.free)
        assert again.grid.cell == floor.grid.cell
        assert again.grid.origin == pytest.approx(floor.grid.origin)
        assert again.walls == pytest.approx(floor.walls, abs=1e-4)


def test_without_its_walls_beside_it_a_map_has_those_of_its_grid(tmp_path: Path) -> None:
    floor = room(tmp_path)
    save(tmp_path / "m", floor)
    (tmp_path / "m.walls.yaml").unlink()
    walls = load(tmp_path / "m").walls
    long = walls[np.hypot(*(walls[:, 1] - walls[:, 0]).T) > 1.5]
    assert len(long) == 6  # four walls of the room, two faces of the board
    for wall in floor.walls[[0, 1, 2, 3, 4, 6]]:
        middle = wall.mean(axis=0)
        assert min(_distance(middle, other) for other in long) < 0.05


def _distance(point: Array, wall: Array) -> float:
    a, b = wall
    along = (b - a) / np.hypot(*(b - a))
    t = np.clip((point - a) @ along, 0.0, np.hypot(*(b - a)))
    return float(np.hypot(*(point - a - t * along)))


def test_a_face_has_the_free_floor_on_its_left() -> None:
    occupied = np.zeros((40, 60), bool)
    occupied[:3] = occupied[-3:] = True
    occupied[:, :3] = occupied[:, -3:] = True
    grid = OccupancyGrid(occupied, ~occupied, 0.1, (0.0, 0.0))
    walls = walls_of(grid)
    assert len(walls) == 4
    for a, b in walls:
        left = np.array([-(b - a)[1], (b - a)[0]]) / np.hypot(*(b - a))
        assert (np.array([3.0, 2.0]) - 0.5 * (a + b)) @ left > 0.0


@pytest.mark.parametrize(
    ("keys", "grey", "expected"),
    [
        ("", 0, "occupied"),
        ("", 254, "free"),
        ("", 205, "unknown"),
        ("negate: 1", 254, "occupied"),
        ("negate: 1", 0, "free"),
        ("mode: scale", 254, "free"),
        ("mode: scale", 128, "unknown"),
        ("mode: raw", 100, "occupied"),
        ("mode: raw", 0, "free"),
        ("mode: raw", 255, "unknown"),
    ],
)
def test_grey_means_what_map_server_makes_of_it(
    tmp_path: Path, keys: str, grey: int, expected: str
) -> None:
    cv2.imwrite(str(tmp_path / "m.pgm"), np.full((4, 5), grey, np.uint8))
    text = "image: m.pgm\nresolution: 0.1\norigin: [1, 2, 0]\n" + keys + "\n"
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    grid = load(tmp_path / "m").grid
    assert grid.occupied.all() == (expected == "occupied")
    assert grid.free.all() == (expected == "free")
    assert grid.origin == (1.0, 2.0)


def test_the_lower_edge_of_the_picture_is_where_the_map_begins(tmp_path: Path) -> None:
    grey = np.full((4, 5), 254, np.uint8)
    grey[3, 1] = 0
    cv2.imwrite(str(tmp_path / "m.pgm"), grey)
    (tmp_path / "m.yaml").write_text(
        "image: m.pgm\nresolution: 1\norigin: [0, 0, 0]\n", encoding="utf-8"
    )
    assert np.argwhere(load(tmp_path / "m").grid.occupied).tolist() == [[0, 1]]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("resolution: 1\norigin: [0, 0, 0]", "1:1: image: is required"),
        ("image: m.pgm\nresolution: no\norigin: [0, 0, 0]", "2:1: resolution: must be a number"),
        ("image: m.pgm\nresolution: 0\norigin: [0, 0, 0]", "2:1: resolution: must be above 0"),
        ("image: m.pgm\nresolution: 1\norigin: [0]", r"3:1: origin: must be \[x, y, yaw\]"),
        ("image: m.pgm\nresolution: 1\norigin: [0, 0, 1]", "3:1: origin: a turned map"),
        ("image: m.pgm\nresolution: 1\norigin: [0, 0]\nmode: best", "4:1: mode: must be one of"),
        ("image: m.pgm\nresolution: 1\norigin: [0, 0]\nfree_thresh: 0.9", "free_thresh: must be"),
        ("image: n.pgm\nresolution: 1\norigin: [0, 0]", "1:1: image: .*n.pgm: No such file"),
        ("image: m.yaml\nresolution: 1\norigin: [0, 0]", "1:1: image: .*not a picture"),
        ("- 1", "expected the keys of a map"),
    ],
)
def test_a_fault_in_a_map_is_named_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    cv2.imwrite(str(tmp_path / "m.pgm"), np.zeros((4, 5), np.uint8))
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=says) as caught:
        load(tmp_path / "m")
    assert "m.yaml:" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("walls_m: 5", "1:1: walls_m must be a list"),
        ("walls_m:\n- [0, 0, 1, 1]\n- [0, 0, 1]", "3:3: walls_m: .* must be 4 numbers"),
        ("walls_m: [[0, 0, 1, nan]]", "must be 4 numbers"),
        ("wall: []", "1:1: unknown key wall"),
        ("{}", "needs walls_m or boards_m"),
        ("boards_m: [[0, 0, 1, 0, 0]]", "a thickness must be above 0"),
        ("walls_m: [[0, 0, 1, 1]]\ncell_m: 3", "2:1: cell_m: must be from"),
    ],
)
def test_a_fault_in_a_plan_is_named_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "plan.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=says):
        read_plan(file)


def test_the_floor_is_what_can_be_reached_from_a_given_point() -> None:
    corners = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]])
    walls = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    cabinet = 0.25 * walls + (3.0, 1.0)
    both = np.concatenate([walls, cabinet])
    outer = from_segments(both).grid.free.sum()
    inner = from_segments(both, free=np.array([[3.5, 1.25]])).grid.free.sum()
    assert 5 * inner < outer
    assert from_segments(walls[:1]).grid.free.any()


def test_a_map_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    floor = room(tmp_path)
    with pytest.raises(UsageError, match="cannot be written"):
        save(tmp_path / "none" / "m", floor)
