import dataclasses

import numpy as np
import pytest
import scipy.linalg
from scipy import sparse

from slowtime.finite_elements import eigenvalues
from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.eigenvalues import (
    MissedModesError,
    lowest_modes,
    modes_below,
    nominal_modes,
)
from slowtime.finite_elements.frame import Support
from slowtime.finite_elements.sections import rectangle
from tests.slowtime.finite_elements.frames import FLAT, STEEL, line_of_beams, small_tower

CLAMPED = np.array([1.875104068711961, 4.694091132974174, 7.854757438237612])
FREE = np.array([4.730040744862704, 7.853204624095838, 10.995607838001671])


def closed_form(roots, length=2.0):
    line_mass = STEEL.density_kg_m3 * FLAT.area_m2
    both = STEEL.young_pa * np.array([FLAT.inertia_y_m4, FLAT.inertia_z_m4]) / line_mass
    return np.sort(np.outer(np.sqrt(both), (roots / length) ** 2).ravel()) / (2 * np.pi)


def test_a_clamped_beam_has_the_frequencies_of_the_closed_form():
    found = nominal_modes(assemble(line_of_beams(40, direction=(1, 2, 3))), 6)
    np.testing.assert_allclose(found.frequency_hz, closed_form(CLAMPED), rtol=2e-6)
    assert found.counted


def test_a_free_beam_has_six_rigid_motions_and_its_elastic_frequencies():
    found = nominal_modes(assemble(line_of_beams(40, supports=())), 10)
    assert found.rigid == 6
    np.testing.assert_allclose(found.frequency_hz[6:], closed_form(FREE)[:4], rtol=2e-6)


def test_a_thick_beam_on_pins_follows_timoshenkos_frequency_equation():
    section, length, number = rectangle(0.3, 0.5), 4.0, 80
    pins = tuple(
        Support(node=n, directions=("ux", "uy", "uz", "rx")) for n in ("0", str(number))
    )
    frame = line_of_beams(number, length, section=section, supports=pins, theory="timoshenko")
    found = nominal_modes(assemble(frame), 8).frequency_hz
    rho, area, inertia = STEEL.density_kg_m3, section.area_m2, section.inertia_z_m4
    shear, bend = STEEL.shear_pa * section.shear_y_m2, STEEL.young_pa * inertia
    for n in (1, 2, 3):
        k = n * np.pi / length
        # (EI k^4) - w^2 rho A (1 + k^2 (I/A + EI/GA_s)) + w^4 rho^2 I A / GA_s = 0
        poly = [
            rho**2 * inertia * area / shear,
            -rho * area * (1 + k**2 * (inertia / area + bend / shear)),
            bend * k**4,
        ]
        expected = np.sqrt(np.roots(poly).min()) / (2 * np.pi)
        assert np.abs(found / expected - 1).min() < 1e-4


def test_close_modes_of_a_square_tower_are_all_found():
    model = assemble(small_tower(8))
    found = nominal_modes(model, 15)
    dense = scipy.linalg.eigh(
        model.stiffness.toarray(), model.mass.toarray(), eigvals_only=True
    )
    np.testing.assert_allclose(found.eigenvalue, dense[:15], rtol=1e-8)
    gram = found.shapes.T @ (model.mass @ found.shapes)
    np.testing.assert_allclose(gram, np.eye(15), atol=1e-8)
    assert found.residual.max() < 1e-6


def test_the_count_below_a_frequency_needs_no_modes():
    model = assemble(small_tower(8))
    frequency = nominal_modes(model, 12).frequency_hz
    for j in (0, 2, 7, 11):
        assert modes_below(model, frequency[j] * 1.0001) == np.sum(
            frequency < frequency[j] * 1.0001
        )


def test_a_solver_that_misses_a_mode_is_found_out(monkeypatch):
    model = assemble(small_tower(8))
    original = eigenvalues._lanczos

    def forgetful(*given, **more):
        values, shapes = original(*given, **more)
        return np.delete(values, 3), np.delete(shapes, 3, axis=1)

    monkeypatch.setattr(eigenvalues, "_lanczos", forgetful)
    with pytest.raises(MissedModesError, match=r"10 modes lie below .* but the solver found 9"):
        nominal_modes(model, 8)


def test_massless_degrees_of_freedom_are_no_obstacle():
    stiffness = np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1.0]])
    mass = np.diag([1.0, 0.0, 1.0])
    found = lowest_modes(sparse.csr_array(stiffness), sparse.csr_array(mass), 2)
    condensed = np.array([[1.5, -0.5], [-0.5, 0.5]])
    np.testing.assert_allclose(found.eigenvalue, np.linalg.eigvalsh(condensed), rtol=1e-9)


def test_runs_repeat_exactly():
    model = assemble(small_tower(8))
    one, other = nominal_modes(model, 9), nominal_modes(model, 9)
    np.testing.assert_array_equal(one.shapes, other.shapes)


def test_more_modes_than_coordinates_are_refused():
    model = assemble(line_of_beams(1))
    with pytest.raises(ValueError, match="7 modes of 6 degrees of freedom"):
        nominal_modes(model, 7)
    bent = dataclasses.replace(model, stiffness=-model.stiffness)
    with pytest.raises(ValueError, match="negative eigenvalue"):
        nominal_modes(bent, 2)
