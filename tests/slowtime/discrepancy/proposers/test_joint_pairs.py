"""Which laws are tried two by two, and what two of them are not an answer to."""

import dataclasses

import pytest
from slowtime.discrepancy.state import Found

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import simulated_chi2, with_effect
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import Candidate, label_of
from slowtime.discrepancy.estimation.candidate_fit import (
    FittedCandidate,
    fit_candidates,
    fitted_effect,
)
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers import joint_pairs as together
from slowtime.discrepancy.proposers.joint_pairs import NEAR, JointPairs, of_refitted
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.test_search import CUBIC, DRAG, KINDS, SECOND, TWO, seen

MORE = KINDS | {"gap_symmetric": catalogue()["gap_symmetric"]}
PLAY = Effect("gap_symmetric", SECOND, {"kg_n_per_m": 500.0, "gap_m": 0.01})
LABELS = [Candidate(effect, 1.0, 0.0, 1e9) for effect in (CUBIC, PLAY, DRAG)]


@pytest.fixture(scope="module")
def lacking():
    """A model without two laws; and what each of three labels leaves of it."""
    trials = seen((CUBIC, DRAG))
    first = refit(Plant.of(TWO, kinds=MORE), trials)
    before = refit_within_tolerances(first, trials)
    named = fit_candidates(before, LABELS, trials, MORE, lambda *_: False)
    found = Found([first], trials, located=locate(before, trials), named=tuple(named))
    return before, trials, found


def beginning(before, trials):
    return JointPairs(before, trials, MORE, (None,), (None,), Monitor())


@pytest.mark.long
def test_no_pair_is_tried_twice_whichever_comes_first(lacking):
    before, trials, _ = lacking
    one, other, third = LABELS
    new = beginning(before, trials)._new
    assert [*new([(one, other), (other, one), (one, third)])] == [(one, other), (one, third)]
    assert [*new([(third, one), (other, third)])] == [(other, third)]


def test_of_laws_that_each_explain_something_none_are_pieces_of_one_curve(lacking):
    _, _, found = lacking
    much = dataclasses.replace(found.fits[0], chi2_in_band=1e9)
    pairs = of_refitted(dataclasses.replace(found, fits=[much]), MORE)
    told = [frozenset(one.effect.kind for one in pair) for pair in pairs]
    assert frozenset({"cubic_hardening", "gap_symmetric"}) not in told
    assert frozenset({"cubic_hardening", "quadratic_damping"}) in told
    assert len(set(told)) == len(told)
    # What explains next to nothing by itself is no half of anything.
    none = dataclasses.replace(found.fits[0], chi2_in_band=0.0)
    assert not [*of_refitted(dataclasses.replace(found, fits=[none]), MORE)]


@pytest.mark.parametrize("moved", [{}, {("stiffness", "k1"): 5.0}], ids=["held", "bent"])
def test_two_that_need_a_constant_that_is_off_are_no_answer(lacking, monkeypatch, moved):
    before, trials, found = lacking
    monkeypatch.setattr(together, "law_pairs", lambda *_: [(LABELS[0], LABELS[2])])
    monkeypatch.setattr(together, "moved_of", lambda _: moved)
    told = beginning(before, trials)(found)
    if moved:
        assert told is None
        return
    assert told is not None
    assert {label_of(a.effect) for a in told.answers} == {label_of(CUBIC), label_of(DRAG)}
    assert told.fits[-1].chi2_in_band < 1.2


@pytest.mark.long
@pytest.mark.parametrize(("best", "on"), [(1e4, True), (30.0, False)])
def test_a_pair_that_is_near_is_fitted_on_from_where_it_was_given_up(monkeypatch, best, on):
    """A moment before the instant of its switch: it is right from there on."""
    jump = Effect("stiffness_jump", SECOND, {"dk_n_per_m": 150.0, "t_jump_s": 4.1})
    kinds = KINDS | {"stiffness_jump": catalogue()["stiffness_jump"]}
    trials = seen((CUBIC, jump))
    before = refit(Plant.of(TWO, kinds=kinds), trials)

    def given_up(before, effect, trials, kinds, noise, enough, **_):
        described = with_effect(before.plant.description, effect)
        right = refit(Plant.of(described, kinds=kinds), trials)
        values = right.values.copy()
        values[right.plant.parameters.index(("effect", 1, "t_jump_s"))] -= 0.1
        left = simulated_chi2(right.plant, values, right.states, right.noise, trials)
        fit = dataclasses.replace(right, values=values, cost=left, chi2_in_band=20.0)
        return FittedCandidate(effect, described, fit, -left / 2)

    monkeypatch.setattr(together, "fit_candidate", given_up)
    one, other = (Candidate(effect, 1.0, 0.0, 1e9) for effect in (CUBIC, jump))
    pairs = JointPairs(before, trials, kinds, (None,), (None,), Monitor())
    told = pairs._refitted(one, other, [], NEAR * best)
    assert told is not None
    assert (told.fit.chi2_in_band < 1.2) == on
    assert not on or fitted_effect(told).parameters["t_jump_s"] == pytest.approx(4.1, abs=0.02)


def test_where_one_law_leaves_but_noise_none_are_tried_together(lacking, monkeypatch):
    before, trials, found = lacking
    best = found.named[0]
    quiet = dataclasses.replace(best, fit=dataclasses.replace(best.fit, chi2_in_band=1.1))
    monkeypatch.setattr(JointPairs, "_pairs", lambda *_: pytest.fail("pairs were asked for"))
    assert beginning(before, trials)(dataclasses.replace(found, named=(quiet,))) is None
