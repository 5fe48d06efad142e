"""Maps from logs, and the robot found on them: `followerd map` and `followerd localize`."""

import csv
import json
from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import degrees, hypot, pi
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import pytest

from followerd.__main__ import call
from followerd.bench.carmen import CarmenLog
from followerd.bench.mapping import matched_poses
from followerd.estimation.pose_graph import Edge, PoseGraph
from followerd.estimation.registry import LOCALIZERS
from followerd.estimation.scan_match import Field, Shape, Window
from followerd.geometry import Array, Pose2, wrap_angle
from followerd.maps.files import load
from followerd.messages import RobotPose, Scan
from tests.laser_scenes import legs, scan_of

# a ring of corridors around a block, with niches that tell its sides apart
OUTER = [
    (0, 0), (8.2, 0), (8.2, 0.5), (9, 0.5), (9, 7), (5, 7), (5, 7.6), (3.5, 7.6), (3.5, 7), (0, 7),
    (0, 4), (-0.5, 4), (-0.5, 3), (0, 3), (0, 0),
]  # fmt: skip
BLOCK = [(2, 2), (7, 2), (7, 5), (2, 5), (2, 2)]
WALLS = [(*a, *b) for corners in (OUTER, BLOCK) for a, b in pairwise(corners)]
SEGMENTS = np.array(WALLS, float)
NONE = np.empty((0, 3))
T = TypeVar("T")


def way() -> list[Pose2]:
    """One and a quarter rounds, in steps of a third of a metre or 18 degrees."""
    corners = [(1.0, 1.0), (8.0, 1.0), (8.0, 6.0), (1.0, 6.0), (1.0, 1.0), (8.0, 1.0)]
    poses: list[Pose2] = []
    for (ax, ay), (bx, by) in pairwise(corners):
        heading = np.arctan2(by - ay, bx - ax)
        turn = wrap_angle(heading - poses[-1].theta) if poses else 0.0
        poses += [
            Pose2(ax, ay, wrap_angle(heading - turn * k / 5)) for k in range(4, 0, -1) if turn
        ]
        steps = round(hypot(bx - ax, by - ay) * 3)
        poses += [
            Pose2(ax + (bx - ax) * k / steps, ay + (by - ay) * k / steps, heading)
            for k in range(steps)
        ]
    return poses


def drifting(poses: list[Pose2], rng: np.random.Generator) -> list[Pose2]:
    """Their odometry: 3 % too long, one degree a metre to the left, and noisy."""
    odometry = [Pose2(5.0, -3.0, 0.5)]
    for one, other in pairwise(poses):
        step = ~one @ other
        long = hypot(step.x, step.y)
        x, y = 1.03 * step.x, step.y
        theta = step.theta + 0.018 * long + 0.01 * rng.standard_normal()
        odometry.append(odometry[-1] @ Pose2(x, y, theta))
    return odometry


def written(
    path: Path, *, corrected: bool = True, every: int = 1, people: Array = NONE
) -> list[Pose2]:
    """A CARMEN log of that way; returns where the robot really was."""
    rng = np.random.default_rng(5)
    poses = way()[::every]
    lines = []
    for k, (pose, odometry) in enumerate(zip(poses, drifting(poses, rng), strict=True)):
        scan = scan_of(people, walls=SEGMENTS, step_deg=1.0, pose=pose, rng=rng)
        ranges = " ".join(f"{r:.3f}" if np.isfinite(r) else "81.91" for r in scan.ranges[:180])
        first = pose if corrected else odometry
        both = " ".join(f"{p.x:.6f} {p.y:.6f} {p.theta:.6f}" for p in (first, odometry))
        lines.append(f"FLASER 180 {ranges} {both} {0.2 * k:.2f} robot {0.2 * k:.2f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return poses


class Quiet:
    """Shows no bars."""

    def shown(self, items: Sequence[T], what: str) -> Iterator[T]:
        return iter(items)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("floor") / "ring.log"
    written(path)
    return path


@pytest.fixture(scope="module")
def floor(log: Path) -> Path:
    name = log.parent / "ring"
    assert call(["map", str(log), "--scans", "even", "--out", str(name)]) == 0
    return name


def from_wall(points: Array, walls: Array) -> Array:
    """Distance (N,) of points to the nearest of walls (K, 2, 2)."""
    a, b = walls[:, 0], walls[:, 1]
    along = b - a
    t = ((points[:, None] - a) * along).sum(axis=2) / (along * along).sum(axis=1)
    foot = a + np.clip(t, 0.0, 1.0)[..., None] * along
    nearest: Array = np.hypot(*(points[:, None] - foot).transpose(2, 0, 1)).min(axis=1)
    return nearest


def test_a_log_becomes_a_map_with_its_walls_where_they_are(floor: Path) -> None:
    made = load(floor)
    grid, truth = made.grid, SEGMENTS.reshape(-1, 2, 2)
    at = (np.argwhere(grid.occupied)[:, ::-1] + 0.5) * grid.cell + grid.origin
    assert (from_wall(at, truth) < 0.08).mean() > 0.98
    assert grid.free.sum() * grid.cell**2 == pytest.approx(48.0, rel=0.05)
    lengths = np.hypot(*(made.walls[:, 1] - made.walls[:, 0]).T)
    assert lengths.sum() > 38.0  # of 48 m
    middles = made.walls[lengths > 1.0].mean(axis=1)
    assert np.median(from_wall(middles, truth)) < 0.01
    assert from_wall(middles, truth).max() < 0.03


def test_the_check_picture_shows_walls_and_the_way(floor: Path) -> None:
    picture = cv2.imread(str(floor.with_suffix(".png")))
    assert picture is not None
    assert max(picture.shape) > 500
    colours = {tuple(pixel) for pixel in picture.reshape(-1, 3)[::7].tolist()}
    assert {(255, 255, 255), (205, 205, 205), (40, 40, 220)} <= colours


def test_matching_finds_the_way_that_odometry_lost(tmp_path: Path) -> None:
    truth = written(tmp_path / "raw.log", corrected=False, every=3)
    steps = list(CarmenLog(tmp_path / "raw.log"))

    found = matched_poses(steps, Quiet())
    world_from_map = truth[0] @ ~found[0]
    odometry_error = max(_off(truth, [s.ego for s in steps if s.ego], truth[0]))
    errors = _off(truth, found, world_from_map @ found[0])
    assert odometry_error > 1.0
    assert max(errors) < 0.12


def _off(truth: list[Pose2], found: list[Pose2], start: Pose2) -> list[float]:
    aligned = [start @ (~found[0] @ pose) for pose in found]
    return [hypot(a.x - b.x, a.y - b.y) for a, b in zip(truth, aligned, strict=True)]


def test_a_scan_is_found_a_good_way_from_where_it_was_expected() -> None:
    pose = Pose2(4.0, 1.0, 0.3)
    chords = [
        p.apply(
            Shape.of(scan_of(NONE, walls=SEGMENTS, pose=p).points(), (0, 0)).chords.reshape(-1, 2)
        )
        for p in (Pose2(3.0, 1.0, 0.0), Pose2(3.5, 1.2, 0.2), Pose2(5.0, 1.0, 0.0))
    ]
    field = Field(np.concatenate(chords).reshape(-1, 2, 2))
    points = Shape.of(scan_of(NONE, walls=SEGMENTS, pose=pose).points(), (0, 0)).points
    near = field.match(points, Pose2(4.2, 0.8, 0.4), Window(0.4, 0.2, 0.3, 0.2))
    far = field.match(points, Pose2(5.2, 0.4, 0.7), Window(2.0, 0.5, 2.0, 0.5))
    for match in (near, far):
        assert match is not None
        assert hypot(match.pose.x - 4.0, match.pose.y - 1.0) < 0.03
        assert degrees(abs(match.pose.theta - 0.3)) < 0.5
        assert match.score > 0.9
    assert field.match(points[:5], pose, Window(0.4, 0.2, 0.3, 0.2)) is None


def test_a_field_of_nothing_matches_nothing() -> None:
    field = Field(np.empty((0, 2, 2)))
    match = field.match(np.ones((30, 2)), Pose2(), Window(0.4, 0.2, 0.3, 0.2))
    assert match is not None
    assert match.score == 0.0


def square(wrong_loop: bool) -> PoseGraph:
    """Four steps of 1 m around a square, measured 5 % too long, closed by two loops."""
    graph = PoseGraph()
    graph.poses = [Pose2()]
    sure = np.diag([400.0, 400.0, 3000.0])
    for k in range(8):
        step = Pose2(1.05, 0.0, pi / 2 + 0.02)
        graph.poses.append(graph.poses[-1] @ step)
        graph.edges.append(Edge(k, k + 1, step, sure))
    for k in range(5):
        graph.edges.append(Edge(k, k + 4, Pose2(), sure, is_loop=True))
    if wrong_loop:
        graph.edges.append(Edge(1, 6, Pose2(3.0, 3.0, 1.0), sure, is_loop=True))
    return graph


@pytest.mark.parametrize("wrong_loop", [False, True])
def test_loops_pull_a_drifting_way_together_and_a_wrong_one_is_left_out(wrong_loop: bool) -> None:
    graph = square(wrong_loop)
    assert graph.distances(8)[4] == pytest.approx(1.0, abs=1e-4)
    assert graph.distances(8)[6] == pytest.approx(2.1, abs=1e-4)
    graph.optimise()
    last = graph.poses[4]
    assert hypot(last.x, last.y) < 0.05
    assert graph.poses[0] == Pose2()


class DeadReckoning:
    """A localizer for tests: it believes the odometry, and is lost after scan 30."""

    class Settings:
        """Takes nothing."""

    def __init__(self, settings: object, floor: object, rng: np.random.Generator) -> None:
        self._at: Pose2 | None = None
        self._map_from_odom: Pose2 | None = None
        self._count = 0

    def start(self, at: Pose2 | None) -> None:
        self._at = at

    def step(
        self, scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        self._count += 1
        if self._at is None:
            return None
        if self._map_from_odom is None:
            self._map_from_odom = self._at @ ~ego
        pose = self._map_from_odom @ ego
        covariance = np.diag([0.09, 0.16, 0.01])
        return RobotPose(scan.stamp, pose, self._map_from_odom, covariance, self._count > 30)


@pytest.fixture
def reckoning(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setitem(LOCALIZERS._table, "reckoning", f"{__name__}:DeadReckoning")
    return "reckoning"


def rows_of(file: Path) -> list[dict[str, str]]:
    with file.open(encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


def test_localize_writes_a_row_for_each_chosen_scan(
    log: Path, floor: Path, reckoning: str, tmp_path: Path
) -> None:
    out, summary = tmp_path / "x.csv", tmp_path / "x.json"
    options = ["--map", str(floor), "--scans", "odd", "--out", str(out), "--summary", str(summary)]
    assert call(["localize", str(log), "--localizer", reckoning, *options]) == 0
    rows = rows_of(out)
    assert list(rows[0]) == ["index", "stamp", "x", "y", "theta", "particles_spread"]
    assert [row["index"] for row in rows] == [str(2 * k + 1) for k in range(len(rows))]
    first = list(CarmenLog(log))[1].corrected
    assert first is not None
    assert float(rows[0]["x"]) == pytest.approx(first.x, abs=1e-4)
    assert float(rows[0]["particles_spread"]) == 0.5
    assert rows[30]["x"] == "nan"  # it says that it is lost
    found = json.loads(summary.read_text(encoding="utf-8"))
    assert (found["scans"], found["located"], found["start"]) == (len(rows), 30, "truth")
    assert 0.0 < found["within_0.5m"] < 1.0
    assert found["error_cm"]["max"] > found["error_cm"]["median"] > 1.0


def test_a_global_start_is_told_nothing(
    log: Path, floor: Path, reckoning: str, tmp_path: Path
) -> None:
    out, summary = tmp_path / "x.csv", tmp_path / "x.json"
    options = ["--map", str(floor), "--start", "global", "--out", str(out), "--summary"]
    assert call(["localize", str(log), "--localizer", reckoning, *options, str(summary)]) == 0
    found = json.loads(summary.read_text(encoding="utf-8"))
    assert (found["located"], found["within_0.5m"]) == (0, 0.0)
    assert found["error_cm"] == {"median": None, "p95": None, "max": None}


@pytest.mark.parametrize("kind", ["reckoning", "likelihood_field"])
def test_rows_never_depend_on_later_scans(
    log: Path, floor: Path, reckoning: str, kind: str, tmp_path: Path
) -> None:
    lines = log.read_text(encoding="utf-8").splitlines(keepends=True)
    texts = []
    for count in (12, 17):
        short = tmp_path / f"{count}.log"
        short.write_text("".join(lines[:count]), encoding="utf-8")
        out = tmp_path / f"{count}.csv"
        options = ["--localizer", kind, "--map", str(floor), "--out", str(out)]
        assert call(["localize", str(short), *options, "--start", "1,1,0"]) == 0
        texts.append(out.read_text(encoding="utf-8"))
    assert texts[1].startswith(texts[0])


@pytest.mark.parametrize(
    ("tokens", "says"),
    [
        (["none.log"], "none.log: no such file"),
        (["{log}", "--map", "none"], "none.yaml: no such file"),
        (["{log}", "--localizer", "dowsing"], "--localizer dowsing: unknown; there are "),
        (["{log}", "--start", "1,2"], "--start 1,2: give truth, global, or X,Y,THETA"),
        (["{log}", "--start", "-50,2,0"], "(-50.00, 2.00) lies outside the map"),
        (["{raw}", "--start", "truth"], "the log has no corrected poses"),
        (["{npz}", "--start", "global"], "the scans have no odometry"),
        (["{map}.yaml"], "not a CARMEN log"),
        (["{log}", "--summary", "/nowhere/x.json"], "--summary /nowhere/x.json: cannot be written"),
    ],
)
def test_what_cannot_be_localized_is_said_in_one_line(
    log: Path,
    floor: Path,
    reckoning: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    tokens: list[str],
    says: str,
) -> None:
    written(tmp_path / "raw.log", corrected=False, every=25)
    np.savez(tmp_path / "x.npz", t=[0.0], ranges=np.ones((1, 9)), angle_min=-1.0, angle_inc=0.2)
    places = {"log": log, "raw": tmp_path / "raw.log", "npz": tmp_path / "x.npz", "map": floor}
    given = [token.format(**places) for token in tokens]
    if "--map" not in given:
        given += ["--map", str(floor)]
    if "--localizer" not in given:
        given += ["--localizer", reckoning]
    assert call(["localize", *given, "--out", str(tmp_path / "x.csv")]) == 2
    error = capsys.readouterr().err.strip()
    assert says in error
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize(
    ("tokens", "says"),
    [
        (["none.log"], "none.log: no such file"),
        (["{raw}", "--poses", "log"], "no corrected poses; use --poses match"),
        (["{npz}", "--poses", "match"], "the scans have no odometry"),
        (["{empty}"], "the scans hold no returns"),
        (["{one}", "--scans", "odd"], "there are no odd scans"),
        (["{log}", "--out", "/nowhere/m"], "/nowhere/m.yaml: cannot be written"),
    ],
)
def test_what_cannot_be_mapped_is_said_in_one_line(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], tokens: list[str], says: str
) -> None:
    written(tmp_path / "raw.log", corrected=False, every=25)
    one = log.read_text(encoding="utf-8").splitlines()[0]
    (tmp_path / "one.log").write_text(one, encoding="utf-8")
    np.savez(tmp_path / "x.npz", t=[0.0], ranges=np.ones((1, 9)), angle_min=-1.0, angle_inc=0.2)
    nothing = " ".join(["81.91"] * 180)
    (tmp_path / "e.log").write_text(f"FLASER 180 {nothing} 0 0 0 0 0 0 1 h 1", encoding="utf-8")
    places = {name: tmp_path / f"{name}.log" for name in ("raw", "one")}
    places |= {"log": log, "npz": tmp_path / "x.npz", "empty": tmp_path / "e.log"}
    given = [token.format(**places) for token in tokens]
    if "--out" not in given:
        given += ["--out", str(tmp_path / "m")]
    assert call(["map", *given]) == 2
    error = capsys.readouterr().err.strip()
    assert says in error
    assert len(error.splitlines()) == 1


def test_a_plan_and_a_simulated_world_become_maps(tmp_path: Path) -> None:
    plan = tmp_path / "plan.yaml"
    rows = "".join(f"- [{', '.join(map(str, wall))}]\n" for wall in WALLS)
    plan.write_text(f"free_m: [[1, 1]]\nwalls_m:\n{rows}", encoding="utf-8")
    assert call(["map", str(plan), "--out", str(tmp_path / "p")]) == 0
    assert load(tmp_path / "p").grid.free.sum() * 0.05**2 == pytest.approx(46.0, rel=0.05)
    assert call(["map", "office", "--out", str(tmp_path / "o")]) == 0
    assert len(load(tmp_path / "o").walls) > 20


def test_turning_a_world_turns_what_is_found() -> None:
    """Matching knows no preferred direction: the same scene turned gives the same step."""
    steps = []
    for angle in (0.0, 1.1):
        turned = Pose2(theta=angle)
        ends = turned.apply(SEGMENTS.reshape(-1, 2)).reshape(-1, 4)
        start, moved = turned @ Pose2(1.0, 1.0, 0.0), turned @ Pose2(1.3, 1.05, 0.1)
        before = Shape.of(scan_of(NONE, walls=ends, pose=start).points(), (0, 0))
        after = Shape.of(scan_of(NONE, walls=ends, pose=moved).points(), (0, 0))
        match = Field(before.chords).match(after.points, Pose2(0.3), Window(0.4, 0.2, 0.2, 0.2))
        assert match is not None
        steps.append((match.pose.x, match.pose.y, match.pose.theta))
    assert steps[0] == pytest.approx((0.3, 0.05, 0.1), abs=0.02)
    assert steps[1] == pytest.approx(steps[0], abs=0.02)


def test_a_person_is_tracked_in_a_carmen_log(tmp_path: Path) -> None:
    path, out = tmp_path / "x.log", tmp_path / "x.csv"
    poses = written(path, every=9, people=legs((2.5, 1.0), 0.0))
    assert (
        call(["track", str(path), "--tracker", "legs", "--init", "1.5,0", "--out", str(out)]) == 0
    )
    rows = rows_of(out)
    assert len(rows) == len(poses)
    assert {row["frame"] for row in rows} == {"odom"}
    assert rows[0]["status"] == "tracked"
