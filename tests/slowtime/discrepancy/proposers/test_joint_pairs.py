"""Two laws are fitted at once where each leaves much alone, and both leave nothing."""

import dataclasses

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import label_of, library_candidates
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers.joint_pairs import (
    JointPairs,
    label_of_pair,
    without_imitations,
)
from slowtime.dynamics.builders import chain
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered
from tests.slowtime.discrepancy.protocol import candidate, fitted_candidate, round_of
from tests.slowtime.discrepancy.two_mass_chain import (
    CUBIC,
    DRAG,
    KINDS,
    SECOND,
    TWO,
    records_of,
)

MORE = KINDS | {"gap_symmetric": catalogue()["gap_symmetric"]}
PLAY = Effect("gap_symmetric", SECOND, {"kg_n_per_m": 500.0, "gap_m": 0.01})
LAWS = {effect.kind: candidate(effect, 1.0, cost_without=1e9) for effect in (CUBIC, PLAY, DRAG)}
BOTH = (LAWS[CUBIC.kind], LAWS[DRAG.kind])
JOINT = JointPairs((None,), (None,))


def lacking_both(of=TWO, kinds=MORE):
    """Give a round of a model that lacks two laws."""
    trials = records_of((CUBIC, DRAG), of=of)
    first = refit(Plant.of(TWO, kinds=kinds), trials)
    before = refit_within_tolerances(first, trials)
    located = locate(before, trials)
    tried = library_candidates(before, located, kinds)
    given = round_of(before, trials, kinds, tried=tried, localized=located)
    hypothesis = dataclasses.replace(given.hypothesis, fits=(first,), localized=located)
    return dataclasses.replace(given, hypothesis=hypothesis)


@pytest.fixture(scope="module")
def lacking():
    return lacking_both()


def leaving(given, *effects, left):
    """Give the round with effects that were fitted and leave a mean square in band."""
    fitted = [
        fitted_candidate(one, carry_effect(given.before, one, MORE), chi2_in_band=left)
        for one in effects
    ]
    return dataclasses.replace(given, fitted=tuple(fitted))


def labels(pairs):
    return [label_of_pair(pair) for pair in pairs]


def test_no_pair_is_given_twice_whichever_of_it_comes_first(lacking):
    bare = dataclasses.replace(lacking.hypothesis.last, chi2_in_band=1e3)
    given = dataclasses.replace(
        lacking, hypothesis=dataclasses.replace(lacking.hypothesis, fits=(bare,))
    )
    twice = leaving(given, CUBIC, DRAG, CUBIC, left=20.0)
    first = labels(JOINT.of_round(twice, frozenset()))
    assert first
    assert len(set(first)) == len(first)
    assert label_of_pair(BOTH) in first
    assert label_of_pair(BOTH) == label_of_pair(BOTH[::-1])
    assert not set(labels(JOINT.of_round(twice, frozenset(first)))) & set(first)


def test_laws_that_each_explain_some_are_paired_unless_they_are_one_curve_in_pieces(lacking):
    def paired(bare):
        last = dataclasses.replace(lacking.hypothesis.last, chi2_in_band=bare)
        given = dataclasses.replace(
            lacking, tried=(), hypothesis=dataclasses.replace(lacking.hypothesis, fits=(last,))
        )
        pairs = JOINT.of_round(leaving(given, CUBIC, PLAY, DRAG, left=20.0), frozenset())
        return {frozenset(one.effect.kind for one in pair) for pair in pairs}

    told = paired(1e9)
    assert frozenset({"cubic_hardening", "gap_symmetric"}) not in told
    assert frozenset({"cubic_hardening", "quadratic_damping"}) in told
    # What explains next to nothing by itself is no half of anything.
    assert frozenset({"cubic_hardening", "quadratic_damping"}) not in paired(1.0)


def test_where_one_law_leaves_only_noise_no_pairs_are_looked_for(lacking):
    with metered() as meter:
        assert JOINT.of_round(leaving(lacking, CUBIC, left=1.1), frozenset()) == []
    assert meter.spent == 0


@pytest.mark.long
def test_a_pair_that_explains_all_is_a_step_of_two_effects(lacking):
    step = JOINT(lacking, [BOTH], lacking.before.chi2_in_band)
    assert step is not None
    assert step.added == 2
    found = step.hypothesis
    assert {label_of(one.effect) for one in found.effects} == {label_of(CUBIC), label_of(DRAG)}
    assert all(one.probability > 0.99 for one in found.effects)
    assert found.last.chi2_in_band < 1.2
    assert len(found.fits) == 3
    assert found.first is lacking.hypothesis.first
    assert lacking.hypothesis.effects == ()
    # Out of budget no pair is fitted.
    late = dataclasses.replace(lacking, monitor=Monitor(late=lambda: True))
    with metered() as meter:
        assert JOINT(late, [BOTH], lacking.before.chi2_in_band) is None
    assert meter.spent == 0


def test_a_pair_that_leaves_much_is_no_step(lacking):
    there = candidate(dataclasses.replace(DRAG, place=SECOND), 1.0, cost_without=1e9)
    assert JOINT(lacking, [(LAWS[DRAG.kind], there)], 1.0) is None
    assert JOINT(lacking, [], 1.0) is None


@pytest.mark.long
def test_two_laws_that_need_a_constant_that_is_off_are_no_answer():
    stiffer = chain([2.0, 1.5], [1150.0, 700.0], dampings_n_s_per_m=[1.6, 1.2])
    given = lacking_both(dataclasses.replace(TWO, elements=stiffer.elements))
    assert JOINT(given, [BOTH], given.before.chi2_in_band) is None


@pytest.mark.long
def test_a_law_that_switches_is_found_beside_another_from_an_instant_nearby():
    jump = Effect("stiffness_jump", SECOND, {"dk_n_per_m": 150.0, "t_jump_s": 4.1})
    kinds = KINDS | {"stiffness_jump": catalogue()["stiffness_jump"]}
    trials = records_of((CUBIC, jump))
    before = refit(Plant.of(TWO, kinds=kinds), trials)
    given = round_of(before, trials, kinds)
    early = dataclasses.replace(jump, parameters={"dk_n_per_m": 150.0, "t_jump_s": 4.0})
    pair = tuple(candidate(one, 1.0, cost_without=1e9) for one in (CUBIC, early))
    step = JOINT(given, [pair], before.chi2_in_band)
    assert step is not None
    told = step.hypothesis.effects[-1].effect
    assert told.parameters["t_jump_s"] == pytest.approx(4.1, abs=0.02)


@pytest.mark.parametrize(("gained", "kept"), [(0.0, 1), (5.0, 1), (50.0, 2)])
def test_a_pair_that_does_the_same_by_more_numbers_is_left_out(lacking, gained, kept):
    def pair(beside, cost):
        fit = dataclasses.replace(carry_effect(lacking.before, beside, MORE), cost=cost)
        return LAWS[DRAG.kind], fitted_candidate(beside, fit)

    simple, more = pair(CUBIC, 1000.0), pair(PLAY, 1000.0 - gained)
    assert len(without_imitations([more, simple], MORE)) == kept
    assert simple in without_imitations([more, simple], MORE)
