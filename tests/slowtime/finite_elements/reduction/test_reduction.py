import dataclasses
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from scipy import sparse

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.close_modes import close_groups, mass_weighted_agreement
from slowtime.finite_elements.eigenvalues import lowest_modes, nominal_modes
from slowtime.finite_elements.frame import Parameter
from slowtime.finite_elements.reduction import (
    BasisSettings,
    craig_bampton,
    reduce_modal,
    settings_for_band,
    verify,
)
from tests.slowtime.finite_elements.frames import line_of_beams, small_tower


@pytest.fixture(scope="module")
def tower():
    return assemble(small_tower(12))


@pytest.fixture(scope="module")
def reduced(tower):
    return reduce_modal(tower, BasisSettings(modes=12, coordinates=60))


def test_frequencies_and_shapes_hold_over_the_range_of_the_parameters(tower, reduced):
    assert reduced.size <= 60
    found = verify(tower, reduced, modes=12, trials=20, seed=9).error
    assert found.frequency < 1e-3
    assert found.agreement > 0.999


def test_the_estimate_of_the_error_is_near_the_error(reduced):
    assert reduced.error.frequency <= 1.5 * reduced.error.estimated
    assert reduced.error.estimated < 10 * reduced.error.frequency


def test_reduced_frequencies_are_upper_bounds_and_exact_at_zero(tower, reduced):
    full = nominal_modes(tower, 12)
    np.testing.assert_allclose(
        reduced.modes(np.zeros(12), 12).frequency_hz, full.frequency_hz, rtol=1e-8
    )
    theta = np.random.default_rng(2).uniform(-0.3, 0.3, 12)
    stiffness, mass = tower.at(theta)
    true = lowest_modes(stiffness, mass, 12).eigenvalue
    assert (reduced.modes(theta, 12).eigenvalue > true * (1 - 1e-6)).all()


@pytest.mark.parametrize("change", [-0.1, 0.01, 0.5])
@pytest.mark.parametrize("coordinates", [30, 60, 140])
def test_a_common_change_of_all_parts_scales_the_frequencies(change, coordinates):
    model = assemble(small_tower(6))
    reduced = reduce_modal(model, BasisSettings(modes=8, coordinates=coordinates), trials=0)
    nominal = nominal_modes(model, 8).frequency_hz
    found = reduced.modes(np.full(6, change), 8).frequency_hz
    np.testing.assert_allclose(found, nominal * np.sqrt(1.0 + change), rtol=1e-5)


def test_shapes_of_the_reduced_model_are_mass_normalised(tower, reduced):
    theta = np.random.default_rng(3).uniform(-0.3, 0.3, 12)
    shapes = reduced.basis @ reduced.modes(theta, 8).shapes
    np.testing.assert_allclose(shapes.T @ (tower.mass @ shapes), np.eye(8), atol=1e-8)


def test_masses_may_be_parameters_too():
    frame = small_tower(6)
    extra = Parameter(name="mass", groups=("storey 3", "storey 5"), acts_on="mass")
    both = Parameter(name="both", groups=("storey 2",), acts_on="both")
    model = assemble(dataclasses.replace(frame, parameters=(*frame.parameters, extra, both)))
    found: Any = reduce_modal(model, BasisSettings(modes=8, coordinates=40), trials=8)
    assert found.error.frequency < 1e-3
    assert found.error.agreement > 0.999


def test_slopes_of_the_reduced_model_are_those_of_the_full_one(tower, reduced):
    theta = np.random.default_rng(4).uniform(-0.2, 0.2, 12)
    rows = np.random.default_rng(5).standard_normal((6, tower.dofs.size))
    modes, slopes = reduced.slopes(theta, reduced.sense(rows), 8)
    full = dataclasses.replace(tower)
    for p in (0, 5, 11):
        change = 1e-5 * np.eye(12)[p]
        ends = []
        for sign in (1, -1):
            stiffness, mass = full.at(theta + sign * change)
            values = scipy.linalg.eigh(
                stiffness.toarray(), mass.toarray(), subset_by_index=(0, 7), eigvals_only=True
            )
            ends.append(values)
        expected = (ends[0] - ends[1]) / 2e-5
        scale = np.abs(slopes.eigenvalue).max(axis=1)
        np.testing.assert_allclose(slopes.eigenvalue[:, p] / scale, expected / scale, atol=0.01)
    assert slopes.sensed.shape == (6, len(modes.eigenvalue), 12)


def test_a_free_structure_keeps_its_rigid_motions():
    frame = line_of_beams(20, supports=())
    model = assemble(frame)
    found: Any = reduce_modal(model, BasisSettings(modes=12, coordinates=60), trials=3)
    values = found.modes(np.full(20, 0.1), 12).eigenvalue
    assert np.abs(values[:6]).max() < 1e-6 * values[6]
    assert found.error.frequency < 1e-3


def test_static_loads_are_answered_exactly(tower):
    load = tower.dofs.row("7.2", {"ux": 1.0, "uz": -0.5})
    found = reduce_modal(
        tower, BasisSettings(modes=6, coordinates=40), loads=load[None], trials=0
    )
    stiffness, _, basis = found.at(np.zeros(12))
    force = basis.T @ found.sense(load[None])[0]
    moved = found.candidates @ (basis @ np.linalg.solve(stiffness, force))
    exact = sparse.linalg.spsolve(sparse.csc_array(tower.stiffness), tower.rows(load[None])[0])
    np.testing.assert_allclose(moved, exact, rtol=1e-6, atol=1e-8 * np.abs(exact).max())


def test_craig_bampton_keeps_the_interface_as_it_is(tower):
    own = np.abs(tower.expansion).tocoo()
    row = [tower.dofs.find("6.0", d) for d in ("ux", "uy", "uz", "rx", "ry", "rz")]
    interface = np.array([own.col[own.row == r][0] for r in row])
    found = craig_bampton(tower, interface, BasisSettings(modes=15, coordinates=100))
    np.testing.assert_array_equal(found.basis[interface, :6], np.eye(6))
    np.testing.assert_array_equal(found.basis[interface, 6:], 0.0)
    # A static load at the interface is answered exactly.
    load = np.zeros(found.size)
    load[:6] = np.arange(1.0, 7.0)
    moved = found.basis @ np.linalg.solve(found.stiffness, load)
    exact = np.zeros(tower.size)
    exact[interface] = load[:6]
    exact = sparse.linalg.spsolve(sparse.csc_array(tower.stiffness), exact)
    np.testing.assert_allclose(moved, exact, rtol=1e-6, atol=1e-9 * np.abs(exact).max())
    error: Any = verify(tower, found, modes=8, span=0.1, trials=4).error
    assert error.frequency < 3e-3


def test_an_interface_that_leaves_the_rest_loose_is_refused():
    model = assemble(line_of_beams(4, supports=()))
    with pytest.raises(ValueError, match="Add degrees of freedom to the interface"):
        craig_bampton(model, np.array([0]), BasisSettings(modes=3))


def test_the_number_of_modes_follows_from_the_band(tower):
    frequency = nominal_modes(tower, 20).frequency_hz
    settings = settings_for_band(tower, frequency[7] / 1.5 * 1.001, BasisSettings(modes=1))
    assert settings.modes == np.sum(frequency < frequency[7] * 1.001)
    with pytest.raises(ValueError, match="give another band or more coordinates"):
        settings_for_band(tower, 1e-6, BasisSettings(modes=1))


def test_close_modes_are_compared_as_subspaces():
    assert close_groups(np.array([1.0, 1.009, 1.018, 1.2])) == [[0, 1, 2], [3]]
    rng = np.random.default_rng(1)
    mass = sparse.csr_array(np.diag(rng.uniform(1, 2, 9)))
    pair, turn = rng.standard_normal((9, 2)), rng.standard_normal((2, 2))
    assert mass_weighted_agreement(pair @ turn, pair, mass) == pytest.approx(1.0, abs=1e-12)
    assert mass_weighted_agreement(pair[:, :1], pair[:, 1:], mass) < 0.9


def test_settings_without_a_solution_are_refused():
    with pytest.raises(ValueError, match="at least as many coordinates as modes"):
        BasisSettings(modes=30, coordinates=20)
    with pytest.raises(ValueError, match="a span between 0 and 1"):
        BasisSettings(modes=3, span=1.0)
