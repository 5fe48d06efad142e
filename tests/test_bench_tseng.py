"""Suite `tseng`: the room, the walker and the robot that trails along, and what is reported."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from math import inf

import numpy as np
import pytest

from followerd.bench import tseng
from followerd.bench import tseng_localization as localization
from followerd.bench.tseng import COLUMNS, Job, bootstrapped, hidden_for, rows, run
from followerd.bench.tseng_room import CLEARANCE, ROOM, Room, Streets, distance, gap
from followerd.bench.tseng_sight import sighted
from followerd.bench.tseng_world import PERIOD, Moment, Plan, furnished, moments, scanned
from followerd.geometry import Array, Pose2

BOARD = (4 + 2j, 4 + 4j)


def test_segments_that_cross_have_no_gap() -> None:
    assert gap((0j, 2 + 0j), (1 - 1j, 1 + 1j)) == 0.0
    assert gap((0j, 2 + 0j), (1 + 0.5j, 1 + 1j)) == pytest.approx(0.5)
    assert gap((0j, 2 + 0j), (3 + 0j, 4 + 0j)) == pytest.approx(1.0)


def test_streets_lead_round_a_board() -> None:
    streets = Streets([BOARD])
    assert not streets.sees(3 + 3j, 5 + 3j)
    path = [3 + 3j, *streets.way(3 + 3j, 5 + 3j)]
    assert path[-1] == 5 + 3j
    assert len(path) == 4
    legs = list(pairwise(path))
    assert all(gap(leg, BOARD) > CLEARANCE for leg in legs)
    assert 3.2 < sum(abs(b - a) for a, b in legs) < 4.2


@pytest.fixture(scope="module")
def walk() -> tuple[Room, list[Moment]]:
    rng = np.random.default_rng(5)
    plan = replace(Plan(), duration=30.0)
    room = furnished(plan, rng)
    return room, list(moments(room, plan, rng))


def test_a_walker_passes_no_board_and_stays_in_the_room(walk: tuple[Room, list[Moment]]) -> None:
    room, seen = walk
    assert len(room.boards) == 4
    for moment in seen:
        assert 0.2 < moment.person.real < ROOM[0] - 0.2
        assert 0.2 < moment.person.imag < ROOM[1] - 0.2
        assert min(distance(board, moment.person) for board in room.boards) > 0.3
    steps = np.abs(np.diff([moment.person for moment in seen])) / PERIOD
    assert 0.3 < steps.mean() < 0.9
    assert steps.max() < 1.0


def test_the_robot_trails_along_and_looks_at_the_person(walk: tuple[Room, list[Moment]]) -> None:
    _, seen = walk
    for moment in seen:
        there = (moment.person - complex(moment.robot.x, moment.robot.y)) * np.exp(
            -1j * moment.robot.theta
        )
        assert abs(np.angle(there)) < 1e-6
        assert abs(there) < 3.7


def test_candidates_are_the_person_and_no_ghosts(walk: tuple[Room, list[Moment]]) -> None:
    room, seen = walk
    found, ghosts, fully = 0, 0, 0
    for moment in seen:
        sweep = sighted(moment.scan, moment.believed, (0.04, 0.015), room.segments)
        off = np.abs(sweep.people - moment.person)
        ghosts += bool((off > 0.7).any())
        fully += moment.hits >= tseng.FULLY
        found += moment.hits >= tseng.FULLY and bool((off < 0.5).any())
    assert found > 0.9 * fully > 50
    assert ghosts <= 1


def test_who_stands_behind_a_board_is_not_hit() -> None:
    room = Room([BOARD])
    rng = np.random.default_rng(1)
    pose = Pose2(1.0, 3.0, 0.0)
    _, none = scanned(room, pose, [], 0.0, rng)
    scan, hits = scanned(room, pose, [2.9 + 3.1j, 2.9 + 2.9j], 0.0, rng)
    _, hidden = scanned(room, pose, [4.6 + 3.0j], 0.0, rng)
    assert none == hidden == 0
    assert hits > 10
    assert np.count_nonzero(np.abs(scan.ranges - 1.85) < 0.1) == pytest.approx(hits, abs=3)


def test_hidden_time_counts_from_the_last_full_sight(walk: tuple[Room, list[Moment]]) -> None:
    seen = [
        replace(moment, hits=hits) for moment, hits in zip(walk[1], (9, 2, 0, 3, 0), strict=False)
    ]
    assert hidden_for(seen) == pytest.approx([0.0, 0.25, 0.5, 0.0, 0.25])
    hidden = hidden_for(seen)
    assert [int(COLUMNS[c](hidden).sum()) for c in ("total", "fo", "po")] == [5, 2, 3]


def test_an_interval_is_of_runs_not_of_scans() -> None:
    sums = np.array([[10.0, 100.0, 1000.0]] * 6)

    def mean(each: Array) -> Array:
        result: Array = each[..., 1] / each[..., 0]
        return result

    assert bootstrapped(sums, mean) == (10.0, 0.0)
    sums[3:, 1] = 300.0
    value, ci95 = bootstrapped(sums, mean)
    assert value == pytest.approx(20.0)
    assert ci95 is not None
    assert 5.0 < ci95 < 10.0
    assert bootstrapped(np.zeros((4, 3)), mean) == (None, None)


@pytest.mark.slow
def test_a_run_is_the_same_every_time_and_gives_every_figure() -> None:
    outcomes = [run(Job("boards", 7, quick=True)) for _ in range(2)]
    for name in tseng.TRACKERS:
        one, other = (outcome.estimates[name] for outcome in outcomes)
        assert np.array_equal(one, other, equal_nan=True)
    found = rows(outcomes[:1])
    for tracker in tseng.TRACKERS:
        metrics = {row.metric for row in found if row.tracker == tracker}
        assert metrics >= {f"{name}_cm" for name in (*tseng.STATISTICS, "hidden_under_1s")}
        assert "step_ms" in metrics
    assert all(row.ci95 is None for row in found if row.metric.endswith("_cm"))


@pytest.mark.slow
def test_who_looks_for_a_hidden_person_where_nobody_is_seen_errs_half_as_much() -> None:
    """On seeds of tuning: the figures come from others."""
    outcomes = [run(Job("boards", seed)) for seed in range(900, 908)]
    found = {(row.tracker, row.metric): row.value for row in rows(outcomes)}
    share = found["stream_field/default", "po_mean_of_kf_cv"]
    assert share is not None
    assert share < 0.6
    under = found["stream_field/default", "hidden_under_1s_cm"]
    assert under is not None
    assert under < 35.0


@pytest.mark.slow
def test_walls_keep_the_robot_where_it_is() -> None:
    drives = [localization.run(seed) for seed in range(900, 903)]
    found = {(row.tracker, row.metric): row.value for row in localization.rows(drives)}
    ekf, odometer = (found[name, "error_mean_cm"] for name in ("line_ekf", "odometer"))
    assert ekf is not None
    assert odometer is not None
    assert ekf < 3.5 < 8.0 < odometer


@pytest.mark.slow
def test_the_suite_reports_all_scenarios_and_pictures() -> None:
    with ThreadPoolExecutor(1) as pool:
        report = tseng.suite(pool, seeds=1, quick=True)
    assert {row.scenario for row in report.rows} == {*tseng.PLANS, "localization"}
    assert len(report.plots) == 6
    assert not any(row.value is not None and row.value == inf for row in report.rows)
