"""The particle half: noise as in the model, resampling without bias, maps of the image."""

import numpy as np
import pytest

from followerd.estimation import kalman, particles
from followerd.geometry import Array


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_the_noise_has_the_models_covariance() -> None:
    dt, q = 1 / 15, (3e4, 1e4)
    noise = particles.ncv_noise(200_000, dt, q, rng())
    _, P = kalman.predict(np.zeros(4), np.zeros((3, 2)), dt, q)
    expected = np.block([[np.diag(P[0]), np.diag(P[1])], [np.diag(P[1]), np.diag(P[2])]])
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (np.cov(noise.T) - expected) / scale == pytest.approx(np.zeros((4, 4)), abs=0.012)


def test_position_and_velocity_noise_are_correlated() -> None:
    noise = particles.ncv_noise(100_000, 0.1, (1.0, 1.0), rng())
    assert np.corrcoef(noise[:, 0], noise[:, 2])[0, 1] == pytest.approx(np.sqrt(3) / 2, abs=0.01)


def test_resampling_is_unbiased() -> None:
    weights = np.array([0.05, 0.4, 0.0, 0.25, 0.3])
    random = rng()
    counts = np.zeros(5)
    for _ in range(4000):
        counts += np.bincount(particles.resample(weights, random), minlength=5)
    assert counts / counts.sum() == pytest.approx(weights, abs=0.01)


def test_a_particle_is_drawn_as_often_as_its_weight_says_give_or_take_one() -> None:
    weights = rng().dirichlet(np.ones(50))
    counts = np.bincount(particles.resample(weights, rng(2)), minlength=50)
    assert np.all(np.abs(counts - 50 * weights) < 1.0)


def test_particles_without_noise_move_by_their_velocity() -> None:
    cloud = np.array([[10.0, 20.0, 30.0, -60.0]])
    moved = particles.predict(cloud, 0.5, (1e-12, 1e-12), rng())
    assert moved[0] == pytest.approx([25.0, -10.0, 30.0, -60.0], abs=1e-4)


HOMOGRAPHY = np.array([[1.02, 0.01, 3.0], [-0.02, 0.98, -2.0], [1e-4, 2e-4, 1.0]])


def mapped(point: Array) -> Array:
    x, y, z = HOMOGRAPHY @ (point[0], point[1], 1.0)
    return np.array([x / z, y / z])


def test_particles_are_carried_by_a_homography_of_their_foot() -> None:
    cloud = np.array([[50.0, 40.0, 0.0, 0.0], [90.0, 60.0, 0.0, 0.0]])
    out = particles.warp(cloud, HOMOGRAPHY, below=15.0)
    for before, after in zip(cloud, out, strict=True):
        assert after[:2] == pytest.approx(mapped(before[:2] + (0.0, 15.0)) - (0.0, 15.0))


def test_the_jacobian_is_the_maps_derivative() -> None:
    point, step = np.array([70.0, 80.0]), 1e-4
    numeric = np.column_stack(
        [(mapped(point + d) - mapped(point - d)) / (2 * step) for d in step * np.eye(2)]
    )
    assert particles.jacobian(HOMOGRAPHY, point) == pytest.approx(numeric, abs=1e-6)


def test_each_particle_finds_its_nearest_candidate() -> None:
    cloud = np.array([[0.0, 0.0, 0.0, 0.0], [9.0, 0.0, 0.0, 0.0]])
    chosen, offsets = particles.nearest(cloud, np.array([[8.0, 0.0], [1.0, 1.0]]))
    assert chosen.tolist() == [1, 0]
    assert offsets.tolist() == [[-1.0, -1.0], [1.0, 0.0]]


def test_weights_of_hopeless_particles_stay_finite() -> None:
    weights = particles.normalised(np.array([-1e6, -1e6 - 1.0]))
    assert weights.sum() == pytest.approx(1.0)
    assert weights[0] / weights[1] == pytest.approx(np.e)


@pytest.mark.parametrize(("how", "x"), [("max", 10.0), ("mean", 4.6), ("cluster", 1.0)])
def test_the_estimators_differ_on_two_groups(how: particles.Estimator, x: float) -> None:
    cloud = np.zeros((3, 4))
    cloud[:, 0] = 10.0, 0.0, 2.0
    weights, groups = np.array([0.4, 0.3, 0.3]), np.array([0, 1, 1])
    assert particles.estimate(cloud, weights, groups, how)[0] == pytest.approx(x)
