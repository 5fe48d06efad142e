"""The tracker of suite `jia` on rendered images with a Kinect's depth."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, radians, sin
from typing import Any

import cv2
import numpy as np

from followerd.bench.ride import Agility, Frame, Ride, Script
from followerd.bench.rows import Row, mean_row
from followerd.bench.scores import as_array, overlap
from followerd.bench.scripts import Chaperon, Stand
from followerd.geometry import Array, Camera
from followerd.messages import TrackPhase
from followerd.sim.people import Pedestrian
from followerd.sim.scenarios import load
from followerd.sim.structured_light import StructuredLight
from followerd.sim.world import World
from followerd.trackers.patches import Patches, PatchesSettings

CAMERA = Camera.from_hfov(640, 480, radians(62.7), x=0.05, z=0.9)
FRAMES = 300  # 20 s
SUCCESS = 0.5  # least overlap with the true box
HIDDEN, SHOWN = 0.5, 0.8  # shares of the person in sight: an occlusion begins, and is over
SETTLES = 15  # frames after an occlusion in which the person must be held again
ON_OTHER, OFF_TARGET = 0.35, 0.6  # m, a track that near to another, that far from the person
CLEAR = 0.9  # share in sight from which the place is measured

SCENARIOS: dict[str, tuple[str, Callable[[], Script]]] = {
    "still-robot": ("jia-still", Stand),
    "moving-robot": ("jia-moving", Chaperon),
    "occlusion": ("jia-occlusion", Stand),
    "light": ("jia-light", Stand),
    "turning": ("jia-turning", Stand),
    "clutter": ("jia-clutter", Stand),
}
TRACKERS: dict[str, dict[str, Any]] = {
    "patches/paper": {"profile": "paper"},
    "patches/default": {},
    "colour_texture": {  # the whole box, by colour and texture alone, wherever that is most alike
        "detector": {
            "use_depth": False,
            "occlusion": False,
            "patch": {"patches": 1, "similar": 0.5, "passing": 0.05},
        }
    },
}
ABLATED = ("occlusion", "clutter")  # scenarios in which the ablations run
ABLATIONS: dict[str, dict[str, Any]] = {
    "no_depth_mask": {"detector": {"depth_mask": False}},
    "no_occlusion": {"detector": {"occlusion": False}},
    "literal_learning": {"detector": {"literal_learning": True}},
}

Figures = dict[str, tuple[float | None, str]]  # metric -> value, unit


@dataclass(frozen=True, slots=True)
class Job:
    """One ride."""

    scenario: str
    tracker: str
    seed: int
    frames: int = FRAMES


@dataclass(frozen=True, slots=True)
class Outcome:
    """What is kept of a ride."""

    job: Job
    figures: Figures
    occlusions: int
    lost_after: int  # of them
    true: Array = field(default_factory=lambda: np.empty((0, 2)))  # (frames, 2) m, in `base`
    claimed: Array = field(default_factory=lambda: np.empty((0, 2)))  # (frames, 2), nan = lost


@dataclass(frozen=True, slots=True)
class Look:
    """One frame, compared with the truth."""

    overlap: float | None  # of the boxes; None = the person is out of view
    shown: float
    sure: bool
    error: float | None  # m, in space
    person: int | None  # whom the track stands on: 0 the target, then the others
    duration: float  # s


def run(job: Job) -> Outcome:
    """One ride, the same for one job every time but for its times."""
    cv2.setNumThreads(1)
    name, script = SCENARIOS[job.scenario]
    world_rng, camera_rng, tracker_rng = np.random.default_rng(job.seed).spawn(3)
    world = World(load(name), world_rng)
    settings = PatchesSettings.model_validate({**TRACKERS, **ABLATIONS}[job.tracker])
    tracker = Patches(settings, tracker_rng)
    take = StructuredLight(camera_rng).of(world)
    ride = Ride(world, CAMERA, script(), Agility(), take)
    target = next(w for w in world.walkers if w.mover.target)
    middle = 0.5 * target.height if isinstance(target, Pedestrian) else 0.0
    looks, true, claimed = [], [], []
    for frame in ride.frames(tracker, job.frames):
        looks.append(compared(frame, tracker.place, middle))
        at = frame.truth.target
        true.append((at.distance * cos(at.bearing), at.distance * sin(at.bearing)))
        claimed.append((np.nan, np.nan) if tracker.place is None else tracker.place[:2])
    events = occlusions(looks)
    return Outcome(
        job,
        figures(looks),
        len(events),
        sum(not held(looks, end) for end in events),
        np.array(true),
        np.array(claimed),
    )


def compared(frame: Frame, place: Array | None, middle: float) -> Look:
    """A frame against the truth; `middle` is the true height of the person's middle, m."""
    track, truth = frame.track, frame.truth
    lost = track is None or track.phase is TrackPhase.LOST or place is None
    fit = None
    if frame.box is not None:
        boxes = as_array([None if lost or track is None else track.box]), as_array([frame.box])
        fit = float(np.nan_to_num(overlap(*boxes)[0]))
    if lost or track is None or place is None:
        return Look(fit, frame.shown, False, None, None, frame.duration)
    actors = (truth.target, *truth.others)
    people = np.array([(a.distance * cos(a.bearing), a.distance * sin(a.bearing)) for a in actors])
    apart = np.hypot(*(people - place[:2]).T)
    nearest = int(apart.argmin())
    other = nearest > 0 and apart[nearest] < ON_OTHER and apart[0] > OFF_TARGET
    return Look(
        fit,
        frame.shown,
        track.phase is TrackPhase.CONFIRMED,
        float(np.hypot(apart[0], place[2] - middle)),
        nearest if other else 0 if apart[0] < OFF_TARGET else None,
        frame.duration,
    )


def figures(looks: Sequence[Look]) -> Figures:
    """The metrics of one ride."""
    fits = [look.overlap for look in looks if look.overlap is not None]
    clear = [look for look in looks if look.sure and look.shown > CLEAR]
    errors = [look.error for look in clear if look.error is not None]
    stood_on = [look.person for look in looks if look.person is not None]
    switches = sum(before != after for before, after in pairwise(stood_on))
    times = [look.duration for look in looks[1:]]
    return {
        "success_percent": (100.0 * float(np.mean(np.array(fits) > SUCCESS)), "%"),
        "identity_switches": (float(switches), ""),
        "error_3d_cm": (100.0 * float(np.mean(errors)) if errors else None, "cm"),
        "frame_ms": (1e3 * float(np.median(times)), "ms"),
    }


def occlusions(looks: Sequence[Look]) -> list[int]:
    """The first frame after each occlusion in which the person is seen well again."""
    ends, hidden = [], False
    for k, look in enumerate(looks):
        if look.shown < HIDDEN:
            hidden = hidden or look.overlap is not None
        elif hidden and look.shown > SHOWN:
            ends.append(k)
            hidden = False
    return [end for end in ends if end + SETTLES <= len(looks)]


def held(looks: Sequence[Look], end: int) -> bool:
    """Whether the person is held again soon after an occlusion."""
    fit = looks[end + SETTLES - 1].overlap
    return fit is None or fit > SUCCESS


def rows(outcomes: Sequence[Outcome]) -> Iterator[Row]:
    """Means over seeds, for each scenario and tracker; occlusions are counted together."""
    for scenario, tracker in dict.fromkeys((o.job.scenario, o.job.tracker) for o in outcomes):
        mine = [o for o in outcomes if (o.job.scenario, o.job.tracker) == (scenario, tracker)]
        for metric, (_, unit) in mine[0].figures.items():
            values = [one.figures[metric][0] for one in mine]
            yield mean_row("jia", scenario, tracker, metric, unit, values)
        events = sum(one.occlusions for one in mine)
        if events:
            lost = 100.0 * sum(one.lost_after for one in mine) / events
            yield Row("jia", scenario, tracker, "occlusions", events, "", seeds=len(mine))
            yield Row("jia", scenario, tracker, "lost_after_percent", lost, "%", seeds=len(mine))
