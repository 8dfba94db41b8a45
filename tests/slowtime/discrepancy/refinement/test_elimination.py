"""Backward elimination drops effects that later ones make needless, and quotes the rest."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import refit_without, states_without
from slowtime.discrepancy.diagnosis import Rival
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.elimination import eliminate, eliminate_needless
from slowtime.discrepancy.selection.acceptance import end_with
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import named_effect
from tests.slowtime.discrepancy.rigs import ONE, PLACE

RATE = 50.0
KINDS = catalogue()
CUBIC = Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 1e5})
DRAG = Effect("quadratic_damping", PLACE, {"c2_n_s2_per_m2": 4.0})
LOSS = Effect("stiffness_loss", PLACE, {"dk_n_per_m": 5.0})


def trials_of(*effects):
    rng = np.random.default_rng(5)
    push = np.convolve(rng.standard_normal(400), np.hanning(9), "same")[:, None] * 4.0
    truth = Plant.of(dataclasses.replace(ONE, effects=tuple(e.entry() for e in effects)))
    seen = truth.simulate(truth.values, push, RATE) + 2e-5 * rng.standard_normal((400, 1))
    return (Trial(inputs=push, outputs=seen, rate_hz=RATE),)


def chain_of(trials, *effects):
    """Fits after each effect, and what was said of each when it was named."""
    entries = [effect.entry() for effect in effects]
    fits = [
        refit(Plant.of(dataclasses.replace(ONE, effects=tuple(entries[:n]))), trials)
        for n in range(len(entries) + 1)
    ]
    return fits, [named_effect(effect, KINDS, 0.95) for effect in effects]


@pytest.mark.parametrize("wrong_first", [True, False])
def test_an_effect_that_others_make_needless_is_dropped_wherever_it_stands(wrong_first):
    trials = trials_of(CUBIC)
    order = (LOSS, CUBIC) if wrong_first else (CUBIC, LOSS)
    before, said = chain_of(trials, *order)
    fits, answers = eliminate(before, said, trials, KINDS)
    assert [answer.effect.kind for answer in answers] == ["cubic_hardening"]
    assert [len(fit.plant.effects) for fit in fits] == [0, 1]
    k3 = answers[0].numbers["k3_n_per_m3"]
    assert abs(k3.value - 1e5) < 4 * k3.sd < 0.05 * k3.value


def test_samples_masked_while_an_effect_was_named_do_not_speak_for_it():
    trials = trials_of(CUBIC)
    use = trials[0].used.copy()
    use[-60:] = False
    before, said = chain_of((dataclasses.replace(trials[0], use=use),), LOSS, CUBIC)
    _, answers = eliminate(before, said, trials, KINDS)
    assert [answer.effect.kind for answer in answers] == ["cubic_hardening"]


def test_needed_effects_stay_and_are_quoted_by_the_last_fit():
    trials = trials_of(CUBIC, DRAG)
    before, said = chain_of(trials, CUBIC, DRAG)
    fits, answers = eliminate(before, said, trials, KINDS)
    assert [answer.effect.kind for answer in answers] == [
        "cubic_hardening",
        "quadratic_damping",
    ]
    assert fits == before
    for answer, true in zip(answers, (CUBIC, DRAG), strict=True):
        for name, value in true.parameters.items():
            number = answer.numbers[name]
            assert abs(number.value - value) < 4 * number.sd
            assert answer.effect.parameters[name] == number.value
        assert answer.sentence != "as named"


def test_a_constant_that_is_far_off_by_itself_stays_an_effect_beside_another():
    """Though the fit with both is stuck a little above where the one without it has come."""
    lost = Effect("stiffness_loss", PLACE, {"dk_n_per_m": 200.0})
    trials = trials_of(CUBIC, lost)
    before, said = chain_of(trials, CUBIC, lost)
    before[-1] = dataclasses.replace(before[-1], cost=before[-1].cost + 200.0)
    _, answers = eliminate(before, said, trials, KINDS)
    assert [answer.effect.kind for answer in answers] == ["cubic_hardening", "stiffness_loss"]
    told = answers[1].numbers["dk_n_per_m"]
    assert abs(told.value - 200.0) < 4 * told.sd


def test_a_single_effect_is_left_as_it_is():
    trials = trials_of(CUBIC)
    before, said = chain_of(trials, CUBIC)
    assert eliminate(before, said, trials, KINDS) == (before, said)


@pytest.mark.parametrize("number", range(4))
def test_states_of_other_effects_stay_where_one_effect_and_its_own_states_go(number):
    effects = (
        Effect("bouc_wen", PLACE, {"kh_n_per_m": 20.0, "zy_m": 0.01, "n": 1.0}),
        CUBIC,
        Effect("extra_dof", Place("node", ONE.nodes[0].id),
               {"mass_kg": 0.1, "frequency_hz": 3.0, "damping_n_s_per_m": 0.1}),
        Effect("bouc_wen", PLACE, {"kh_n_per_m": 30.0, "zy_m": 0.02, "n": 1.0}),
    )  # fmt: skip

    def model(some):
        return Plant.of(dataclasses.replace(ONE, effects=tuple(e.entry() for e in some)))

    whole, rest = model(effects), model([e for i, e in enumerate(effects) if i != number])
    own = {name: 0.001 * (i + 1) for i, name in enumerate(whole.state_names)}
    fit = refit(model(()), trials_of(CUBIC))
    known = dataclasses.replace(
        fit, plant=whole, values=whole.values, states=(np.array(list(own.values())),)
    )
    (state,) = states_without(known, number)
    # By what each is of: those that come later are counted one less.
    told = dict(zip(rest.state_names, state.tolist(), strict=True))
    for (what, name), value in own.items():
        head, _, tail = name.partition(" ")
        at = tail.partition(".")[0]
        if not at.isdigit():
            assert told[what, name] == value
        elif int(at) != number:
            later = int(at) - (int(at) > number)
            assert told[what, name.replace(f"{head} {at}.", f"{head} {later}.")] == value


@pytest.mark.parametrize(("strength", "kept"), [(0.01, 1), (20.0, 2)], ids=["faint", "clear"])
def test_a_law_that_does_next_to_nothing_is_dropped_though_the_fit_without_it_is_stuck(
    strength, kept
):
    trials = trials_of(CUBIC)
    fits, said = chain_of(trials, CUBIC, LOSS)
    # A refit without the loss that begins at this stiffness ends in a minimum of its own.
    names = fits[-1].plant.parameters
    values = fits[-1].values.copy()
    values[names.index(("effect", 0, "k3_n_per_m3"))] *= 3.0
    at = fits[-1].prior.names.index(("effect", 1, "dk_n_per_m"))
    values[fits[-1].prior.index[at]] = strength * fits[-1].sd[at]
    fits[-1] = dataclasses.replace(fits[-1], values=values)
    less = refit_without(fits[-1], 1, trials, KINDS)
    assert less is not None
    assert less.chi2_in_band > 5.0
    chain, left = eliminate(fits, said, trials, KINDS)
    assert len(left) == kept
    if kept == 1:
        assert left[0].effect.kind == "cubic_hardening"
        assert chain[-1].chi2_in_band < 1.2


def test_a_hypothesis_of_needed_effects_alone_is_given_as_it_is():
    trials = trials_of(CUBIC)
    fits, said = chain_of(trials, CUBIC)
    found = Hypothesis(tuple(fits), trials, effects=tuple(said))
    same = eliminate_needless(found, trials, KINDS)
    assert (same.fits, same.effects) == (found.fits, found.effects)


DRIFT = Effect("sensor_drift", Place("sensor", ONE.sensors[0].channel), {"drift_total": 0.0})


def test_a_drift_without_a_law_stays_behind_the_law_it_was_found_beside():
    trials = trials_of(CUBIC)
    fits, said = chain_of(trials, CUBIC)
    found = Hypothesis(tuple(fits), trials, effects=tuple(said))
    drift = named_effect(DRIFT, KINDS)
    ended = end_with(found, found.last, drift, KINDS, DRIFT).hypothesis
    kept = eliminate_needless(ended, trials, KINDS)
    assert [one.effect.kind for one in kept.effects] == ["cubic_hardening", "sensor_drift"]
    assert [len(fit.plant.effects) for fit in kept.fits] == [0, 1, 2]


@pytest.mark.parametrize("sure", [0.6, 0.95])
def test_doubts_about_a_needless_effect_give_way_to_doubts_about_what_stays(sure):
    trials = trials_of(CUBIC)
    fits, (needless, stays) = chain_of(trials, LOSS, CUBIC)
    rivals = tuple(
        Rival(kind, CUBIC.place, share * (1 - sure))
        for kind, share in (("gap_symmetric", 0.97), ("bouc_wen", 0.03))
    )
    stays = dataclasses.replace(stays, probability=sure, rivals=rivals)
    undecided = (Rival(LOSS.kind, LOSS.place, 0.5), rivals[0])
    found = Hypothesis(tuple(fits), trials, effects=(needless, stays), undecided=undecided)
    left = eliminate_needless(found, trials, KINDS)
    assert [one.effect.kind for one in left.effects] == ["cubic_hardening"]
    told = [rival.effect for rival in left.undecided]
    assert told == (["cubic_hardening", "gap_symmetric"] if sure < 0.9 else [])
    assert found.undecided == undecided
