"""The closed form against the matrices of the textbook."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.estimation.moving_point import MovingPoint
from followerd.geometry import Array

numbers = st.floats(-3.0, 3.0)
entries = st.lists(numbers, min_size=20, max_size=20)


def a_point(values: list[float]) -> MovingPoint:
    """Any mean with any covariance."""
    root = np.array(values[4:]).reshape(4, 4)
    P = root @ root.T + 0.01 * np.eye(4)
    return MovingPoint(
        *values[:4], *P[[0, 0, 1, 0, 0, 1, 1, 2, 2, 3], [0, 1, 1, 2, 3, 2, 3, 2, 3, 3]]
    )


def mean(point: MovingPoint) -> Array:
    """(4,)"""
    return np.array(point[:4])


@given(entries)
def test_a_point_is_as_unsure_as_the_longest_axis_of_its_ellipse(values: list[float]) -> None:
    point = a_point(values)
    longest = np.linalg.eigvalsh(point.covariance[:2, :2])[1]
    assert point.sigma == pytest.approx(np.sqrt(longest))


@given(entries)
def test_mean_and_covariance_make_the_same_point_again(values: list[float]) -> None:
    point = a_point(values)
    assert MovingPoint.of(point[:2], point[2:4], point.covariance) == point


@given(entries, st.floats(-0.2, 0.5), st.floats(0.1, 2.0))
def test_time_passes_as_in_the_textbook(values: list[float], t: float, density: float) -> None:
    point = a_point(values)
    F = np.eye(4)
    F[:2, 2:] = t * np.eye(2)
    noise = max(0.0, t)
    Q = density * np.kron([[noise**3 / 3, noise**2 / 2], [noise**2 / 2, noise]], np.eye(2))
    later = point.after(t, density)
    assert mean(later) == pytest.approx(F @ mean(point))
    np.testing.assert_allclose(later.covariance, F @ point.covariance @ F.T + Q, atol=1e-9)


@given(entries, st.floats(0.0, 6.3), numbers, st.floats(0.01, 2.0), st.floats(-0.2, 0.2))
def test_a_measurement_corrects_as_in_the_textbook(
    values: list[float], angle: float, off: float, variance: float, t: float
) -> None:
    point = a_point(values)
    a, b = float(np.cos(angle)), float(np.sin(angle))
    H = np.array([a, b, t * a, t * b])
    P = point.covariance
    K = P @ H / (H @ P @ H + variance)
    corrected = point.corrected((a, b), off, variance, t, 100.0)
    assert corrected is not None
    assert mean(corrected) == pytest.approx(mean(point) + K * off)
    np.testing.assert_allclose(corrected.covariance, P - np.outer(K, H @ P), atol=1e-9)


def test_a_measurement_beyond_the_gate_is_refused() -> None:
    point = MovingPoint(0, 0, 0, 0, 0.5, 0, 0.5, 0, 0, 0, 0, 1, 0, 1)
    assert point.corrected((1.0, 0.0), 3.1, 0.5, 0.0, 3.0) is None
    assert point.corrected((1.0, 0.0), 2.9, 0.5, 0.0, 3.0) is not None
