"""Suite `jia`: its scores by hand, and one short ride and run of each part."""

import pytest

from followerd.bench import jia, jia_follow, jia_rides
from followerd.bench.jia_rides import Look, figures, held, occlusions
from followerd.config import load
from followerd.sim import scenarios
from followerd.trackers.patches import PatchesSettings


def look(fit: float | None = 0.8, shown: float = 1.0, person: int | None = 0) -> Look:
    return Look(fit, shown, True, 0.05, person, 0.005)


def test_success_is_the_share_of_frames_with_the_person_in_view() -> None:
    found = figures([look(0.8), look(0.2), look(None), look(0.6)])
    assert found["success_percent"][0] == pytest.approx(200 / 3)
    assert found["error_3d_cm"][0] == pytest.approx(5.0)
    assert found["frame_ms"][0] == pytest.approx(5.0)


def test_identity_switches_are_counted_there_and_back() -> None:
    track = [look(), look(person=2), look(person=None), look(person=2), look()]
    assert figures(track)["identity_switches"][0] == 2.0


def test_an_occlusion_is_over_when_the_person_is_seen_well_again() -> None:
    walk = [look()] * 3 + [look(shown=0.1)] * 4 + [look(shown=0.6)] * 2 + [look()] * 20
    (end,) = occlusions(walk)
    assert end == 9
    assert held(walk, end)
    lost = walk[:9] + [look(0.0)] * 20
    assert not held(lost, end)


@pytest.mark.slow
def test_every_baseline_is_a_tracker_and_every_scenario_ships() -> None:
    for changes in (*jia_rides.TRACKERS.values(), *jia_rides.ABLATIONS.values()):
        PatchesSettings.model_validate(changes)
    for name, _ in jia_rides.SCENARIOS.values():
        assert scenarios.load(name).target_is_person
    for changes in jia_follow.LAWS.values():
        assert load("patches-sim", dict(changes)).controller.kind == "fuzzy_gears"


def test_the_person_walks_the_path_at_the_speed_asked_for() -> None:
    (person,) = jia_follow.walking(scenarios.load("jia-paths"), 1.0).people
    assert {stop.speed_mps for stop in person.path} == {1.0}
    assert person.path[3].pause_s == 10.0


@pytest.mark.slow
def test_a_short_ride_is_scored_and_drawn() -> None:
    rides = [
        jia_rides.run(jia_rides.Job(scenario, "patches/default", 0, 4))
        for scenario in ("still-robot", "moving-robot", "occlusion")
    ]
    assert rides[0].figures["success_percent"][0] == 100.0
    assert {row.metric for row in jia_rides.rows(rides)} >= {"success_percent", "frame_ms"}
    assert len(jia.tracks(rides).axes) == 6


@pytest.mark.slow
def test_a_short_run_behind_a_person_is_scored_and_drawn() -> None:
    one = jia_follow.run(jia_follow.Job("fuzzy/default", 0.8, 0, duration=5.5))
    assert one.figures["out_of_view_percent"][0] == 0.0
    least = one.figures["min_range_m"][0]
    assert least is not None
    assert 1.2 < least < 2.1
    assert len(jia.paths([one]).axes) == len(jia.distances([one]).axes) == 2
