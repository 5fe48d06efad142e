"""`followerd demo`: the daemon and its twins in one command."""

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal, TypeVar

import yaml
from cyclopts import Parameter

from followerd import app, clock
from followerd.bench.closed_loop import Summary, simulate, staged
from followerd.bench.film import Film
from followerd.cli.display import Display
from followerd.cli.page import on_a_free_port
from followerd.cli.recording import RecordFile, recorded
from followerd.cli.run import Ending, Seconds, SummaryFile, in_a_folder, live
from followerd.cli.timings import Timings, TimingsFile
from followerd.config import Config, load
from followerd.errors import Stopped, UsageError
from followerd.hw.camera.settings import PRESETS
from followerd.resources import shipped
from followerd.runtime import logs
from followerd.runtime.daemon import Daemon
from followerd.sim import scenarios, truth_log
from followerd.sim.darkroom import darkroom
from followerd.sim.rig import Rig
from followerd.sim.truth import Truth

T = TypeVar("T")

START_UP = 20.0  # s that the simulation may take to offer its links
LOOK = 0.05  # s, between looks for them


def demo(
    *,
    tracker: Annotated[str, Parameter(help="KIND or KIND/PROFILE, such as hpf/paper")] = "hpf",
    scenario: str = "corridor",
    seed: int = 0,
    duration: Seconds = 60.0,
    virtual: Annotated[
        bool, Parameter(help="one process, as fast as it goes, reproducible")
    ] = False,
    headless: Annotated[bool, Parameter(help="no live view in the terminal")] = False,
    camera: Annotated[str | None, Parameter(help=f"one of {', '.join(PRESETS)}")] = None,
    summary: SummaryFile = None,
    timings: TimingsFile = None,
    render: Annotated[
        Path | None,
        Parameter(
            help="film the run into this *.mp4, or its end into a *.png", validator=in_a_folder
        ),
    ] = None,
    record: RecordFile = None,
    images: Annotated[
        Literal["exact", "jpeg", "none"] | None, Parameter(help="as the recording keeps them")
    ] = None,
) -> None:
    """Watch a simulated Pioneer follow a person: the real daemon, its drivers and twins."""
    changes = {"sim.scenario": scenario, "seed": seed, **_preset(camera)}
    changes |= {} if images is None else {"record.images": images}
    settings = staged(_with_tracker(tracker, changes))
    ending, late = Ending(), Timings()
    with ExitStack() as stack:
        world = None
        if virtual:  # forks, which is safe as long as the display has no thread yet
            world = app.rig(settings)
            stack.enter_context(darkroom(world))
        display = stack.enter_context(Display(headless=headless))
        logs.configure("warning" if display.is_shown else settings.log_level)
        recorders = stack.enter_context(recorded(record, settings))
        watchers: list[app.Attach] = [*recorders, display.attach, ending.attach, late.attach]
        if world is not None:
            world.camera.develops = bool(render or recorders)  # else only the tracker looks
            figures = _in_virtual_time(settings, duration, watchers, render, world)
        else:
            tell = None if headless else display.tell
            figures = _in_real_time(settings, duration, watchers, render, tell)
    _tell(figures)
    if timings is not None:
        late.write(timings)
    ending.finish(figures, summary)


def _in_virtual_time(
    settings: Config,
    duration: float,
    watchers: list[app.Attach],
    render: Path | None,
    world: Rig,
) -> Summary:
    def newest() -> Truth | None:
        return world.truths[-1] if world.truths else None

    with ExitStack() as stack:
        if render is not None:
            watchers.append(stack.enter_context(_film(render, settings, newest)).attach)
        return simulate(settings, duration, *watchers, world=world)


def _in_real_time(
    settings: Config,
    duration: float,
    watchers: list[app.Attach],
    render: Path | None,
    tell: Callable[[str], None] | None,
) -> Summary:
    """The world and the twins in a process of their own, so that the daemon is measured alone."""
    with TemporaryDirectory(prefix="followerd-") as name, ExitStack() as stack:
        folder = Path(name)
        truth = folder / "truth.jsonl"
        stack.enter_context(_simulation(settings, folder, truth))
        plugged = on_a_free_port(app.plugged_into(settings, folder))
        plugged = plugged.model_copy(update={"socket": settings.socket or str(folder / "ctl")})
        if render is not None:
            film = stack.enter_context(_film(render, settings, truth_log.Tail(truth).newest))
            thread = stack.enter_context(ThreadPoolExecutor(1, "film"))
            watchers.append(partial(_film_in, thread, film))
        return clock.run(live(plugged, duration, watchers, truth, tell))


@contextmanager
def _simulation(settings: Config, folder: Path, truth: Path) -> Iterator[None]:
    """A `followerd sim` of the same robot, its links in `folder`."""
    config = folder / "config.yaml"
    config.write_text(yaml.safe_dump(settings.model_dump(mode="json")), encoding="utf-8")
    command = [sys.executable, "-m", "followerd", "sim", settings.sim.scenario]
    command += ["--links", str(folder), "--seed", str(settings.seed), "--config", str(config)]
    command += ["--truth", str(truth), "--until-eof"]
    with Popen(command, stdin=PIPE, stdout=DEVNULL) as process:
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


def _film(
    path: Path, settings: Config, truth: Callable[[], Truth | None]
) -> AbstractContextManager[Film]:
    rate, scenario = app.equipment(settings).camera_rate, scenarios.load(settings.sim.scenario)
    return closing(Film(path, rate, scenario, truth))


def _film_in(thread: ThreadPoolExecutor, film: Film, daemon: Daemon) -> None:
    """Film a daemon in real time without holding up its loop."""
    daemon.measurement_watchers.append(partial(_submit, thread, film.measured))
    daemon.decision_watchers.append(partial(_submit, thread, film.decided))


def _submit(thread: ThreadPoolExecutor, work: Callable[[T], None], what: T) -> None:
    thread.submit(work, what)


def _tell(figures: Summary) -> None:
    """The run in a few lines."""
    follow = figures["follow"] or {}
    share = follow.get("tracking_rate")
    print(
        f"{figures['scenario']}, seed {figures['seed']}: {figures['duration_s']:.0f} s,"
        f" {figures['frames']} images, {figures['scans']} scans"
    )
    if share is not None:
        print(
            f"the person's position was known and right {share:.1%} of the time;"
            f" lost {follow['lost_count']} times, {follow['collision_count']} collisions"
        )
    for name, figure in figures["latency_ms"].items():
        if figure["p50"] is not None and not figures["virtual_time"]:
            print(f"{name.replace('_', ' ')}: p50 {figure['p50']} ms, p99 {figure['p99']} ms")


def _with_tracker(tracker: str, changes: dict[str, Any]) -> Config:
    kind, _, profile = tracker.partition("/")
    known = sorted(path.stem.removesuffix("-sim") for path in shipped().glob("*-sim.yaml"))
    if kind not in known:
        raise UsageError(f"--tracker {kind}: there are {', '.join(known)}")
    return load(f"{kind}-sim", changes | ({"tracker.profile": profile} if profile else {}))


def _preset(name: str | None) -> dict[str, float]:
    if name is None:
        return {}
    if name not in PRESETS:
        raise UsageError(f"--camera {name}: there are {', '.join(PRESETS)}")
    width, height, rate = PRESETS[name]
    return {"camera.width": width, "camera.height": height, "camera.rate_hz": rate}
