"""`followerd run` and `followerd demo`: the daemon on hardware, and on its twins."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import DEVNULL, Popen
from tempfile import TemporaryDirectory
from typing import Annotated

import yaml
from cyclopts import Parameter

from followerd import app, clock
from followerd.bench.closed_loop import Run, Summary, simulate
from followerd.cli.display import Display
from followerd.config import Config, load
from followerd.errors import Stopped, UsageError
from followerd.hw.camera.settings import PRESETS
from followerd.messages import Decision, Mode
from followerd.runtime import logs
from followerd.runtime.daemon import Daemon
from followerd.sim import scenarios, truth_log

START_UP = 20.0  # s that the simulation may take to offer its links
LOOK = 0.05  # s, between looks for them

SummaryFile = Annotated[Path | None, Parameter(help="write the run's figures, JSON")]
Duration = Annotated[float | None, Parameter(help="end after so many seconds")]


def run(
    config: str,
    *,
    duration: Duration = None,
    summary: SummaryFile = None,
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
    logs.configure(settings.log_level)
    record: list[Decision] = []
    with Display(headless=True) as display:
        figures = clock.run(_live(settings, duration, record, display))
    _finish(figures, summary, record)


def demo(
    *,
    tracker: str = "hpf",
    scenario: str = "corridor",
    seed: int = 0,
    duration: float = 60.0,
    virtual: Annotated[
        bool, Parameter(help="one process, as fast as it goes, reproducible")
    ] = False,
    headless: Annotated[bool, Parameter(help="no live view in the terminal")] = False,
    camera: Annotated[str | None, Parameter(help=f"one of {', '.join(PRESETS)}")] = None,
    summary: SummaryFile = None,
) -> None:
    """Watch a simulated Pioneer follow a person: the real daemon, its drivers and twins."""
    changes = {"sim.scenario": scenario, "seed": seed, **_preset(camera)}
    settings = load(f"{tracker}-sim", changes)
    scenarios.load(scenario)  # a wrong name is said before anything starts
    record: list[Decision] = []
    with Display(headless=headless) as display:
        logs.configure(settings.log_level if headless else "warning")
        if virtual:
            figures = simulate(settings, duration, display.attach, _recorder(record))
        else:
            figures = _demo_live(settings, duration, record, display)
    _finish(figures, summary, record)


def _demo_live(
    settings: Config, duration: float, record: list[Decision], display: Display
) -> Summary:
    with TemporaryDirectory(prefix="followerd-") as name:
        folder = Path(name)
        with _simulation(settings, folder):
            plugged = app.plugged_into(settings, folder)
            plugged = plugged.model_copy(update={"socket": settings.socket or str(folder / "ctl")})
            return clock.run(_live(plugged, duration, record, display, folder / "truth.jsonl"))


@contextmanager
def _simulation(settings: Config, folder: Path) -> Iterator[None]:
    """A process of its own with the world and the twins, its links in `folder`."""
    config = folder / "config.yaml"
    config.write_text(yaml.safe_dump(settings.model_dump(mode="json")), encoding="utf-8")
    command = [sys.executable, "-m", "followerd", "sim", settings.sim.scenario]
    command += ["--links", str(folder), "--seed", str(settings.seed), "--config", str(config)]
    command += ["--truth", str(folder / "truth.jsonl")]
    with Popen(command, stdout=DEVNULL) as process:
        try:
            clock.run(_until_served(process, folder))
            yield
        finally:
            process.terminate()


async def _until_served(process: "Popen[bytes]", folder: Path) -> None:
    async def look() -> bool:
        while not all((folder / name).exists() for name in ("robot", "laser", "camera")):
            if process.poll() is not None:
                return False
            await clock.sleep(LOOK)
        return True

    if not await clock.within(START_UP, look()):
        raise Stopped("the simulation did not start; its own message stands above")


async def _live(
    config: Config,
    duration: float | None,
    record: list[Decision],
    display: Display,
    truth: Path | None = None,
) -> Summary:
    def attach(daemon: Daemon) -> None:
        _recorder(record)(daemon)
        display.attach(daemon)

    daemon = await app.live(config, duration, attach)
    truths = truth_log.read(truth) if truth is not None else []
    return Run(config, daemon, truths, record).summary(clock.now(), virtual=False)


def _recorder(record: list[Decision]) -> app.Attach:
    return lambda daemon: daemon.decision_watchers.append(record.append)


def _finish(figures: Summary, path: Path | None, record: list[Decision]) -> None:
    if path is not None:
        path.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    if record and record[-1].mode is Mode.FAULT:
        reasons = "; ".join(str(reason) for reason in record[-1].reasons)
        raise Stopped(f"the robot stands because of a fault: {reasons}")


def _preset(name: str | None) -> dict[str, float]:
    if name is None:
        return {}
    if name not in PRESETS:
        raise UsageError(f"--camera {name}: there are {', '.join(PRESETS)}")
    width, height, rate = PRESETS[name]
    return {"camera.width": width, "camera.height": height, "camera.rate_hz": rate}
