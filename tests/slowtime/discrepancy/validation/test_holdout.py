"""A model that explains what it was fitted to has to be true of other records, too."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.validation.free_run import refit_on_record
from slowtime.discrepancy.validation.holdout import (
    MAX_EXCESS,
    are_parameters_equal,
    is_confirmed_on_holdout,
)
from slowtime.dynamics.description import Spring
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import ONE, PLACE

KINDS, RATE = catalogue(), 64.0
HARD = Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 3e4})
STOPS = Effect("gap_symmetric", PLACE, {"kg_n_per_m": 150.0, "gap_m": 0.02})
MUCH = 1 + 10 * MAX_EXCESS


def model_of(*effects, of=ONE):
    return Plant.of(dataclasses.replace(of, effects=tuple(e.entry() for e in effects)))


def recorded(effect, level, seed, of=ONE, state0=None):
    rng = np.random.default_rng(seed)
    push = level * np.convolve(rng.standard_normal(1200), np.hanning(7), "same")[:, None]
    plant = model_of(effect, of=of)
    clean = plant.simulate(plant.values, push, RATE, state0=state0)
    noise = 0.02 * clean.std(axis=0) * rng.standard_normal(clean.shape)
    return Trial(inputs=push, outputs=clean + noise, rate_hz=RATE)


@pytest.fixture(scope="module")
def fitted():
    """The right law and a neighbour, fitted to motion in which they are hardly apart."""
    trials = tuple(recorded(HARD, level, seed) for seed, level in enumerate((0.8, 1.0)))
    return {law.kind: refit(model_of(law), trials) for law in (HARD, STOPS)}


def test_an_error_of_noise_needs_no_second_look(fitted):
    assert is_confirmed_on_holdout(fitted["gap_symmetric"], 1.0, [recorded(HARD, 9.0, 7)])


@pytest.mark.long
@pytest.mark.parametrize(
    "begun",
    [pytest.param(None, marks=pytest.mark.long), np.array([0.05, -1.5])],
    ids=["at rest", "moving"],
)
def test_the_right_law_has_the_same_numbers_elsewhere(fitted, begun):
    test = recorded(HARD, 9.0, 7, state0=begun)
    assert is_confirmed_on_holdout(fitted["cubic_hardening"], MUCH, [test])
    again = refit_on_record(fitted["cubic_hardening"], test)
    assert again is not None
    assert again.values[-1] == pytest.approx(3e4, rel=0.05)


def test_a_neighbour_of_the_right_law_has_not(fitted):
    last = fitted["gap_symmetric"]
    assert last.chi2_in_band < 1.5
    assert not is_confirmed_on_holdout(last, MUCH, [recorded(HARD, 9.0, 7)])
    # One record that speaks against it is enough.
    assert not is_confirmed_on_holdout(
        last, MUCH, [recorded(HARD, 0.8, 9), recorded(HARD, 9.0, 7)]
    )


def test_numbers_are_the_same_as_far_as_both_are_known(fitted):
    fit = fitted["cubic_hardening"]
    sd = fit.sd[-1]
    for times, same in ((1.0, True), (20.0, False)):
        free = fit.free.copy()
        free[-1] += times * sd
        values = fit.values.copy()
        values[fit.plant.parameters.index(fit.prior.names[-1])] = free[-1]
        other = dataclasses.replace(fit, values=values)
        assert other.free[-1] == free[-1]
        assert are_parameters_equal(fit, other) is same


def test_what_floats_drifts_on_its_own_and_is_not_judged_by_that():
    loose = Spring(id="k1", between=("base", "m1"), damping_n_s_per_m=1.6)
    free = dataclasses.replace(ONE, elements=(loose,))
    drag = Effect("quadratic_damping", PLACE, {"c2_n_s2_per_m2": 3.0})
    trials = (recorded(drag, 2.0, 1, of=free),)
    fit = refit(model_of(drag, of=free), trials)
    assert fit.noise.drift is not None
    assert is_confirmed_on_holdout(fit, 1e3, [recorded(drag, 9.0, 7, of=free)])
