"""The flow toward a goal: Tseng's eq. (4) and the special cases."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from followerd.stream_field import FASTEST, OUTWARD, discs, lines, velocity

NONE = np.empty(0, complex), np.empty(0)
DISC = np.array([0j]), np.array([0.5])


def at(
    z: complex, sink: complex, strength: float = 1.0, centres: Any = DISC[0],
    radii: Any = DISC[1],
) -> complex:  # fmt: skip
    flow = velocity(np.array([z]), np.array([sink]), np.array([strength]), centres, radii)
    return complex(flow[0])


def test_a_sink_draws_with_its_strength_over_the_distance() -> None:
    assert at(2 + 0j, 0j, 1.4, *NONE) == pytest.approx(-0.7)
    assert at(0 + 2j, 0j, 1.4, *NONE) == pytest.approx(-0.7j)


def test_it_is_the_slope_of_the_papers_potential() -> None:
    """The numeric derivative of eq. (4): sink, image sink at the inverse point, source."""

    def potential(z: complex, s: complex, a: float, strength: float) -> complex:
        inverse = a * a / np.conj(s)
        return complex(-strength * (np.log(z - s) + np.log(z - inverse) - np.log(z)))

    rng = np.random.default_rng(1)
    for _ in range(50):
        z = 0.5 * np.exp(2j * np.pi * rng.random()) * rng.uniform(1.1, 4.0)
        s = 0.5 * np.exp(2j * np.pi * rng.random()) * rng.uniform(1.5, 6.0)
        h = 1e-5
        slope = (potential(z + h, s, 0.5, 0.1) - potential(z - h, s, 0.5, 0.1)) / (2 * h)
        if abs(slope) < FASTEST:
            assert at(z, s, 0.1) == pytest.approx(np.conj(slope), abs=1e-7)


def test_nothing_flows_through_a_disc() -> None:
    rim = 0.5 * np.exp(2j * np.pi * np.linspace(0, 1, 73)) * (1 + 1e-12)
    sink = np.full(rim.size, 3 + 1j)
    flow = velocity(rim, sink, np.full(rim.size, 1.0), *DISC)
    assert np.abs((flow * (rim / abs(rim)).conj()).real).max() < 1e-9


def test_stream_lines_part_before_a_disc_and_meet_at_the_sink() -> None:
    starts, sinks = -2.0 + 1j * np.linspace(-0.6, 0.6, 7), np.full(7, 2.0 + 0j)
    drawn = lines(starts.astype(complex), sinks, *DISC, 0.05, 120)
    assert drawn.shape == (7, 120)
    assert np.abs(drawn).min() > 0.49
    assert np.abs(drawn[:, -1] - 2.0)[np.arange(7) != 3].max() < 0.01


@pytest.mark.parametrize(
    ("name", "z", "sink", "expected"),
    [
        ("on the sink nothing is infinite", 2 + 0j, 2 + 0j, lambda v: abs(v) <= FASTEST),
        ("near the sink the speed is capped", 2.01 + 0j, 2 + 0j, lambda v: abs(v) <= FASTEST),
        ("inside a disc it leads out", 0.3 + 0j, 3 + 0j, lambda v: v.real > 0.8 * OUTWARD),
        ("a goal in a disc leaves the disc out", 2 + 0j, 0.4 + 0j, lambda v: v.real < -0.5),
        ("a goal in the middle of a disc", 2 + 0j, 0j, lambda v: v.real == pytest.approx(-0.5)),
        ("in the middle of a disc", 0j, 3 + 0j, lambda v: abs(v) <= FASTEST),
    ],
)
def test_special_cases_stay_finite(
    name: str, z: complex, sink: complex, expected: Callable[[complex], bool]
) -> None:
    flow = at(z, sink)
    assert np.isfinite(flow), name
    assert expected(flow), name


def test_behind_a_disc_the_flow_stands_still() -> None:
    assert abs(at(-0.5 - 1e-12, 3 + 0j)) < 1e-6


def test_between_two_discs_that_touch_nobody_is_driven_into_one() -> None:
    centres, radii = np.array([0.35j, -0.35j]), np.array([0.35, 0.35])
    z = np.array([-0.35 + 0.35j, -0.30 - 0.16j])  # on the rims
    flow = velocity(z, np.full(2, 3 + 0j), np.full(2, 1.0), centres, radii)
    nearest = np.abs(z[:, None] - centres).argmin(axis=1)
    outward = (z - centres[nearest]) / 0.35
    assert ((flow * outward.conj()).real > -1e-9).all()


def test_a_walker_goes_round_a_disc_to_the_goal() -> None:
    centres, radii = np.array([0j]), np.array([0.7])
    z = np.array([-2 + 0.1j])
    clearance = []
    for _ in range(400):
        z = z + 0.02 * velocity(z, np.array([2 + 0j]), np.array([3.0]), centres, radii)
        clearance.append(abs(z[0]) - 0.7)
    assert abs(z[0] - 2) < 0.2
    assert min(clearance) > -0.03


def test_a_chain_of_discs_covers_its_board() -> None:
    centres = discs([[[0.0, 0.0], [1.5, 0.0]], [[5.0, 0.0], [5.0, 0.2]]])
    along = np.linspace(0.0, 1.5, 50)
    assert np.abs(along[:, None] - centres).min(axis=1).max() < 0.28
    assert np.isin(5.0 + 0.1j, np.round(centres, 9))
