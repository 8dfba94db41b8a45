"""Effects that later ones make needless are left out; the rest has the numbers of the whole."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import augmentation, refit
from slowtime.discrepancy.calibration.augmentation import refit_without
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement import elimination as pruning
from slowtime.discrepancy.refinement.elimination import eliminate
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
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
    return fits, [
        NamedEffect(e, KINDS[e.kind].family, {}, 0.95, (), "as named") for e in effects
    ]


@pytest.mark.parametrize("wrong_first", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_what_the_others_make_needless_is_left_out_wherever_it_stands(wrong_first):
    trials = trials_of(CUBIC)
    order = (LOSS, CUBIC) if wrong_first else (CUBIC, LOSS)
    before, said = chain_of(trials, *order)
    fits, answers = eliminate(before, said, trials, KINDS)
    assert [answer.effect.kind for answer in answers] == ["cubic_hardening"]
    assert [len(fit.plant.effects) for fit in fits] == [0, 1]
    k3 = answers[0].numbers["k3_n_per_m3"]
    assert abs(k3.value - 1e5) < 4 * k3.sd < 0.05 * k3.value


def test_samples_that_were_left_out_while_it_was_named_speak_for_no_effect():
    trials = trials_of(CUBIC)
    use = trials[0].used.copy()
    use[-60:] = False
    before, said = chain_of((dataclasses.replace(trials[0], use=use),), LOSS, CUBIC)
    _, answers = eliminate(before, said, trials, KINDS)
    assert [answer.effect.kind for answer in answers] == ["cubic_hardening"]


@pytest.mark.slow
def test_what_is_needed_stays_and_has_the_numbers_of_the_last_fit():
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
def test_what_is_left_begins_in_the_motion_that_the_whole_began_in(monkeypatch, number):
    """Each number of a state goes with its own, though what goes takes some with it."""
    effects = (
        Effect("bouc_wen", PLACE, {"kh_n_per_m": 20.0, "zy_m": 0.01, "n": 1.0}),
        CUBIC,
        Effect("extra_dof", Place("node", ONE.nodes[0].id),
               {"mass_kg": 0.1, "frequency_hz": 3.0, "damping_n_s_per_m": 0.1}),
        Effect("bouc_wen", PLACE, {"kh_n_per_m": 30.0, "zy_m": 0.02, "n": 1.0}),
    )  # fmt: skip

    def model(some):
        return Plant.of(dataclasses.replace(ONE, effects=tuple(e.entry() for e in some)))

    trials = trials_of(CUBIC)
    whole, rest = model(effects), model([e for i, e in enumerate(effects) if i != number])
    own = {name: 0.001 * (i + 1) for i, name in enumerate(whole.state_names)}
    fit = refit(model(()), trials)
    known = dataclasses.replace(
        fit, plant=whole, values=whole.values, states=(np.array(list(own.values())),)
    )
    begun = []

    def caught(plant, trials, **how):
        begun.extend(how["states"])
        assert plant.state_names == rest.state_names
        raise FloatingPointError

    monkeypatch.setattr(augmentation, "refit", caught)
    assert refit_without(known, number, trials, KINDS) is None
    # By what each is of: those that come later are counted one less.
    told = dict(zip(rest.state_names, begun[0].tolist(), strict=True))
    for (what, name), value in own.items():
        head, _, tail = name.partition(" ")
        at = tail.partition(".")[0]
        if not at.isdigit():
            assert told[what, name] == value
        elif int(at) != number:
            later = int(at) - (int(at) > number)
            assert told[what, name.replace(f"{head} {at}.", f"{head} {later}.")] == value


@pytest.mark.parametrize(("faint", "kept"), [(True, 1), (False, 2)])
def test_a_law_that_does_next_to_nothing_is_left_out_though_a_fit_without_is_lost(
    monkeypatch, faint, kept
):
    """What tips over goes another way for a thousandth of its mass."""
    trials = trials_of(CUBIC)
    fits, said = chain_of(trials, CUBIC, LOSS)
    alone = fits[1]
    values = alone.values.copy()
    values[-1] *= 0.3
    lost = dataclasses.replace(alone, values=values, cost=1e9, chi2_in_band=50.0)
    monkeypatch.setattr(pruning, "refit_without", lambda _, which, *__: lost if which else None)
    monkeypatch.setattr(pruning, "sds_of_strength", lambda *_: 0.2 if faint else 20.0)
    chain, answers = eliminate(fits, said, trials, KINDS)
    assert len(answers) == kept
    if faint:
        assert answers[0].effect.kind == "cubic_hardening"
        assert chain[-1].chi2_in_band < 1.2
