"""A person whom furniture hides: shortest ways, filters on them, and what all trackers share."""

from dataclasses import replace
from math import hypot, pi
from time import process_time

import numpy as np
import pytest

from followerd.estimation.geodesic import Floor, Ways
from followerd.estimation.geodesic_rbpf import GeodesicRbpf, GeodesicSettings
from followerd.estimation.occluded import PersonFilter, Pursuit, Sweep
from followerd.estimation.person_filters import ConstantVelocityKalman, ConstantVelocityParticles
from followerd.estimation.stream_rbpf import (
    StreamField,
    StreamFieldRbpf,
    StreamFieldSettings,
    StreamFieldSir,
)
from followerd.geometry import Array, Pose2

BOUNDS = np.array([[0.0, 0.0], [8.0, 6.0]])
BOARD = np.array([[[4.0, 2.0], [4.0, 4.0]]])
WALLS = np.array(
    [[0, 0, 8, 0], [8, 0, 8, 6], [8, 6, 0, 6], [0, 6, 0, 0], [4, 2, 4, 4]], dtype=float
)
BEAMS = 361


@pytest.fixture(scope="module")
def ways() -> Ways:
    return Ways.over(Floor.of(WALLS))


def field(particles: int = 400) -> StreamField:
    settings = StreamFieldSettings(particles=particles)
    return StreamField(BOARD, BOUNDS, np.random.default_rng(1), settings)


def filters(ways: Ways) -> dict[str, PersonFilter]:
    return {
        "kf_cv": ConstantVelocityKalman(),
        "sir_pf": ConstantVelocityParticles(np.random.default_rng(1)),
        "pf_sf": StreamFieldSir(field()),
        "paper": StreamFieldRbpf(field()),
        "default": GeodesicRbpf(ways, np.random.default_rng(1)),
    }


NAMES = ("kf_cv", "sir_pf", "pf_sf", "paper", "default")


def sweep(stamp: float, *people: complex, ranges: Array | None = None, both: bool = True) -> Sweep:
    """From (4, 0.5) looking up; without `ranges` nothing can be seen past."""
    return Sweep(
        stamp, Pose2(4.0, 0.5, 0.5 * pi), 0.01, 0.003, -0.5 * pi, pi / (BEAMS - 1),
        np.zeros(BEAMS) if ranges is None else ranges,
        np.array(people, complex), np.full(len(people), both),
    )  # fmt: skip


def test_the_way_round_a_board_leads_past_its_end(ways: Ways) -> None:
    start = np.array([3.5 + 3.0j])
    goal = int(np.abs(ways.goals - (4.5 + 3.0j)).argmin())
    left = float(ways.distance[goal, ways.floor.cells(start)][0])
    straight = abs(ways.goals[goal] - start[0])
    assert 2.0 * straight < left < 3.6
    z, walked = start, 0.0
    while abs(z[0] - ways.goals[goal]) > 0.15:
        z = z + 0.05 * ways.direction[goal, ways.floor.cells(z)]
        walked += 0.05
        assert hypot(z[0].real - 4.0, max(abs(z[0].imag - 3.0) - 1.0, 0.0)) > 0.2
        assert walked < 1.1 * left + 0.3


def test_distances_are_the_lengths_of_straight_ways_where_nothing_stands() -> None:
    ways = Ways.over(Floor.of(WALLS[:4]))
    z = np.array([2.0 + 2.0j, 6.3 + 4.1j, 1.0 + 5.0j])
    cells = ways.floor.cells(z)
    straight = np.abs(ways.goals[:, None] - ways.floor.centres()[cells])
    assert np.all(ways.distance[:, cells] > straight - 1e-3)
    assert np.all(ways.distance[:, cells] < 1.03 * straight + 1e-3)


def test_who_stands_too_near_to_a_wall_is_led_off_it(ways: Ways) -> None:
    z = np.array([0.1 + 3.0j, 4.1 + 3.0j])
    for goal in (0, ways.goals.size):
        away = ways.direction[goal, ways.floor.cells(z)]
        assert (away.real > 0.3).all()


def test_a_floor_is_one_piece_and_goals_lie_on_it() -> None:
    closet = np.array([[6, 0, 6, 2], [6, 2, 8, 2]], dtype=float)
    floor = Floor.of(np.vstack([WALLS[:4], closet]))
    inside, outside = np.array([7.0 + 1.0j]), np.array([20.0 - 3.0j])
    assert not floor.free.ravel()[floor.cells(inside)][0]
    assert not floor.free.ravel()[floor.cells(outside)][0]
    ways = Ways.over(floor)
    assert floor.free.ravel()[floor.cells(ways.goals)].all()
    assert np.isfinite(ways.distance[:, floor.free.ravel()]).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_person_in_view_is_followed(name: str, ways: Ways) -> None:
    pursuit = Pursuit(filters(ways)[name])
    rng = np.random.default_rng(3)
    for k in range(24):
        truth = 1.0 + 0.15 * k + 1.0j
        estimate = pursuit.step(sweep(0.25 * k, truth + 0.05 * complex(*rng.standard_normal(2))))
        assert estimate is not None
        assert estimate.seen
        assert estimate.unseen_for == 0.0
        if k > 8:
            assert abs(estimate.position - truth) < 0.2
            assert estimate.spread < 0.3


@pytest.mark.parametrize("name", NAMES)
def test_the_longer_unseen_the_less_certain(name: str, ways: Ways) -> None:
    pursuit = Pursuit(filters(ways)[name])
    assert pursuit.step(sweep(0.0)) is None
    for k in range(8):
        pursuit.step(sweep(0.25 * k, 1.0 + 0.15 * k + 1.0j))
    spreads = []
    for k in range(8, 20):
        estimate = pursuit.step(sweep(0.25 * k))
        assert estimate is not None
        assert not estimate.seen
        assert estimate.unseen_for == pytest.approx(0.25 * (k - 7))
        spreads.append(estimate.spread)
    assert spreads[0] < spreads[5] < spreads[-1]


@pytest.mark.parametrize("name", NAMES)
def test_somebody_far_off_is_believed_in_the_second_scan(name: str, ways: Ways) -> None:
    pursuit = Pursuit(filters(ways)[name])
    for k in range(6):
        pursuit.step(sweep(0.25 * k, 1.0 + 1.0j))
    once = pursuit.step(sweep(1.5, 6.0 + 5.0j))
    assert once is not None
    assert abs(once.position - (1 + 1j)) < 0.5
    again = pursuit.step(sweep(1.75, 6.1 + 5.0j))
    assert again is not None
    assert again.seen
    assert abs(again.position - (6.1 + 5j)) < 0.2


@pytest.mark.parametrize("name", NAMES)
def test_ghosts_that_jump_about_are_not_believed(name: str, ways: Ways) -> None:
    pursuit = Pursuit(filters(ways)[name])
    for k in range(6):
        pursuit.step(sweep(0.25 * k, 1.0 + 1.0j))
    for k, ghost in enumerate((6 + 5j, 1 + 5j, 6 + 5j), start=6):
        estimate = pursuit.step(sweep(0.25 * k, ghost))
        assert estimate is not None
        assert abs(estimate.position - (1 + 1j)) < 1.0


def test_free_floor_that_shows_nobody_drives_the_belief_into_the_shadow(ways: Ways) -> None:
    """The board's shadow as seen from the robot: beams end at the board, elsewhere at the walls."""
    ranges = np.full(BEAMS, 6.0)
    ranges[170:220] = 1.5  # what lies left of straight ahead is hidden from 1.5 m on
    belief = GeodesicRbpf(ways, np.random.default_rng(2))
    blind = GeodesicRbpf(ways, np.random.default_rng(2))
    for each, seen in ((belief, ranges), (blind, np.zeros(BEAMS))):
        pursuit = Pursuit(each)
        pursuit.start(3.7 + 2.5j, 0.0)
        for k in range(1, 9):
            pursuit.step(sweep(0.25 * k, ranges=seen))

    def in_shadow(each: GeodesicRbpf) -> float:
        off = (each.cloud.z - (4.0 + 0.5j)) * np.exp(-0.5j * pi)
        bearing = np.degrees(np.angle(off))
        return float(each.cloud.w[(bearing > -6.0) & (bearing < 21.0)].sum())

    assert in_shadow(belief) > 0.9 > 0.8 > in_shadow(blind)


def test_a_doubtful_heading_takes_the_force_from_negative_information(ways: Ways) -> None:
    belief = GeodesicRbpf(ways, np.random.default_rng(2))
    belief.start(3.0 + 3.0j)
    open_floor = sweep(0.0, ranges=np.full(BEAMS, 8.0))
    sure = belief.detectable(open_floor).mean()
    doubtful = replace(open_floor, heading_sigma=0.1)
    assert sure > 0.9
    assert belief.detectable(doubtful).mean() < 0.1


def test_where_every_particle_is_contradicted_the_weights_stay(ways: Ways) -> None:
    rbpf = StreamFieldRbpf(field())
    rbpf.start(1 + 1j)
    before = rbpf.cloud.w.copy()
    assert not rbpf.cloud.weigh(np.zeros(rbpf.cloud.count))
    assert np.array_equal(rbpf.cloud.w, before)


def test_the_papers_weights_stay_without_a_person() -> None:
    """Line 13 of Algorithm 1 would zero them."""
    rbpf = StreamFieldRbpf(field())
    pursuit = Pursuit(rbpf)
    for k in range(4):
        pursuit.step(sweep(0.25 * k, 1.0 + 0.15 * k + 1.0j))
    weights = rbpf.cloud.w.copy()
    pursuit.step(sweep(1.0))
    assert np.array_equal(rbpf.cloud.w, weights)


def test_the_papers_goals_lie_two_metres_ahead_of_who_walks() -> None:
    rbpf = StreamFieldRbpf(field(1000))
    pursuit = Pursuit(rbpf)
    for k in range(20):
        pursuit.step(sweep(0.25 * k, 0.6 + 0.2 * k + 1.0j))
    ahead = rbpf.field.goals - rbpf.cloud.z
    assert np.abs(ahead) == pytest.approx(np.full(1000, 2.0))
    assert complex(rbpf.cloud.w @ ahead).real > 1.0


def test_nobody_leaves_the_room() -> None:
    stream = field()
    stream.start(0.3 + 0.3j)
    for _ in range(20):
        stream.advance(0.25)
    z = stream.cloud.z
    assert z.real.min() > 0.14
    assert z.imag.min() > 0.14


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "default"])
def test_the_cost_of_a_step_is_linear_in_the_particles(name: str, ways: Ways) -> None:
    def cost(count: int) -> float:
        belief: PersonFilter
        if name == "paper":
            belief = StreamFieldRbpf(field(count))
        else:
            settings = GeodesicSettings(particles=count)
            belief = GeodesicRbpf(ways, np.random.default_rng(1), settings)
        pursuit, times = Pursuit(belief), []
        open_floor = np.full(BEAMS, 4.0)
        for k in range(12):
            people = () if k % 4 == 3 else (1.0 + 0.15 * k + 1.0j,)
            began = process_time()
            pursuit.step(sweep(0.25 * k, *people, ranges=open_floor))
            times.append(process_time() - began)
        return float(np.median(times[1:])) / count

    assert cost(100_000) < 3.0 * cost(10_000)
