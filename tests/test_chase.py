"""A head that keeps pace with a moving goal: what it is told, and how near it stays on the twin."""

from math import degrees, radians, sin

import numpy as np
import pytest

from followerd import clock
from followerd.hw.vcc50i.chase import Chase, Goal
from followerd.hw.vcc50i.driver import Vcc50i, Vcc50iSettings
from followerd.messages import Measurement, PtzState
from followerd.sim.line import Line
from followerd.sim.twins.vcc50i import Vcc50iTwin
from tests.test_head_wiring import Ended, ended

ENDS = (-889, 889)


def chase(goal: Goal) -> Chase:
    made = Chase(800, ENDS)
    made.goal = goal
    return made


@pytest.mark.parametrize(
    ("goal", "pan", "expected"),
    [
        (Goal(100, 0.0, 0.0), 0, 1),  # to the right
        (Goal(-100, 0.0, 0.0), 0, -1),
        (Goal(1, 0.0, 0.0), 0, 0),  # not worth it
        (Goal(0, 200.0, 0.0), 0, 1),  # there, but it moves on
        (Goal(880, 300.0, 0.0), 889, 0),  # beyond the end
    ],
)
def test_it_runs_towards_where_the_goal_is_by_then(goal: Goal, pan: int, expected: int) -> None:
    speed = chase(goal).speed(pan, 0.0, 0.02)
    assert np.sign(speed) == expected


def test_it_is_never_told_more_than_it_can() -> None:
    assert chase(Goal(889, 0.0, 0.0)).speed(-889, 0.0, 0.0) == 800


def test_a_goal_that_nobody_renews_comes_to_rest() -> None:
    one = chase(Goal(0, 400.0, 0.0))
    assert one.speed(0, 0.1, 0.1) > 0
    late = chase(Goal(0, 400.0, 0.0))
    assert late.speed(160, 5.0, 5.0) == 0


def test_small_changes_are_not_worth_telling_but_a_turn_back_is() -> None:
    one = chase(Goal(0, 0.0, 0.0))
    one.told = 100
    assert not one.is_news(105)
    assert one.is_news(150)
    assert one.is_news(0)
    one.told = 8
    assert one.is_news(-8)


def follows(paced: bool, speed_dps: float, baud: int) -> float:
    """Mean error, deg, behind a goal that swings at `speed_dps` at most."""
    off: list[float] = []
    states: list[PtzState] = []

    def note(measurement: Measurement) -> None:
        assert isinstance(measurement, PtzState)
        states.append(measurement)

    async def story() -> None:
        twin = Vcc50iTwin(np.random.default_rng(1), knows_home=True, baud=baud)
        line = Line(twin, np.random.default_rng(2), "ptz")
        head = Vcc50i(Vcc50iSettings(baud=19200, rate_hz=30), line.link)

        async def swing() -> None:
            while not states:
                await clock.sleep(0.02)
            began = clock.now()
            while (t := clock.now() - began) < 8.0:
                goal = 40.0 * sin(speed_dps / 40.0 * t)
                rate = speed_dps * np.cos(speed_dps / 40.0 * t)
                head.look(radians(goal), 0.0, radians(rate) if paced else None)
                await clock.sleep(1 / 30)
                twin.head.advance(clock.now())
                goal = 40.0 * sin(speed_dps / 40.0 * (clock.now() - began))
                off.append(abs(goal + 0.1125 * twin.head.pan.position))
            head.look(radians(10.0), 0.0)  # and a place again, at its full speed
            await clock.sleep(2.0)
            assert degrees(states[-1].pan) == pytest.approx(10.0, abs=0.3)
            assert twin.head.pan_speed == 800

        with pytest.raises(Ended):
            await clock.together(line.run(), head.run(note), ended(swing()))

    clock.run_virtual(story())
    return float(np.mean(off))


@pytest.mark.slow
def test_keeping_pace_lags_less_than_moves_from_place_to_place() -> None:
    paced, moved = (follows(by_pace, 50.0, 19200) for by_pace in (True, False))
    assert paced < 3.0
    assert paced < 0.5 * moved
