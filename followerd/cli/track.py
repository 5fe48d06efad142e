"""`followerd track`: a tracker alone over a recording."""

import cProfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from pstats import SortKey, Stats
from typing import Annotated, TypeVar

import cv2
import numpy as np
from cyclopts import Parameter
from rich.progress import Progress

from followerd import config as configs
from followerd.bench.laser_track import (
    LASER_COLUMNS,
    follow_scans,
    labelled,
    parse_mount,
    parse_point,
    summarise_scans,
)
from followerd.bench.overlay import draw
from followerd.bench.recorded import camera_of, images, open_source
from followerd.bench.scan_logs import open_log
from followerd.bench.scores import read_people, read_truth
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
from followerd.cli.summary import print_result, write_result
from followerd.config import Config
from followerd.errors import UsageError
from followerd.trackers.interfaces import Tracker

T = TypeVar("T")


def track(
    source: Path,
    *,
    tracker: str = "hpf",
    init: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    start: int = 0,
    config: str | None = None,
    out: Path,
    laser: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    truth: Path | None = None,
    summary: Path | None = None,
    render: Path | None = None,
    seed: int = 0,
    profile: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Follow one person through recorded frames or scans, and write one row for each.

    Parameters
    ----------
    source
        A folder of images (or one with the images in img/), a video file, a recording (*.mcap) or
        a ROS 1 or 2 bag; for patches a folder with rgb/, depth/ (16-bit, mm) and calib.json where
        depth is to be registered; for legs a recording, a bag, a CARMEN log, an .npz file of scans
        (t, ranges, angle_min, angle_inc) or a folder with scans.npz, and with odom.csv.gz where
        there is odometry.
    tracker
        Its kind, or kind/profile: hpf, hpf/paper, patches, legs.
    init
        The person at the start: X,Y,W,H or a point X,Y in px; for legs X,Y in m in the laser's
        frame (x forward, y left). Default: from the truth.
    start
        Index of the first frame or scan to track, counted from 0.
    config
        A config file (or a shipped one, by name) with settings of the tracker and the camera.
    out
        CSV file: index,stamp,x,y,w,h,status,confidence; for legs
        index,stamp,x,y,vx,vy,status,confidence,frame in m, in odom where there is odometry,
        else in the laser's frame of each scan.
    laser
        For legs with odometry, the laser on the robot: X,Y,YAW in m and degrees.
    truth
        Ground truth of the whole source (groundtruth_rect.txt, gt.txt, groundtruth.txt; for legs
        people_gt.csv with scan_index,id,x,y in the laser's frame).
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
    chosen = build(tracker, np.random.default_rng(seed), settings)
    with _profiled(profile):
        if "scan" in chosen.needs:
            if render is not None:
                raise UsageError(f"--render draws on images, and {tracker} follows scans")
            found = _in_scans(chosen, source, init, start, laser, truth, out)
        else:
            if laser is not None:
                raise UsageError(f"--laser is for trackers of scans, and {tracker} follows images")
            found = _in_images(chosen, source, init, start, settings, truth, out, render)
    result = {"source": str(source), "tracker": tracker, "seed": seed} | found
    print_result(result)
    if summary:
        write_result(summary, result)


def _in_images(
    tracker: Tracker,
    source: Path,
    init: str | None,
    start: int,
    settings: Config | None,
    truth: Path | None,
    out: Path,
    render: Path | None,
) -> dict[str, object]:
    recording = open_source(source)
    right = read_truth(truth) if truth else None
    if init is not None:
        region = parse_region(init)
    elif right is not None:
        region = region_from_truth(right, start)
    else:
        raise UsageError("say who is to be followed: --init X,Y,W,H, or --truth FILE")
    frames = images(recording, camera_of(recording, settings))
    with Progress(transient=True) as progress:
        steps = follow(tracker, frames, region, start)
        shown = _shown(steps, progress, recording.count - start)
        return summarise(write_csv(out, _rows(shown, render, recording.rate)), right)


def _in_scans(
    tracker: Tracker,
    source: Path,
    init: str | None,
    start: int,
    laser: str | None,
    truth: Path | None,
    out: Path,
) -> dict[str, object]:
    recording = open_log(source, parse_mount(laser) if laser is not None else None)
    point = parse_point(init) if init is not None else None
    labels = None
    if truth is not None:
        point, labels = labelled(read_people(truth, recording.count), start, point)
    if point is None:
        raise UsageError("say who is to be followed: --init X,Y, or --truth FILE")
    with Progress(transient=True) as progress:
        rows = follow_scans(tracker, recording, point, start)
        shown = _shown(rows, progress, recording.count - start)
        return summarise_scans(write_csv(out, shown, LASER_COLUMNS), labels)


def _shown(steps: Iterable[T], progress: Progress, total: int) -> Iterator[T]:
    """Not rich's own `track`: a thread of it outlives an error, and the garbage collector may
    then wait for that thread in the one that draws, for ever."""
    bar = progress.add_task("tracking", total=total or None)
    for step in steps:
        yield step
        progress.advance(bar)


@contextmanager
def _profiled(wanted: bool) -> Iterator[None]:
    if not wanted:
        yield
        return
    with cProfile.Profile() as profiler:
        yield
    Stats(profiler).strip_dirs().sort_stats(SortKey.TIME).print_stats(15)


def _rows(steps: Iterable[Step], render: Path | None, rate: float) -> Iterator[TrackRow]:
    if render is None:
        yield from (step.row for step in steps)
        return
    with VideoWriter(render, rate) as video:
        for step in steps:
            video.write(draw(step.image.pixels, step.track, f"#{step.image.id}"))
            yield step.row
