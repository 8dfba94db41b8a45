"""Ranges of parameters at which a stiffness stays positive, and the error beyond them."""

import math

import numpy as np
import pytest
from scipy import sparse

from slowtime.finite_elements.definiteness import (
    DENSE,
    IndefiniteStiffnessError,
    check_definite,
    parameter_ranges,
)
from slowtime.finite_elements.factorization import SymmetricFactor
from slowtime.finite_elements.parametric_matrices import ParametricMatrices
from slowtime.finite_elements.reduction import BasisSettings, reduce_modal
from slowtime.finite_elements.sparse_slopes import sparse_mode_slopes


def spring(size, first, last, stiffness):
    """Stiffness of springs from node `first` - 1 to `last` - 1 of a chain on the ground."""
    matrix = sparse.lil_array((size, size))
    for k in range(first, last):
        matrix[k, k] += stiffness
        if k:
            matrix[k - 1, k - 1] += stiffness
            matrix[k, k - 1] -= stiffness
            matrix[k - 1, k] -= stiffness
    return sparse.csr_array(matrix)


def chain(size, *, factor=1.0, overlap=0):
    """A chain of two groups; the file of the second is `factor` times too large."""
    half = size // 2
    parts = (spring(size, 0, half + overlap, 100.0), factor * spring(size, half, size, 100.0))
    return ParametricMatrices(
        stiffness=spring(size, 0, size, 100.0),
        mass=sparse.csr_array(sparse.eye_array(size)),
        names=("lower", "upper"),
        stiffness_parts=parts,
        mass_parts=(None, None),
    )


@pytest.mark.parametrize("size", [20, DENSE + 60])
@pytest.mark.parametrize(
    ("factor", "lower", "upper"),
    [(1.0, -1.0, math.inf), (2.0, -0.5, math.inf), (-1.0, -math.inf, 1.0)],
)
def test_the_range_of_a_group_follows_from_how_much_of_the_whole_it_is(
    size, factor, lower, upper
):
    first, second = parameter_ranges(chain(size, factor=factor))
    assert first.is_part
    assert second.lower == pytest.approx(lower, rel=1e-5)
    assert second.upper == pytest.approx(upper, rel=1e-5)
    assert second.is_part == (factor == 1.0)


def test_the_error_names_the_group_that_is_no_part_and_what_is_allowed():
    model = chain(30, factor=2.0)
    theta = np.array([0.1, -0.6])
    with pytest.raises(
        IndefiniteStiffnessError, match=r"upper -0\.6.*'upper' from -0\.5 up"
    ) as told:
        sparse_mode_slopes(model, theta, np.eye(30)[:3], 2)
    assert "'lower' from" not in str(told.value)


def test_groups_that_overlap_are_told_with_the_range_of_all_together():
    model = chain(30, overlap=5)
    factor = SymmetricFactor(model.at(np.array([-0.7, -0.7]))[0])
    with pytest.raises(
        IndefiniteStiffnessError, match=r"all groups together' from -0\.5 up only"
    ):
        check_definite(model, np.array([-0.7, -0.7]), factor)


def test_what_is_positive_is_not_refused():
    model = chain(30, factor=2.0)
    theta = np.array([-0.9, -0.4])
    check_definite(model, theta, SymmetricFactor(model.at(theta)[0]))


def test_a_reduction_over_too_wide_a_span_names_the_group():
    model = chain(60, factor=2.5)
    settings = BasisSettings(modes=4, coordinates=20, span=0.9)
    with pytest.raises(IndefiniteStiffnessError, match=r"'upper' from -0\.4 up"):
        reduce_modal(model, settings, trials=6)
