"""The fault campaign: what counts as a stop, an approach, a false stop."""

from dataclasses import replace
from math import pi

import pytest

from followerd.bench.fault_runs import HUNG, Job, Outcome, approaches, run
from followerd.bench.faults import rows
from followerd.geometry import Pose2
from followerd.messages import Twist
from followerd.sim.truth import Actor, Truth

STOPPED = Outcome(
    moved=True,
    time_to_stop=0.2,
    standstill=1.0,
    stop_distance=0.3,
    collisions=0,
    approaches=0,
    wrong_follow=0.0,
    false_stops=1,
    unnamed_stops=0,
    stops=2,
    too_early=0.0,
    sound=1800.0,
    following=1900.0,
)


def test_figures_stand_by_failsafe_and_by_fault() -> None:
    went_on = replace(STOPPED, time_to_stop=None, standstill=None, stop_distance=None)
    runs = [
        (Job(HUNG, "corridor", 1), STOPPED),
        (Job("laser:flip", "corridor", 1), went_on),
        (Job("laser:flip", "corridor", 2), replace(STOPPED, time_to_stop=0.4)),
        (Job("laser:off", "corridor", 1), replace(STOPPED, moved=False)),
    ]
    found = {(row.scenario, row.metric): row.value for row in rows(runs)}
    names = list(dict.fromkeys(name for name, _ in found))
    assert names == ["F1", "F2", "F7", "F10", "F19", HUNG, "laser:flip", "laser:off"]
    assert found["F1", "time_to_stop_max_s"] == 0.2
    assert found["laser:flip", "time_to_stop_p50_s"] == 0.4
    assert found["laser:flip", "stopped_percent"] == 50.0
    assert found["laser:off", "time_to_stop_p50_s"] is None
    assert found["F19", "false_stops_per_hour"] == pytest.approx(2.0)


def truth(stamp: float, distance: float, v: float, bearing: float = 0.0) -> Truth:
    person = Actor("walker", distance, 0.0, 0.0, (0.0, 0.0), distance, bearing, True)
    return Truth(stamp, Pose2(), Twist(v, 0.0), person, (), 0, 0, distance, distance)


def test_only_driving_toward_somebody_near_is_an_approach() -> None:
    assert approaches([truth(0.0, 0.4, 0.3), truth(0.1, 0.39, 0.3)]) == 1
    assert approaches([truth(0.0, 0.4, 0.3), truth(0.1, 0.5, 0.3), truth(0.2, 0.4, 0.3)]) == 2
    assert approaches([truth(0.0, 0.5, 0.3), truth(0.1, 0.4, 0.05)]) == 0
    assert approaches([truth(0.0, 0.4, 0.3, pi), truth(0.1, 0.4, -0.3, 0.0)]) == 0


@pytest.mark.slow
def test_the_same_job_gives_the_same_outcome() -> None:
    job = Job("robot:garbage", "turns", 7)
    assert run(job) == run(job)
