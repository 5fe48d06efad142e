"""Zhuang's law: what it wishes."""

from math import radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.control.image_centering import ImageCentering, ImageCenteringSettings
from followerd.control.interfaces import Target
from followerd.control.registry import CONTROLLERS
from followerd.errors import ConfigError
from followerd.messages import Twist

PAPER = ImageCentering(ImageCenteringSettings(profile="paper"))
DEFAULT = ImageCentering()
BAND = radians(5.3)


@pytest.mark.parametrize("law", [PAPER, DEFAULT])
@pytest.mark.parametrize("bearing", [0.0, 0.09, -0.09])
def test_inside_the_stationary_band_there_is_no_turn(law: ImageCentering, bearing: float) -> None:
    assert law.wish(Target(bearing, 1.5)).omega == 0.0


@pytest.mark.parametrize("law", [PAPER, DEFAULT])
def test_outside_the_band_it_turns_toward_the_person(law: ImageCentering) -> None:
    assert law.wish(Target(0.3, 1.5)).omega > 0.0
    assert law.wish(Target(-0.3, 1.5)).omega < 0.0


def test_the_paper_turns_in_proportion_to_the_bearing() -> None:
    assert PAPER.wish(Target(0.3, 1.5)).omega == pytest.approx(1.5 * 0.3)


def test_the_default_turn_starts_gently_at_the_edge_of_the_band() -> None:
    assert DEFAULT.wish(Target(BAND + 0.01, 1.5)).omega == pytest.approx(0.015)


@pytest.mark.parametrize(
    ("distance", "speed"), [(2.0, 0.4), (1.5, 0.0), (1.2, 0.0), (0.9, 0.0), (0.7, -0.1)]
)
def test_the_papers_distance_rule(distance: float, speed: float) -> None:
    assert PAPER.wish(Target(0.0, distance)).v == speed


@pytest.mark.parametrize("law", [PAPER, DEFAULT])
def test_without_a_range_it_only_turns(law: ImageCentering) -> None:
    wish = law.wish(Target(0.4, None, (1.0, 0.0)))
    assert wish.v == 0.0
    assert wish.omega > 0.0


def test_the_default_keeps_pace_with_the_person_at_the_distance() -> None:
    assert DEFAULT.wish(Target(0.0, 1.5, (0.8, 0.0))).v == pytest.approx(0.72)
    assert DEFAULT.wish(Target(0.0, 2.0, (0.8, 0.0))).v == 0.8


def test_the_default_does_not_answer_a_swaying_person() -> None:
    assert DEFAULT.wish(Target(0.0, 1.5, (0.05, 0.05))) == Twist()


def test_the_default_turns_with_a_person_who_walks_across() -> None:
    assert DEFAULT.wish(Target(0.0, 2.0, (0.0, 0.8))).omega == pytest.approx(0.315)


def test_the_default_backs_away_only_from_a_near_person() -> None:
    assert DEFAULT.wish(Target(0.0, 1.2, (-0.8, 0.0))).v == 0.0
    assert DEFAULT.wish(Target(0.0, 0.7)).v == -0.1
    assert DEFAULT.wish(Target(0.0, 0.7, (1.2, 0.0))).v == 0.0


def test_the_default_does_not_drive_past_a_person_beside_it() -> None:
    assert DEFAULT.wish(Target(radians(100), 3.0)).v == 0.0


velocities = st.tuples(st.floats(-2, 2), st.floats(-2, 2))


@given(st.floats(-3.1, 3.1), st.none() | st.floats(0.0, 8.0), velocities)
def test_never_forward_to_a_near_or_unknown_person_and_never_too_fast_a_turn(
    bearing: float, distance: float | None, velocity: tuple[float, float]
) -> None:
    for law in (PAPER, DEFAULT):
        wish = law.wish(Target(bearing, distance, velocity))
        if distance is None or distance < 1.0:
            assert wish.v <= 0.0
        assert wish.v >= -0.15
        assert abs(wish.omega) <= radians(57.0) + 1e-9


def test_a_law_is_found_by_its_name() -> None:
    law = CONTROLLERS.load("image_centering")(ImageCenteringSettings(profile="paper"))
    assert law.wish(Target(0.0, 2.0)) == Twist(0.4, 0.0)


def test_an_unknown_law_names_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"no telepathy; known are .*image_centering"):
        CONTROLLERS.load("telepathy")
