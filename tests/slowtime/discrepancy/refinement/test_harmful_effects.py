"""Effects that explain nothing and lead astray are dropped; gaps are of what was not fitted."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.refinement.elimination import eliminate_needless
from slowtime.discrepancy.refinement.harmful_effects import drop_harmful_effects
from slowtime.discrepancy.validation.free_run import free_runs, refit_on_heads, relative_errors
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import named_effect, with_last
from tests.slowtime.discrepancy.rigs import ONE, PLACE

KINDS = catalogue()
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
    return Hypothesis(
        (first, wrong), trials, effects=(named_effect(LOSS, KINDS),), localized=BEFORE
    )


def held_out(found):
    return Campaign(description=ONE, trials=found.trials, holdout=(recorded(2),))


def test_an_effect_that_explains_nothing_and_leads_astray_is_dropped(found):
    less = drop_harmful_effects(found, held_out(found))
    assert less.fits == found.fits[:1]
    assert less.effects == ()
    assert less.rest is BEFORE
    assert drop_harmful_effects(less, held_out(found)).fits == less.fits


def test_an_effect_that_explains_the_records_stays_whatever_it_does_elsewhere(found):
    whole = with_last(found, chi2_in_band=1.0)
    assert drop_harmful_effects(whole, held_out(found)) is whole


@pytest.mark.parametrize("rms", [0.3, 0.0])
def test_a_base_that_nobody_measured_stays_named_and_constants_are_as_given(found, rms):
    base = Effect("base_motion", Place("base", "base"), {"rms_m_per_s2": rms})
    answer = named_effect(base, KINDS)
    bent = bent_constants(found.first)
    moved = Hypothesis(
        (bent, carry_effect(bent, base, KINDS)),
        found.trials,
        effects=(answer,),
        localized=BEFORE,
    )
    moved = drop_harmful_effects(moved, held_out(found))
    assert moved.effects == (answer,)
    assert_constants_as_given(moved)


def bent_constants(fit):
    return dataclasses.replace(fit, values=1.3 * fit.values, chi2_in_band=50.0)


def assert_constants_as_given(found):
    plain = found.first.plant
    for fit in found.fits:
        np.testing.assert_array_equal(fit.values[: len(plain.values)], plain.values)


DRIFT = Effect("sensor_drift", Place("sensor", ONE.sensors[0].channel), {"drift_total": 0.0})


def test_a_drift_without_a_law_stays_where_it_is_alone(found):
    bent, answer = bent_constants(found.first), named_effect(DRIFT, KINDS)
    told = Hypothesis(
        (bent, carry_effect(bent, DRIFT, KINDS)), found.trials,
        effects=(answer,), localized=BEFORE, final=True,
    )  # fmt: skip
    told = drop_harmful_effects(told, held_out(found))
    assert told.final
    assert told.effects == (answer,)
    assert len(told.fits) == 2
    assert_constants_as_given(told)
    assert eliminate_needless(told, told.trials, KINDS).effects == told.effects


def test_a_drift_without_a_law_is_dropped_with_the_harmful_effect_it_was_added_to(found):
    """No effect is left without a fit, nor the search's end without what ended it."""
    bent, wrong = bent_constants(found.first), found.last
    told = Hypothesis(
        (bent, wrong, carry_effect(wrong, DRIFT, KINDS)), found.trials,
        effects=(*found.effects, named_effect(DRIFT, KINDS)), localized=BEFORE, final=True,
    )  # fmt: skip
    told = drop_harmful_effects(told, held_out(found))
    assert not told.final
    assert told.effects == ()
    assert len(told.fits) == 1
    assert_constants_as_given(told)
    assert eliminate_needless(told, told.trials, KINDS).effects == ()


def test_ends_of_records_are_judged_by_parameters_fitted_to_their_beginnings(found):
    trial = found.trials[0]
    spoilt = trial.outputs.copy()
    spoilt[300:] *= 1.5
    spoilt = dataclasses.replace(trial, outputs=spoilt)
    first = found.first
    told, same = refit_on_heads(first, (spoilt,)), refit_on_heads(first, (trial,))
    np.testing.assert_array_equal(told.values, same.values)
    assert refit(first.plant, (spoilt,)).values[0] != pytest.approx(same.values[0], rel=1e-6)


@pytest.mark.parametrize("held", [False, True])
def test_a_free_run_that_diverges_has_a_bounded_error(found, held):
    """As dampers do that have made up for a law: only with it they stand."""
    first, trial = found.first, recorded(3)
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
