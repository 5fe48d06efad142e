"""Suite `faults`: every fault of every device while a person is followed, bytes and all.

Times count from the fault to the last byte of zero velocity. A fault need not stop the robot: how
many of the runs that drove were stopped stands beside the times. `mixed` is an hour of driving in
pieces, by every tracker, with one fault after the other and somebody who arms again; `none` is the
same without faults. Rows of F numbers say how the campaign meets that failsafe.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from itertools import product

import numpy as np
from matplotlib.figure import Figure

from followerd.bench.fault_runs import (
    FOLLOWING,
    GONE,
    HEAD,
    MOMENTS,
    Job,
    Outcome,
    run,
)
from followerd.bench.mishaps import JUMPS, MISHAPS
from followerd.bench.report import Report
from followerd.bench.rows import Row
from followerd.bench.sweep import sweep
from followerd.sim.faults import FaultKind

TRACKER = "all"
DEVICES = ("robot", "laser", "camera", "ptz")
SCENARIOS = ("corridor", "turns", "office")  # by turns
HEAD_SCENARIO = "thermal-walk"
DRIVEN = tuple(moment for moment in MOMENTS if moment != "start-up")
FIRST_SEED = 6000  # seeds below serve for tuning
FIRST_MIXED = 6500
MOST_SEEDS = 2  # of each fault and moment
CHUNK = 60.0  # s, of the mixed drive
CHUNKS, QUICK_CHUNKS = 60, 4
MIXED = (  # presets and scenarios, by turns
    ("hpf-sim", "corridor"), ("hpf-sim", "office"), ("hpf-sim", "turns"), ("legs-sim", "office"),
    ("hpf-sim", "corridor"), ("hpf-sim", "office"), ("hpf-sim", "turns"),
    ("stream_field-sim", "turns"), ("legs-sim", "corridor"), ("patches-sim", "jia-paths"),
    ("head-sim", "face-to-face"), ("ofkf-sim", "thermal-walk"),
)  # fmt: skip
NONE = 120.0  # s, of each run without faults
QUICK_KINDS = (FaultKind.OFF, FaultKind.STUCK, FaultKind.WRONG, FaultKind.DISCONNECT)
BYTES = (FaultKind.GARBAGE, FaultKind.WRONG, FaultKind.DROP, FaultKind.FLIP,
         FaultKind.DUPLICATE, FaultKind.SPLIT)  # fmt: skip
EARLY = (FaultKind.OFF, FaultKind.REBOOT)  # a port that is not there ends the start
SILENT = (FaultKind.OFF, FaultKind.STUCK, FaultKind.GARBAGE, FaultKind.DISCONNECT,
          FaultKind.REBOOT)  # fmt: skip # nothing fresh comes
NUMBERS = {"laser": "F2", "camera": "F3", "robot": "F4", GONE: "F14"} | {
    name: number for name, (number, _) in MISHAPS.items()
}
EVERYWHERE = ("F10", "F11", "F12", "F19")  # bounds that hold in every run
MAP_PRESET = "stream_field-sim"  # of who lives by the map
PERCENTILES: dict[str, Callable[[np.ndarray], float]] = {
    "p50": lambda times: float(np.percentile(times, 50)),
    "p99": lambda times: float(np.percentile(times, 99)),
    "max": lambda times: float(times.max()),
}

Run = tuple[Job, Outcome]


def suite(executor: Executor, seeds: int, quick: bool) -> Report:
    """`quick`: one seed and moment, four kinds, and four minutes of mixed faults."""
    jobs = plan(1 if quick else min(seeds, MOST_SEEDS), quick=quick)
    runs = list(zip(jobs, sweep(executor, run, jobs, "faults"), strict=True))
    return Report(rows(runs), {"time to stop": plot(runs)})


def plan(seeds: int, *, quick: bool) -> list[Job]:
    """Every run of the campaign; the longest first, so that no worker is left with one."""
    numbers = range(FIRST_SEED, FIRST_SEED + seeds)
    jobs = [Job("none", SCENARIOS[k % 3], seed, NONE) for k, seed in enumerate(numbers)]
    jobs += mixed(FIRST_MIXED, QUICK_CHUNKS if quick else CHUNKS)
    kinds = QUICK_KINDS if quick else tuple(FaultKind)
    names = [
        GONE,
        *MISHAPS,
        *(f"{device}:{kind.value}" for device, kind in product(DEVICES, kinds)),
    ]
    moments = DRIVEN[1:2] if quick else DRIVEN
    for k, (seed, name, moment) in enumerate(product(numbers, names, moments)):
        is_head = name.startswith("ptz:")
        preset = HEAD if is_head else MAP_PRESET if name == JUMPS else FOLLOWING
        scenario = HEAD_SCENARIO if is_head else SCENARIOS[k % 3]
        jobs.append(Job(name, scenario, seed, None, moment, preset))
    early = [kind.value for kind in EARLY]
    names = [f"{device}:{kind}" for device, kind in product(DEVICES[:3], early)]
    starts = enumerate(product(numbers, names))
    return jobs + [Job(n, SCENARIOS[k % 3], seed, 12.0, "start-up") for k, (seed, n) in starts]


def mixed(first: int, chunks: int) -> list[Job]:
    """The mixed drive, with seeds from `first`."""
    return [
        Job("mixed", scenario, first + k, CHUNK, preset=preset)
        for k, (preset, scenario) in ((k, MIXED[k % len(MIXED)]) for k in range(chunks))
    ]


def groups(runs: Sequence[Run]) -> dict[str, list[Outcome]]:
    """Outcomes by F number (FAILSAFES) where the campaign has it, and by fault."""
    found: dict[str, list[Outcome]] = {}
    for job, outcome in runs:
        for name in (*_names(job), *EVERYWHERE):
            found.setdefault(name, []).append(outcome)
    return dict(sorted(found.items(), key=lambda item: _order(item[0])))


def _names(job: Job) -> list[str]:
    """What a run is evidence of."""
    if job.moment == "start-up":
        return ["F18"]
    names = [job.fault]
    device, _, kind = job.fault.partition(":")
    if device not in DEVICES:
        names.append(NUMBERS.get(job.fault, ""))
    elif device in NUMBERS and FaultKind(kind) in SILENT:
        names.append(NUMBERS[device])
    if device in DEVICES and FaultKind(kind) in BYTES:
        names.append("F7")
    if job.fault == "mixed":
        names.append(f"mixed:{job.preset.removesuffix('-sim')}")
    if job.fault == "mixed" or device == "camera":
        names.append("F9")
    return [name for name in names if name]


def _order(name: str) -> tuple[int, str]:
    return (int(name[1:]), "") if name[0] == "F" else (100, name)


def rows(runs: Sequence[Run]) -> list[Row]:
    """The figures of each group."""
    return [row for name, outcomes in groups(runs).items() for row in _figures(name, outcomes)]


def _figures(name: str, outcomes: Sequence[Outcome]) -> list[Row]:
    moved = [o for o in outcomes if o.moved]
    times = np.array([o.time_to_stop for o in moved if o.time_to_stop is not None])
    ways = [o.stop_distance for o in moved if o.stop_distance is not None]
    stands = [o.standstill for o in moved if o.standstill is not None]
    hours = sum(o.sound for o in outcomes) / 3600
    share = 100 * sum(o.stood for o in outcomes) / 3600 / hours if hours else None
    figures: dict[str, tuple[float | None, str]] = {
        f"time_to_stop_{part}_s": (of(times) if times.size else None, "s")
        for part, of in PERCENTILES.items()
    }
    figures |= {
        "standstill_max_s": (max(stands, default=None), "s"),
        "stop_distance_max_m": (max(ways, default=None), "m"),
        "stopped_percent": (100 * times.size / len(moved) if moved else None, "%"),
        "resumed_m": (_sum(outcomes, "resumed"), "m"),
        "false_stops_per_hour": (_sum(outcomes, "false_stops") / hours if hours else None, "1/h"),
        "false_stop_percent": (share, "%"),
        "collisions": (_sum(outcomes, "collisions"), ""),
        "approaches": (_sum(outcomes, "approaches"), ""),
        "wrong_follow_m": (_sum(outcomes, "wrong_follow"), "m"),
        "unnamed_stops": (_sum(outcomes, "unnamed_stops"), ""),
        "too_early_m": (_sum(outcomes, "too_early"), "m"),
        "following_h": (_sum(outcomes, "following") / 3600, "h"),
    }
    if name == "F11":
        figures["toward_person_max_mps"] = (max(o.toward_person for o in outcomes), "m/s")
    if name == "F12":
        figures["fastest_max_mps"] = (max(o.fastest for o in outcomes), "m/s")
        figures["toward_others_max_mps"] = (max(o.toward_others for o in outcomes), "m/s")
    return [
        Row("faults", name, TRACKER, metric, value, unit, seeds=len(outcomes))
        for metric, (value, unit) in figures.items()
    ]


def _sum(outcomes: Sequence[Outcome], name: str) -> float:
    return float(sum(getattr(outcome, name) for outcome in outcomes))


def plot(runs: Sequence[Run]) -> Figure:
    """Every stop as a dot, a line per fault."""
    found = {
        name: [o.time_to_stop for o in outcomes if o.time_to_stop is not None]
        for name, outcomes in groups(runs).items()
        if ":" in name
    }
    figure = Figure((8.0, 1.5 + 0.2 * len(found)), layout="constrained")
    ax = figure.subplots()
    for place, times in enumerate(found.values()):
        ax.plot(times, [place] * len(times), "o", color="tab:blue", alpha=0.4)
    ax.set_yticks(range(len(found)), list(found), fontsize="small")
    ax.set_xlabel("from the fault to zero velocity, s")
    ax.grid(axis="x", color="0.9")
    ax.invert_yaxis()
    return figure
