"""`followerd track`: a tracker alone over a recording."""

import cProfile
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from pstats import SortKey, Stats
from typing import Annotated

import cv2
import numpy as np
from cyclopts import Parameter
from rich.progress import Progress

from followerd import config as configs
from followerd.bench.overlay import draw
from followerd.bench.recorded import camera_of, images, open_source
from followerd.bench.scores import read_truth
from followerd.bench.track import (
    Step,
    TrackRow,
    follow,
    parse_region,
    region_from_truth,
    summarise,
    write_csv,
)
from followerd.bench.trackers import build
from followerd.bench.video import VideoWriter
from followerd.errors import UsageError


def track(
    source: Path,
    *,
    tracker: str = "hpf",
    init: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    start: int = 0,
    config: str | None = None,
    out: Path,
    truth: Path | None = None,
    summary: Path | None = None,
    render: Path | None = None,
    seed: int = 0,
    profile: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Follow one person through recorded frames, and write one row per frame.

    Parameters
    ----------
    source
        A folder of images (or one with the images in img/), or a video file.
    tracker
        Its kind, or kind/profile: hpf, hpf/paper.
    init
        The person at the start: X,Y,W,H or a point X,Y in px. Default: the truth's box.
    start
        Index of the first frame to track, counted from 0.
    config
        A config file (or a shipped one, by name) with settings of the tracker and the camera.
    out
        CSV file: index,stamp,x,y,w,h,status,confidence.
    truth
        Ground truth of the whole source (groundtruth_rect.txt, gt.txt, groundtruth.txt).
    summary
        JSON file for counts, times and scores.
    render
        MP4 file with candidates, particles and the box drawn.
    seed
        Of the tracker's random numbers.
    profile
        Print where the tracker's time goes (the times are then not to be quoted).
    """
    cv2.setNumThreads(1)
    if start < 0:
        raise UsageError(f"--start {start}: frames are counted from 0")
    settings = configs.load(config) if config else None
    recording = open_source(source)
    right = read_truth(truth) if truth else None
    if init is not None:
        region = parse_region(init)
    elif right is not None:
        region = region_from_truth(right, start)
    else:
        raise UsageError("say who is to be followed: --init X,Y,W,H, or --truth FILE")
    chosen = build(tracker, np.random.default_rng(seed), settings)
    frames = images(recording, camera_of(recording, settings))
    steps = follow(chosen, frames, region, start)
    profiler = cProfile.Profile() if profile else None
    with Progress(transient=True) as progress:
        shown = _shown(steps, progress, recording.count - start or None)
        if profiler:
            profiler.enable()
        rows = write_csv(out, _rows(shown, render, recording.rate))
        if profiler:
            profiler.disable()
    if profiler:
        Stats(profiler).strip_dirs().sort_stats(SortKey.TIME).print_stats(15)
    result = {"source": str(source), "tracker": tracker, "seed": seed} | summarise(rows, right)
    _print(result)
    if summary:
        _write(summary, result)


def _shown(steps: Iterable[Step], progress: Progress, total: int | None) -> Iterator[Step]:
    """Not rich's own `track`: a thread of it outlives an error, and the garbage collector may
    then wait for that thread in the one that draws, for ever."""
    bar = progress.add_task("tracking", total=total)
    for step in steps:
        yield step
        progress.advance(bar)


def _rows(steps: Iterable[Step], render: Path | None, rate: float) -> Iterator[TrackRow]:
    if render is None:
        yield from (step.row for step in steps)
        return
    with VideoWriter(render, rate) as video:
        for step in steps:
            video.write(draw(step.image.pixels, step.track, f"#{step.image.id}"))
            yield step.row


def _print(result: dict[str, object]) -> None:
    for name, value in result.items():
        parts = value if isinstance(value, dict) else {"": value}
        for part, number in parts.items():
            text = f"{number:.3f}" if isinstance(number, float) else str(number)
            print(f"{name}{'.' if part else ''}{part}: {text}")


def _write(path: Path, result: dict[str, object]) -> None:
    try:
        path.write_text(json.dumps(result, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--summary {path}: cannot be written: {error.strerror}") from error
