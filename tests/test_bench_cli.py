"""`followerd bench` prints, writes JSON and a page; follow figures become rows."""

import json
from concurrent.futures import Executor
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from followerd.bench import follow
from followerd.bench.report import Report
from followerd.bench.rows import Row
from followerd.cli import bench as cli
from followerd.errors import UsageError


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, bool]]:
    calls: list[tuple[int, bool]] = []

    def suite(executor: Executor, seeds: int, quick: bool) -> Report:
        assert isinstance(executor, Executor)
        calls.append((seeds, quick))
        plot = Figure((2, 1))
        return Report([Row("speed", "192x144", "hpf", "frame_ms_p50", 0.5, "ms")], {"p": plot})

    monkeypatch.setattr(cli, "SUITES", {"speed": suite})
    return calls


def test_bench_prints_a_table_and_writes_what_is_asked_for(
    tmp_path: Path, asked: list[tuple[int, bool]], capsys: pytest.CaptureFixture[str]
) -> None:
    rows, page = tmp_path / "rows.json", tmp_path / "page.html"
    cli.bench(["speed", "speed"], seeds=3, jobs=1, json=rows, html=page)
    assert asked == [(3, False)]  # a suite named twice runs once
    assert "192x144" in capsys.readouterr().out
    assert json.loads(rows.read_text())[0]["metric"] == "frame_ms_p50"
    assert "<h2>speed: p</h2>" in page.read_text()


@pytest.mark.parametrize("wrong", [{"seeds": 0}, {"jobs": 0}])
def test_nothing_runs_on_a_count_below_one(
    asked: list[tuple[int, bool]], wrong: dict[str, int]
) -> None:
    with pytest.raises(UsageError, match="at least 1"):
        cli.bench(["speed"], seeds=wrong.get("seeds", 1), jobs=wrong.get("jobs", 1))
    assert asked == []


def test_follow_figures_become_rows_with_units() -> None:
    figures = {
        "tracking_rate": 0.9,
        "range_rmse_m": None,
        "bearing_rmse_deg": 2.0,
        "time_to_reacquire_s": {"p50": 1.0, "p95": None},
    }
    job = follow.Job("hpf/default", "corridor", 1000, 60.0)
    rows = follow.rows([(job, follow.flat(figures)), (job, follow.flat(figures))])
    assert [(row.metric, row.value, row.unit, row.seeds) for row in rows] == [
        ("tracking_rate", 0.9, "", 2),
        ("range_rmse_m", None, "m", 0),
        ("bearing_rmse_deg", 2.0, "deg", 2),
        ("time_to_reacquire_s_p50", 1.0, "s", 2),
        ("time_to_reacquire_s_p95", None, "s", 0),
    ]


@pytest.mark.parametrize(
    ("metric", "unit"),
    [("follow_distance_mean_m", "m"), ("lost_count", ""), ("wrong_follow_m", "m")],
)
def test_a_metric_names_its_unit(metric: str, unit: str) -> None:
    assert follow.unit(metric) == unit


@pytest.mark.slow
def test_a_run_of_the_whole_daemon_gives_the_follow_figures_and_the_same_again() -> None:
    job = follow.Job("hpf/default", "corridor", 1, 6.0)
    figures = follow.run(job)
    assert figures["collision_count"] == 0
    assert figures["target_visibility_ratio"] == 1.0
    assert follow.run(job) == figures
