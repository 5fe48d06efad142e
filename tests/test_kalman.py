"""Our Kalman steps are those of filterpy."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from followerd.estimation import kalman
from followerd.geometry import Array


def transition(dt: float) -> Array:
    """F (4, 4) of two positions followed by their velocities."""
    return np.kron([[1.0, dt], [0.0, 1.0]], np.eye(2))


def noise(dt: float, q: tuple[float, float]) -> Array:
    """Q (4, 4) of white acceleration noise of densities `q`."""
    return np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.diag(q))


def full(P: Array) -> Array:
    """The covariance (4, 4) of two axes that do not meet."""
    return np.block([[np.diag(P[0]), np.diag(P[1])], [np.diag(P[1]), np.diag(P[2])]])


def test_many_steps_equal_filterpys() -> None:
    rng = np.random.default_rng(4)
    theirs = KalmanFilter(dim_x=4, dim_z=2)
    theirs.x, theirs.P = np.array([30.0, 80.0, 1.0, -2.0]), np.diag([9.0, 25.0, 4.0, 5.0])
    theirs.H, theirs.R = np.eye(2, 4), np.diag([9.0, 25.0])
    x, P = theirs.x.copy(), np.array([[9.0, 25.0], [0.0, 0.0], [4.0, 5.0]])
    for _ in range(40):
        dt = rng.uniform(0.02, 0.2)
        z = rng.normal((32.0, 85.0), (3.0, 5.0))
        theirs.predict(F=transition(dt), Q=noise(dt, (400.0, 800.0)))
        x, P = kalman.predict(x, P, dt, (400.0, 800.0))
        assert x == pytest.approx(theirs.x)
        assert full(P) == pytest.approx(theirs.P)
        theirs.update(z)
        x, P = kalman.update(x, P, z, np.array([9.0, 25.0]))
        assert x == pytest.approx(theirs.x)
        assert full(P) == pytest.approx(theirs.P)


def test_a_measurement_never_makes_the_state_less_sure() -> None:
    P = np.array([[9.0, 25.0], [20.0, -30.0], [100.0, 100.0]])
    _, after = kalman.update(np.zeros(4), P, np.ones(2), np.array([9.0, 25.0]))
    assert np.all(np.linalg.eigvalsh(full(P) - full(after)) > -1e-9)
    assert np.all(np.linalg.eigvalsh(full(after)) > 0.0)
