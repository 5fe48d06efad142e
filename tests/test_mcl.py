"""Monte Carlo localisation: table of scans, field, cloud, and the localizers that use them."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from math import cos, degrees, hypot, pi, radians, sin, sqrt
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.bench import kwolek_mcl
from followerd.bench.kwolek_room import Trial, is_clear, wander
from followerd.errors import ConfigError
from followerd.estimation.claims import bridged, unclaimed
from followerd.estimation.likelihood_field import Coarse, FieldSensor, FieldSettings
from followerd.estimation.mcl import tempered
from followerd.estimation.pose_cloud import MotionNoise, cube_estimate, mean_pose, moved
from followerd.estimation.registry import LOCALIZERS
from followerd.estimation.scan_histogram import BEST, HistogramSensor
from followerd.geometry import Array, Pose2, wrap_angle
from followerd.localizers.fine_lines import FineSettings
from followerd.localizers.likelihood_field import LikelihoodField, LikelihoodFieldSettings
from followerd.localizers.scan_histogram import ScanHistogram, ScanHistogramSettings
from followerd.maps import table_cache
from followerd.maps.distance_field import DistanceField
from followerd.maps.floor import FloorMap, OccupancyGrid
from followerd.maps.plan import from_segments
from followerd.maps.scan_table import (
    BEAMS,
    HEADINGS,
    ScanTable,
    TableShape,
    build,
    ranges_along,
    stride_of,
)
from followerd.maps.table_cache import table_for
from followerd.messages import Scan
from followerd.sim.raycast import cast

CORNERS = [(0.0, 0.0), (2.4, 0.0), (2.4, 0.9), (1.6, 0.9), (1.6, 2.0), (0.0, 2.0)]
WALLS = np.array([[a, b] for a, b in zip(CORNERS, CORNERS[1:] + CORNERS[:1], strict=True)])
NOBODY = np.empty((0, 3))
RNG = np.random.default_rng(99)
EXACT = MotionNoise(along_m=0.01, drift_deg=5.0, turn_share=0.0, turn_deg=0.0, tail_share=0.0)


def scan_at(pose: Pose2, mount: Pose2 | None = None, people: Array = NOBODY) -> Scan:
    """What the laser sees of WALLS, 180 beams."""
    laser = pose @ (mount or Pose2())
    bearings = np.radians(np.arange(-90.0, 90.0))
    ways = np.column_stack([np.cos(bearings + laser.theta), np.sin(bearings + laser.theta)])
    ranges = cast(np.array([laser.x, laser.y]), ways, WALLS.reshape(-1, 4), people)
    step = radians(1.0)
    return Scan(0.0, 0.0, -pi / 2, step, ranges, 8.0, np.zeros(180), mount or Pose2())


def share_near(poses: Array, to: Pose2) -> float:
    """The share of poses (3, N) within 0.3 m and 20 degrees."""
    turned = (poses[2] - to.theta + pi) % (2 * pi) - pi
    near = np.hypot(poses[0] - to.x, poses[1] - to.y) < 0.3
    return float((near & (np.abs(turned) < radians(20.0))).mean())


@pytest.fixture(scope="module")
def floor() -> FloorMap:
    return from_segments(WALLS, 0.1, np.array([[0.5, 0.5]]))


@pytest.fixture(scope="module")
def tables(floor: FloorMap) -> dict[int, ScanTable]:
    return {bins: build(floor.grid, TableShape(bins=bins)) for bins in (4, 8)}


@pytest.fixture(scope="module")
def table(tables: dict[int, ScanTable]) -> ScanTable:
    return tables[8]


def test_ranges_on_the_grid_are_those_to_the_walls() -> None:
    grid = from_segments(WALLS, 0.05, np.array([[0.5, 0.5]])).grid
    j, i = np.nonzero(grid.free)
    places = np.column_stack([i + 0.5, j + 0.5]) * grid.cell + grid.origin
    for angle in np.radians([0.0, 17.0, 90.0, 133.0, 180.0, 251.0, 300.0]).tolist():
        way = np.tile([cos(angle), sin(angle)], (len(places), 1))
        true = cast(places, way, WALLS.reshape(-1, 4), NOBODY)
        found = ranges_along(grid, angle)[grid.free]
        assert np.median(np.abs(found - true)) < grid.cell
        assert np.mean(np.abs(found - true) > 3 * grid.cell) < 0.08  # rays that pass a corner


@pytest.mark.parametrize("bins", [4, 8])
def test_the_table_counts_what_counting_beam_by_beam_does(
    floor: FloorMap, tables: dict[int, ScanTable], bins: int
) -> None:
    table = tables[bins]
    grid, centres = floor.grid, table.centres()
    far = [ranges_along(grid, radians(k)) for k in range(360)]
    rng = np.random.default_rng(1)
    for place, heading in rng.integers(0, (len(centres), HEADINGS), (25, 2)).tolist():
        i, j = np.floor((centres[place] - grid.origin) / grid.cell).astype(int).tolist()
        expected = np.zeros(2 * bins)
        for beam in range(-90, 90):
            r = float(far[(4 * heading + beam) % 360][j, i])
            x, y = r * cos(radians(beam)), r * sin(radians(beam))
            column = int(x / table.reach * bins)
            row = int((y + table.reach) / (2 * table.reach) * bins // 1)
            expected[min(max(column, 0), bins - 1)] += 1
            expected[bins + min(max(row, 0), bins - 1)] += 1
        counted = table.counts[place, heading].astype(float)
        assert counted.sum() == 2 * BEAMS
        assert np.abs(counted - expected).sum() <= 12  # beams on the border of a bin


def test_a_scan_fits_its_place_in_the_table_best(table: ScanTable) -> None:
    sensor = HistogramSensor(table, 20.0)
    pose = Pose2(0.62, 1.31, 0.7)
    sensor.see(scan_at(pose), None)
    assert sensor.fit(pose) > 0.85
    scores = table.counts.reshape(-1, 16).astype(float)
    brute = np.minimum(scores, np.round(sensor._seen)).sum(axis=1)
    best = sensor.best_rows()
    assert brute[best].max() == brute.max()
    assert brute[best].min() >= np.sort(brute)[-2 * BEST]
    found = sensor.search(500, np.random.default_rng(0))
    assert share_near(found, pose) > 3.0 * share_near(sensor.anywhere(500, RNG), pose)


@pytest.mark.parametrize("bins", [4, 8])
def test_scores_by_words_are_sums_of_the_smaller_counts(
    tables: dict[int, ScanTable], bins: int
) -> None:
    sensor = HistogramSensor(tables[bins], 20.0)
    sensor.see(scan_at(Pose2(0.5, 0.5, 1.0)), None)
    rows = tables[bins].counts.reshape(-1, 2 * bins)[:5000]
    seen = np.round(sensor._seen).astype(int)
    expected = np.minimum(rows.astype(int), seen).sum(axis=1)
    assert (sensor._scores(rows) == expected).all()


def test_a_laser_off_the_middle_sees_from_where_it_is(table: ScanTable) -> None:
    mount, pose = Pose2(0.2, 0.0, 0.0), Pose2(0.5, 1.0, -0.9)
    sensor = HistogramSensor(table, 20.0)
    sensor.see(scan_at(pose, mount), None)
    assert sensor.fit(pose) > 0.85
    assert sensor.fit(pose @ mount) < sensor.fit(pose)
    found = sensor.search(500, np.random.default_rng(0))
    assert share_near(found, pose) > 3.0 * share_near(sensor.anywhere(500, RNG), pose)


def test_nobody_can_be_in_a_wall_or_off_the_map(table: ScanTable) -> None:
    sensor = HistogramSensor(table, 20.0)
    sensor.see(scan_at(Pose2(0.5, 0.5, 0.0)), None)
    log = sensor.log_likelihood(np.array([[0.5, 0.0, 99.0], [0.5, 0.0, -99.0], [0.0, 0.0, 0.0]]))
    assert log[0] > -3.0
    assert (log[1:] < -20.0).all()


def test_beams_on_the_person_are_left_out_and_the_wall_goes_on_behind() -> None:
    pose = Pose2(0.9, 1.0, pi)
    alone = scan_at(pose)
    person = scan_at(pose, people=np.array([[0.5, 1.0, 0.1]]))
    hidden = np.abs(person.ranges - alone.ranges) > 1e-6
    assert hidden.sum() > 20
    points = unclaimed(person, (0.4, 0.0))
    assert np.isnan(points[hidden]).all()
    filled = bridged(points, person)
    assert np.abs(filled - alone.points())[hidden].max() < 0.1


def test_a_map_too_large_gets_coarser_cells_and_then_a_remedy() -> None:
    free = np.ones((1000, 1000), np.bool_)
    grid = OccupancyGrid(~free, free, 0.05, (0.0, 0.0))
    assert stride_of(grid, TableShape(max_bytes=100_000_000)) == 4  # 20 cm
    with pytest.raises(ConfigError, match="likelihood_field"):
        stride_of(grid, TableShape(max_bytes=20_000_000))


def test_a_kept_table_is_read_and_a_broken_one_is_built_anew(
    floor: FloorMap, table: ScanTable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[float] = []
    first = table_for(floor.grid, TableShape(), tmp_path, done.append)
    assert done[-1] == 1.0
    assert (first.counts == table.counts).all()
    assert first.reach == pytest.approx(table.reach)
    again = table_for(floor.grid, TableShape(), tmp_path, done.append)
    assert isinstance(again.counts, np.memmap)
    next(tmp_path.glob("*.npy")).write_bytes(b"torn")
    mended = table_for(floor.grid, TableShape(), tmp_path)
    assert (mended.counts == table.counts).all()
    key = table_cache.key_of
    assert key(floor.grid, TableShape()) != key(floor.grid, TableShape(bins=4))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert table_cache.cache_dir() == tmp_path / "followerd" / "scan_tables"


def test_the_distance_field_is_the_distance_to_the_nearest_wall() -> None:
    grid = from_segments(WALLS, 0.05, np.array([[0.5, 0.5]])).grid
    field = DistanceField.of(grid)
    j, i = np.nonzero(field.free)
    walls = np.argwhere(grid.occupied)
    brute = [np.hypot(*(walls - (a, b)).T).min() for a, b in zip(j, i, strict=True)]
    assert np.allclose(field.far[field.free], np.array(brute) * field.cell, atol=1e-4)


def test_the_field_sums_over_the_beams_as_a_loop_does(floor: FloorMap) -> None:
    settings = FieldSettings()
    field = DistanceField.of(floor.grid)
    sensor = FieldSensor(field, settings)
    pose = Pose2(0.5, 1.0, 0.4)
    scan = scan_at(pose)
    scan = replace(scan, ranges=scan.ranges + 0.013)  # off the borders of cells
    sensor.see(scan, None)
    points = scan.points()[np.linspace(0, 179, settings.beams).astype(int)]
    poses = [Pose2(0.5, 1.0, 0.4), Pose2(0.7, 1.0, 0.4), Pose2(0.5, 1.0, 1.0)]
    expected = []
    for p in poses:
        total = 0.0
        for x, y in p.apply(points).tolist():
            i = int(np.floor((x - field.origin[0]) / field.cell))
            j = int(np.floor((y - field.origin[1]) / field.cell))
            inside = 0 <= i < field.far.shape[1] and 0 <= j < field.far.shape[0]
            far = float(field.far[j, i]) if inside else 2.0
            gauss = np.exp(-0.5 * (far / settings.sigma_m) ** 2)
            share = settings.stray_share
            total += settings.trust * np.log((1 - share) * gauss + share)
        expected.append(total)
    found = sensor.log_likelihood(np.array([(p.x, p.y, p.theta) for p in poses]).T)
    assert found == pytest.approx(expected, abs=1e-3)
    assert found.argmax() == 0


def test_the_robot_may_stand_where_no_scan_of_the_map_saw_the_floor_but_not_in_a_wall() -> None:
    grid = from_segments(WALLS, 0.05, np.array([[0.5, 0.5]])).grid
    unseen = replace(grid, free=np.zeros_like(grid.free))
    pose, in_wall = np.array([[0.5], [1.0], [0.4]]), np.array([[0.5], [0.01], [0.4]])
    found = []
    for one in (grid, unseen):
        sensor = FieldSensor(DistanceField.of(one), FieldSettings())
        sensor.see(scan_at(Pose2(0.5, 1.0, 0.4)), None)
        found.append(float(sensor.log_likelihood(pose)[0]))
        assert sensor.log_likelihood(in_wall)[0] < -25.0
    assert found[1] == pytest.approx(found[0] - 1.0)


def test_shifted_pictures_sum_what_each_place_sees(floor: FloorMap) -> None:
    coarse = Coarse(DistanceField.of(floor.grid))
    points, theta = np.array([[0.6, 0.1], [0.2, -0.7], [1.1, 0.4]]), 0.8
    sums = coarse._scores(points, theta)
    turned = np.rint(Pose2(theta=theta).apply(points) / coarse.cell).astype(int)
    height, width = coarse._score.shape
    for k in range(0, sums.size, 7):
        expected = 0
        for dx, dy in turned.tolist():
            x, y = coarse._i[k] + dx, coarse._j[k] + dy
            if 0 <= x < width and 0 <= y < height:
                expected += int(coarse._score[y, x])
        assert sums[k] == expected


def test_the_search_of_the_field_finds_the_place(floor: FloorMap) -> None:
    sensor = FieldSensor(DistanceField.of(floor.grid), FieldSettings())
    pose = Pose2(0.7, 1.3, 2.2)
    sensor.see(scan_at(pose), None)
    found = sensor.search(50, np.random.default_rng(0))
    assert share_near(found[:, :2], pose) >= 0.5  # the room is nearly its own mirror image


@given(st.integers(1, 8))
def test_noise_grows_with_the_way_whatever_the_steps(steps: int) -> None:
    rng = np.random.default_rng(steps)
    poses: Array = np.zeros((3, 4000))
    for _ in range(steps):
        poses = moved(poses, Pose2(1.0 / steps), EXACT, rng)
    assert degrees(poses[2].std()) == pytest.approx(5.0, rel=0.08)
    assert poses[1].std() == pytest.approx(radians(5.0) / sqrt(3.0), rel=0.08)
    assert np.corrcoef(poses[1], poses[2])[0, 1] == pytest.approx(sqrt(3.0) / 2.0, abs=0.03)


def test_right_turns_and_backward_ways_are_as_noisy_as_left_and_forward_ones() -> None:
    for one, other in (
        (Pose2(theta=1.0), Pose2(theta=-1.0)),
        (Pose2(0.5), Pose2(-0.5)),
    ):
        spreads, means = [], []
        for step in (one, other):
            poses = moved(np.zeros((3, 4000)), step, MotionNoise(), np.random.default_rng(3))
            spreads.append(poses.std(axis=1))
            means.append(poses.mean(axis=1))
        assert spreads[0] == pytest.approx(spreads[1], rel=0.1)
        assert means[0] == pytest.approx(-means[1], abs=0.05)


def test_the_mean_is_one_of_directions_and_normalised() -> None:
    poses = np.array([[1.0, 3.0], [0.0, 0.0], [pi - 0.1, -pi + 0.1]])
    mean = mean_pose(poses, np.array([0.2, 0.2]))
    assert (mean.x, mean.y) == pytest.approx((2.0, 0.0))
    assert abs(wrap_angle(mean.theta - pi)) < 1e-9


def test_the_estimate_is_where_most_of_the_weight_is_not_the_single_best() -> None:
    rng = np.random.default_rng(0)
    crowd = np.array([[1.0], [1.0], [0.0]]) + 0.05 * rng.standard_normal((3, 99))
    poses = np.concatenate([crowd, [[4.0], [4.0], [1.0]]], axis=1)
    weights = np.full(100, 0.9 / 99)
    weights[-1] = 0.1
    pose, share = cube_estimate(poses, weights)
    assert hypot(pose.x - 1.0, pose.y - 1.0) < 0.05
    assert share == pytest.approx(0.9)
    lone, _ = cube_estimate(poses, weights, candidates=1)
    assert lone.x == pytest.approx(4.0)


def test_one_scan_leaves_enough_particles() -> None:
    log = np.linspace(-500.0, 0.0, 100)
    weights = tempered(np.full(100, 0.01), log, 20.0)
    assert weights.sum() == pytest.approx(1.0)
    assert 19.0 < 1.0 / float(weights @ weights) < 45.0
    free = tempered(np.full(100, 0.01), log, 0.0)
    assert free[-1] > 0.99


def test_localizers_are_known_by_name() -> None:
    assert {"scan_histogram", "likelihood_field"} <= set(LOCALIZERS.names())
    assert LOCALIZERS.load("scan_histogram") is ScanHistogram
    assert LOCALIZERS.load("likelihood_field") is LikelihoodField


@pytest.mark.parametrize("kind", ["scan_histogram", "likelihood_field"])
def test_a_localizer_finds_its_place_keeps_it_and_stands_still_in_between(
    floor: FloorMap, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cls = LOCALIZERS.load(kind)
    localizer = cls(cls.Settings(particles=400), floor, np.random.default_rng(1))
    localizer.start(None)
    truth, ego = Pose2(0.5, 0.5, 0.3), Pose2(5.0, 5.0, -1.0)
    step = Pose2(0.07, 0.0, 0.12)
    found = []
    for _ in range(12):
        pose = localizer.step(scan_at(truth), ego)
        again = localizer.step(scan_at(truth), ego)
        carried = ~pose.map_from_base @ again.map_from_base
        assert hypot(carried.x, carried.y) < 1e-9
        found.append((pose, truth))
        truth, ego = truth @ step, ego @ step
    assert found[0][0].lost
    assert not found[-1][0].lost
    for pose, true in found[-4:]:
        off = ~true @ pose.map_from_base
        assert hypot(off.x, off.y) < 0.2
    last = found[-1][0]
    assert np.linalg.eigvalsh(last.covariance).min() >= 0.0
    odom = last.map_from_odom @ (ego @ ~step)
    assert hypot(odom.x - last.map_from_base.x, odom.y - last.map_from_base.y) < 1e-9
    localizer.start(Pose2(0.5, 0.5, 0.3))
    told = localizer.step(scan_at(Pose2(0.5, 0.5, 0.3)), Pose2())
    assert not told.lost


def test_draws_round_the_estimate_sharpen_it_where_the_cloud_is_thin() -> None:
    floor = from_segments(WALLS, 0.02, np.array([[0.5, 0.5]]))
    truth = Pose2(0.9, 0.8, 0.7)
    errors: dict[int, list[float]] = {0: [], 300: []}
    for draws, found in errors.items():
        for seed in range(10):
            settings = LikelihoodFieldSettings(particles=50, draws=draws)
            localizer = LikelihoodField(settings, floor, np.random.default_rng(seed))
            localizer.start(truth @ Pose2(0.08, -0.05, 0.03))
            pose = localizer.step(scan_at(truth), Pose2())
            assert pose is not None
            found.append(hypot(pose.map_from_base.x - truth.x, pose.map_from_base.y - truth.y))
    assert np.mean(errors[300]) < 0.6 * np.mean(errors[0])
    assert max(errors[300]) < 0.03


def test_the_fine_pose_is_the_cloud_s_or_near_it(floor: FloorMap) -> None:
    settings = LikelihoodFieldSettings(particles=300, fine=FineSettings())
    localizer = LikelihoodField(settings, floor, np.random.default_rng(1))
    truth, ego = Pose2(0.5, 0.5, 0.3), Pose2()
    localizer.start(truth)
    step = Pose2(0.06, 0.0, 0.1)
    errors = []
    for _ in range(12):
        pose = localizer.step(scan_at(truth), ego)
        assert pose is not None
        assert not pose.lost
        off = ~truth @ pose.map_from_base
        errors.append(hypot(off.x, off.y))
        truth, ego = truth @ step, ego @ step
    assert max(errors) < 0.15
    assert float(np.median(errors)) < 0.03


def test_the_wanderer_stays_clear_and_its_odometry_does_not_feel_the_kidnapping() -> None:
    seen = list(wander(Trial(updates=12, kidnapped_at=6, blocked=0.15), np.random.default_rng(7)))
    assert all(is_clear(moment.truth) for moment in seen)
    steps = [hypot(b.truth.x - a.truth.x, b.truth.y - a.truth.y) for a, b in pairwise(seen)]
    assert max(steps[:5] + steps[6:]) < 0.2
    assert seen[5].ego == seen[6].ego
    assert all(moment.person is not None for moment in seen)


@pytest.mark.slow
def test_the_suite_s_rows_are_the_design_s(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with ThreadPoolExecutor(1) as executor:
        report = kwolek_mcl.suite(executor, 1, quick=True)
    assert {"mcl", "mcl-blocked", "mcl-kidnapped"} <= {row.scenario for row in report.rows}
    trackers = {"scan_histogram/paper", "scan_histogram/default", "likelihood_field"}
    assert {row.tracker for row in report.rows} == trackers
    figures = {row.metric: row for row in report.rows if row.tracker == "scan_histogram/default"}
    for metric in (
        "success_percent",
        "updates_to_converge",
        "error_cm",
        "heading_error_deg",
        "update_ms",
        "table_mb",
        "build_s",
    ):
        assert figures[metric].value is not None
    size, loaded = figures["table_mb"].value, figures["load_s"].value
    assert size is not None
    assert loaded is not None
    assert size <= 100.0
    assert loaded <= 0.3
    assert all(row.suite == "kwolek" for row in report.rows)
    assert len(report.plots) == 5


@pytest.mark.slow
def test_the_room_is_found_and_found_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    settings = ScanHistogramSettings()
    for scenario, least in (("mcl", 5), ("mcl-blocked", 4), ("mcl-kidnapped", 4)):
        good = 0
        for seed in range(5):
            world, rng = np.random.default_rng(seed).spawn(2)
            localizer = ScanHistogram(settings, kwolek_mcl._room(), rng)
            localizer.start(None)
            trial = kwolek_mcl.SCENARIOS[scenario]
            places = []
            for moment in wander(trial, world):
                pose = localizer.step(moment.scan, moment.ego, moment.person)
                assert pose is not None
                off = ~moment.truth @ pose.map_from_base
                places.append(hypot(off.x, off.y))
            start = (trial.kidnapped_at or 20) + 10
            good += max(places[start:]) < 0.3
        assert good >= least
