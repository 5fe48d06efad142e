"""The motion filter in the robot's axes."""

from itertools import pairwise
from math import cos, exp, pi, sin

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st

from followerd.bench.jia_motion import Job, run
from followerd.estimation.motion_ekf import (
    Estimate,
    Look,
    MotionEkf,
    MotionEkfSettings,
    predicted,
    sight_noise,
)
from followerd.geometry import Array, Pose2

STANDING = MotionEkfSettings(odometry_speed_mps=0.0, odometry_turn_degps=0.0)
STEADY = MotionEkfSettings(pace_s=1e5)
START = np.array([2.0, 0.5, 0.9])


def looks(count: int = 40, seed: int = 0) -> list[Look]:
    """A person who walks past a robot that turns, seen ten times a second."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(count):
        ego = Pose2(0.02 * k, 0.0, 0.5 * sin(0.2 * k))
        x, y = (~ego).apply_point(2.0 + 0.05 * k, 0.5 - 0.03 * k)
        z = np.array([x, y, 0.9]) + 0.03 * rng.standard_normal(3)
        found.append(Look(0.1 * k, ego, z))
    return found


def filtered(found: list[Look], settings: MotionEkfSettings | None = None) -> MotionEkf:
    motion = MotionEkf(found[0], settings)
    for look in found[1:]:
        motion.step(look)
    return motion


PLACES = st.tuples(*[st.floats(-3, 3)] * 4)
MOVES = st.builds(Pose2, st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-pi, pi))


@given(PLACES, MOVES)
def test_a_prediction_moves_the_person_over_the_ground_and_the_robot_away(
    place: tuple[float, float, float, float], move: Pose2
) -> None:
    """The print rotates the position where it should rotate the velocity."""
    x, y, vx, vy = place
    now = Estimate(np.array([x, y, 1.0, vx, vy, 0.0, 0.0]), np.eye(7))
    later = predicted(now, 0.1, move, STEADY)
    expected = (~move).apply_point(x + 0.1 * vx, y + 0.1 * vy)
    assert later.x[:2] == pytest.approx(expected, abs=1e-4)
    assert later.x[2] == 1.0
    turned = Pose2(theta=-move.theta).apply_point(vx, vy)
    assert later.x[3:5] == pytest.approx(turned, abs=1e-4)


def test_who_walks_a_bend_goes_on_in_it_and_slows_down_when_unseen() -> None:
    now = Estimate(np.array([2.0, 0.0, 0.9, 0.8, 0.0, 0.0, 0.4]), np.eye(7))
    half, whole = (predicted(now, dt, Pose2(), MotionEkfSettings()).x for dt in (0.5, 1.0))
    assert 0.0 < half[4] < whole[4] < 0.4
    assert 2.4 > half[0] > 2.3
    assert 2.8 > whole[0] > 2.6


def test_depth_errs_along_the_line_of_sight() -> None:
    R = sight_noise(np.array([2.0, 2.0, 0.9]), 0.2, 0.03)
    towards = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    assert towards @ R @ towards == pytest.approx(0.2**2)
    assert np.linalg.eigvalsh(R) == pytest.approx([0.03**2, 0.03**2, 0.2**2])


def test_control_noise_is_the_derivative_by_speed_and_turn_rate() -> None:
    state = np.array([2.0, 0.7, 0.9, 0.4, -0.2, 0.1, 0.3])
    dt, v, w, h = 0.1, 0.5, 0.8, 1e-5

    def after(speed: float, rate: float) -> Array:
        move = Pose2().moved(speed, rate, dt)
        return predicted(Estimate(state, np.zeros((7, 7))), dt, move, STANDING).x

    by_speed = (after(v + h, w) - after(v - h, w)) / (2 * h)
    by_turn = (after(v, w + h) - after(v, w - h)) / (2 * h)
    noisy = MotionEkfSettings(odometry_speed_mps=0.3, odometry_turn_degps=20.0)
    move = Pose2().moved(v, w, dt)
    zero = Estimate(state, np.zeros((7, 7)))
    added = predicted(zero, dt, move, noisy).P - predicted(zero, dt, move, STANDING).P
    rate = np.radians(20.0)
    expected = 0.3**2 * np.outer(by_speed, by_speed) + rate**2 * np.outer(by_turn, by_turn)
    # dp/dw at v != 0 has a term of the chord, v dt² / 2, which is left out
    assert np.allclose(added, expected, atol=2e-4)


def test_it_is_filterpys_kalman_filter() -> None:
    found = looks()
    settings = MotionEkfSettings()
    oracle = KalmanFilter(dim_x=7, dim_z=3)
    oracle.x = np.array([*START, 0.0, 0.0, 0.0, 0.0])
    oracle.x[:3] = found[0].z
    change = settings.accel_mps2**2
    oracle.P = np.diag([0.01, 0.01, 0.01, 1.0, 1.0, change, change])
    oracle.H = np.eye(3, 7)
    motion = MotionEkf(found[0], settings)
    for before, look in pairwise(found):
        assert before.ego is not None
        assert look.ego is not None
        assert look.z is not None
        move = ~before.ego @ look.ego
        dt = look.stamp - before.stamp
        blank = Estimate(oracle.x, np.zeros((7, 7)))
        c, s = cos(move.theta), sin(move.theta)
        turn = np.array([[c, s], [-s, c]])
        pace, bend = exp(-dt / settings.pace_s), exp(-dt / settings.bend_s)
        still = np.eye(7)
        still[:2, 3:5] = settings.pace_s * (1.0 - pace) * np.eye(2)
        gain = settings.bend_s * (1.0 - bend)
        still[:2, 5:] = settings.bend_s * (dt - gain) * np.eye(2)
        still[3:5, 3:5], still[3:5, 5:] = pace * np.eye(2), gain * np.eye(2)
        still[5:, 5:] = bend * np.eye(2)
        rotation = np.zeros((7, 7))
        rotation[:2, :2] = rotation[3:5, 3:5] = rotation[5:, 5:] = turn
        rotation[2, 2] = 1.0
        oracle.F = rotation @ still
        oracle.Q = predicted(blank, dt, move, settings).P
        oracle.predict()
        oracle.x[:2] -= turn @ (move.x, move.y)
        oracle.update(look.z, R=motion.noise(look.z))
        assert motion.step(look)
        assert np.allclose(motion.estimate.x, oracle.x, atol=1e-9)
        assert np.allclose(motion.estimate.P, oracle.P, atol=1e-9)


def test_a_late_look_counts_as_if_it_had_come_in_time() -> None:
    found = looks(20)
    late = [*found[:12], *found[13:16], found[12], *found[16:]]
    assert np.allclose(filtered(late).estimate.x, filtered(found).estimate.x)
    assert np.allclose(filtered(late).estimate.P, filtered(found).estimate.P)


def test_a_look_older_than_the_first_changes_nothing() -> None:
    found = looks(6)
    motion = filtered(found)
    before = motion.estimate
    assert not motion.step(Look(-1.0, None, START))
    assert np.allclose(motion.estimate.x, before.x)


def test_somebody_else_is_outside_the_gate() -> None:
    motion = filtered(looks())
    assert not motion.step(Look(4.0, Pose2(0.8), np.array([1.0, -1.5, 0.9])))
    assert motion.seen < 4.0


def test_who_turns_on_their_heel_is_not_left_behind() -> None:
    rng = np.random.default_rng(0)
    places = [np.array([2.2, abs(0.8 * (k / 15 - 3.0)), 0.9]) for k in range(75)]
    found = [
        Look(k / 15, Pose2(), place + 0.01 * rng.standard_normal(3))
        for k, place in enumerate(places)
    ]
    motion = MotionEkf(found[0])
    off = []
    for look, place in zip(found[1:], places[1:], strict=True):
        motion.step(look)
        off.append(float(np.hypot(*(motion.estimate.x - [*place, 0, 0, 0, 0])[:2])))
    assert max(off) < 0.3
    assert off[-1] < 0.05


def test_unseen_people_become_unsure_and_more_so_after_a_while() -> None:
    motion = filtered(looks())
    ego = motion.look.ego
    spread = [motion.foreseen(motion.seen + t, ego).P[0, 0] ** 0.5 for t in (0.0, 0.4, 0.8, 1.6)]
    assert all(later > earlier for earlier, later in pairwise(spread))
    assert spread[3] > 4 * spread[1]


def test_the_covariance_stays_one() -> None:
    P = filtered(looks(200)).estimate.P
    assert np.array_equal(P, P.T)
    assert np.linalg.eigvalsh(P).min() > 0


@pytest.mark.slow
def test_a_turning_robot_keeps_the_person_and_does_not_without_odometry() -> None:
    seeds = range(4)
    known = [run(Job("mekf", seed)) for seed in seeds]
    unknown = [run(Job("no_ego_motion", seed)) for seed in seeds]
    assert np.mean([one.visible_cm for one in known]) < 5.0
    assert np.mean([one.gap_cm for one in known]) < 25.0
    assert np.mean([one.gap_cm for one in unknown]) > 50.0
