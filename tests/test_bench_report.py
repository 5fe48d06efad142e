"""Figures become rows, a table, JSON and one self-contained page."""

import json
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.console import Console

from followerd.bench.report import write_html
from followerd.bench.rows import Row, interval, mean_row, table, write_json
from followerd.errors import UsageError

ROWS = [
    Row("zhuang", "S3", "hpf/paper", "loss_percent", 12.5, "%", 1.25, None, 20),
    Row("zhuang", "S3", "hpf/default", "loss_percent", 2.5, "%", 0.5, None, 20),
    Row("zhuang", "S3", "hpf/default", "error_px", None, "px", None, None, 0),
]


def test_a_mean_leaves_out_the_runs_that_do_not_know() -> None:
    row = mean_row("follow", "corridor", "hpf", "range_rmse_m", "m", [1.0, None, 3.0])
    assert (row.value, row.seeds) == (2.0, 2)
    unknown = mean_row("follow", "corridor", "hpf", "range_rmse_m", "m", [None])
    assert (unknown.value, unknown.ci95, unknown.seeds) == (None, None, 0)


def test_the_interval_is_that_of_the_mean() -> None:
    values = np.random.default_rng(1).normal(5.0, 2.0, 400)
    mean, half = interval(values)
    assert mean == pytest.approx(values.mean())
    assert half == pytest.approx(1.96 * values.std() / 20, rel=0.1)
    assert interval(values[:1]) == (values[0], None)


def test_json_holds_one_object_per_row(tmp_path: Path) -> None:
    write_json(tmp_path / "rows.json", ROWS)
    first, _, last = json.loads((tmp_path / "rows.json").read_text())
    assert first == {
        "suite": "zhuang",
        "scenario": "S3",
        "tracker": "hpf/paper",
        "metric": "loss_percent",
        "value": 12.5,
        "unit": "%",
        "ci95": 1.25,
        "paper_value": None,
        "seeds": 20,
    }
    assert last["value"] is None


def test_the_table_sets_the_trackers_side_by_side() -> None:
    console = Console(width=100, file=StringIO())
    with console.capture() as text:
        console.print(table(ROWS))
    lines = [line.split("│") for line in text.get().splitlines() if "│" in line]
    cells = [[cell.strip() for cell in line[1:-1]] for line in lines]
    assert cells == [
        ["S3", "loss_percent", "12.5 ± 1.2 %", "2.5 ± 0.5 %"],
        ["", "error_px", "", "-"],
    ]


def test_the_page_needs_no_other_file(tmp_path: Path) -> None:
    plot = Figure((2, 1))
    plot.subplots().plot([1, 2])
    write_html(tmp_path / "page.html", ROWS, {"x over <frames>": plot})
    page = (tmp_path / "page.html").read_text()
    assert page.count("src=") == page.count("src='data:image/png;base64,") == 1
    assert "href" not in page
    assert "x over &lt;frames&gt;" in page
    assert "2.5 ± 0.5 %" in page


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"--json .*nowhere"):
        write_json(tmp_path / "nowhere" / "rows.json", ROWS)
    with pytest.raises(UsageError, match=r"--html .*nowhere"):
        write_html(tmp_path / "nowhere" / "page.html", ROWS, {})
