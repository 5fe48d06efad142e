"""Where the person will be seen next, and the predictors that only run alongside."""

import asyncio
from dataclasses import replace
from math import degrees, inf, pi, radians
from typing import get_args

import numpy as np
import pytest

from followerd import clock
from followerd.bench.closed_loop import simulate
from followerd.config import load
from followerd.estimation.foresight import Foresight, ForesightSettings
from followerd.estimation.predictors import Kind
from followerd.messages import Command, Decision, Mode, Sight
from followerd.runtime import logs, shadows
from followerd.runtime.shadows import Shadows

T = 1 / 15


def foresight(**settings: float | str) -> Foresight:
    return Foresight(ForesightSettings.model_validate(settings), np.random.default_rng(1))


@pytest.mark.parametrize("kind", get_args(Kind))
def test_a_steady_turn_is_foreseen_through_the_jump_of_the_angle(kind: Kind) -> None:
    """From 150 degrees on to the left, past 180."""
    one = foresight(predictor=kind, sigma_deg=0.3)
    for k in range(60):
        one.see(k * T, (radians(150.0 + 20.0 * k * T) + pi) % (2 * pi) - pi)
    at = one.at(60 * T)
    assert at is not None
    assert degrees(at) == pytest.approx(150.0 + 80.0, abs=1.0)


@pytest.mark.parametrize("burst", [1, 2, 3])
def test_wrong_sights_before_a_gap_do_not_lead_the_search_away(burst: int) -> None:
    """A heat source beside a person who turns by 40 degrees a second, then nobody is seen."""
    one = foresight(sigma_deg=0.7)
    for k in range(30):
        one.see(k * T, radians(40.0 * k * T))
    for k in range(30, 30 + burst):
        one.see(k * T, radians(40.0 * 30 * T - 18.0))
    at = one.at((29 + burst) * T + 0.4)
    assert at is not None
    assert degrees(at) == pytest.approx(40.0 * (29 + burst) * T, abs=4.0)


def test_whoever_is_not_where_they_were_foreseen_is_looked_for_where_last_seen() -> None:
    one = foresight(forget_s=0.8, reach_s=0.3)
    for k in range(30):
        one.see(k * T, radians(30.0 * k * T))
    last = 29 * T
    assert one.at(last + 0.2) == pytest.approx(radians(30.0 * (last + 0.2)), abs=0.02)
    assert one.at(last + 0.7) == pytest.approx(radians(30.0 * last), abs=1e-4)
    assert one.at(last + 0.9) is None
    one.see(last + 2.0, 1.0)  # anew, standing
    assert one.at(last + 2.2) == pytest.approx(1.0)


def test_what_is_not_newer_is_left_out_and_somebody_else_begins_anew() -> None:
    one = foresight()
    assert one.at(0.0) is None
    one.see(1.0, 0.5)
    one.see(1.0, 0.9)
    one.see(0.5, 0.9)
    newest = one.newest
    assert newest == Sight(1.0, 0.5)
    one.forget()
    assert one.newest is None
    assert one.at(1.0) is None


def decision(sight: Sight | None) -> Decision:
    return Decision(0, 0.0, Mode.READY, None, None, Command(0.0), sight=sight)


def run_beside(one: Shadows, sights: list[Sight | None]) -> None:
    async def told() -> None:
        for sight in sights:
            one.note(replace(decision(sight)))
            one.note(decision(sight))  # the same again is nothing new
            await clock.sleep(0.01)

    async def story() -> None:
        task = asyncio.create_task(one.run())
        await told()
        task.cancel()

    clock.run_virtual(story())


def test_shadows_say_how_far_off_each_would_have_been() -> None:
    kinds: tuple[Kind, ...] = ("kf", "of", "pf")
    one = Shadows(kinds, ForesightSettings(), np.random.default_rng(2))
    run_beside(one, [Sight(k * T, radians(25.0 * k * T)) for k in range(40)])
    figures = one.figures()
    assert figures["shed"] == 0
    for kind in kinds:
        row = figures[kind]
        assert isinstance(row, dict)
        assert row["sights"] == 39
        assert row["error_mean_deg"] < 1.5


def test_shadows_forget_with_the_pipeline() -> None:
    one = Shadows(("of",), ForesightSettings(), np.random.default_rng(2))
    run_beside(one, [Sight(0.0, 0.0), None, Sight(0.1, 2.0), Sight(0.2, 2.0)])
    row = one.figures()["of"]
    assert isinstance(row, dict)
    assert (row["sights"], row["error_mean_deg"]) == (1, 0.0)


def test_shadows_are_shed_before_they_take_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that takes 20 ms may look at a sight every 2 s."""
    one = Shadows(("of",), ForesightSettings(), np.random.default_rng(2))
    now = [0.0]
    see = Foresight.see

    def slow(self: Foresight, stamp: float, pan: float) -> None:
        now[0] += 0.02
        see(self, stamp, pan)

    monkeypatch.setattr(Foresight, "see", slow)
    monkeypatch.setattr(clock, "now", lambda: now[0])

    async def story() -> None:
        task = asyncio.create_task(one.run())
        for k in range(60):
            now[0] = max(now[0], k * T)
            one.note(decision(Sight(k * T, 0.0)))
            await asyncio.sleep(0)
            await asyncio.sleep(0)
        task.cancel()

    asyncio.run(story())
    assert one.shed >= 55


def test_more_sights_than_wait_are_left_out() -> None:
    one = Shadows(("of",), ForesightSettings(), np.random.default_rng(2))

    async def story() -> None:
        for k in range(20):
            one.note(decision(Sight(k * T, 0.0)))

    clock.run_virtual(story())
    assert one.shed == 20 - shadows.WAITING


@pytest.mark.slow
def test_shadows_change_nothing_and_stand_in_the_summary() -> None:
    logs.configure("error")
    watched, alone = (
        simulate(load("ofkf-sim", {"shadow": kinds, "seed": 5}), 7.0)
        for kinds in (["pf", "kf"], [])
    )
    assert alone["shadow"] is None
    assert set(watched["shadow"]) == {"shed", "imm_pda", "pf", "kf"}
    assert watched["shadow"]["kf"]["sights"] > 50
    assert watched["follow"] == alone["follow"]
    assert watched["follow"]["tracking_rate"] > 0.7
    assert inf > watched["shadow"]["kf"]["error_mean_deg"] > 0.0
