"""Maps of real floors from recorded logs; slow, and only beside the shared recordings."""

from itertools import pairwise
from math import degrees
from pathlib import Path
from time import process_time

import numpy as np
import pytest

from followerd.__main__ import call
from followerd.bench.carmen import CarmenLog
from followerd.bench.mapping import matched_poses
from followerd.bench.scan_logs import open_log
from followerd.geometry import Array, Pose2, wrap_angle
from followerd.maps.files import load
from tests.test_mapping import Quiet, rows_of

LOGS = Path(__file__).parents[2] / "shared" / "data" / "laser_map"
SCANS = {"aces": 440, "edmonton": 340, "freiburg-079": 4791, "intel": 910}

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not LOGS.is_dir(), reason="no recordings at ../shared/data/laser_map"),
]


def log_of(name: str) -> Path:
    return LOGS / f"carmen_{name}" / f"{name}-corrected.log.gz"


def errors(found: list[Pose2], right: list[Pose2]) -> tuple[Array, Array]:
    """Distances (N,), m, and turns (N,), deg, once the ways are laid over each other."""
    a, b = (np.array([(p.x, p.y) for p in poses]) for poses in (found, right))
    spread = (a - a.mean(axis=0)).T @ (b - b.mean(axis=0))
    turn = float(np.arctan2(spread[0, 1] - spread[1, 0], spread[0, 0] + spread[1, 1]))
    laid = Pose2(theta=turn).apply(a - a.mean(axis=0)) + b.mean(axis=0)
    turns = [abs(wrap_angle(p.theta + turn - q.theta)) for p, q in zip(found, right, strict=True)]
    return np.hypot(*(laid - b).T), np.degrees(turns)


@pytest.mark.parametrize("name", SCANS)
def test_recorded_logs_are_read_whole(name: str) -> None:
    log = CarmenLog(log_of(name))
    assert log.count == SCANS[name]
    assert log.is_corrected
    steps = list(log)
    ways = np.array([np.hypot(s.corrected.x, s.corrected.y) for s in steps if s.corrected])
    assert ways.size == log.count
    drift = [
        degrees(abs((~(~a.corrected @ b.corrected) @ (~a.ego @ b.ego)).theta))
        for a, b in pairwise(steps)
        if a.corrected and b.corrected and a.ego and b.ego
    ]
    assert np.median(drift) < 4.0  # the odometry of a step is that of the corrected one, nearly


@pytest.mark.parametrize("number", [1, 2, 3])
def test_wean_halls_logs_have_a_laser_25_cm_ahead(number: int) -> None:
    log = open_log(LOGS / "wean_hall" / f"robotdata{number}.log.gz")
    step = next(iter(log))
    assert step.scan.base_from_laser.x == pytest.approx(0.25, abs=1e-3)
    assert step.corrected is None
    assert step.scan.ranges.size == 180


def test_wean_halls_map_is_read_with_its_walls() -> None:
    floor = load(LOGS / "wean_hall" / "wean_map")
    assert floor.grid.occupied.shape == (800, 800)
    assert np.hypot(*(floor.walls[:, 1] - floor.walls[:, 0]).T).sum() > 300.0


def test_thousands_of_scans_are_a_map_in_seconds(tmp_path: Path) -> None:
    begun = process_time()
    name = tmp_path / "m"
    assert call(["map", str(log_of("freiburg-079")), "--scans", "even", "--out", str(name)]) == 0
    assert process_time() - begun < 15.0  # 4 were measured
    floor = load(name)
    assert floor.grid.free.sum() * floor.grid.cell**2 == pytest.approx(375.0, rel=0.05)
    assert np.hypot(*(floor.walls[:, 1] - floor.walls[:, 0]).T).sum() > 200.0


def test_scans_and_odometry_alone_give_the_way_through_a_building() -> None:
    """ACES: 323 m, a ring of corridors; odometry alone is metres off."""
    steps = list(CarmenLog(log_of("aces")))
    right = [step.corrected for step in steps if step.corrected]
    alone, _ = errors([step.ego for step in steps if step.ego], right)
    places, turns = errors(matched_poses(steps, Quiet()), right)
    assert np.median(alone) > 2.0
    assert np.median(places) < 0.2
    assert places.max() < 0.8
    assert np.percentile(turns, 95) < 3.0


def test_the_robot_is_found_on_the_map_of_the_other_half_of_its_scans(tmp_path: Path) -> None:
    log, name, out = str(log_of("edmonton")), str(tmp_path / "m"), tmp_path / "x.csv"
    assert call(["map", log, "--scans", "even", "--out", name]) == 0
    options = ["--map", name, "--scans", "odd", "--out", str(out)]
    assert call(["localize", log, "--localizer", "likelihood_field", *options]) == 0
    steps = {step.index: step.corrected for step in CarmenLog(log_of("edmonton"))}
    rows = rows_of(out)
    off = []
    for row in rows:
        right = steps[int(row["index"])]
        assert right is not None
        off.append(np.hypot(float(row["x"]) - right.x, float(row["y"]) - right.y))
    assert len(rows) == 170
    assert np.nanmedian(off) < 0.1
    assert (np.nan_to_num(off, nan=9.0) < 0.5).mean() > 0.95
