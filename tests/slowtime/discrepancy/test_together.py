"""Which laws are tried two by two, and what two of them are not an answer to."""

import dataclasses

import pytest

from slowtime.discrepancy import together
from slowtime.discrepancy.candidates import Candidate, label_of
from slowtime.discrepancy.found import Found
from slowtime.discrepancy.locate import locate
from slowtime.discrepancy.naming import refit_all
from slowtime.discrepancy.refit import refit
from slowtime.discrepancy.together import Together, of_refitted
from slowtime.discrepancy.unbent import unbent
from slowtime.discrepancy.watch import Watch
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
    before = unbent(first, trials)
    named = refit_all(before, LABELS, trials, MORE, lambda *_: False)
    found = Found([first], trials, located=locate(before, trials), named=tuple(named))
    return before, trials, found


def beginning(before, trials):
    return Together(before, trials, MORE, (None,), (None,), Watch())


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
    monkeypatch.setattr(together, "pairs", lambda *_: [(LABELS[0], LABELS[2])])
    monkeypatch.setattr(together, "moved_of", lambda _: moved)
    told = beginning(before, trials)(found)
    if moved:
        assert told is None
        return
    assert told is not None
    assert {label_of(a.effect) for a in told.answers} == {label_of(CUBIC), label_of(DRAG)}
    assert told.fits[-1].chi2_in_band < 1.2


def test_where_one_law_leaves_but_noise_none_are_tried_together(lacking, monkeypatch):
    before, trials, found = lacking
    best = found.named[0]
    quiet = dataclasses.replace(best, fit=dataclasses.replace(best.fit, chi2_in_band=1.1))
    monkeypatch.setattr(Together, "_pairs", lambda *_: pytest.fail("pairs were asked for"))
    assert beginning(before, trials)(dataclasses.replace(found, named=(quiet,))) is None
