"""A law that was put beside the right place is found there once the others are in."""

import dataclasses

import pytest

from slowtime.discrepancy.calibration import FitAbandoned, refit
from slowtime.discrepancy.candidates.library_fit import Candidate
from slowtime.discrepancy.diagnosis import Rival
from slowtime.discrepancy.estimation.candidate_fit import fit_candidates
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.refinement import relocation as misplaced
from slowtime.discrepancy.refinement.relocation import relocate
from slowtime.discrepancy.selection.probabilities import answer_of
from slowtime.discrepancy.state import Found
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.test_search import FIRST, SECOND, TWO, seen

KINDS = catalogue()
DRAG = Effect("quadratic_damping", FIRST, {"c2_n_s2_per_m2": 30.0})
NODES = [Place("node", node.id) for node in TWO.nodes]
TRUE = {
    "curve": Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 8e4}),
    "jump": Effect("stiffness_jump", SECOND, {"dk_n_per_m": 150.0, "t_jump_s": 4.1}),
    "rider": Effect(
        "extra_dof", NODES[1], {"mass_kg": 0.2, "frequency_hz": 3.1, "damping_n_s_per_m": 0.2}
    ),
}
OTHER = {"curve": FIRST, "jump": FIRST, "rider": NODES[0]}


def accounted(trials, *effects):
    """Give an account of effects, each fitted beside those before it."""
    fits, answers = [refit(Plant.of(TWO, kinds=KINDS), trials)], []
    for effect in effects:
        label = Candidate(effect, 0.0, 0.0, 0.0)
        (named,) = fit_candidates(fits[-1], [label], trials, KINDS, lambda *_: False)
        fits.append(named.fit)
        answers.append(answer_of([named], [1.0], KINDS))
    return Found(fits, trials, answers=answers)


@pytest.mark.long
@pytest.mark.parametrize("first", [True, False], ids=["first", "last"])
@pytest.mark.parametrize("name", ["jump", "curve", "rider"])
def test_it_goes_to_where_it_leaves_least(first, name):
    true = TRUE[name]
    # Beside less noise, which minimum the wrong law is fitted into hangs on the last digit.
    trials = seen((true, DRAG), samples=600, noise=0.05)
    wrong = dataclasses.replace(true, place=OTHER[name])
    found = accounted(trials, *((wrong, DRAG) if first else (DRAG, wrong)))
    before = found.fits[-1].chi2_in_band
    assert relocate(found, KINDS, Monitor())
    told = {answer.effect.kind: answer for answer in found.answers}
    assert told[true.kind].effect.place == true.place
    assert told["quadratic_damping"].effect.place == FIRST
    assert found.fits[-1].chi2_in_band < 1.2 < before
    for number, value in true.parameters.items():
        assert told[true.kind].numbers[number].value == pytest.approx(value, rel=0.1)
    assert [len(fit.plant.effects) for fit in found.fits] == [0, 1, 2]
    assert str(true.place) in told[true.kind].sentence


@pytest.mark.long
def test_what_is_where_it_belongs_stays():
    found = accounted(seen((TRUE["curve"], DRAG)), TRUE["curve"], DRAG)
    fits = list(found.fits)
    assert not relocate(found, KINDS, Monitor())
    assert found.fits == fits


@pytest.mark.long
def test_one_law_alone_is_not_asked_and_nor_is_what_ended_or_comes_too_late():
    wrong = dataclasses.replace(TRUE["curve"], place=FIRST)
    found = accounted(seen((TRUE["curve"], DRAG)), wrong, DRAG)
    one = dataclasses.replace(found, fits=found.fits[:2], answers=found.answers[:1])
    assert not relocate(one, KINDS, Monitor())
    assert not relocate(dataclasses.replace(found, ended=True), KINDS, Monitor())
    assert not relocate(dataclasses.replace(found, unheard=True), KINDS, Monitor())
    late = dataclasses.replace(found)
    assert not relocate(late, KINDS, Monitor(over=lambda: True))
    assert late.hurried


@pytest.mark.long
def test_at_another_place_a_law_is_begun_with_as_strong_as_it_comes_nearest(monkeypatch):
    """An element that moves less needs more of it; the motion tells before any fit."""
    trials = seen((TRUE["jump"], DRAG), samples=600)
    found = accounted(trials, DRAG, TRUE["jump"])
    right = found.fits[-1]
    values = right.values.copy()
    strength = ("effect", 1, "dk_n_per_m")
    values[right.plant.parameters.index(strength)] = 150.0 / 4
    (drag, jump), model = right.plant.description.effects, right.plant.description
    wrong = dataclasses.replace(model, effects=(drag, {**jump, "element": FIRST.id}))
    plant = Plant.of(wrong, kinds=KINDS)
    found.fits[-1] = dataclasses.replace(right, plant=plant, values=values)
    found.answers[1] = dataclasses.replace(
        found.answers[1], effect=dataclasses.replace(TRUE["jump"], place=FIRST)
    )
    begun = {}

    def fitted(plant, *_, values, **__):
        numbers = dict(zip(plant.parameters, values.tolist(), strict=True))
        begun[plant.effects[0].place, plant.effects[1].place] = numbers[strength]
        raise FitAbandoned

    monkeypatch.setattr(misplaced, "refit", fitted)
    assert not relocate(found, KINDS, Monitor())
    assert begun[FIRST, SECOND] == pytest.approx(150.0, rel=1e-6)


@pytest.mark.long
def test_a_better_instant_is_looked_for_there_too(monkeypatch):
    found = accounted(seen((TRUE["jump"], DRAG)), TRUE["jump"], DRAG)
    asked = []

    def better(fit, trials, kinds, beat, most, which):
        asked.append(which)
        right = fit.plant.effects[which].kind == "stiffness_jump"
        return dataclasses.replace(fit, cost=0.0) if right else fit

    monkeypatch.setattr(misplaced, "refit", lambda plant, *_, **__: right_at(plant, found))
    monkeypatch.setattr(misplaced, "refine_switching_instant", better)
    monkeypatch.setattr(misplaced, "left_out", lambda chain, number, less, *_: [less, less])
    assert relocate(found, KINDS, Monitor())
    assert found.answers[0].effect.place == FIRST
    assert set(asked) == {0, 1}


def right_at(plant, found):
    """A fit of the same numbers and cost by another plant."""
    return dataclasses.replace(found.fits[-1], plant=plant)


@pytest.mark.long
def test_what_was_doubted_of_the_place_that_a_law_had_is_doubted_no_more():
    true = TRUE["curve"]
    trials = seen((true, DRAG), samples=600)
    found = accounted(trials, dataclasses.replace(true, place=FIRST), DRAG)
    rival, other = (Rival(true.kind, place, 0.3) for place in (SECOND, FIRST))
    curve, drag = found.answers
    found.answers = [dataclasses.replace(curve, rivals=(rival,)), drag]
    found.undecided = (other, rival)
    assert relocate(found, KINDS, Monitor())
    assert found.answers[0].rivals == ()
    assert found.undecided == ()
