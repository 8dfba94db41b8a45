from typing import Any

import numpy as np
import pytest
from scipy import sparse

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.degrees_of_freedom import DofMap, full_map
from slowtime.finite_elements.parametric_matrices import MatrixFamily, ParametricMatrices
from tests.slowtime.finite_elements.frames import small_tower


def test_projections_are_those_of_the_dense_matrices():
    model: Any = assemble(small_tower(3))
    rng = np.random.default_rng(0)
    left, right = rng.standard_normal((model.size, 4)), rng.standard_normal((model.size, 3))
    expected = [left.T @ part.toarray() @ right for part in model.stiffness_parts]
    found = model.stiffness_family.project(left, right)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    cube = rng.standard_normal((model.size, 2, 3))
    expected = [
        np.einsum("acj,ab,bj->cj", cube, part.toarray(), right)
        for part in model.stiffness_parts
    ]
    found = model.stiffness_family.contract(cube, right)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_small_parts_are_projected_alike_and_parts_may_be_missing():
    rng = np.random.default_rng(0)
    nominal = sparse.csr_array(np.eye(5))
    part = np.zeros((5, 5))
    part[1:3, 1:3] = [[2.0, -1.0], [-1.0, 2.0]]
    far = np.zeros((5, 5))
    far[0, 4] = far[4, 0] = 3.0
    family = MatrixFamily(nominal, [sparse.csr_array(part), None, sparse.csr_array(far)])
    left, right = rng.standard_normal((5, 2)), rng.standard_normal((5, 3))
    np.testing.assert_allclose(
        family.project(left, right),
        [left.T @ part @ right, np.zeros((2, 3)), left.T @ far @ right],
        atol=1e-14,
    )
    theta = np.array([0.5, 9.0, -2.0])
    np.testing.assert_allclose(
        family.at(theta).toarray(), np.eye(5) + 0.5 * part - 2.0 * far, atol=1e-14
    )


def test_matrices_that_do_not_belong_together_are_refused():
    one, other = sparse.csr_array(np.eye(3)), sparse.csr_array(np.eye(4))
    with pytest.raises(ValueError, match=r"mass matrix has shape \(4, 4\)"):
        ParametricMatrices(stiffness=one, mass=other)
    skew = sparse.csr_array(np.array([[1.0, 2, 0], [0, 1, 0], [0, 0, 1]]))
    with pytest.raises(ValueError, match="only one triangle was exported, mirror it"):
        ParametricMatrices(stiffness=skew, mass=one)
    with pytest.raises(ValueError, match="stiffness_parts were given for 2 parameters"):
        ParametricMatrices(stiffness=one, mass=one, names=("a", "b"), stiffness_parts=(one,))
    with pytest.raises(ValueError, match="not finite"):
        ParametricMatrices(stiffness=sparse.csr_array(np.diag([1, np.nan, 1])), mass=one)
    with pytest.raises(ValueError, match="map has 6 degrees of freedom, the matrices have 3"):
        ParametricMatrices(stiffness=one, mass=one, dofs=full_map(["a"], np.zeros((1, 3))))


def test_a_sensor_sees_a_node_along_a_line():
    dofs = full_map(["a", "b"], np.zeros((2, 3)))
    row = dofs.row("b", {"ux": 0.6, "uz": 0.8})
    assert row[dofs.find("b", "ux")] == 0.6
    assert row[dofs.find("b", "uz")] == 0.8
    assert np.count_nonzero(row) == 2
    np.testing.assert_array_equal(dofs.row("a", (0.0, 1.0, 0.0)), np.eye(12)[1])
    with pytest.raises(ValueError, match="Node 'c', direction 'ux' was given"):
        dofs.find("c", "ux")


def test_a_map_names_each_pair_once():
    with pytest.raises(ValueError, match="Give each pair once"):
        DofMap(
            node_names=("a",),
            coordinates=np.zeros((1, 3)),
            node=np.array([0, 0]),
            direction=np.array([1, 1]),
        )
    dofs = DofMap(
        node_names=("a",),
        coordinates=np.zeros((1, 3)),
        node=np.array([0]),
        direction=np.array([1]),
    )
    with pytest.raises(ValueError, match="has no degree of freedom rz"):
        dofs.find("a", "rz")
