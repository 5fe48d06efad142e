"""A benchmark's report as one HTML file that needs nothing else: tables and plots."""

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import groupby
from pathlib import Path

from matplotlib.figure import Figure

from followerd.bench.rows import Row, max_seeds, pivot
from followerd.errors import UsageError

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 72rem; color: #222 }
table { border-collapse: collapse; font-size: 13px; display: block; overflow-x: auto }
th, td { border-bottom: 1px solid #ddd; padding: .3rem .7rem; text-align: right }
th { text-align: right; background: #f4f4f4 }
td:nth-child(-n+2), th:nth-child(-n+2) { text-align: left }
img { max-width: 100% }
"""


@dataclass(frozen=True)
class Report:
    """What a suite found: figures, and pictures by their titles."""

    rows: list[Row]
    plots: dict[str, Figure] = field(default_factory=dict)


def html(rows: Sequence[Row], plots: Mapping[str, Figure]) -> str:
    """The page: a table per suite, then the plots with their titles."""
    tables = [_table(suite, list(part)) for suite, part in groupby(rows, lambda row: row.suite)]
    return _page("followerd bench", [*tables, *_pictures(plots)])


def page(title: str, text: str, plots: Mapping[str, Figure]) -> str:
    """A page of plain text and plots."""
    parts = [f"<h1>{escape(title)}</h1>", *_pictures(plots), f"<pre>{escape(text)}</pre>"]
    return _page(title, parts)


def _pictures(plots: Mapping[str, Figure]) -> list[str]:
    return [
        f"<h2>{escape(title)}</h2>\n<img alt='{escape(title)}' src='{_embedded(plot)}'>"
        for title, plot in plots.items()
    ]


def _page(title: str, parts: Sequence[str]) -> str:
    body = "\n".join(parts)
    head = f"<meta charset='utf-8'><title>{escape(title)}</title><style>{STYLE}</style>"
    return f"<!doctype html>\n<html lang='en'><head>{head}</head>\n<body>\n{body}\n</body></html>\n"


def write_html(path: Path, rows: Sequence[Row], plots: Mapping[str, Figure]) -> None:
    """Write the page; raises UsageError."""
    try:
        path.write_text(html(rows, plots), encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--html {path}: cannot be written: {error.strerror}") from error


def _table(suite: str, rows: Sequence[Row]) -> str:
    trackers, lines = pivot(rows)
    head = "".join(f"<th>{escape(name)}</th>" for name in ("scenario", "metric", *trackers))
    body = "\n".join(
        "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in (*key, *texts)) + "</tr>"
        for key, texts in lines.items()
    )
    note = f"Mean over {max_seeds(rows)} seeds, ± half of the 95 % interval."
    return f"<h1>{escape(suite)}</h1>\n<p>{note}</p>\n<table><tr>{head}</tr>\n{body}</table>"


def _embedded(plot: Figure) -> str:
    buffer = io.BytesIO()
    plot.savefig(buffer, format="png", dpi=110, bbox_inches="tight")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
