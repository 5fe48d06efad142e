"""Our Kalman steps are those of filterpy."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from followerd.estimation import kalman
from followerd.estimation.hybrid import H


def test_many_steps_equal_filterpys() -> None:
    rng = np.random.default_rng(4)
    theirs = KalmanFilter(dim_x=4, dim_z=2)
    theirs.x, theirs.P, theirs.H = np.array([30.0, 80.0, 1.0, -2.0]), np.diag([9.0, 25, 4, 4]), H
    theirs.R = np.diag([9.0, 25.0])
    x, P = theirs.x.copy(), theirs.P.copy()
    for _ in range(40):
        dt = rng.uniform(0.02, 0.2)
        F, Q = kalman.ncv_transition(dt), kalman.ncv_noise(dt, (400.0, 800.0))
        z = rng.normal((32.0, 85.0), (3.0, 5.0))
        theirs.predict(F=F, Q=Q)
        theirs.update(z)
        x, P = kalman.predict(x, P, F, Q)
        y, S = kalman.innovation(x, P, z, H, theirs.R)
        x, P = kalman.update(x, P, z, H, theirs.R)
        assert y == pytest.approx(theirs.y)
        assert pytest.approx(theirs.S) == S
        assert x == pytest.approx(theirs.x)
        assert pytest.approx(theirs.P) == P


def test_a_measurement_never_makes_the_state_less_sure() -> None:
    P = np.diag([9.0, 25.0, 100.0, 100.0])
    _, after = kalman.update(np.zeros(4), P, np.ones(2), H, np.diag([9.0, 25.0]))
    assert np.all(np.linalg.eigvalsh(P - after) > -1e-9)
    assert np.allclose(after, after.T)
