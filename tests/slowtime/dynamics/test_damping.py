import numpy as np
import pytest

from slowtime.dynamics.builders import chain
from slowtime.dynamics.damping import (
    is_proportional,
    modal_damping,
    non_proportionality,
    rayleigh_coefficients,
)
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import complex_modes, undamped_modes
from slowtime.dynamics.structure import Structure

BARE = assemble(chain([1.0, 2.0, 1.5, 1.0], [800.0, 600.0, 700.0, 500.0]))
M, K = BARE.mass, BARE.stiffness
OMEGA = undamped_modes(BARE).angular_frequency


def ratios(damping):
    """Damping ratios of modes that really are uncoupled, by the state space."""
    structure = Structure(mass=M, damping=damping, stiffness=K)
    assert is_proportional(structure)
    a = np.block(
        [[np.zeros((4, 4)), np.eye(4)], [-np.linalg.solve(M, np.hstack([K, damping]))]]
    )
    poles = np.linalg.eigvals(a)
    poles = poles[poles.imag > 0]
    poles = poles[np.argsort(np.abs(poles))]
    np.testing.assert_allclose(np.abs(poles), OMEGA, rtol=1e-10)
    return -poles.real / np.abs(poles)


def test_rayleigh_gives_its_two_modes_their_ratios_and_the_others_the_law():
    a0, a1 = rayleigh_coefficients((OMEGA[0], OMEGA[2]), (0.02, 0.03))
    found = ratios(a0 * M + a1 * K)
    np.testing.assert_allclose(found[[0, 2]], [0.02, 0.03], rtol=1e-10)
    np.testing.assert_allclose(found, (a0 / OMEGA + a1 * OMEGA) / 2, rtol=1e-10)


def test_a_ratio_for_each_mode_is_what_each_mode_gets():
    given_ratios = np.array([0.01, 0.05, 0.02, 0.08])
    np.testing.assert_allclose(ratios(modal_damping(M, K, given_ratios)), given_ratios)
    np.testing.assert_allclose(ratios(modal_damping(M, K, 0.03)), 0.03)


def test_example_3_3_has_real_modes_and_example_3_5_has_not(family):
    assert non_proportionality(family["example 3.3"]()) < 1e-15
    structure = family["example 3.5"]()
    # Eq. 3.248 and 3.249, c k / m = 0.2: their difference over the larger of them.
    assert non_proportionality(structure) == pytest.approx(0.2 / 0.4)
    assert not is_proportional(structure)
    assert np.abs(complex_modes(structure).shapes.imag).max() > 1e-2


def test_modes_are_uncoupled_exactly_where_the_test_says_so(structure):
    x = undamped_modes(structure).shapes
    modal = x.T @ structure.damping @ x
    coupling = np.abs(modal - np.diag(np.diag(modal))).max()
    if is_proportional(structure):
        assert coupling <= 1e-8 * max(np.abs(modal).max(), 1e-300)
    else:
        assert coupling > 1e-4 * np.abs(modal).max()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: rayleigh_coefficients((1.0, 1.0), (0.1, 0.1)), "two different frequencies"),
    ],
)
def test_damping_that_cannot_be_made_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
