"""`--timings F`: how late each command and the loop was, for whoever compares parts of a run."""

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from followerd.cli.run import in_a_folder
from followerd.runtime.daemon import Daemon
from followerd.runtime.stats import Stats

TimingsFile = Annotated[
    Path | None,
    Parameter(
        help="write when and how late, s, each command and the loop was; JSON",
        validator=in_a_folder,
    ),
]


class Timings:
    """Keeps what a run measured, also when its tracker was changed."""

    def __init__(self) -> None:
        self._of: list[Stats] = []

    def attach(self, daemon: Daemon) -> None:
        """Look at a daemon."""
        self._of.append(daemon.stats)

    def write(self, path: Path) -> None:
        """Pairs of loop time and lateness, s."""
        late = {
            "frame_to_command": [pair for of in self._of for pair in of.latencies.get("image", ())],
            "scan_to_command": [pair for of in self._of for pair in of.latencies.get("scan", ())],
            "loop_lag": [pair for of in self._of for pair in of.lags],
        }
        path.write_text(json.dumps(late), encoding="utf-8")
