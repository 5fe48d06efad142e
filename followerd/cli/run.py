"""`followerd run`: the daemon on the links that a config names."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from followerd import app, clock
from followerd.bench.closed_loop import Run, Summary
from followerd.cli.page import Anew, Opened
from followerd.cli.recording import RecordFile, recorded
from followerd.config import Config, load
from followerd.errors import Stopped, UsageError
from followerd.messages import Decision, Mode
from followerd.runtime import logs
from followerd.runtime.daemon import Daemon
from followerd.sim import truth_log


def in_a_folder(_type: object, path: Path | None) -> None:
    """Refuse a file to be written whose folder does not exist, before anything starts."""
    if path is not None and not path.parent.is_dir():
        raise ValueError(f"{path.parent} is no folder")


SummaryFile = Annotated[
    Path | None, Parameter(help="write the run's figures, JSON", validator=in_a_folder)
]
Seconds = Annotated[float, Parameter(help="end after so long", validator=validators.Number(gt=0))]


def run(
    config: str,
    *,
    duration: Seconds | None = None,
    summary: SummaryFile = None,
    record: RecordFile = None,
    links: Annotated[
        Path | None,
        Parameter(help="use what `followerd sim --links` offers for links that say sim"),
    ] = None,
) -> None:
    """Run the daemon on a config file; it arms by itself only if the config says operator: auto."""
    settings = load(config)
    if links is not None:
        settings = app.plugged_into(settings, links)
    if settings.simulated:
        raise UsageError(f"{config} has links that say sim; give --links, or use followerd demo")
    logs.configure(settings.log_level, queued=True)
    ending = Ending()
    with recorded(record, settings) as recorders:
        figures = clock.run(live(settings, duration, [*recorders, ending.attach], tell=_page))
    ending.finish(figures, summary)


def _page(address: str) -> None:
    print(f"page: {address}", flush=True)


async def live(
    config: Config,
    duration: float | None,
    watchers: Sequence[app.Attach],
    truth: Path | None = None,
    tell: Callable[[str], None] | None = None,
) -> Summary:
    """Run the daemon in real time and sum it up; `truth` is what a simulation wrote meanwhile.

    `tell` is given the address of the operator's page; None: no page. When the page chooses
    another tracker the daemon starts anew, disarmed.
    """
    record: list[Decision] = []

    def attach(daemon: Daemon) -> None:
        if truth is not None:
            daemon.decision_watchers.append(record.append)
        for watch in watchers:
            watch(daemon)

    began = clock.now()
    while True:
        left = None if duration is None else max(0.1, began + duration - clock.now())
        pages = [] if config.web is None or tell is None else [Opened(config, tell).run]
        try:
            daemon = await app.live(config, left, attach, pages)
        except Anew as choice:
            config = choice.config
            continue
        truths = truth_log.read(truth) if truth is not None else []
        return Run(config, daemon, truths, record).summary(clock.now(), virtual=False)


class Ending:
    """Remembers the last decision, for the exit code."""

    def __init__(self) -> None:
        self._last: Decision | None = None

    def attach(self, daemon: Daemon) -> None:
        """Look at a daemon's decisions."""
        daemon.decision_watchers.append(self._look)

    def finish(self, figures: Summary, path: Path | None) -> None:
        """Write the summary; raises Stopped when the run ended in a fault."""
        if path is not None:
            path.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
        if self._last is not None and self._last.mode is Mode.FAULT:
            reasons = "; ".join(str(reason) for reason in self._last.reasons)
            raise Stopped(f"the robot stands because of a fault: {reasons}")

    def _look(self, decision: Decision) -> None:
        self._last = decision
