"""Linear Kalman filter steps in the field's letters, and the nearly constant velocity model.

x state, P its covariance, F transition, Q process noise, z measurement, H its model, R its noise,
y innovation, S its covariance, K gain. Checked against filterpy in the tests; filterpy itself is
not used here because its import costs 2 s and 97 MB, and its step a third more time.
"""

import numpy as np

from followerd.geometry import Array


def ncv_transition(dt: float) -> Array:
    """F (4, 4) of two positions followed by their velocities (eq. 11)."""
    F = np.eye(4)
    F[0, 2] = F[1, 3] = dt
    return F


def ncv_noise(dt: float, q: tuple[float, float]) -> Array:
    """Q (4, 4) of white acceleration noise with spectral densities `q` (Q22 of eq. 11 f.)."""
    Q = np.zeros((4, 4))
    for axis, density in enumerate(q):
        Q[axis, axis] = density * dt**3 / 3
        Q[axis, axis + 2] = Q[axis + 2, axis] = density * dt**2 / 2
        Q[axis + 2, axis + 2] = density * dt
    return Q


def predict(x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
    """Prior state and covariance (eq. 4, 6)."""
    return F @ x, F @ P @ F.T + Q


def innovation(x: Array, P: Array, z: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """y and S of measurement `z` (the brackets of eq. 5 and 7)."""
    return z - H @ x, H @ P @ H.T + R


def update(x: Array, P: Array, z: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Posterior state and covariance (eq. 5, 7, 8; the covariance in Joseph's form)."""
    y, S = innovation(x, P, z, H, R)
    K = np.linalg.solve(S, H @ P).T
    rest = np.eye(x.size) - K @ H
    return x + K @ y, rest @ P @ rest.T + K @ R @ K.T
