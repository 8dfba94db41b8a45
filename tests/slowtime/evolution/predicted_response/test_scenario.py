"""Bands of a response: as wide as what is not known, and no wider."""

import dataclasses

import numpy as np
import pytest

from slowtime.dynamics import loads
from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.response import harmonic_response, step_response
from slowtime.evolution.predicted_response.scenario import ParameterBelief, bands, response_runs
from slowtime.evolution.structures import ParametricStructure

MASS, STIFFNESS, DAMPING = 2.0, 800.0, 0.03
TIMES = loads.instants(4.0, 200.0)


def one(theta=0.0, sd=0.0, damping_sd=0.0):
    """An oscillator whose stiffness is known as well as `sd` says."""
    matrix = np.array([[STIFFNESS]])
    return ParameterBelief(
        structure=ParametricStructure(
            mass=np.array([[MASS]]), stiffness=matrix, stiffness_parts=matrix[None],
            element_names=("k",), dof_names=("m",),
        ),
        theta=np.array([theta]),
        covariance=np.array([[sd**2]]),
        log_damping=np.log([DAMPING]),
        log_damping_sd=np.array([damping_sd]),
        influence=np.ones(1),
    )  # fmt: skip


def ran(believed, load, *, rate_hz=200.0, on="m", quantity="displacement", draws=2, seed=1):
    rng = np.random.default_rng(seed)
    return response_runs(
        believed, load, rate_hz, on=on, outputs=["m"], quantity=quantity, draws=draws, rng=rng
    )


def test_what_is_known_for_certain_responds_as_the_closed_form_says():
    oscillator = Oscillator(MASS, 2 * DAMPING * np.sqrt(MASS * STIFFNESS), STIFFNESS)
    found = bands(ran(one(), loads.step(TIMES, 5.0)))
    np.testing.assert_allclose(
        found.mean[:, 0], 5.0 * step_response(oscillator, TIMES)[0], atol=1e-12
    )
    np.testing.assert_array_equal(found.lo, found.hi)
    assert not found.sd.any()


def test_a_harmonic_load_moves_it_as_the_closed_form_says():
    times = loads.instants(20.0, 400.0)
    oscillator = Oscillator(MASS, 2 * DAMPING * np.sqrt(MASS * STIFFNESS), STIFFNESS)
    found = ran(one(), loads.harmonic(times, 1.0, 2.0), rate_hz=400.0)[0, :, 0]
    total = harmonic_response(oscillator, times, 2 * np.pi * 2.0)[0]
    np.testing.assert_allclose(found, total, atol=2e-3 * np.abs(total).max())


def test_the_base_carries_an_accelerometer_along():
    slow = loads.harmonic(TIMES, 1.0, 0.05)
    felt = ran(one(), slow, on=None, quantity="acceleration")[0, :, 0]
    relative = ran(one(), slow, on=None)[0, :, 0]
    omega = 2 * np.pi * 0.05
    assert felt[-1] == pytest.approx(slow[-1], abs=0.1)
    assert np.abs(relative).max() < 3 * MASS / STIFFNESS
    assert omega < np.sqrt(STIFFNESS / MASS)


def test_bands_of_a_soft_spring_are_those_of_its_flexibility():
    """Under a constant force that has lasted, q = F / k: the band is that of 1 / k."""
    times = loads.instants(20.0, 20.0)
    found = bands(ran(one(sd=0.1), loads.step(times, 8.0), rate_hz=20.0, draws=300))
    assert found.mean[-1, 0] == pytest.approx(0.01 * np.exp(0.005), rel=0.01)
    assert found.lo[-1, 0] == pytest.approx(0.01 * np.exp(-0.196), rel=0.05)
    assert found.hi[-1, 0] == pytest.approx(0.01 * np.exp(0.196), rel=0.05)


def test_the_band_holds_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(7)
    held = []
    for seed in range(10):
        true = one(theta=0.05 * rng.standard_normal())
        load = loads.white(TIMES, 1.0, 200.0, rng)
        truth = ran(true, load, draws=1)[0]
        found = bands(ran(one(sd=0.05), load, draws=40, seed=seed))
        held.append(((found.lo <= truth) & (truth <= found.hi)).mean())
    assert 0.75 < np.mean(held) < 0.995


def test_the_same_seed_gives_the_same_runs_and_another_does_not():
    load = loads.step(TIMES, 1.0)
    first, again, other = (ran(one(sd=0.1), load, seed=s) for s in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0


def test_parts_that_err_together_are_drawn_together():
    matrix = np.array([[STIFFNESS]])
    both = dataclasses.replace(
        one(),
        structure=ParametricStructure(
            mass=np.array([[MASS]]), stiffness=2 * matrix,
            stiffness_parts=np.stack([matrix, matrix]), dof_names=("m",),
        ),
        theta=np.zeros(2),
        covariance=0.04 * np.array([[1.0, -1.0], [-1.0, 1.0]]),
    )  # fmt: skip
    thetas = both.thetas(500, np.random.default_rng(2))
    np.testing.assert_allclose(thetas[:, 0], -thetas[:, 1], atol=1e-12)
    assert thetas[:, 0].std() == pytest.approx(0.2, rel=0.1)


def test_a_quantity_that_is_none_is_refused():
    with pytest.raises(ValueError, match="is none of displacement"):
        ran(one(), loads.step(TIMES, 1.0), quantity="force")
