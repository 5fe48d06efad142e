"""Predictors of a turning target: each against what it must be."""

from math import degrees, radians, tan
from typing import get_args

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st

from followerd.bench.motai_runs import Job, run
from followerd.bench.motai_target import SIGMA, SPEEDS
from followerd.estimation.arbitration import OfKf
from followerd.estimation.direction import Look
from followerd.estimation.direction_flow import Of
from followerd.estimation.direction_kf import Axis, Kf
from followerd.estimation.false_looks import MOST, FalseLooks
from followerd.estimation.pan_flow import angles, camera_flow, following_turn, pixels
from followerd.estimation.predictors import Kind, predictor

FOCAL = 686.0
T = 1 / 15


def look(k: int, pan_seen: float, head: float = 0.0, tilt_seen: float = 0.0) -> Look:
    """The target at `pan_seen`, deg, left positive, by a head at `head`, deg."""
    x = -FOCAL * tan(radians(pan_seen - head))
    y = -tan(radians(tilt_seen)) * np.hypot(FOCAL, x)
    return Look(k * T, x, float(y), radians(head), 0.0, FOCAL)


@given(st.floats(-20, 20), st.floats(-15, 15), st.floats(-40, 40))
def test_a_look_gives_the_direction_it_was_made_from(pan: float, tilt: float, head: float) -> None:
    seen = look(0, pan + head, head, tilt)
    assert np.degrees(seen.angles) == pytest.approx((pan + head, tilt), abs=1e-9)


@given(st.floats(-20, 20), st.floats(-15, 15), st.floats(-40, 40))
def test_a_direction_is_seen_where_it_came_from(pan: float, tilt: float, head: float) -> None:
    seen = look(0, pan + head, head, tilt)
    assert pixels(seen.angles, seen.pan, seen.tilt, FOCAL) == pytest.approx((seen.x, seen.y))


@given(
    st.floats(-300, 300), st.floats(-200, 200), st.floats(-1, 1), st.floats(-1, 1)
)  # fmt: skip
def test_the_turn_that_follows_a_flow_undoes_it(x: float, y: float, a: float, b: float) -> None:
    """eq. 39-41: P is never singular, and -V is the camera's turn."""
    flow = camera_flow(x, y, (a, b), FOCAL)
    pan, tilt = following_turn(x, y, (-flow[0], -flow[1]), FOCAL)
    assert (pan, tilt) == pytest.approx((a, b), abs=1e-9)


def test_a_head_that_turns_left_moves_the_image_right() -> None:
    u, v = camera_flow(0.0, 0.0, (0.5, 0.0), FOCAL)
    assert (u, v) == pytest.approx((0.5 * FOCAL, 0.0))
    u, v = camera_flow(0.0, 0.0, (0.0, 0.5), FOCAL)
    assert (u, v) == pytest.approx((0.0, 0.5 * FOCAL))
    approach = camera_flow(100.0, 50.0, (0.0, 0.0), FOCAL, ahead=0.7, depth=2.0)
    assert approach == pytest.approx((35.0, 17.5))


def test_the_camera_flow_is_that_of_the_pinhole() -> None:
    h = 1e-6
    for pan, tilt in ((0.3, -0.2), (-0.1, 0.25)):
        x, y = -FOCAL * tan(pan), -tan(tilt) * np.hypot(FOCAL, FOCAL * tan(pan))
        turned = -FOCAL * tan(pan - h * 0.8)
        u, _ = camera_flow(x, float(y), (0.8, 0.0), FOCAL)
        assert u == pytest.approx((turned - x) / h, rel=1e-5)
    assert angles(0.0, 0.0, 0.1, 0.2, FOCAL) == (0.1, 0.2)


def test_the_axis_is_filterpys_filter() -> None:
    rng = np.random.default_rng(1)
    axis = Axis(0.3, 0.7, 0.012)
    oracle = KalmanFilter(dim_x=2, dim_z=1)
    oracle.x = np.array([[0.3], [0.0]])
    oracle.P = np.diag([0.012**2, radians(20.0) ** 2])
    oracle.H = np.array([[1.0, 0.0]])
    oracle.R = np.array([[0.012**2]])
    for _ in range(60):
        dt, z = rng.uniform(0.05, 0.1), 0.3 + 0.1 * rng.standard_normal()
        oracle.F = np.array([[1.0, dt], [0.0, 1.0]])
        oracle.Q = 0.7**2 * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
        oracle.predict()
        oracle.update(z)
        axis.predict(dt)
        axis.update(z)
        assert (axis.p, axis.v) == pytest.approx(oracle.x.ravel(), abs=1e-9)
        covariance = [axis.P00, axis.P01, axis.P01, axis.P11]
        assert covariance == pytest.approx(oracle.P.ravel(), abs=1e-9)


def test_the_flow_carries_on_what_the_target_did_whatever_the_head_does() -> None:
    of = Of()
    for k in range(6):
        of.step(look(k, 2.0 * k, head=15.0 * np.sin(k)))
    assert degrees(of.ahead(T)[0]) == pytest.approx(12.0, abs=0.35)
    still = Of()
    for k in range(6):
        still.step(look(k, 2.0 * k))
    assert degrees(still.ahead(T)[0]) == pytest.approx(12.0, abs=0.02)


def test_a_measured_flow_counts_instead_of_the_two_last_places() -> None:
    of = Of()
    of.step(look(0, 0.0))
    of.step(Look(T, 0.0, 0.0, 0.0, 0.0, FOCAL, flow=(-FOCAL * radians(30.0), 0.0)))
    assert degrees(of.ahead(T)[0]) == pytest.approx(2.0, abs=0.01)


def test_the_triangle_takes_the_flow_in_a_turn_and_the_filter_on_a_straight() -> None:
    ofkf = OfKf()
    places = [0.0, 2.0, 4.0, 6.0, 4.5]
    turns = []
    for k, place in enumerate(places):
        ofkf.step(look(k, place, head=place - 1.0))
        turns.append(ofkf.turns)
    assert turns == [False, False, False, False, True]
    of, kf = Of(), Kf()
    for k, place in enumerate(places):
        of.step(look(k, place, head=place - 1.0))
        kf.step(look(k, place, head=place - 1.0))
    assert ofkf.ahead(T) == of.ahead(T)
    ofkf.step(look(5, 2.5))
    kf.step(look(5, 2.5))
    assert ofkf.ahead(T) == pytest.approx(kf.ahead(T))


def test_jitter_of_a_target_that_stands_is_no_turn() -> None:
    ofkf = OfKf()
    for k in range(20):
        ofkf.step(look(k, 0.3 * (-1) ** k))
        assert not ofkf.turns


@pytest.mark.parametrize("kind", get_args(Kind))
def test_a_steady_turn_is_foreseen_on_both_axes(kind: Kind) -> None:
    filter_ = predictor(kind, radians(0.3), np.random.default_rng(3))
    for k in range(60):
        filter_.step(look(k, 0.6 * k - 18.0, head=0.6 * k - 18.0, tilt_seen=0.1 * k))
    pan, tilt = (degrees(angle) for angle in filter_.ahead(T))
    assert pan == pytest.approx(0.6 * 60 - 18.0, abs=0.5)
    assert tilt == pytest.approx(6.0, abs=0.5)


def test_a_burst_elsewhere_moves_ours_little_and_a_new_place_is_taken_in_time() -> None:
    imm = predictor("imm_pda", radians(0.7), np.random.default_rng(0))
    for k in range(30):
        imm.step(look(k, 0.2 * k))
    for k in range(30, 33):
        imm.step(look(k, 25.0))
    assert degrees(imm.ahead(T)[0]) == pytest.approx(6.6, abs=1.5)
    for k in range(33, 40):
        imm.step(look(k, 25.0))
    assert degrees(imm.ahead(T)[0]) == pytest.approx(25.0, abs=1.5)


@pytest.mark.parametrize(("kind", "least", "most"), [("pf", 0.0, 0.5), ("pf_paper", 3.0, 25.0)])
def test_the_papers_particles_swing_for_a_second_after_wrong_looks_and_ours_do_not(
    kind: Kind, least: float, most: float
) -> None:
    filter_ = predictor(kind, radians(0.7), np.random.default_rng(0))
    off = []
    for k in range(36):
        filter_.step(look(k, 2.5 * k - (25.0 if k in (20, 21, 22) else 0.0), head=2.5 * k - 12.0))
        off.append(abs(degrees(filter_.ahead(0.0)[0]) - 2.5 * k))
    assert least < np.mean(off[23:]) < most


def test_whoever_turns_back_suddenly_is_believed_at_the_second_look() -> None:
    """A look too far ahead makes the rate too high, and looks on the way back doubtful."""
    imm = predictor("imm_pda", radians(0.8), np.random.default_rng(0))
    for k, seen in enumerate([*np.linspace(0.0, 42.0, 15), 48.0, 39.0, 35.5, 32.0, 28.5]):
        imm.step(look(k, seen, head=25.0))
        if k >= 17:
            assert degrees(imm.ahead(T)[0]) == pytest.approx(seen - 3.5, abs=1.0)


def test_a_warm_thing_that_was_seen_in_bursts_is_known_when_the_target_comes_near() -> None:
    """Three looks at it instead of one at the target that just passed it."""

    def error(known: bool) -> float:
        imm = predictor("imm_pda", radians(0.8), np.random.default_rng(0))
        for k in range(30):
            imm.step(look(k, 5.0 if known and k in (8, 9, 20, 21) else 60.0 - 2.0 * k, head=20.0))
        for k in range(30, 33):
            imm.step(look(k, 5.0, head=0.0))
        return abs(degrees(imm.ahead(T)[0]) - (60.0 - 2.0 * 33))

    assert error(known=True) < 0.7 * error(known=False)


def test_one_doubted_look_suffices_where_that_is_asked_for() -> None:
    imm = predictor("imm_pda", radians(0.7), np.random.default_rng(0), agreeing=1)
    for k in range(20):
        imm.step(look(k, 0.0))
    imm.step(look(20, 25.0))
    assert degrees(imm.ahead(T)[0]) == pytest.approx(25.0, abs=0.1)


def test_places_of_false_looks_are_remembered_but_not_without_end() -> None:
    false = FalseLooks(0.01, 0.03, 1.0)
    anywhere = false.density(0.5)
    false.take(0.5, false=True)
    assert false.density(0.5) > 10.0 * anywhere
    false.take(0.9, false=False)
    assert false.density(0.5) == anywhere
    for place in (0.5, 0.51, 0.52):
        false.learn(place)  # the same
    remembered = false.density(0.52)
    assert remembered > 10.0 * anywhere
    for k in range(MOST):
        false.learn(2.0 + k)
    assert false.density(0.52) == pytest.approx(anywhere)


def test_runs_are_paired_and_repeatable() -> None:
    jobs = [Job("C", "fast", kind, 7) for kind in get_args(Kind)]
    first, again = [[run(job) for job in jobs] for _ in range(2)]
    assert all(np.array_equal(a.foreseen, b.foreseen) for a, b in zip(first, again, strict=True))
    assert all(np.array_equal(one.true, first[0].true) for one in first)


@pytest.mark.slow
def test_ours_beats_the_arbitration_in_every_cell() -> None:
    """Bars: mean error 0.6 and overshoot 0.5 of ofkf's; in no cell 5 % worse than the best."""
    error: dict[tuple[str, str, Kind], float] = {}
    over: dict[Kind, float] = dict.fromkeys(get_args(Kind), 0.0)
    for target in SIGMA:
        for speed in SPEEDS:
            for kind in get_args(Kind):
                runs = [run(Job(target, speed, kind, 300 + seed)) for seed in range(40)]
                error[target, speed, kind] = float(np.mean([one.errors.mean() for one in runs]))
                over[kind] += float(np.mean([(one.errors > 3.0).mean() for one in runs]))
    cells = [(target, speed) for target in SIGMA for speed in SPEEDS]
    mean = {kind: np.mean([error[*cell, kind] for cell in cells]) for kind in get_args(Kind)}
    assert mean["imm_pda"] <= 0.6 * mean["ofkf"]
    assert over["imm_pda"] <= 0.5 * over["ofkf"]
    for cell in cells:
        best = min(error[*cell, kind] for kind in get_args(Kind) if kind != "imm_pda")
        assert error[*cell, "imm_pda"] <= 1.05 * best
