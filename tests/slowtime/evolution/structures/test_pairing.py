"""Measured modes are paired with those of the model that they are, close ones too."""

import numpy as np
import pytest

from slowtime.evolution.structures import MeasuredModes, ParametricStructure, estimate
from slowtime.evolution.structures.measured_modes import mode_misfit
from slowtime.finite_elements.close_modes import close_groups

COUPLING = 1e-3
"""Stiffness between the two directions of the top, over that of a storey [1]."""


def frame_in_two_directions(apart):
    """Three storeys that bend almost alike in two directions; their modes come in pairs."""
    parts = np.zeros((4, 6, 6))
    for k in range(3):
        ends = [0] if k == 0 else [k - 1, k]
        own = np.array([[1.0]]) if k == 0 else np.array([[1.0, -1.0], [-1.0, 1.0]])
        others = [end + 3 for end in ends]
        parts[k][np.ix_(ends, ends)] = own
        parts[k][np.ix_(others, others)] = own
        parts[3][np.ix_(others, others)] += ((1.0 + apart) ** 2 - 1.0) * own
    tie = np.zeros(6)
    tie[[2, 5]] = 1.0, -1.0
    stiffness = parts.sum(axis=0) + COUPLING * np.outer(tie, tie)
    return ParametricStructure(mass=np.eye(6), stiffness=stiffness, stiffness_parts=parts)


def all_but_one(structure, theta, left_out, sd, rng):
    """All modes of a structure but one, with errors, and their numbers in the model."""
    modes = structure.modes(theta)
    own = np.setdiff1d(np.arange(6), [left_out])
    shapes = modes.shape.T[own]
    measured = MeasuredModes(
        frequency_hz=modes.frequency_hz[own] * np.exp(sd * rng.standard_normal(5)),
        frequency_sd_hz=sd * modes.frequency_hz[own],
        shapes=shapes + sd * rng.standard_normal(shapes.shape),
        shape_sd=np.full(shapes.shape, sd),
    )
    return measured, own


@pytest.mark.parametrize("left_out", range(6))
@pytest.mark.parametrize("apart", [0.004, 0.008])
@pytest.mark.parametrize("change", [-0.05, 0.05])
def test_a_mode_beside_one_that_was_not_identified_keeps_its_number(left_out, apart, change):
    structure = frame_in_two_directions(apart)
    assert close_groups(structure.modes(np.zeros(4)).frequency_hz) == [[0, 1], [2, 3], [4, 5]]
    # The frequencies of a pair move further than they are apart.
    theta = np.log1p([change, change, change, 0.0])
    rng = np.random.default_rng(left_out)
    measured, own = all_but_one(structure, theta, left_out, 1e-4, rng)
    prior = np.array([0.2, 0.2, 0.2, 0.2])
    assert mode_misfit(structure, measured, np.zeros(4), prior).pairs.tolist() == own.tolist()
    found = estimate(structure, measured, prior, starts=0)
    miss = (found.theta - theta) / np.sqrt(np.diag(found.covariance))
    assert np.abs(miss).max() < 4.0


def test_close_modes_that_were_both_identified_are_paired_in_order():
    structure = frame_in_two_directions(0.004)
    modes = structure.modes(np.zeros(4))
    # Shapes of a pair are interchanged, as they are after a rotation by a right angle.
    measured = MeasuredModes(
        frequency_hz=modes.frequency_hz,
        frequency_sd_hz=1e-4 * modes.frequency_hz,
        shapes=modes.shape.T[[1, 0, 2, 3, 4, 5]],
        shape_sd=np.full((6, 6), 1e-3),
    )
    found = mode_misfit(structure, measured, np.zeros(4), np.full(4, 0.2))
    assert found.pairs.tolist() == [0, 1, 2, 3, 4, 5]
