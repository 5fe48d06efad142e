"""The fuzzy surfaces and the follow law `fuzzy_gears`."""

from math import atan2, hypot, radians
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from followerd.app import equipment, laser_settings, pipeline_settings
from followerd.bench import fields
from followerd.bench.jia_follow import call_us
from followerd.bench.surfaces import picture
from followerd.cli.check import check
from followerd.config import load as load_config
from followerd.control.fuzzy import SETS, Surface, load, memberships
from followerd.control.fuzzy_gears import FuzzyGears, FuzzyGearsSettings
from followerd.control.interfaces import Target
from followerd.errors import ConfigError, UsageError
from followerd.messages import WheelSpeeds

PAPER, DEFAULT = load("paper"), load("default")
SPEED = DEFAULT.speed()
LAW = FuzzyGears()
ENDS = -1.0, -0.5, 0.0, 0.5, 1.0


def at(surface: Surface, first: float, second: float) -> float:
    """The exact output for two inputs in half domains."""
    a, b = (
        np.array([0.5 * (low + high + value * (high - low))])
        for value, (low, high) in ((first, surface.first), (second, surface.second))
    )
    return float(surface.infer(a, b)[0, 0])


def seen(x: float, y: float, vx: float = 0.0, vy: float = 0.0) -> Target:
    return Target(atan2(y, x), hypot(x, y), (vx, vy), 0.05)


def omega(wheels: WheelSpeeds) -> float:
    return (wheels.right - wheels.left) / (2 * LAW.settings.half_track_m)


def speed(wheels: WheelSpeeds) -> float:
    return 0.5 * (wheels.left + wheels.right)


def test_neighbouring_sets_cross_at_one_half() -> None:
    between = memberships(np.array([-0.75, -0.25, 0.25, 0.75]), PAPER.sigma)
    for i in range(4):
        assert between[i, i] == pytest.approx(0.5, abs=0.01)
        assert between[i + 1, i] == pytest.approx(0.5, abs=0.01)


def test_in_the_middle_of_two_sets_the_rule_of_their_cell_prevails() -> None:
    """The corners named in the paper's text: (PF, PF) is the fastest, (NF, NF) the slowest."""
    for table, surface, sets in (
        (DEFAULT.speed_rules, DEFAULT.speed(), DEFAULT.speeds),
        (DEFAULT.gear_rules, DEFAULT.gear(), DEFAULT.gears),
    ):
        for i in range(len(SETS)):
            for j in range(len(SETS)):
                off = abs(at(surface, ENDS[i], ENDS[j]) - sets[table[i][j]])
                assert off < 0.14, (SETS[i], SETS[j])


def test_left_and_right_are_mirror_images_in_the_gears() -> None:
    inputs = np.linspace(-1.0, 1.0, 21)
    for rules in (PAPER, DEFAULT):
        table = rules.gear().infer(1.25 * inputs, inputs)
        assert np.allclose(table, table[::-1, ::-1], atol=1e-9)


def test_the_default_speed_grows_with_both_inputs_and_uses_its_range() -> None:
    table = DEFAULT.speed().infer(np.linspace(0.0, 3.0, 41), np.linspace(-1.0, 1.0, 41))
    assert np.diff(table, axis=0).min() > -1e-9
    assert np.diff(table, axis=1).min() > -1e-9
    assert table.min() < 0.02
    assert table.max() > 0.99


def test_the_papers_centroid_never_reaches_the_ends() -> None:
    """Why `default` infers otherwise: the published robot cannot be told to stand."""
    table = PAPER.speed().infer(np.linspace(0.0, 3.0, 21), np.linspace(-1.0, 1.0, 21))
    assert 0.05 < table.min() < 0.2
    assert 0.8 < table.max() < 0.97


@given(st.floats(-1.0, 4.0), st.floats(-2.0, 2.0))
def test_looking_up_is_inferring(x: float, v: float) -> None:
    exact = float(SPEED.infer(np.clip([x], 0.0, 3.0), np.clip([v], -1.0, 1.0))[0, 0])
    assert SPEED.at(x, v) == pytest.approx(exact, abs=0.01)


@given(st.floats(0.1, 5.0), st.floats(-1.4, 1.4), st.floats(-2, 2), st.floats(-2, 2))
def test_wheels_and_turn_rate_stay_within_their_limits(
    away: float, bearing: float, vx: float, vy: float
) -> None:
    wheels = LAW.wish(Target(bearing, away, (vx, vy)))
    assert max(abs(wheels.left), abs(wheels.right)) <= LAW.settings.max_wheel_mps + 1e-9
    assert abs(omega(wheels)) <= LAW.settings.max_turn_radps + 1e-9
    assert speed(wheels) >= -1e-9


def test_a_person_on_the_left_is_turned_to_on_the_arc_through_them() -> None:
    wheels = LAW.wish(seen(2.5, 0.5, 0.5))
    arc = 2 * 0.5 / (2.5**2 + 0.5**2)
    gain = omega(wheels) / (speed(wheels) * arc)
    assert wheels.right > wheels.left
    assert gain == pytest.approx(LAW.settings.max_gain * LAW.gear.at(0.5, 0.0), rel=1e-6)


@pytest.mark.parametrize("x", [0.3, 0.9, 1.15])
def test_near_the_person_the_robot_only_turns(x: float) -> None:
    """The rule tables alone would drive into whoever stands there."""
    wheels = LAW.wish(seen(x, 0.2, vx=1.0))
    assert speed(wheels) == 0.0
    assert omega(wheels) > 0.1


def test_behind_the_robot_or_at_an_unknown_distance_it_turns_in_place() -> None:
    for target in (seen(-1.0, 0.3), Target(radians(40))):
        wheels = LAW.wish(target)
        assert speed(wheels) == 0.0
        assert omega(wheels) > 0.3


def test_a_large_gain_is_capped_where_it_would_swing() -> None:
    law = FuzzyGears(FuzzyGearsSettings(stop_m=0.2, full_m=0.3))
    wheels = law.wish(seen(0.5, 0.1, vx=1.0, vy=1.0))
    gain = omega(wheels) / (2 * 0.1 / (0.5**2 + 0.1**2))  # v k
    assert 2 * gain / hypot(0.5, 0.1) <= law.settings.loop_gain_per_s + 1e-6


def test_the_papers_profile_is_the_table_and_the_wheel_law() -> None:
    law = FuzzyGears(FuzzyGearsSettings(profile="paper"))
    wheels = law.wish(seen(0.4, 0.0))
    assert speed(wheels) == pytest.approx(0.2 * law.speed.at(0.4, 0.0))
    assert law.wish(Target(0.5)) == WheelSpeeds(0.0, 0.0)


def test_unknown_rules_are_an_error_that_names_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="constant, default, paper"):
        load("fuzziest")


def test_rules_of_ones_own_are_checked(tmp_path: Path) -> None:
    text = (Path(__file__).parents[1] / "config" / "fuzzy" / "default.yaml").read_text()
    own = tmp_path / "own.yaml"
    own.write_text(text.replace("[F, VF, VF, VF, VF]", "[F, VF, VF, VF, WARP]"))
    with pytest.raises(ConfigError, match="WARP"):
        load(str(own))


@pytest.mark.slow
@pytest.mark.realtime
def test_a_look_up_takes_microseconds() -> None:
    assert call_us(LAW) < 20.0


@pytest.mark.slow
def test_both_surfaces_are_drawn_by_one_command(tmp_path: Path) -> None:
    assert len(picture(FuzzyGearsSettings(profile="paper")).axes) == 5
    drawn = tmp_path / "a.png"
    check("patches-sim", picture=drawn)
    assert drawn.stat().st_size > 20_000
    with pytest.raises(UsageError, match="cannot be written"):
        check("hpf-sim", picture=tmp_path / "missing" / "a.png")


def test_the_fields_are_as_long_as_the_guard_keeps_them() -> None:
    config = load_config("hpf-sim", {"laser.baud": 38400, "laser.resolution_deg": 1})
    guard, axes = pipeline_settings(config).guard, Figure().subplots()
    fields.draw(axes, guard, laser_settings(config), equipment(config).camera)
    labels = [str(patch.get_label()) for patch in axes.patches]
    way = guard.speed_cap * guard.reaction_s + guard.speed_cap**2 / (2 * guard.deceleration_mps2)
    assert f"free ahead at 0.70 m/s: {way + guard.margin_m:.2f} m" in labels
    assert {"laser, 180 degrees", "camera, 48 degrees", "footprint"} <= set(labels)
