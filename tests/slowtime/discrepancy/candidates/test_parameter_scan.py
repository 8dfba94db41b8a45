"""The parameter of a change of a series is the one that explains most of the residual."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slowtime.discrepancy.candidates.force_space import ForceSpace
from slowtime.discrepancy.candidates.parameter_scan import (
    DIFFERENCE_STEP,
    _best_parameter_value,
)
from slowtime.dynamics.effects import catalogue

TIMES = np.arange(400) / 100.0
KINDS = catalogue()


def series(times):
    return np.sin(9.0 * times) + 0.5 * np.cos(23.0 * times)


class LeastSquares(ForceSpace):
    """Plain least squares of one record to a residual, without constants or states."""

    def __init__(self, residual):
        self.residual = residual
        latent: Any = SimpleNamespace(motion=SimpleNamespace(e=series(TIMES)))
        self.latents = [latent]

    def lines_of(self, series):
        return series

    def normal_equations(self, forces):
        (columns,) = forces
        return columns.T @ columns, columns.T @ self.residual

    def separate_fits(self, forces):
        inner, seen = self.normal_equations(forces)
        return seen / np.diag(inner), seen**2 / np.diag(inner)


def best(residual, acted, parameter, idle):
    space = LeastSquares(residual)
    return _best_parameter_value(
        space, lambda value, only=None: [acted(value)[:, None]], parameter, idle,
        DIFFERENCE_STEP,
    )  # fmt: skip


def scaled(gain):
    return (gain - 1.0) * series(TIMES)


@pytest.mark.parametrize("gain", [-3.0, 0.2, 0.98, 1.5, 40.0])
def test_a_gain_of_any_size_is_found_as_its_action_is_linear(gain):
    parameter = KINDS["sensor_gain"].parameter("gain")
    found = best(scaled(gain), scaled, parameter, 1.0)
    assert found is not None
    assert found[0] == pytest.approx(gain, rel=1e-6)
    assert found[1] == pytest.approx(np.sum(scaled(gain) ** 2))


def test_a_gain_that_leaves_nothing_of_the_series_is_none():
    assert best(scaled(0.001), scaled, KINDS["sensor_gain"].parameter("gain"), 1.0) is None


@pytest.mark.parametrize("delay_s", [0.004, 0.05, 0.12])
def test_a_delay_is_found_though_its_action_is_not_linear(delay_s):
    def late(value):
        return series(TIMES - value) - series(TIMES)

    found = best(late(delay_s), late, KINDS["input_delay"].parameter("delay_s"), 0.0)
    assert found is not None
    assert found[0] == pytest.approx(delay_s, abs=1e-4)
    assert found[1] == pytest.approx(np.sum(late(delay_s) ** 2), rel=1e-3)
