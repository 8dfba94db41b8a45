"""Modes against the printed examples, exact tables, and the identities that define them."""

import csv

import numpy as np
import pytest
import scipy.linalg

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import DefectiveModesError, complex_modes, undamped_modes
from slowtime.dynamics.structure import Structure, state_matrix

SYSTEMS = {
    "ex3.3 m=1 k=1 c=0.2": "example 3.3",
    "ex3.4": "example 3.4",
    "ex3.5 m=1 k=1 c=0.2": "example 3.5",
}
# From the table of exact roots (30 digits, rounded).
EXACT = {
    "example 3.3": [
        -0.1 + 0.758805928829569j,
        -0.1 + 1.410673597966588j,
        -0.1 + 1.845051100206467j,
    ],
    "example 3.4": [
        -0.09260556629297056 + 32.32911192665912j,
        -3.907394433707029 + 35.18671381480545j,
    ],
    "example 3.5": [
        -0.05017766388752886 + 0.7650807567772756j,
        -0.1 + 1.410673597966588j,
        -0.04982233611247114 + 1.843814388363977j,
    ],
}


def turned(shape):
    """Shape with its largest component 1, so that only what matters is compared."""
    return shape / shape[np.argmax(np.abs(shape))]


@pytest.mark.parametrize("name", EXACT)
def test_poles_of_the_examples_are_the_exact_roots(family, name):
    np.testing.assert_allclose(complex_modes(family[name]()).poles, EXACT[name], rtol=2e-14)


def test_poles_and_shapes_agree_with_the_whole_table(tables, family):
    with (tables / "T2_eigen_examples.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    for row in rows:
        structure = family[SYSTEMS[row["system"]]]()
        modes, at = complex_modes(structure), int(row["mode"]) - 1
        s = float(row["re_s"]) + 1j * float(row["im_s"])
        assert modes.poles[at] == pytest.approx(s, rel=1e-13)
        assert modes.angular_frequency[at] == pytest.approx(float(row["abs_s"]), rel=1e-13)
        assert modes.damping_ratio[at] == pytest.approx(float(row["zeta"]), rel=1e-12)
        shape = np.array(
            [
                float(row[f"z{k}_re"]) + 1j * float(row[f"z{k}_im"])
                for k in range(1, structure.dofs + 1)
            ]
        )
        np.testing.assert_allclose(turned(modes.shapes[:, at]), turned(shape), atol=2e-13)
        # The table scales by gamma = 2 s, as the book; ours by 2i Im s.
        scale = np.sqrt(2 * s / modes.norms[at])
        assert np.abs(modes.shapes[:, at] * scale - shape).max() < 1e-12 or (
            np.abs(modes.shapes[:, at] * scale + shape).max() < 1e-12
        )


def test_example_3_3_has_the_frequencies_and_modes_of_3_152_and_3_176():
    m, k = 2.5, 7.0
    structure = assemble(chain([m] * 3, [k] * 4))
    modes = undamped_modes(structure)
    root = np.sqrt(2.0)
    np.testing.assert_allclose(
        modes.angular_frequency**2, k / m * np.array([2 - root, 2, 2 + root]), rtol=1e-14
    )
    printed = np.array([[1, root, 1], [root, 0, -root], [1, -root, 1]]) / (2 * np.sqrt(m))
    signs = np.sign((modes.shapes * printed).sum(axis=0))
    np.testing.assert_allclose(modes.shapes * signs, printed, atol=1e-14)


def test_example_3_3_is_damped_as_printed(family):
    modes = complex_modes(family["example 3.3"]())
    np.testing.assert_allclose(modes.damping_ratio.round(5), [0.13066, 0.07071, 0.05412])
    np.testing.assert_allclose(modes.shapes.imag, 0.0, atol=1e-14)


def test_example_3_4_has_the_printed_exact_shapes(family):
    z = complex_modes(family["example 3.4"]()).shapes
    second = z[1] / z[0] * np.array([0.7870 - 0.0661j, -0.6406 - 0.1179j])
    np.testing.assert_allclose(second, [0.6443 + 0.1018j, 0.7631 - 0.0603j], atol=1e-4)


def test_the_second_mode_of_example_3_5_is_exactly_real(family):
    modes = complex_modes(family["example 3.5"]())
    assert np.abs(modes.shapes[:, 1].imag).max() < 1e-14
    assert modes.poles[1].real == pytest.approx(-0.1, abs=1e-14)
    np.testing.assert_allclose(modes.damping_ratio.round(4), [0.0654, 0.0707, 0.0270])


def test_undamped_modes_are_orthogonal_over_mass_and_stiffness(any_structure):
    modes = undamped_modes(any_structure)
    x = modes.shapes
    np.testing.assert_allclose(x.T @ any_structure.mass @ x, np.eye(len(x)), atol=1e-11)
    scale = modes.angular_frequency.max() ** 2
    np.testing.assert_allclose(
        x.T @ any_structure.stiffness @ x / scale,
        np.diag(modes.angular_frequency**2) / scale,
        atol=1e-10,
    )
    assert np.all(np.diff(modes.angular_frequency) >= 0)


def test_complex_modes_solve_their_eigenproblem_and_are_scaled_as_promised(structure):
    modes = complex_modes(structure)
    m, c, k = structure.mass, structure.damping, structure.stiffness
    poles, shapes, norms = modes.all()
    assert len(poles) == 2 * structure.dofs
    size = np.abs(k).max() * np.abs(shapes).max()
    residual = m @ shapes * poles**2 + c @ shapes * poles + k @ shapes
    assert np.abs(residual).max() < 1e-11 * size
    scaled = np.einsum("aj,jab,bj->j", shapes, 2 * poles[:, None, None] * m + c, shapes)
    np.testing.assert_allclose(scaled, norms, rtol=1e-8)
    np.testing.assert_allclose(modes.norms, 2j * modes.poles.imag)


def test_modes_of_the_state_space_obey_the_identities_of_f36(structure):
    poles, shapes, norms = complex_modes(structure).all()
    inverse = np.linalg.inv(structure.mass)
    zero = (shapes / norms) @ shapes.T
    one = (shapes * poles / norms) @ shapes.T
    scale = np.abs(inverse).max()
    np.testing.assert_allclose(zero * np.abs(poles).max(), 0.0, atol=1e-9 * scale)
    np.testing.assert_allclose(one, inverse, atol=1e-10 * scale)


def test_poles_are_the_eigenvalues_of_the_state_matrix(structure):
    poles = complex_modes(structure).all()[0]
    truth = np.linalg.eigvals(state_matrix(structure))
    far = np.abs(poles[:, None] - truth[None, :])
    # A frequency that occurs twice is found by eigvals to half its digits only.
    assert far.min(axis=0).max() < 1e-7 * np.abs(truth).max()
    assert far.min(axis=1).max() < 1e-7 * np.abs(truth).max()


def test_the_books_own_scaling_would_turn_proportional_modes_by_a_phase(family):
    structure = family["example 3.3"]()
    modes = complex_modes(structure)
    z = modes.shapes * np.sqrt(2 * modes.poles / modes.norms)
    own = np.einsum("aj,ab,bj->j", z, structure.mass, z)
    np.testing.assert_allclose(own, modes.poles / (1j * modes.poles.imag))
    np.testing.assert_allclose(
        np.einsum("aj,ab,bj->j", modes.shapes, structure.mass, modes.shapes), 1.0
    )


def test_modes_that_do_not_span_all_motion_are_refused(defective):
    with pytest.raises(DefectiveModesError, match=r"do not span.*simulate_structure"):
        complex_modes(defective)


def test_an_unstable_structure_has_no_natural_frequency():
    with pytest.raises(ValueError, match="unstable at rest"):
        undamped_modes(assemble(chain([1.0, 1.0], [-1.0, 0.5])))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"stiffness": np.array([[1.0, 2.0], [3.0, 4.0]])}, "not symmetric"),
        ({"mass": np.diag([1.0, 0.0])}, "no mass"),
        ({"damping": np.full((2, 2), np.nan)}, "NaN"),
        ({"names": ("a",)}, "one for each"),
    ],
)
def test_matrices_that_are_no_structure_are_refused(change, words):
    whole = {"mass": np.eye(2), "damping": np.eye(2), "stiffness": np.eye(2)} | change
    with pytest.raises(ValueError, match=words):
        Structure(**whole)


def test_an_unknown_degree_of_freedom_is_named_with_those_there_are():
    structure = assemble(chain([1.0, 1.0], [1.0, 1.0]))
    assert structure.dof("m2") == 1
    with pytest.raises(ValueError, match=r"'m3'.*m1, m2"):
        structure.dof("m3")


def test_a_state_matrix_moves_position_by_velocity(structure):
    a, dofs = state_matrix(structure), structure.dofs
    np.testing.assert_array_equal(a[:dofs, dofs:], np.eye(dofs))
    np.testing.assert_allclose(
        structure.mass @ a[dofs:, :dofs], -structure.stiffness, atol=1e-9, rtol=1e-9
    )
    assert scipy.linalg.norm(a[:dofs, :dofs]) == 0
