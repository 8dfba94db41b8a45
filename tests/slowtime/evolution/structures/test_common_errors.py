"""Errors that channels have in common weigh as their joint covariance says."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg

from slowtime.evolution.structures import MeasuredModes, ParametricStructure, estimate
from slowtime.evolution.structures.measured_modes import mode_misfit

CHANNELS = 12


@pytest.fixture(scope="module")
def chain():
    """Twelve storeys, whose lower, middle and upper ones are parameters."""
    parts = np.zeros((3, CHANNELS, CHANNELS))
    for k in range(CHANNELS):
        ends = [0] if k == 0 else [k - 1, k]
        own = np.array([[1.0]]) if k == 0 else np.array([[1.0, -1.0], [-1.0, 1.0]])
        parts[k // 4][np.ix_(ends, ends)] += own
    return ParametricStructure(
        mass=np.eye(CHANNELS), stiffness=parts.sum(axis=0), stiffness_parts=parts
    )


def shapes_with_errors(chain, theta, sd, patterns, rng):
    """Three modes whose shapes err by patterns, and by independent errors."""
    modes = chain.modes(theta)
    own = sd * rng.standard_normal((3, CHANNELS))
    own += np.einsum("jk,jkc->jc", rng.standard_normal(patterns.shape[:2]), patterns)
    return MeasuredModes(
        frequency_hz=modes.frequency_hz[:3],
        frequency_sd_hz=0.1 * modes.frequency_hz[:3],
        shapes=modes.shape.T[:3] + own,
        shape_sd=np.full((3, CHANNELS), sd),
        shape_common=patterns,
    )


def test_residuals_have_the_norm_that_the_covariance_gives(chain):
    rng = np.random.default_rng(3)
    patterns = 0.05 * rng.standard_normal((3, 2, CHANNELS))
    measured = shapes_with_errors(chain, np.zeros(3), 0.01, patterns, rng)
    assert measured.shapes is not None
    found = mode_misfit(chain, measured, np.zeros(3), np.full(3, 0.2)).residual[3:]
    model = chain.modes(np.zeros(3)).shape
    for j, residual in enumerate(found.reshape(3, CHANNELS)):
        covariance = 1e-4 * np.eye(CHANNELS) + patterns[j].T @ patterns[j]
        root = scipy.linalg.cholesky(covariance, lower=True)
        column, shape = scipy.linalg.solve_triangular(
            root, np.column_stack((model[:, j], measured.shapes[j])), lower=True
        ).T
        left = shape - column * (column @ shape) / (column @ column)
        assert residual @ residual == pytest.approx(left @ left, rel=1e-9)


def without_patterns(measured):
    """The same modes and deviations, as if the errors were independent."""
    own = np.sqrt(measured.shape_sd**2 + np.sum(measured.shape_common**2, axis=1))
    return dataclasses.replace(measured, shape_sd=own, shape_common=None)


@pytest.mark.parametrize("parameter", [0, 1, 2])
def test_parameters_err_as_stated_where_channels_err_as_a_change_would_make_them(
    chain, parameter
):
    rng = np.random.default_rng(4)
    known: list[float] = []
    unknown: list[float] = []
    for _ in range(40):
        theta = 0.1 * rng.standard_normal(3)
        slope = chain.sensed_modes(theta, np.eye(CHANNELS), 4).sensed_slope
        patterns = 0.1 * slope[:, :3, parameter].T[:, None]
        measured = shapes_with_errors(chain, theta, 0.002, patterns, rng)
        for told, chi_square in ((measured, known), (without_patterns(measured), unknown)):
            found = estimate(chain, told, 0.1, starts=0)
            sd = np.sqrt(found.covariance[parameter, parameter])
            chi_square.append(float((found.theta - theta)[parameter] / sd) ** 2)
    assert 0.5 < np.mean(known) < 1.3
    assert np.mean(unknown) > 1.4
