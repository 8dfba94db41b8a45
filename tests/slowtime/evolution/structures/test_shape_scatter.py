"""Standard deviations of shapes that are too small are noticed, told and widened."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from slowtime.evolution.structures import (
    MeasuredModes,
    ReducedStructure,
    estimate,
    estimate_with_scatter,
    shape_scatter,
)
from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.definiteness import IndefiniteStiffnessError
from slowtime.finite_elements.eigenvalues import lowest_modes
from slowtime.finite_elements.reduction import BasisSettings, reduce_modal
from tests.slowtime.finite_elements.frames import line_of_beams, small_tower

MODEL, TOWER = assemble(line_of_beams(3)), assemble(small_tower(3))
STRUCTURE = ReducedStructure(
    model=reduce_modal(MODEL, BasisSettings(modes=9, coordinates=18), trials=0)
)
ROWS = np.eye(STRUCTURE.size)[6:]
ROWS = ROWS[np.arange(len(ROWS)) % 6 < 3]  # translations
TOWER_ROWS = np.eye(6 * 16)[24::5]
PRIOR_SD, SHAPE_SD, MODES = 0.2, 0.01, 5


def measured(seed, true_sd, *, said=SHAPE_SD):
    """Log factors, and modes whose shapes err by `true_sd` of their largest component."""
    rng = np.random.default_rng(seed)
    theta = PRIOR_SD * rng.standard_normal(3)
    modes = lowest_modes(*MODEL.at(np.expm1(theta)), MODES)
    seen = (MODEL.rows(ROWS) @ modes.shapes).T
    seen /= np.abs(seen).max(axis=1, keepdims=True)
    return theta, MeasuredModes(
        frequency_hz=modes.frequency_hz * (1 + 0.005 * rng.standard_normal(MODES)),
        frequency_sd_hz=0.005 * modes.frequency_hz,
        shapes=seen + true_sd * rng.standard_normal(seen.shape),
        shape_sd=np.full_like(seen, said),
        channels=ROWS,
    )


def test_honest_deviations_are_kept_and_their_chi_square_is_their_number():
    sums, counts = 0.0, 0.0
    for seed in range(12):
        _, modes = measured(seed, SHAPE_SD)
        found, scatter = estimate_with_scatter(STRUCTURE, modes, PRIOR_SD, starts=0)
        np.testing.assert_array_equal(
            found.theta, estimate(STRUCTURE, modes, PRIOR_SD, starts=0).theta
        )
        assert scatter.factor == 1.0
        assert scatter.sentence == ""
        sums, counts = sums + scatter.chi_square, counts + scatter.count
    # Chi-square of n numbers has a standard deviation of sqrt(2 n).
    assert abs(sums - counts) < 4.0 * np.sqrt(2.0 * counts)


def test_deviations_five_times_too_small_are_widened_and_then_hold():
    before, after, factors = [], [], []
    for seed in range(8):
        theta, modes = measured(seed, 5 * SHAPE_SD)
        plain = estimate(STRUCTURE, modes, PRIOR_SD, starts=4)
        found, scatter = estimate_with_scatter(STRUCTURE, modes, PRIOR_SD, starts=4)
        before.append(((plain.theta - theta) / plain.sd) ** 2)
        after.append(((found.theta - theta) / found.sd) ** 2)
        factors.append(scatter.factor)
        assert "far too small: their residuals have chi-square" in scatter.sentence
        assert scatter.chi_square > 10.0 * scatter.count
    np.testing.assert_allclose(factors, 5.0, rtol=0.2)
    # 24 values of chi-square with mean 1 have a mean of 0.3 to 2.1 with 99.9 %.
    assert np.mean(before) > 3.0
    assert 0.3 < np.mean(after) < 2.1


def test_several_sets_and_frequencies_alone_are_counted():
    _, first = measured(1, SHAPE_SD)
    _, other = measured(1, SHAPE_SD)
    bare = dataclasses.replace(other, shapes=None, shape_sd=None, channels=None)
    found, scatter = estimate_with_scatter(STRUCTURE, (bare, first), PRIOR_SD, starts=0)
    assert scatter.factor == 1.0
    assert MODES * len(ROWS) - 15 < scatter.count < MODES * len(ROWS)
    assert shape_scatter(STRUCTURE, (bare,), found).count <= 0.0
    assert estimate_with_scatter(STRUCTURE, bare, PRIOR_SD, starts=0)[1].factor == 1.0


@pytest.mark.parametrize("modal", [True, False])
def test_the_group_that_makes_a_reduced_stiffness_negative_is_named(modal):
    parts: list[Any] = list(TOWER.stiffness_parts)
    parts[1] = 3.0 * parts[1]
    wrong = dataclasses.replace(TOWER, stiffness_parts=tuple(parts))
    reduced = reduce_modal(wrong, BasisSettings(modes=12, coordinates=60), trials=0)
    structure = ReducedStructure(model=reduced)
    with pytest.raises(
        IndefiniteStiffnessError, match=r"reduced model.*storey 2 -0\.6"
    ) as told:
        structure.sensed_modes(np.log([1.0, 0.4, 1.0]), TOWER_ROWS, 3 if modal else 12)
    assert "Allowed alone: 'storey 2' from -0.333 up" in str(told.value)
    assert "storey 1'" not in str(told.value)
    structure.sensed_modes(np.log([1.0, 0.7, 1.0]), TOWER_ROWS, 3)


def test_groups_that_overlap_are_told_of_a_reduced_model():
    parts = list(TOWER.stiffness_parts)
    parts[0] = parts[2]
    twice = dataclasses.replace(TOWER, stiffness_parts=tuple(parts))
    reduced = reduce_modal(twice, BasisSettings(modes=12, coordinates=60), trials=0)
    with pytest.raises(IndefiniteStiffnessError, match=r"they overlap.*no element is in two"):
        ReducedStructure(model=reduced).sensed_modes(np.log([0.2, 1.0, 0.2]), TOWER_ROWS, 3)
