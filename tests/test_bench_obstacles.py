"""F10: something is suddenly in the way of the whole daemon; `bench obstacles` has the figures."""

import pytest

from followerd.bench.obstacles import SCENES, Job, Outcome, rows, run


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene",
    [
        "box at the zone's end",
        "thin pole",
        "steps in from the right",
        "dark trousers",
        "backward: person",
        "turning left: pole",
    ],
)
def test_f10_what_is_suddenly_in_the_way_stops_it_within_400_ms(scene: str) -> None:
    outcome = run(Job(scene, 1))
    assert outcome.moved
    assert outcome.time_to_stop is not None
    assert outcome.time_to_stop <= 0.4
    assert outcome.held >= 0.99
    assert not outcome.touched


def test_f10_there_are_twenty_scenes_and_more() -> None:
    assert len(SCENES) >= 20


def test_runs_that_never_got_under_way_do_not_count() -> None:
    stopped, idle = Outcome(True, 0.2, 1.0, False), Outcome(False, None, 0.0, False)
    found = rows([(Job("pole", 1), stopped), (Job("pole", 2), idle)])
    figures = {row.metric: row.value for row in found if row.scenario == "all"}
    assert figures["time_to_stop_max_s"] == 0.2
    assert figures["stopped_percent"] == 100.0
    assert {row.seeds for row in found} == {1}
