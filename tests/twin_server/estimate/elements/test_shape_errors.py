"""Errors of the changes of shapes that a learnt model gives, where modes are close."""

import numpy as np
import pytest

from twin_server.estimate.elements.compared_modes import shape_error as _shape_error


def turned(frequency_hz, coupling):
    """By what share of itself a small coupling of two modes turns the first to the second."""
    _, shapes = np.linalg.eigh(
        np.diag(np.asarray(frequency_hz) ** 2) + coupling * (1 - np.eye(2))
    )
    return shapes[1, 0] / shapes[0, 0]


@pytest.mark.parametrize("apart", [0.003, 0.01, 0.05])
@pytest.mark.parametrize("wrong", [-2e-4, 5e-4])
def test_the_error_of_a_turn_is_that_of_the_distance_of_the_modes(apart, wrong):
    true_hz = np.array([3.0, 3.0 * (1 + apart)])
    model_hz = true_hz * np.array([1.0, 1.0 + wrong])
    coupling = 1e-6
    error = turned(model_hz, coupling) / turned(true_hz, coupling) - 1.0
    said = _shape_error(true_hz, model_hz)
    assert said[0] == pytest.approx(said[1])
    # First order in the error of the distance.
    assert said[0] == pytest.approx(abs(error), rel=0.25)


def test_a_model_that_is_right_has_no_error_and_equal_modes_may_turn_anyhow():
    frequency_hz = np.array([1.0, 2.0, 4.0])
    assert _shape_error(frequency_hz, frequency_hz).tolist() == [0.0, 0.0, 0.0]
    # A common factor moves no mode towards another.
    assert _shape_error(1.01 * frequency_hz, frequency_hz).max() < 1e-12
    equal = _shape_error(np.array([1.0, 1.001, 2.0]), np.array([1.0, 1.0, 2.0]))
    assert equal[:2].tolist() == [1.0, 1.0]
    assert equal[2] < 0.01
    assert _shape_error(np.array([1.1]), np.array([1.0])).tolist() == [0.0]
