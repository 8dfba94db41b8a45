import numpy as np
import pytest

from slowtime.dynamics.modes import complex_modes, undamped_modes
from slowtime.dynamics.perturbation import (
    coupled_shapes,
    factored_shapes,
    light_frequencies,
    light_shapes,
    modal_damping_matrix,
    uncoupled_frequencies,
)
from slowtime.dynamics.structure import Structure

PRINTED_FIRST = np.array([0.7870 - 0.0661j, -0.6406 - 0.1179j])
"""First components of the modes of example 3.4, as the book scales them."""


def second_components(shapes):
    return shapes[1] / shapes[0] * PRINTED_FIRST


def weakened(structure, factor):
    return Structure(
        mass=structure.mass, damping=factor * structure.damping, stiffness=structure.stiffness
    )


def unit(shapes):
    return shapes / shapes[np.argmax(np.abs(shapes), axis=0), np.arange(shapes.shape[1])]


def test_the_corrected_3_224_gives_the_books_own_numbers(family):
    found = second_components(factored_shapes(family["example 3.4"]()))
    np.testing.assert_allclose(found, [0.6287 + 0.1070j, 0.7797 - 0.0729j], atol=1e-4)


def test_classical_perturbation_gives_the_books_own_numbers(family):
    found = second_components(light_shapes(family["example 3.4"]()))
    np.testing.assert_allclose(found, [0.4658 + 0.2362j, 0.8866 - 0.3989j], atol=2e-4)


def test_3_221_errs_least_on_the_close_modes_of_example_3_4(family):
    structure = family["example 3.4"]()
    exact = second_components(complex_modes(structure).shapes)
    coupled, factored, light = (
        np.abs(second_components(shapes(structure)) - exact)
        for shapes in (coupled_shapes, factored_shapes, light_shapes)
    )
    np.testing.assert_allclose(coupled, [0.008, 0.021], atol=1e-3)
    np.testing.assert_allclose(factored, [0.016, 0.021], atol=1e-3)
    np.testing.assert_allclose(light, [0.22, 0.36], atol=1e-2)


def test_frequencies_of_example_3_5_are_those_of_3_251_to_3_253(family):
    root, c, m = np.sqrt(2.0), 0.2, 1.0
    expected = np.sqrt([2 - root, 2, 2 + root]) + 1j * c / m * np.array([1 / 4, 1 / 2, 1 / 4])
    np.testing.assert_allclose(light_frequencies(family["example 3.5"]()), expected)


def test_the_modal_damping_of_example_3_5_couples_first_and_third_mode(family):
    structure = family["example 3.5"]()
    found = modal_damping_matrix(structure, undamped_modes(structure))
    np.testing.assert_allclose(
        np.abs(found), 0.2 * np.array([[0.5, 0, 0.5], [0, 1, 0], [0.5, 0, 0.5]]), atol=1e-15
    )


def test_uncoupled_frequencies_are_exact_where_modes_do_not_couple(family):
    structure = family["modal damping"]()
    exact = complex_modes(structure).complex_frequency
    np.testing.assert_allclose(uncoupled_frequencies(structure), exact, rtol=1e-10)
    assert np.abs(light_frequencies(structure) - exact).max() > 1e-4


@pytest.mark.parametrize("name", ["example 3.5", "random dampers"])
def test_what_frequencies_are_off_by_falls_fourfold_when_damping_is_halved(family, name):
    structure = weakened(family[name](), 0.5)
    for approximation in (light_frequencies, uncoupled_frequencies):
        errors = [
            np.abs(approximation(s) - complex_modes(s).complex_frequency).max()
            for s in (structure, weakened(structure, 0.5))
        ]
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    assert (
        np.abs(
            light_frequencies(family["example 3.5"]())
            - complex_modes(family["example 3.5"]()).complex_frequency
        ).max()
        < 4e-3
    )


@pytest.mark.parametrize("shapes", [light_shapes, coupled_shapes, factored_shapes])
def test_what_shapes_are_off_by_falls_fourfold_when_damping_is_halved(family, shapes):
    structure = weakened(family["random dampers"](), 0.25)
    errors = [
        np.abs(unit(shapes(s)) - unit(complex_modes(s).shapes)).max()
        for s in (structure, weakened(structure, 0.5))
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def test_given_the_exact_frequencies_3_221_is_better_still(family):
    structure = family["example 3.4"]()
    modes = complex_modes(structure)
    exact = second_components(modes.shapes)
    better = second_components(coupled_shapes(structure, modes.complex_frequency))
    rough = second_components(coupled_shapes(structure))
    assert np.abs(better - exact).max() < np.abs(rough - exact).max()


def test_equal_frequencies_are_refused(family):
    with pytest.raises(ValueError, match="complex_modes"):
        light_shapes(family["two alike"]())
