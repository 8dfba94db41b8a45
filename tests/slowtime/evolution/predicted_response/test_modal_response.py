"""Responses mode by mode equal those of the structure's matrices."""

import numpy as np
import pytest

from slowtime.dynamics.damping import modal_damping
from slowtime.dynamics.simulation import simulate_structure
from slowtime.dynamics.structure import Structure
from slowtime.evolution.predicted_response.modal_response import linear_hold, modal_response
from slowtime.evolution.predicted_response.scenario import ParameterBelief, response_runs
from slowtime.evolution.structures import ParametricStructure

RATIOS = np.array([0.01, 0.3, 0.05])


def chain(*, grounded=True):
    springs = [900.0, 500.0, 700.0] if grounded else [0.0, 500.0, 700.0]
    stiffness = np.zeros((3, 3))
    for k, spring in enumerate(springs):
        stiffness[k, k] += spring
        if k:
            stiffness[k - 1, k - 1] += spring
            stiffness[k - 1, k] -= spring
            stiffness[k, k - 1] -= spring
    return np.diag([2.0, 1.0, 3.0]), stiffness


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("rate_hz", [5.0, 200.0])
def test_every_quantity_is_that_of_the_matrices(order, rate_hz):
    mass, stiffness = chain()
    load = np.random.default_rng(3).standard_normal(400)
    pushed = np.array([0.0, 2.0, -1.0])
    structure = Structure(
        mass=mass, stiffness=stiffness, damping=modal_damping(mass, stiffness, RATIOS)
    )
    force = np.multiply.outer(load, pushed)
    expected = simulate_structure(structure, force, rate_hz, hold="first")[order]
    found = modal_response(
        (mass, stiffness), RATIOS, pushed, load, rate_hz, rows=np.eye(3), order=order
    )
    assert found is not None
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_weights_of_small_and_large_steps_agree_with_each_other():
    # Where series and closed forms meet, both are right.
    z = np.array([0.0999, 0.1001]) * np.exp(2.5j)
    for part in linear_hold(z):
        assert abs(part[1] - part[0]) < 3e-4
    near = linear_hold(np.array([1e-9 + 0j]))
    np.testing.assert_allclose([part[0] for part in near], [1.0, 0.5, 0.5], atol=1e-8)


def believed(matrices):
    mass, stiffness = matrices
    return ParameterBelief(
        structure=ParametricStructure(
            mass=mass, stiffness=stiffness, stiffness_parts=stiffness[None],
            element_names=("k",), dof_names=("a", "b", "c"),
        ),
        theta=np.zeros(1),
        covariance=np.array([[0.01]]),
        log_damping=np.log(RATIOS),
        log_damping_sd=np.full(3, 0.1),
        influence=np.array([1.0, 1.0, 0.0]),
        base_mass=np.array([0.0, 0.2, 0.0]),
    )  # fmt: skip


@pytest.mark.parametrize("on", [None, "b"])
@pytest.mark.parametrize("grounded", [True, False])
def test_runs_of_drawn_structures_are_those_of_their_matrices(on, grounded):
    belief = believed(chain(grounded=grounded))
    load = np.random.default_rng(4).standard_normal(300)
    found = response_runs(
        belief, load, 50.0, on=on, outputs=["c", "a"], draws=3, rng=np.random.default_rng(1)
    )
    for run, structure in zip(found, belief.draw(3, np.random.default_rng(1)), strict=True):
        force = np.multiply.outer(load, np.array([0.0, 1.0, 0.0]))
        if on is None:
            force = structure.base_force(load)
        motion = simulate_structure(structure, force, 50.0, hold="first")[2]
        if on is None:
            motion = motion + np.multiply.outer(load, structure.influence)
        expected = motion[:, [2, 0]]
        np.testing.assert_allclose(run, expected, atol=1e-8 * np.abs(expected).max())
