"""A plate made by scikit-fem, through files: against the closed form and another solver."""

import json

import numpy as np
import pytest
import scipy.linalg
from scipy import sparse

from slowtime.finite_elements.eigenvalues import lowest_modes, nominal_modes
from slowtime_services.matrices import read_matrix_model, write_matrix

skfem = pytest.importorskip("skfem")

SIDE_M, THICK_M, YOUNG_PA, POISSON, DENSITY = 1.0, 0.01, 7.0e10, 0.3, 2700.0
RIGIDITY = YOUNG_PA * THICK_M**3 / (12 * (1 - POISSON**2))


def plate(halvings):
    """Free stiffness, mass and stiffness of the left half of a simply supported plate."""
    from skfem.helpers import dd, ddot, eye, trace

    mesh = skfem.MeshTri.init_symmetric().refined(halvings)
    element = skfem.ElementTriMorley()

    @skfem.BilinearForm
    def bending(u, v, _):
        def moments(w):
            return RIGIDITY * ((1 - POISSON) * dd(w) + POISSON * eye(trace(dd(w)), 2))

        return ddot(moments(u), dd(v))

    @skfem.BilinearForm
    def inertia(u, v, _):
        return DENSITY * THICK_M * u * v

    whole = skfem.Basis(mesh, element)
    left = skfem.Basis(mesh, element, elements=lambda x: x[0] < SIDE_M / 2)
    held = whole.get_dofs().all("u")
    free = np.setdiff1d(np.arange(whole.N), held)
    parts = [bending.assemble(whole), inertia.assemble(whole), bending.assemble(left)]
    return [sparse.csr_array(part)[free][:, free] for part in parts]


def through_files(parts, folder):
    """Matrices of a model file that names them, each in a format of its own."""
    for name, matrix in zip(("K.mtx", "M.mat", "left.npz"), parts, strict=True):
        write_matrix(folder / name, matrix)
    values = {
        "slowtime_model": 2,
        "matrices": {
            "stiffness": "K.mtx",
            "mass": "M.mat",
            "parameters": [{"name": "left half", "stiffness": "left.npz"}],
        },
    }
    (folder / "plate.yaml").write_text(json.dumps(values))
    return read_matrix_model(folder / "plate.yaml").matrices


def test_a_simply_supported_plate_converges_to_the_closed_form(tmp_path):
    # S. Timoshenko, "Vibration Problems in Engineering": pi/2 (m^2 + n^2)/a^2 sqrt(D/(rho h)).
    waves = np.array([2, 5, 5, 8, 10, 10])
    closed = np.pi / 2 * np.sqrt(RIGIDITY / (DENSITY * THICK_M)) / SIDE_M**2 * waves
    coarse, fine = (
        nominal_modes(through_files(plate(halvings), tmp_path), 6).frequency_hz
        for halvings in (3, 4)
    )
    # Errors of Morley's triangles fall with the square of their size.
    np.testing.assert_allclose(fine + (fine - coarse) / 3.0, closed, rtol=8e-3)
    np.testing.assert_allclose((coarse - closed) / (fine - closed), 4.0, rtol=0.2)


def test_modes_are_those_of_another_solver_whatever_the_parameter(tmp_path):
    parts = plate(3)
    model = through_files(parts, tmp_path)
    for theta in (0.0, -0.3):
        stiffness = (parts[0] + theta * parts[2]).toarray()
        expected = scipy.linalg.eigh(
            stiffness, parts[1].toarray(), eigvals_only=True, subset_by_index=(0, 5)
        )
        own, mass = model.at(np.array([theta]))
        found = lowest_modes(own, mass, 6).eigenvalue
        np.testing.assert_allclose(found, expected, rtol=1e-8)
