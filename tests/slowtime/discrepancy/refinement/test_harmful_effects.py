"""What explains nothing and leads astray is left out; a gap is of what was not fitted."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.diagnose import _prune
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.refinement.harmful_effects import drop_harmful_effects
from slowtime.discrepancy.state import Found
from slowtime.discrepancy.validation.free_run import free_runs, refit_on_heads, relative_errors
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import ONE, PLACE

RATE = 40.0
BEFORE = object.__new__(Localization)
LOSS = Effect("stiffness_loss", PLACE, {"dk_n_per_m": 200.0})


def recorded(seed):
    rng = np.random.default_rng(seed)
    push = rng.standard_normal((400, 1))
    plant = Plant.of(ONE)
    seen = plant.simulate(plant.values, push, RATE) + 1e-5 * rng.standard_normal((400, 1))
    return Trial(inputs=push, outputs=seen, rate_hz=RATE)


@pytest.fixture(scope="module")
def found():
    """A model as it was refitted, and with a loss of stiffness that never was."""
    trials = (recorded(1),)
    first = refit(Plant.of(ONE), trials)
    lost = Plant.of(dataclasses.replace(ONE, effects=(LOSS.entry(),)))
    values = np.append(first.values, 200.0)
    wrong = dataclasses.replace(first, plant=lost, values=values, chi2_in_band=50.0)
    answer = NamedEffect(LOSS, "linear stiffness", {}, 1.0, (), "")
    return Found([first, wrong], trials, located=BEFORE, answers=[answer])


def held_out(found):
    return Campaign(description=ONE, trials=found.trials, holdout=(recorded(2),))


def test_an_effect_that_explains_nothing_and_leads_astray_is_left_out(found):
    less = dataclasses.replace(found, fits=list(found.fits), answers=list(found.answers))
    drop_harmful_effects(less, held_out(found))
    assert (len(less.fits), less.answers, less.left) == (1, [], BEFORE)


def test_what_explains_the_records_stays_whatever_it_does_elsewhere(found):
    whole = dataclasses.replace(found.fits[1], chi2_in_band=1.0)
    kept = dataclasses.replace(found, fits=[found.fits[0], whole], answers=list(found.answers))
    drop_harmful_effects(kept, held_out(found))
    assert len(kept.fits) == 2


@pytest.mark.parametrize("rms", [0.3, 0.0])
def test_a_base_that_nobody_measured_stays_named_and_constants_are_as_given(found, rms):
    base = Effect("base_motion", Place("base", "base"), {"rms_m_per_s2": rms})
    bent = dataclasses.replace(
        found.fits[0], values=1.3 * found.fits[0].values, chi2_in_band=50.0
    )
    answer = NamedEffect(base, "base motion", {}, 1.0, (), "")
    fits = [bent, carry_effect(bent, base, catalogue())]
    told = Found(fits, found.trials, located=BEFORE, answers=[answer])
    drop_harmful_effects(told, held_out(found))
    assert told.answers == [answer]
    plain = told.fits[0].plant
    np.testing.assert_array_equal(told.fits[0].values, plain.values)
    np.testing.assert_array_equal(told.fits[1].values[: len(plain.values)], plain.values)


LAST = Effect("sensor_drift", Place("sensor", ONE.sensors[0].channel), {"drift_total": 0.0})


@pytest.mark.long
@pytest.mark.parametrize("behind", [False, True])
def test_a_drift_that_is_a_word_only_stays_alone_and_goes_with_what_leads_astray(found, behind):
    """No answer is left without a fit, nor an end to the search without what ended it."""
    answer = NamedEffect(LAST, "sensor", {}, 1.0, (), "")
    bent = dataclasses.replace(
        found.fits[0], values=1.3 * found.fits[0].values, chi2_in_band=50.0
    )
    fits = [bent, *found.fits[1:]] if behind else [bent]
    answers = [*found.answers, answer] if behind else [answer]
    fits = [*fits, carry_effect(fits[-1], LAST, catalogue())]
    told = Found(fits, found.trials, located=BEFORE, answers=answers, ended=True)
    drop_harmful_effects(told, held_out(found))
    assert told.answers == ([] if behind else [answer])
    assert told.ended is not behind
    assert len(told.fits) == 1 + len(told.answers)
    plain = told.fits[0].plant
    for fit in told.fits:
        np.testing.assert_array_equal(fit.values[: len(plain.values)], plain.values)
    _prune(told, found.trials, catalogue())
    assert len(told.fits) == 1 + len(told.answers)


def test_tails_are_judged_by_numbers_that_never_saw_them(found):
    trial = found.trials[0]
    spoilt = trial.outputs.copy()
    spoilt[300:] *= 1.5
    spoilt = dataclasses.replace(trial, outputs=spoilt)
    first = found.fits[0]
    told, same = refit_on_heads(first, (spoilt,)), refit_on_heads(first, (trial,))
    np.testing.assert_array_equal(told.values, same.values)
    assert refit(first.plant, (spoilt,)).values[0] != pytest.approx(same.values[0], rel=1e-6)


@pytest.mark.parametrize("held", [False, True])
def test_constants_that_would_run_away_end_no_diagnosis(found, held):
    """As dampers do that have made up for a law: only with it they stand."""
    first, trial = found.fits[0], recorded(3)
    size = 100.0 * ONE.nodes[0].mass_kg
    more = Effect("viscous_damping", PLACE, {"dc_n_s_per_m": size}).entry()
    plant = Plant.of(dataclasses.replace(ONE, effects=(more,) if held else ()))
    values = plant.values
    at = plant.parameters.index(("damping", PLACE.id))
    values[at] -= size
    (run,) = free_runs(dataclasses.replace(first, plant=plant, values=values), (trial,))
    assert np.isfinite(run).all() == held
    error = float(relative_errors((trial,), [run])[0])
    assert error < 0.01 if held else error == 1e6
