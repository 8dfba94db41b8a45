"""A fitted candidate is accepted as an effect if it is worth its parameters."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import cut_segments, refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.candidates.constant_equivalents import is_single_changed_constant
from slowtime.discrepancy.estimation.input_hold import NOTICEABLE_POWER
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.search import SearchSettings
from slowtime.discrepancy.search.next_effect import accept_best
from slowtime.discrepancy.selection.acceptance import (
    MAX_SECOND_REST,
    MIN_NESTED_GAIN,
    Criteria,
    accept,
    end_with,
)
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import fit_effect, named_effect
from tests.slowtime.discrepancy.two_mass_chain import CUBIC, FIRST, SECOND, TWO, records_of

KINDS = catalogue()
PLAIN = Criteria(stated=None, pulled=False)
LOSS = Effect("stiffness_loss", SECOND, {"dk_n_per_m": 250.0})
HARD, LEVEL, SKEW = (
    Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 2e4}),
    Effect("saturating_stiffness", SECOND, {"ks_n_per_m": 100.0, "es_m": 0.01}),
    Effect("quadratic_damping", SECOND, {"c2_n_s2_per_m2": 3.0}),
)


@pytest.fixture(scope="module")
def white():
    """Records of which nothing is missing, and their fit."""
    trials = records_of(())
    return trials, refit(Plant.of(TWO), trials)


@pytest.fixture(scope="module")
def hardened():
    """Records of a spring that hardens, the fit without, and with it."""
    trials = records_of((CUBIC,))
    first = refit(Plant.of(TWO), trials)
    return trials, first, fit_effect(first, CUBIC, trials, KINDS)


@pytest.fixture(scope="module")
def lossy():
    """Records of a spring that hardens and is softer than claimed; the fits after each."""
    trials = records_of((HARD, LOSS))
    first = refit(Plant.of(TWO), trials)
    hard = fit_effect(first, HARD, trials, KINDS)
    found = Hypothesis((first, hard.fit), trials, effects=(named_effect(HARD, KINDS),))
    return found, fit_effect(hard.fit, LOSS, trials, KINDS)


def pulled(fit, **by):
    """Let constants of the elements be off by so many tolerances, and no others."""
    values = fit.values.copy()
    for name, mean, sd in zip(fit.prior.names, fit.prior.mean, fit.prior.sd, strict=True):
        key = "_".join(str(part) for part in name)
        values[fit.plant.parameters.index(name)] = mean + by.get(key, 0.0) * sd
    return dataclasses.replace(fit, values=values)


def of(fit, element, off):
    return pulled(fit, **{f"stiffness_{element.id}": off})


def test_one_constant_that_is_far_off_by_itself_is_an_effect(white):
    _, fit = white
    far, near = LIMITS.alone_tolerances + 0.1, LIMITS.alone_tolerances - 0.1
    assert is_single_changed_constant(of(fit, SECOND, far), LOSS)
    assert is_single_changed_constant(of(fit, SECOND, -far), LOSS)
    assert not is_single_changed_constant(of(fit, SECOND, near), LOSS)
    assert not is_single_changed_constant(of(fit, FIRST, far), LOSS)
    assert not is_single_changed_constant(of(fit, SECOND, far), CUBIC)
    two = {
        f"stiffness_{FIRST.id}": LIMITS.moved_tolerances + 0.1,
        f"stiffness_{SECOND.id}": far,
    }
    assert not is_single_changed_constant(pulled(fit, **two), LOSS)


def test_an_accepted_candidate_is_the_last_effect_of_a_new_hypothesis(hardened):
    trials, first, fitted = hardened
    found = Hypothesis((first,), trials)
    step = accept(found, first, [fitted], trials, KINDS, PLAIN)
    assert step.added == 1
    assert step.drift is None
    assert step.hypothesis.fits == (first, fitted.fit)
    (named,) = step.hypothesis.effects
    assert (named.effect.kind, named.effect.place) == (CUBIC.kind, CUBIC.place)
    assert (found.fits, found.effects) == ((first,), ())
    refused = accept(found, first, [], trials, KINDS, PLAIN)
    assert refused.added == 0
    assert refused.hypothesis is found


def test_an_effect_without_a_law_ends_the_search(hardened):
    trials, first, _ = hardened
    drift = Effect("sensor_drift", Place("sensor", "v_m2"), {"drift_total": 0.3})
    still = dataclasses.replace(drift, parameters={"drift_total": 0.0})
    found = Hypothesis((first,), trials)
    step = end_with(found, first, named_effect(drift, KINDS), KINDS, still)
    assert step.added == 0
    assert step.hypothesis.final
    assert step.hypothesis.effects[0].effect == drift
    # In the model it is there without any strength, so that its free run is as it was.
    assert step.hypothesis.last.values[-1] != 0.3
    assert len(step.hypothesis.last.plant.effects) == 1


def test_a_constant_far_off_is_accepted_beside_a_law_that_leaves_something_there(lossy):
    found, loss = lossy
    loud = dataclasses.replace(loss, fit=dataclasses.replace(loss.fit, chi2_in_band=2.0))
    terms = Criteria(stated=None, pulled=bool(moved_of(found.last)), same_place=True)
    assert accept(found, found.last, [loud], found.trials, KINDS, terms).added == 1


@pytest.mark.parametrize("off", [True, False])
def test_a_constant_is_refused_beside_a_rival_that_needs_it_no_more(lossy, off):
    found, loss = lossy
    before, trials = found.last, found.trials
    assert is_single_changed_constant(before, LOSS)
    drag = Effect("quadratic_damping", FIRST, {"c2_n_s2_per_m2": 0.1})
    carried = carry_effect(before, drag, KINDS)
    at = carried.plant.parameters.index(("stiffness", SECOND.id))
    values = carried.values.copy()
    values[at] = before.values[at] if off else carried.plant.values[at]
    fit = dataclasses.replace(loss.fit, plant=carried.plant, values=values,
                              prior=carried.prior, covariance=carried.covariance)  # fmt: skip
    rival = FittedCandidate(drag, carried.plant.description, fit, loss.score)
    terms = Criteria(stated=None, pulled=True)
    step = accept(found, before, [loss, rival], trials, KINDS, terms)
    # A rival that leaves the constant as far off is no other answer.
    assert step.added == off


def accept_beside_hardening(white, effect, first_chi2, last_chi2, left):
    """Offer a second law at a place, whose fit leaves a mean square in band."""
    trials, fit = white
    first, last = (
        dataclasses.replace(fit, chi2_in_band=one) for one in (first_chi2, last_chi2)
    )
    found = Hypothesis((first, last), trials, effects=(named_effect(HARD, KINDS),))
    carried = carry_effect(last, effect, KINDS)
    best = dataclasses.replace(carried, chi2_in_band=left, cost=-1e6)
    offered = FittedCandidate(effect, carried.plant.description, best, 1e6)
    terms = Criteria(stated=None, pulled=False, same_place=True)
    return accept(found, last, [offered], trials, KINDS, terms).added == 1


@pytest.mark.parametrize(
    ("effect", "left", "taken"),
    [
        (SKEW, 0.9 * MAX_SECOND_REST, True),
        (SKEW, 1.1 * MAX_SECOND_REST, False),
        (LEVEL, 0.9 * MAX_SECOND_REST, False),  # another curve over the same elongation
    ],
)
def test_a_second_law_at_a_place_has_to_take_most_of_what_is_left_there(
    white, effect, left, taken
):
    assert accept_beside_hardening(white, effect, 1e3, 101.0, 1 + 100 * left) is taken


def test_hardly_anything_left_is_no_reason_for_a_second_law_at_a_place(white):
    assert not accept_beside_hardening(white, SKEW, 1e6, 91.0, 3.0)


def test_out_of_budget_a_candidate_is_compared_with_the_last_fit_as_it_is(lossy):
    found, loss = lossy

    def accepted(over):
        terms = Criteria(stated=(), pulled=True, asked=(), over=over)
        return accept(found, found.last, [loss], found.trials, KINDS, terms).hypothesis

    in_time, late = accepted(bool), accepted(lambda: True)
    assert [one.effect for one in late.effects] == [one.effect for one in in_time.effects]
    np.testing.assert_array_equal(late.last.values, in_time.last.values)


@pytest.mark.parametrize("later", [False, True])
def test_out_of_budget_the_best_candidate_is_accepted_and_not_refined(lossy, hardened, later):
    if later:
        found, fitted = lossy
    else:
        trials, first, fitted = hardened
        found = Hypothesis((first,), trials)
    how = SearchSettings(KINDS, Monitor(over=lambda: True))
    step = accept_best(found, found.last, [fitted], how, pulled=later)
    assert step.added == 1
    assert step.hypothesis.last is fitted.fit


@pytest.mark.long
@pytest.mark.parametrize(("k3", "told"), [(20.0, True), (5.0, False)])
def test_a_faint_law_after_which_only_noise_is_left_is_accepted_beside_a_loud_fault(k3, told):
    """Louder noise would be left by any law."""
    wrong = Effect("sensor_gain", Place("sensor", "x_m1"), {"gain": 0.96})
    faint = Effect("cubic_hardening", SECOND, {"k3_n_per_m3": k3})
    trials = records_of((wrong, faint), samples=2000)
    first = refit(Plant.of(TWO), trials)
    gain = fit_effect(first, wrong, trials, KINDS)
    law = fit_effect(gain.fit, faint, trials, KINDS)
    assert gain.fit.cost - law.fit.cost < NOTICEABLE_POWER * gain.fit.data
    found = Hypothesis((first, gain.fit), trials, effects=(named_effect(wrong, KINDS),))
    assert accept(found, gain.fit, [law], trials, KINDS, PLAIN).added == told
    same = dataclasses.replace(PLAIN, same_place=True)
    assert accept(found, gain.fit, [law], trials, KINDS, same).added == 0


@pytest.mark.parametrize(("beside", "taken"), [(0.0, True), (1e9, False)])
def test_a_later_effect_that_explains_next_to_nothing_of_what_was_missing_is_refused(
    hardened, beside, taken
):
    """It is a flaw of what was found first."""
    trials, first, fitted = hardened
    gained = first.cost - fitted.fit.cost
    # So much was missing from the model as given that this is a share of it, or next to none.
    loud = tuple(np.sqrt(1 + beside * gained / first.cost) * one for one in first.residual)
    given = dataclasses.replace(first, residual=loud)
    found = Hypothesis((given, first), trials, effects=(named_effect(HARD, KINDS),))
    step = accept(found, first, [fitted], trials, KINDS, PLAIN)
    assert step.added == taken
    assert len(step.hypothesis.effects) == 1 + taken


@pytest.mark.parametrize(
    ("gained", "taken"),
    [
        (0.5 * MIN_NESTED_GAIN, "coulomb"),
        (1.1 * MIN_NESTED_GAIN, "stribeck"),
        (0.5, "stribeck"),
    ],
)
def test_a_law_that_explains_next_to_nothing_beyond_its_limit_is_taken_for_that(
    white, gained, taken
):
    trials, fit = white
    loud = tuple(40.0 * one for one in fit.residual)
    values = fit.values * 1.02  # the model that is compared leaves much
    before = dataclasses.replace(fit, values=values, residual=loud)
    bare = refit(before.plant, trials, noise=fit.noise, values=values, states=fit.states,
                 horizons=(1.0,))  # fmt: skip
    missing = bare.cost - bare.data
    offered = []
    for kind, cost in (("stribeck", 0.0), ("coulomb", gained * abs(missing))):
        carried = carry_effect(fit, Effect(kind, SECOND, dict.fromkeys(KINDS[kind].names, 1.0)),
                               KINDS)  # fmt: skip
        made = dataclasses.replace(carried, cost=cost - 1e4)
        offered.append(
            FittedCandidate(carried.plant.effects[-1], carried.plant.description, made,
                            1e4 - cost)
        )  # fmt: skip
    step = accept(Hypothesis((before,), trials), before, offered, trials, KINDS, PLAIN)
    assert step.hypothesis.effects[0].effect.kind == taken


@pytest.mark.long
def test_no_hold_of_the_inputs_is_suggested_by_segments(hardened):
    trials, first, fitted = hardened
    cut, _ = cut_segments(first.plant, trials)
    whole = refit(fitted.fit.plant, cut, values=fitted.fit.values, horizons=(1.0,))
    law = dataclasses.replace(fitted, fit=whole)
    before = refit(first.plant, cut, values=first.values, horizons=(1.0,))
    terms = Criteria(stated=(None,), pulled=False, asked=())
    step = accept(Hypothesis((first,), cut), before, [law], cut, KINDS, terms)
    assert step.added == 1
    assert step.hypothesis.holds is None
    assert step.hypothesis.suggested_holds is None
