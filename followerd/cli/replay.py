"""`followerd replay`: the pipeline again over what a recording holds."""

import json
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

from cyclopts import Parameter
from rich.progress import Progress

from followerd import app
from followerd import config as configs
from followerd.bench.comparison import Comparison
from followerd.config import Config
from followerd.errors import UsageError
from followerd.record.reading import Recording
from followerd.record.replay import Replay
from followerd.runtime.recording import UNDER_WAY, described

TOLD = 3  # differences named


def replay(
    rec: Path,
    *,
    config: str | None = None,
    tracker: Annotated[
        str | None, Parameter(help="another one's kind, or kind/profile, else as recorded")
    ] = None,
    summary: Path | None = None,
    out: Annotated[
        Path | None, Parameter(help="CSV of both tracks, recorded and replayed, a line an image")
    ] = None,
) -> None:
    """Run the pipeline over a recording: with its own config the decisions are identical.

    With another config or tracker it shows what that one would have made of the same inputs; the
    robot then moves as it did, not as it would have.
    """
    recording = Recording(rec)
    recorded = configs.parse(recording.about["config"], f"{rec} (config)")
    settings = _changed(recorded, config, tracker)
    found = _replay(recording, settings, own=settings == recorded, out=out)
    for name, value in found.items():
        print(f"{name}: {value}")
    if summary is not None:
        summary.write_text(json.dumps({"source": str(rec), **found}, indent=1) + "\n", "utf-8")


def _replay(recording: Recording, config: Config, *, own: bool, out: Path | None) -> dict[str, Any]:
    tracker, pipeline = app.thinking(config)
    replay = Replay(tracker, pipeline, own)
    comparison = Comparison()
    differences: list[str] = []
    decisions = identical = 0
    began, stamps = perf_counter(), list[float]()
    with Progress(transient=True) as progress:
        bar = progress.add_task("replaying", total=None)
        for pair in replay.run(recording):
            decisions += 1
            comparison.add(pair)
            stamps = [*stamps[:1], pair.replayed.stamp]
            difference = pair.difference if own else ""
            identical += own and not difference
            if difference and len(differences) < TOLD:
                differences.append(f"decision {pair.replayed.sequence}: {difference}")
            progress.update(bar, advance=1)
    if not decisions:
        raise UsageError(f"{recording.path} holds no decisions")
    wall, spanned = perf_counter() - began, stamps[-1] - stamps[0]
    if out is not None:
        comparison.write(out)
    return {
        "tracker": f"{config.tracker.kind}",
        "duration_s": round(spanned, 3),
        "wall_s": round(wall, 3),
        "times_real_time": round(spanned / wall, 2),
        "decisions": decisions,
        "identical": identical if own else None,
        "differences": differences,
        "why_not": _reasons(recording, replay, config, own=own),
        **comparison.figures(),
    }


def _changed(recorded: Config, config: str | None, tracker: str | None) -> Config:
    chosen = recorded if config is None else configs.load(config)
    if tracker is None:
        return chosen
    return configs.with_tracker(chosen, tracker)


def _reasons(recording: Recording, replay: Replay, config: Config, *, own: bool) -> list[str]:
    """Why the decisions need not be identical."""
    about, now = recording.about, described(config)
    reasons = []
    if not own:
        reasons.append("another config")
    if about["images"] != "exact":
        reasons.append(f"images were recorded as {about['images']}")
    reasons += [
        f"{name} is {now[name]}, was {about[name]}"
        for name in sorted(now.keys() & about.keys() - {"config", "images"})
        if now[name] != about[name]
    ]
    if about.get("begun") == UNDER_WAY:
        reasons.append("recording began while the daemon ran")
    if replay.gaps:
        reasons.append(f"the recorder could not keep up {replay.gaps} times")
    if replay.missing:
        reasons.append(f"{replay.missing} images are missing")
    if recording.truncated:
        reasons.append(f"the recording is cut off: {recording.truncated}")
    return reasons
