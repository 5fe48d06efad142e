"""Motai's follow law: what it wishes, and what a Pioneer makes of it."""

from collections.abc import Callable
from dataclasses import replace
from math import degrees, radians
from typing import Any

import numpy as np
import pytest

from followerd import app, clock
from followerd.config import load
from followerd.control.heading_overwrite import HeadingOverwrite, HeadingOverwriteSettings
from followerd.control.interfaces import HeadController, Scene, Target
from followerd.errors import ConfigError
from followerd.events import Tick
from followerd.geometry import Pose2, wrap_angle
from followerd.hw.p2os.commands import Cmd
from followerd.messages import LookAt, Odometry, Sight, TurnBy, Twist
from tests.p2os_bench import Bench, bench, story

AHEAD = Target(0.0, range=3.0)


def law(**settings: Any) -> HeadingOverwrite:
    return HeadingOverwrite(HeadingOverwriteSettings(**settings))


def turning(start_deg: float, rate_dps: float = 0.0) -> Callable[[float], float]:
    """Foresees a person who turns steadily from a direction at time 0."""
    return lambda stamp: radians(start_deg + rate_dps * stamp)


def scene(
    foresee: Callable[[float], float | None],
    now: float = 0.0,
    heading_deg: float = 0.0,
    **more: Any,
) -> Scene:
    base = Pose2(theta=radians(heading_deg))
    sight = Sight(now, foresee(now) or 0.0)
    return Scene(now, base, Twist(), **{"sight": sight, "foresee": foresee, **more})


def test_the_turn_ends_where_the_person_will_be_when_the_base_gets_there() -> None:
    still = law().wish(AHEAD, scene(turning(20.0)))
    assert isinstance(still, TurnBy)
    assert degrees(still.angle) == pytest.approx(20.0)
    moving = law(latency_s=0.1, brake_degps2=100.0).wish(AHEAD, scene(turning(20.0, 30.0)))
    assert isinstance(moving, TurnBy)
    braking = 0.5 * 30.0**2 / 100.0
    assert degrees(moving.angle) == pytest.approx(20.0 + 3.0 + braking, abs=0.01)


def test_the_turn_counts_from_the_heading_that_the_base_reported() -> None:
    reported = Odometry(-0.08, -0.08, Pose2(theta=radians(35.0)), Twist())
    wish = law().wish(AHEAD, scene(turning(60.0), heading_deg=40.0, odometry=reported))
    assert isinstance(wish, TurnBy)
    assert degrees(wish.angle) == pytest.approx(25.0)


def test_what_is_within_the_dead_band_turns_nothing() -> None:
    reported = Odometry(0.0, 0.0, Pose2(theta=radians(10.0)), Twist())
    wish = law(dead_band_deg=1.0).wish(
        AHEAD, scene(turning(10.8), heading_deg=10.0, odometry=reported)
    )
    assert isinstance(wish, TurnBy)
    assert wish.angle == 0.0


def test_an_unseen_person_is_turned_to_where_the_laser_has_them() -> None:
    wish = law(turn="rate").wish(Target(0.3, range=3.0), scene(lambda _: None))
    assert isinstance(wish, Twist)
    assert wish.omega > 0.0


def test_a_rate_follows_a_steady_turn_and_is_capped() -> None:
    on_it = law(turn="rate", latency_s=0.0).wish(AHEAD, scene(turning(0.0, 20.0)))
    assert isinstance(on_it, Twist)
    assert degrees(on_it.omega) == pytest.approx(20.0)
    far = law(turn="rate", max_turn_degps=50.0).wish(AHEAD, scene(turning(-120.0)))
    assert isinstance(far, Twist)
    assert degrees(far.omega) == pytest.approx(-50.0)


@pytest.mark.parametrize(
    ("target", "drives"),
    [
        (Target(0.0, range=3.0), True),
        (Target(0.0, range=1.5), False),
        (Target(0.0, range=0.7), False),  # never backward
        (Target(0.0), False),  # at an unknown distance
        (Target(radians(100), range=3.0), False),  # not past somebody who stands behind
    ],
)
def test_the_laser_range_keeps_the_distance(target: Target, drives: bool) -> None:
    assert (law().wish(target, scene(turning(0.0))).v > 0.0) is drives
    assert law(turn_only=True).wish(target, scene(turning(0.0))).v == 0.0


def test_a_head_takes_the_fast_part_and_the_base_brings_it_back_to_its_middle() -> None:
    both = law(head=True, head_latency_s=0.1)
    assert isinstance(both, HeadController)
    seen = scene(turning(30.0, 20.0), heading_deg=5.0)
    look = both.look(seen)
    assert look is not None
    assert degrees(look.pan) == pytest.approx(30.0 + 2.0 - 5.0)
    base = both.wish(AHEAD, seen)
    assert isinstance(base, Twist)
    assert 0.0 < degrees(base.omega) < 40.0
    middle = both.wish(AHEAD, scene(turning(7.0), heading_deg=5.0))
    assert middle.omega == 0.0  # type: ignore[union-attr]  # a Twist as above


def test_the_head_keeps_pace_with_the_bases_turn() -> None:
    both = law(head=True, head_latency_s=0.1)
    look = both.look(replace(scene(turning(0.0)), twist=Twist(0.0, radians(40.0))))
    assert look is not None
    assert degrees(look.pan) == pytest.approx(-4.0)
    assert look.rate == pytest.approx(radians(-40.0))


@pytest.mark.parametrize(
    ("seen_deg", "leans_deg"),
    [(10.0, 0.0), (12.5, 0.0), (18.0, 4.8), (40.0, 6.0), (2.0, -4.8), (-350.0, 0.0)],
)
def test_the_head_leans_to_a_sight_that_may_be_wrong_but_not_far(
    seen_deg: float, leans_deg: float
) -> None:
    look = law(head=True, doubt_deg=6.0).look(
        scene(turning(10.0), sight=Sight(0.0, radians(seen_deg)))
    )
    assert look is not None
    assert degrees(look.pan) == pytest.approx(10.0 + leans_deg)


def test_the_head_is_told_nothing_new_for_less_than_the_dead_band() -> None:
    both = law(head=True, dead_band_deg=1.0)
    first = both.look(scene(turning(10.0)))
    assert both.look(scene(turning(10.6))) is first
    assert both.look(scene(turning(11.4))) is not first


def test_without_a_head_or_a_person_in_sight_nobody_looks_anywhere() -> None:
    assert law().look(scene(turning(10.0))) is None
    assert law(head=True).look(scene(lambda _: None)) is None


# on a Pioneer


async def headings(made: Bench, controller: HeadingOverwrite, goal_deg: float) -> list[float]:
    """Deg, in 3 s of images, 15 a second, of somebody who stands at `goal_deg`."""
    found = []
    for k in range(150):
        now = clock.now()
        heading = made.newest.pose
        sight = Sight(0.0 + k // 3, 0.0)
        seen = replace(
            scene(turning(goal_deg), now, degrees(heading.theta), odometry=made.newest), sight=sight
        )
        await made.drive(controller.wish(Target(0.0), seen), 0.02, 0.02)
        found.append(degrees(wrap_angle(made.body.pose.theta)))
    return found


def test_overwritten_headings_arrive_and_the_papers_added_turns_run_past() -> None:
    """DHEAD counts from the base's own goal: told again under way, it is added again."""
    off = {}

    async def told() -> None:
        for profile in ("default", "paper"):
            async with bench() as made:
                await made.connect()
                await made.motors_on()
                turned = np.array(await headings(made, law(profile=profile), 40.0))
                off[profile] = np.abs(turned - 40.0)[len(turned) // 2 :]
                heard = {number for number, _ in made.twin.heard}
                assert (Cmd.DHEAD in heard) is (profile == "paper")
                assert (Cmd.HEAD in heard) is (profile == "default")

    story(told)
    assert off["default"].max() < 1.0
    assert off["paper"].max() > 30.0


def test_a_turn_that_is_added_is_told_once_however_long_it_is_wished() -> None:
    async def told() -> None:
        async with bench() as made:
            await made.connect()
            await made.motors_on()
            await made.drive(TurnBy(radians(30.0), added=True), 2.0)
            assert [number for number, _ in made.twin.heard].count(Cmd.DHEAD) == 1
            assert degrees(made.body.pose.theta) == pytest.approx(30.0, abs=1.0)

    story(told)


def test_a_heading_is_kept_while_the_base_turns_to_it() -> None:
    """Whatever the reports say meanwhile, the goal on the wire stays."""

    async def told() -> None:
        async with bench() as made:
            await made.connect()
            await made.motors_on()
            goals = []
            for _ in range(60):
                heading = degrees(made.newest.pose.theta)
                seen = scene(turning(70.0), clock.now(), heading, odometry=made.newest)
                await made.drive(law().wish(Target(0.0), seen), 0.02, 0.02)
            goals = [argument for number, argument in made.twin.heard if number == Cmd.HEAD]
            assert np.ptp(np.array(goals, float)) <= 1.0

    story(told)


def test_a_law_that_turns_a_head_needs_one() -> None:
    with pytest.raises(ConfigError, match="add a ptz section"):
        app.verify(load("ofkf-sim", {"ptz": None}))


def test_the_head_is_told_only_what_is_new(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[float, float | None]] = []

    async def run() -> None:
        config = load("ofkf-sim")
        daemon = app.build(config, app.in_memory(app.rig(config)))
        assert daemon.head is not None
        monkeypatch.setattr(
            daemon.head, "look", lambda pan, tilt, rate: told.append((pan + tilt, rate))
        )
        looks = iter([None, LookAt(0.1), LookAt(0.1), LookAt(0.2, rate=0.3), None])
        step = daemon.pipeline.step
        monkeypatch.setattr(
            daemon.pipeline, "step", lambda event, now: replace(step(event, now), look=next(looks))
        )
        for _ in range(5):
            daemon.handle(Tick())

    clock.run_virtual(run())
    assert told == [(0.1, None), (0.2, 0.3)]
