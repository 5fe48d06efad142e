"""`followerd drive-check`: the first run on a real robot, wheels up."""

import asyncio
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from followerd import app, clock
from followerd.config import load
from followerd.errors import Stopped, UsageError
from followerd.runtime import logs
from followerd.runtime.drive_check import DriveCheck
from followerd.runtime.standing_checks import Check, Outcome

STYLES = {Outcome.OK: "green", Outcome.FAILED: "bold red", Outcome.LEFT_OUT: "dim"}


def drive_check(
    config: str,
    *,
    links: Annotated[
        Path | None,
        Parameter(help="use what `followerd sim --links` offers for links that say sim"),
    ] = None,
    yes: Annotated[
        bool, Parameter(negative="", help="answer every question with yes; with --links only")
    ] = False,
) -> None:
    """Check base and laser before the robot drives for the first time; its wheels hang free.

    It looks at reports, battery, bumpers, sonar and laser, then turns the wheels slowly: forward,
    stop, left, no commands, no bytes at all. It asks what a person sees. Exit code 4: something is
    wrong, and must be put right before the daemon drives this robot.
    """
    settings = load(config)
    if yes and (links is None or settings.base.link != "sim"):
        raise UsageError("--yes is for a base of `followerd sim --links`; a robot needs your eyes")
    if links is not None:
        settings = app.plugged_into(settings, links)
    if settings.simulated:
        raise UsageError(f"{config} has links that say sim; give --links of followerd sim")
    if not yes and not sys.stdin.isatty():
        raise UsageError("drive-check asks questions: run it in a terminal")
    logs.configure("error")
    base, laser, link = app.for_drive_check(settings, app.hardware(settings))
    check = DriveCheck(base, laser, link, _agree if yes else _ask, _tell, by_hand=not yes)
    checks = clock.run(check.run())
    Console().print(_table(checks))
    failed = [each.name for each in checks if each.outcome is Outcome.FAILED]
    if failed:
        raise Stopped(f"drive-check failed: {', '.join(failed)}")


def _tell(check: Check) -> None:
    print(f"{check.outcome.value}: {check.name}: {check.detail}", flush=True)


async def _agree(question: str) -> bool:
    print(f"{question} yes", flush=True)
    return True


async def _ask(question: str) -> bool:
    """The answer typed at the terminal, while everything else goes on."""
    while True:
        print(f"{question} [y/n] ", end="", flush=True)
        answer = (await _line()).strip().lower()
        if answer in ("y", "yes", "n", "no"):
            return answer.startswith("y")


async def _line() -> str:
    """The next line that is typed."""
    loop, typed = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(sys.stdin, typed.set)
    try:
        await typed.wait()
    finally:
        loop.remove_reader(sys.stdin)
    return sys.stdin.readline()


def _table(checks: list[Check]) -> Table:
    table = Table(title="drive-check")
    for column in ("check", "outcome", "what came of it", "what to do"):
        table.add_column(column, overflow="fold")
    for check in checks:
        style = STYLES[check.outcome]
        outcome = f"[{style}]{check.outcome.value}[/]"
        table.add_row(check.name, outcome, check.detail, check.remedy)
    return table
