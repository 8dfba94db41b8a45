import numpy as np
import pytest

from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.transfer import (
    frequency_response,
    laplace_response,
    transfer_function,
)

S = np.array([0.3 + 0.2j, 2.0j, 11.0j, -0.5 + 40j])


def test_transfer_is_the_inverse_of_the_dynamic_stiffness(structure):
    for s, h in zip(S, transfer_function(structure, S), strict=True):
        stiffness = s**2 * structure.mass + s * structure.damping + structure.stiffness
        np.testing.assert_allclose(stiffness @ h, np.eye(len(h)), atol=1e-9)


def test_transfer_is_reciprocal(structure):
    h = transfer_function(structure, S)
    np.testing.assert_allclose(h, h.swapaxes(1, 2), atol=1e-9 * np.abs(h).max())


def test_velocity_and_acceleration_are_derivatives(family):
    structure, omega = family["example 3.5"](), np.array([0.5, 2.0])
    q, v, a = (
        frequency_response(structure, omega, what)
        for what in ("displacement", "velocity", "acceleration")
    )
    np.testing.assert_allclose(v, 1j * omega[:, None, None] * q)
    np.testing.assert_allclose(a, -(omega[:, None, None] ** 2) * q)


def test_3_193_is_the_response_to_initial_displacement(family):
    structure = family["example 3.3"]()
    modes = undamped_modes(structure)
    x, w = modes.shapes, modes.angular_frequency
    omega = np.linspace(0.0, 2.0, 9)[:, None]
    z = 0.1 / w
    printed = (x[1] * (2 * z * w + 1j * omega) / (w**2 - omega**2 + 2j * omega * z * w)) @ x.T
    found = laplace_response(
        structure, 1j * omega[:, 0], displacement=np.array([0.0, 1.0, 0.0])
    )
    np.testing.assert_allclose(found, printed, atol=1e-13)
    np.testing.assert_allclose(found[:, 0], found[:, 2], atol=1e-13)


def test_force_and_start_add_up(structure):
    rng = np.random.default_rng(1)
    q0, v0 = rng.standard_normal((2, structure.dofs))
    force = rng.standard_normal((len(S), structure.dofs)) + 0j
    both = laplace_response(structure, S, force=force, displacement=q0, velocity=v0)
    alone = laplace_response(structure, S, force=force)
    start = laplace_response(structure, S, displacement=q0, velocity=v0)
    np.testing.assert_allclose(both, alone + start, atol=1e-12 * np.abs(both).max())


def test_an_unknown_quantity_is_named_with_those_there_are(family):
    with pytest.raises(ValueError, match=r"jerk.*displacement, velocity, acceleration"):
        frequency_response(family["example 3.3"](), np.array([1.0]), "jerk")
