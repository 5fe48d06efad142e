"""Suite `jia`: patches and depth, the motion filter and the fuzzy gears (Jia et al. 2015).

The paper shows picture sequences and paths (figures 8 to 10) and gives no numbers: a standing and
a moving robot, somebody who passes before the person, another method that loses them there.
"""

from collections.abc import Sequence
from concurrent.futures import Executor

from matplotlib.figure import Figure

from followerd.bench import jia_follow, jia_motion, jia_rides
from followerd.bench.report import Report
from followerd.bench.sweep import sweep

FIRST_SEED = 4500  # seeds below serve for tuning
QUICK_FRAMES = 60
QUICK_DURATION = 12.0  # s
MOTION_SEEDS = 20  # at least: a walk takes a fraction of a second
CROSSINGS = "occlusion", "patches/default"  # the ride that counts occlusions, 50 and more
CROSSING_SEEDS = 11  # at least
FOLLOW_SEEDS = 5  # at least, of the repaired follow law


def suite(executor: Executor, seeds: int, quick: bool) -> Report:
    """Everything, on each seed; `quick` has two seeds and shorter runs."""

    def numbers(least: int = 0) -> range:
        return range(FIRST_SEED, FIRST_SEED + (2 if quick else max(seeds, least)))

    frames = QUICK_FRAMES if quick else jia_rides.FRAMES
    duration = QUICK_DURATION if quick else 60.0
    pairs = [(s, t) for s in jia_rides.SCENARIOS for t in jia_rides.TRACKERS]
    pairs += [(s, ablation) for s in jia_rides.ABLATED for ablation in jia_rides.ABLATIONS]
    ride_jobs = [
        jia_rides.Job(scenario, tracker, seed, frames)
        for scenario, tracker in pairs
        for seed in numbers(CROSSING_SEEDS if (scenario, tracker) == CROSSINGS else 0)
    ]
    rides = sweep(executor, jia_rides.run, ride_jobs, "jia: rides")
    motion_jobs = [
        jia_motion.Job(f, seed) for f in jia_motion.FILTERS for seed in numbers(MOTION_SEEDS)
    ]
    motion = sweep(executor, jia_motion.run, motion_jobs, "jia: filter")
    follow_jobs = [
        jia_follow.Job(law, speed, seed, duration)
        for speed in jia_follow.SPEEDS
        for law in jia_follow.LAWS
        for seed in numbers(FOLLOW_SEEDS if law == "fuzzy/default" else 0)
    ]
    follow = sweep(executor, jia_follow.run, follow_jobs, "jia: following")
    rows = [*jia_rides.rows(rides), *jia_motion.rows(motion), *jia_follow.rows(follow)]
    return Report(rows, plots(rides, follow))


def plots(
    rides: Sequence[jia_rides.Outcome], follow: Sequence[jia_follow.Outcome]
) -> dict[str, Figure]:
    """The person's tracks (figure 8), the robot's paths (9), distances against time (10)."""
    seed = rides[0].job.seed
    return {
        f"tracks before a standing and a moving robot, seed {seed}": tracks(
            [o for o in rides if o.job.seed == seed]
        ),
        f"paths of person and robot, seed {seed}": paths([o for o in follow if o.job.seed == seed]),
        f"distance to the person, seed {seed}": distances(
            [o for o in follow if o.job.seed == seed]
        ),
    }


def tracks(rides: Sequence[jia_rides.Outcome]) -> Figure:
    """Where the person is, ahead and aside of the robot, and where each tracker has them."""
    figure = Figure((9.0, 6.0), layout="constrained")
    scenarios = ("still-robot", "moving-robot", "occlusion")
    panels = figure.subplots(2, len(scenarios), sharex=True, sharey="row")
    for column, scenario in enumerate(scenarios):
        mine = [o for o in rides if o.job.scenario == scenario]
        mine = [o for o in mine if o.job.tracker in jia_rides.TRACKERS]
        for axis, ax in enumerate(panels[:, column]):
            for one in mine:
                ax.plot(one.claimed[:, axis], linewidth=0.8, label=one.job.tracker)
            ax.plot(mine[0].true[:, axis], color="black", linewidth=1.3, label="true")
            ax.set_ylabel(("ahead, m", "left, m")[axis] if column == 0 else "")
        low, high = mine[0].true.min(axis=0) - 1.0, mine[0].true.max(axis=0) + 1.0
        for axis in (0, 1):
            panels[axis, column].set_ylim(low[axis], high[axis])
        panels[0, column].set_title(scenario)
        panels[1, column].set_xlabel("frame")
    panels[0, 0].legend(fontsize="small")
    return figure


def paths(follow: Sequence[jia_follow.Outcome]) -> Figure:
    """The floor from above: the person's path and that of the robot under each law."""
    figure = Figure((9.0, 7.0), layout="constrained")
    panels = figure.subplots(len(jia_follow.SPEEDS), 1, sharex=True)
    for ax, speed in zip(panels, jia_follow.SPEEDS, strict=True):
        mine = [o for o in follow if o.job.speed == speed]
        for one in mine:
            ax.plot(*one.robot.T, linewidth=1.0, label=one.job.law)
        for one in mine[:1]:
            ax.plot(*one.person.T, "k--", linewidth=1.2, label="person")
        ax.set(title=f"person at {speed} m/s", ylabel="y, m", aspect="equal")
    panels[-1].set_xlabel("x, m")
    panels[0].legend(fontsize="small")
    return figure


def distances(follow: Sequence[jia_follow.Outcome]) -> Figure:
    """Distance against time under each law."""
    figure = Figure((9.0, 6.0), layout="constrained")
    panels = figure.subplots(len(jia_follow.SPEEDS), 1, sharex=True)
    for ax, speed in zip(panels, jia_follow.SPEEDS, strict=True):
        for one in follow:
            if one.job.speed == speed:
                ax.plot(one.time, one.range, linewidth=1.0, label=one.job.law)
        ax.set(title=f"person at {speed} m/s", ylabel="distance, m", ylim=(0.0, 4.0))
    panels[-1].set_xlabel("s")
    panels[0].legend(fontsize="small")
    return figure
