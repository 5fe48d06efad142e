"""The fault campaign: what counts as a stop, an approach, a false stop."""

from dataclasses import replace
from math import pi

import pytest

from followerd.bench.false_stops import account
from followerd.bench.fault_runs import GONE, MOMENTS, Job, Outcome, approaches, run
from followerd.bench.faults import DEVICES, plan, rows
from followerd.bench.mishaps import HUNG, MISHAPS
from followerd.geometry import Pose2
from followerd.messages import Command, Decision, Mode, Reason, StopReason, Twist
from followerd.sim.faults import FaultKind
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
    resumed=0.0,
    fastest=0.5,
    toward_person=0.0,
    toward_others=0.2,
    stood=18.0,
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
    bounds = ["F10", "F11", "F12", "F19"]
    assert names == ["F1", "F2", "F7", *bounds, HUNG, "laser:flip", "laser:off"]
    assert found["F2", "time_to_stop_max_s"] is None  # a bit that turns leaves some scans fresh
    assert found["F12", "fastest_max_mps"] == 0.5
    assert found["F11", "toward_person_max_mps"] == 0.0
    assert found["F1", "time_to_stop_max_s"] == 0.2
    assert found["laser:flip", "time_to_stop_p50_s"] == 0.4
    assert found["laser:flip", "stopped_percent"] == 50.0
    assert found["laser:off", "time_to_stop_p50_s"] is None
    assert found["F19", "false_stops_per_hour"] == pytest.approx(2.0)
    assert found["F19", "false_stop_percent"] == pytest.approx(1.0)


def truth(stamp: float, distance: float, v: float, bearing: float = 0.0) -> Truth:
    person = Actor("walker", distance, 0.0, 0.0, (0.0, 0.0), distance, bearing, True)
    return Truth(stamp, Pose2(), Twist(v, 0.0), person, (), 0, 0, distance, distance)


def test_only_driving_toward_somebody_near_is_an_approach() -> None:
    assert approaches([truth(0.0, 0.4, 0.3), truth(0.1, 0.39, 0.3)]) == 1
    assert approaches([truth(0.0, 0.4, 0.3), truth(0.1, 0.5, 0.3), truth(0.2, 0.4, 0.3)]) == 2
    assert approaches([truth(0.0, 0.5, 0.3), truth(0.1, 0.4, 0.05)]) == 0
    assert approaches([truth(0.0, 0.4, 0.3, pi), truth(0.1, 0.4, -0.3, 0.0)]) == 0


def test_the_plan_has_every_fault_of_every_device_at_every_moment() -> None:
    jobs = plan(1, quick=False)
    faults = {job.fault for job in jobs}
    assert {f"{device}:{kind.value}" for device in DEVICES for kind in FaultKind} <= faults
    assert faults >= MISHAPS.keys()
    laser = [job for job in jobs if job.fault == "laser:stuck"]
    assert {job.moment for job in laser} == set(MOMENTS) - {"start-up"}
    early = {job.fault for job in jobs if job.moment == "start-up"}
    assert early == {f"{d}:{k}" for d in ("robot", "laser", "camera") for k in ("off", "reboot")}
    assert sum(job.duration or 0.0 for job in jobs if job.fault == "mixed") == 3600.0
    assert len({(job.fault, job.seed, job.moment) for job in jobs}) == len(jobs)


def test_a_fault_while_it_starts_up_and_the_identity_have_rows_of_their_own() -> None:
    runs = [
        (Job("laser:off", "corridor", 1, 12.0, "start-up"), replace(STOPPED, too_early=0.3)),
        (Job("mixed", "office", 2, 60.0, preset="legs-sim"), replace(STOPPED, wrong_follow=0.5)),
        (Job(GONE, "office", 3), replace(STOPPED, time_to_stop=0.9)),
    ]
    found = {(row.scenario, row.metric): row.value for row in rows(runs)}
    names = list(dict.fromkeys(name for name, _ in found))
    numbers = ["F9", "F10", "F11", "F12", "F14", "F18", "F19"]
    assert names == [*numbers, "mixed", "mixed:legs", GONE]
    assert found["F18", "too_early_m"] == 0.3
    assert found["F9", "wrong_follow_m"] == found["mixed:legs", "wrong_follow_m"] == 0.5
    assert found["F14", "time_to_stop_max_s"] == 0.9


# what the machine tests at each change of the whole campaign, which takes minutes
@pytest.mark.slow
@pytest.mark.parametrize(
    ("job", "latest"),
    [
        (Job(HUNG, "corridor", 6100), 0.3),
        (Job("laser:off", "office", 6102), 0.5),
        (Job("robot:disconnect", "turns", 6103), 0.5),
        (Job("mixed", "office", 5608, 32.0), None),  # slid onto somebody who stood there
        (Job("mixed", "turns", 5607, 32.0), None),  # and onto a wall
    ],
    ids=lambda value: f"{value.fault}-{value.scenario}" if isinstance(value, Job) else "",
)
def test_whatever_fails_the_robot_stops_in_time_and_follows_nobody_else(
    job: Job, latest: float | None
) -> None:
    outcome = run(job)
    assert outcome.following > 4.0
    assert (outcome.collisions, outcome.approaches) == (0, 0)
    assert outcome.wrong_follow == 0.0
    if latest is not None:
        assert outcome.moved
        assert outcome.time_to_stop is not None
        assert outcome.time_to_stop <= latest


@pytest.mark.slow
def test_a_device_that_is_lost_while_it_is_set_up_ends_the_start_and_not_the_campaign() -> None:
    outcome = run(Job("laser:off", "corridor", 6001, 12.0, "start-up"))
    assert (outcome.moved, outcome.following) == (False, 0.0)


@pytest.mark.slow
def test_the_same_job_gives_the_same_outcome() -> None:
    job = Job("robot:garbage", "turns", 7)
    assert run(job) == run(job)


def decided(stamp: float, mode: Mode, *why: StopReason) -> Decision:
    reasons = tuple(Reason(reason, "x") for reason in why)
    command = Command(stamp, None if why else Twist(0.3, 0.0), stamp)
    return Decision(0, stamp, mode, None, None, command, reasons, True, "")


FOLLOWED = [decided(0.05 * k, Mode.FOLLOWING) for k in range(40)]  # until 2 s
DOUBTED = [decided(2.0 + 0.05 * k, Mode.HOLDING, StopReason.TARGET_UNSURE) for k in range(10)]
AGAIN = [decided(2.5 + 0.05 * k, Mode.FOLLOWING) for k in range(11)]
SIGHT = [truth(0.05 * k, 2.0, 0.3) for k in range(70)]


def test_a_stop_without_a_fault_is_false_and_lasts_until_it_follows_again() -> None:
    found = account(SIGHT, [*FOLLOWED, *DOUBTED, *AGAIN], [], lambda actor: actor.in_sight)
    assert found.stops == ((2.0, StopReason.TARGET_UNSURE),)
    assert found.stood == pytest.approx(0.5)
    assert found.sound == pytest.approx(3.0)


def test_a_stop_for_a_fault_or_a_person_out_of_sight_or_beside_somebody_is_none() -> None:
    drive = [*FOLLOWED, *DOUBTED, *AGAIN]
    hurt = account(SIGHT, drive, [(1.5, 9.0)], lambda actor: actor.in_sight)
    assert not hurt.stops
    assert hurt.sound == pytest.approx(1.5)
    hidden = account(SIGHT, drive, [], lambda _: False)
    assert not hidden.stops
    assert hidden.sound == pytest.approx(2.5)
    crowded = [replace(t, others=(t.target,)) for t in SIGHT]
    assert not account(crowded, drive, [], lambda _: True).stops
    by_device = [decided(2.0, Mode.HOLDING, StopReason.SCAN_STALE), *DOUBTED[1:], *AGAIN]
    found = account(crowded, [*FOLLOWED, *by_device], [], lambda _: False)
    assert found.stops == ((2.0, StopReason.SCAN_STALE),)
