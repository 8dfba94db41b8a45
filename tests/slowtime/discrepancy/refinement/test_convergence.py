"""Parameters are quoted from where the misfit is least."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import WRONG_MODEL_CHI2, refit
from slowtime.discrepancy.calibration.augmentation import simulated_chi2
from slowtime.discrepancy.calibration.levenberg_marquardt import FitControl
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.refinement.convergence import converge, converge_stick_slip
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import fit_at, named_effect, with_last
from tests.slowtime.discrepancy.rigs import ONE, PLACE

RATE = 64.0
KINDS = {name: kind for name, kind in catalogue().items() if name == "cubic_hardening"}
HARDER = Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 4e4})
NAME = ("effect", 0, "k3_n_per_m3")
TRUTH = dataclasses.replace(ONE, effects=(HARDER.entry(),))


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(5)
    plant = Plant.of(TRUTH, kinds=KINDS)
    found = []
    for level in (3.0, 6.0):
        push = level * np.convolve(rng.standard_normal(700), np.hanning(9) / 2, "same")[:, None]
        clean = plant.simulate(plant.values, push, RATE)
        noise = 0.02 * clean.std() * rng.standard_normal(clean.shape)
        found.append(Trial(inputs=push, outputs=clean + noise, rate_hz=RATE))
    return tuple(found)


@pytest.fixture(scope="module")
def beside(trials):
    """A law whose fit ended half a standard deviation beside its minimum."""
    right = refit(Plant.of(TRUTH, kinds=KINDS), trials)
    at = right.prior.names.index(NAME)
    values = right.values.copy()
    values[list(right.prior.index)] += 0.5 * right.covariance[:, at] / right.sd[at]
    fit = fit_at(right, trials, values, chi2_in_band=right.chi2_in_band)
    effects = (named_effect(HARDER, KINDS),)
    return Hypothesis((refit(Plant.of(ONE, kinds=KINDS), trials), fit), trials, effects=effects)


def test_parameters_are_quoted_where_the_misfit_is_least(beside):
    found = converge(beside, 0, KINDS)
    assert found.last.cost < beside.last.cost - 0.1
    told = found.effects[0].numbers["k3_n_per_m3"]
    at = found.last.plant.parameters.index(NAME)
    assert told.value == found.last.values[at] != beside.last.values[at]
    again = converge(found, 0, KINDS)
    assert np.abs(again.last.free - found.last.free) == pytest.approx(0.0, abs=0.01 * told.sd)


@pytest.mark.parametrize(
    "changed",
    [{"final": True}, {"trials": ()}, {}],
    ids=["no law", "segments", "a wrong model"],
)
def test_only_a_model_that_explains_whole_records_is_fitted_to_the_end(beside, changed):
    found = dataclasses.replace(beside, **changed)
    if not changed:
        found = with_last(found, chi2_in_band=1.1 * WRONG_MODEL_CHI2)
    assert converge(found, 0, KINDS) is found


@pytest.mark.long
@pytest.mark.parametrize("late", [False, True])
def test_a_diagnosis_out_of_budget_is_not_fitted_to_the_end(trials, late):
    """What it says is as good as the search's own fit."""
    campaign = Campaign(description=ONE, trials=trials)
    (named,) = diagnose(campaign, kinds=KINDS, late=lambda: late).effects
    number = named.numbers["k3_n_per_m3"]
    least = refit(
        Plant.of(TRUTH, kinds=KINDS),
        trials,
        horizons=(1.0,),
        control=FitControl(to_convergence=True),
    )
    right = least.values[least.plant.parameters.index(NAME)]
    assert abs(number.value - right) < (0.5 if late else 0.01) * number.sd


RUBBING = Effect("coulomb", PLACE, {"friction_n": 0.25})
FRICTION = ("effect", 0, "friction_n")


@pytest.fixture(scope="module")
def rubbed():
    """Give records of dry friction, and a fit that ended two standard deviations beside."""
    known, rng = dataclasses.replace(ONE, effects=(RUBBING.entry(),)), np.random.default_rng(3)
    truth, records = Plant.of(known), []
    for _ in range(2):
        push = np.convolve(rng.standard_normal(1280), np.hanning(9), "same")[:, None]
        clean = truth.simulate(truth.values, push, RATE)
        seen = clean + 0.02 * clean.std(axis=0) * rng.standard_normal(clean.shape)
        records.append(Trial(inputs=push, outputs=seen, rate_hz=RATE))
    right = refit(truth, tuple(records))
    values = right.values.copy()
    at = right.prior.names.index(FRICTION)
    values[list(right.prior.index)] += 2 * right.covariance[:, at] / right.sd[at]
    left = simulated_chi2(truth, values, right.states, right.noise, tuple(records))
    return tuple(records), right, dataclasses.replace(right, values=values, cost=left)


@pytest.mark.long
def test_friction_goes_to_the_best_minimum_nearby_and_its_error_holds_their_scatter(rubbed):
    records, right, beside = rubbed
    found = converge_stick_slip(Hypothesis((beside,), records), 1, catalogue(), Monitor())
    best, at = found.last, right.prior.names.index(FRICTION)
    assert best.cost <= right.cost + 0.1
    assert abs(best.free[at] - RUBBING.parameters["friction_n"]) < 3 * best.sd[at]
    # How far the fit had ended from there counts among what is not known.
    off = beside.free[at] - best.free[at]
    assert best.sd[at] ** 2 > right.sd[at] ** 2 + 0.4 * off**2
    assert np.linalg.eigvalsh(best.covariance).min() > 0


@pytest.mark.parametrize("why", ["late", "final", "no friction"])
def test_friction_stays_where_it_ended_without_budget_or_law_or_friction(rubbed, beside, why):
    records, _, fit = rubbed
    found = Hypothesis((fit,), records, final=why == "final")
    if why == "no friction":
        found = beside
    monitor = Monitor(late=lambda: why == "late")
    same = converge_stick_slip(found, 1, catalogue(), monitor)
    assert np.array_equal(same.last.values, found.last.values)
    assert np.array_equal(same.last.covariance, found.last.covariance)


@pytest.mark.long
def test_friction_that_is_known_badly_stays_above_nothing(rubbed):
    records, right, _ = rubbed
    at = right.prior.names.index(FRICTION)
    faint = dataclasses.replace(right, covariance=right.covariance.copy())
    faint.covariance[at, at] = (0.6 * right.free[at]) ** 2
    found = converge_stick_slip(Hypothesis((faint,), records), 1, catalogue(), Monitor())
    assert found.last.free[at] > 0
    assert found.last.cost <= faint.cost
