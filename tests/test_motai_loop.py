"""Motai's law in closed loop, through the twins of base and head."""

import numpy as np
import pytest

from followerd.bench import motai_loop
from followerd.bench.motai_loop import Job, Law, Outcome, run
from followerd.runtime import logs


@pytest.fixture(autouse=True)
def quiet() -> None:
    logs.configure("error")


def outcomes(law: Law, target: str = "A", seeds: range = range(300, 303)) -> list[Outcome]:
    return [run(Job(target, "fast", "head", law, seed)) for seed in seeds]


def near(runs: list[Outcome]) -> float:
    return float(np.mean([(one.off <= 10.0).mean() for one in runs]))


@pytest.mark.slow
def test_a_run_depends_on_its_job_alone() -> None:
    job = Job("C", "moderate", "heading", "kf", 7)
    assert np.array_equal(run(job).directions, run(job).directions)


@pytest.mark.slow
def test_the_same_target_is_shown_to_every_law() -> None:
    one, other = (run(Job("A", "slow", "head", law, 3)) for law in ("queue", "of"))
    moved = [np.ptp(run_.directions[:, 0]) for run_ in (one, other)]
    assert moved[0] == pytest.approx(moved[1], abs=0.5)


def shown(target: str, law: Law, *off: float) -> Outcome:
    camera = np.array(off)
    directions = np.column_stack([0.0 * camera, camera])
    return Outcome(Job(target, "fast", "head", law, 1), directions)


def test_rows_say_what_is_reached_of_the_oracle_and_how_a_queue_compares() -> None:
    runs = [
        one
        for target in "ABC"
        for one in (
            shown(target, "imm_pda", 0.0, 8.0, 12.0, 4.0),
            shown(target, "oracle", 1.0, 1.0, 1.0, -1.0),
            shown(target, "queue", 20.0, 20.0, -30.0, 2.0),
        )
    ]
    rows = {(row.tracker, row.metric): row.value for row in motai_loop.rows(runs)}
    assert rows["imm_pda", "reach_of_oracle"] == pytest.approx(0.75)
    assert rows["imm_pda", "queue_over_overwrite"] == pytest.approx(3.0)
    assert rows["queue", "in_view_percent"] == pytest.approx(75.0)
    assert rows["queue", "off_worst_deg"] == 30.0
    assert list(motai_loop.plots(runs))


@pytest.mark.slow
def test_a_head_keeps_a_fast_target_in_view_and_nearly_as_near_as_an_oracle_would() -> None:
    ours = outcomes("imm_pda")
    assert max(one.off.max() for one in ours) < 25.0
    assert near(ours) > 0.85 * near(outcomes("oracle"))


@pytest.mark.slow
def test_turns_that_wait_for_each_other_come_too_late() -> None:
    queued, ours = outcomes("queue"), outcomes("imm_pda")
    factor = np.mean([one.off.mean() for one in queued]) / np.mean([o.off.mean() for o in ours])
    assert factor > 1.5


@pytest.mark.slow
def test_the_base_alone_follows_moderate_turns() -> None:
    runs = [run(Job("A", "moderate", "heading", "imm_pda", seed)) for seed in range(300, 303)]
    assert max(one.off.max() for one in runs) < 25.0
