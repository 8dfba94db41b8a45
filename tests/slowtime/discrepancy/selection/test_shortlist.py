"""What is told first, where more than one effect is missing."""

import dataclasses
from collections.abc import Sequence

import pytest

from slowtime.discrepancy import search as searching
from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.candidates.library_fit import Candidate, Label, label_of
from slowtime.discrepancy.estimation.candidate_fit import FittedCandidate, fit_candidates
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers.lower_ranked import LowerRanked
from slowtime.discrepancy.search import Search, search
from slowtime.discrepancy.selection.shortlist import begins, begun_with
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.test_search import CUBIC, DRAG, FIRST, KINDS, SECOND, TWO, seen


def test_what_explains_how_records_begin_and_nothing_of_the_rest_comes_before_no_other():
    trials = seen((CUBIC,))
    bent = refit(Plant.of(TWO, kinds=KINDS), trials)
    label = Candidate(CUBIC, 0.0, 0.0, 0.0)
    (best,) = fit_candidates(bent, [label], trials, KINDS, lambda *_: False)
    assert begins(best, label_of(CUBIC), bent)
    assert not begins(best, label_of(DRAG), bent)
    worse = dataclasses.replace(best.fit, chi2_in_band=2 * bent.chi2_in_band)
    assert not begins(dataclasses.replace(best, fit=worse), label_of(CUBIC), bent)


@pytest.mark.long
@pytest.mark.parametrize(
    ("at", "left", "leaves", "told"),
    [
        (SECOND, (30.0, 100.0), 20.0, True),
        (FIRST, (30.0, 100.0), 20.0, False),
        (SECOND, (30.0, 70.0), 20.0, False),
        (SECOND, (30.0, 100.0), 30.0, False),
        (SECOND, (2.9, 100.0), 20.0, False),
    ],
    ids=["stands out", "elsewhere", "another comes near", "leaves much", "alone"],
)
def test_what_stands_out_among_several_is_told_before_the_others(at, left, leaves, told):
    trials = seen((CUBIC,))
    fit = refit(Plant.of(TWO, kinds=KINDS), trials)
    before = dataclasses.replace(fit, chi2_in_band=100.0)
    located = locate(fit, trials)
    own = next(group for group in located.groups if SECOND in group.places)
    rest = [group for group in located.groups if group is not own]
    ranked = [dataclasses.replace(own, left=left[0])]
    ranked += [dataclasses.replace(group, left=left[1]) for group in rest]
    shown = dataclasses.replace(located, groups=tuple(ranked))
    effect = dataclasses.replace(CUBIC, place=at)
    named = [FittedCandidate(effect, TWO, dataclasses.replace(fit, chi2_in_band=leaves), 0.0)]
    assert begun_with(named, before, shown) is told
    assert not begun_with([], before, shown)


class Told:
    """Stands for what pieces of the records tell: nothing, or what it is given."""

    begins: Label | None = None
    whole: Sequence[Candidate] = ()

    def __init__(self, told):
        self.told = told

    def at_once(self):
        return []

    def __call__(self, found):
        return []


@pytest.mark.parametrize(
    ("stands_out", "told", "down"),
    [
        (True, [], False),
        (False, [], True),
        pytest.param(False, [1], False, marks=pytest.mark.long),
    ],
    ids=["stands out", "nothing tells", "pieces tell"],
)  # fmt: skip
def test_where_one_stands_out_no_law_is_tried_on_how_records_begin(
    monkeypatch, stands_out, told, down
):
    asked = []

    def looked(_, found):
        asked.append(found)
        return []

    monkeypatch.setattr(searching, "begun_with", lambda *_: stands_out)
    monkeypatch.setattr(searching, "SegmentCandidates", lambda *_: Told(told))
    monkeypatch.setattr(LowerRanked, "__call__", looked)
    trials = seen((CUBIC, DRAG), samples=250)
    search(refit(Plant.of(TWO, kinds=KINDS), trials), trials, Search(KINDS, Monitor()))
    assert bool(asked) is down


@pytest.mark.long
@pytest.mark.parametrize(
    ("left", "whole"),
    [(20.0, []), pytest.param(50.0, [label_of(DRAG)], marks=pytest.mark.long)],
)
def test_what_pieces_tell_comes_first_and_is_fitted_to_all_where_it_is_lost(
    monkeypatch, left, whole
):
    trials = seen((CUBIC, DRAG), samples=250)
    fit = refit(Plant.of(TWO, kinds=KINDS), trials)
    shown = [
        FittedCandidate(effect, TWO, dataclasses.replace(fit, chi2_in_band=chi2), 0.0)
        for effect, chi2 in ((CUBIC, left), (DRAG, 2 * left))
    ]
    fitted: list[Label] = []
    given: list[Label] = []

    class Pieced(Told):
        """Tells the one that leaves more of the whole."""

        begins = label_of(DRAG)

        def __init__(self, *_):
            super().__init__([Candidate(DRAG, 0.0, 0.0, 0.0)])
            self.whole = self.told

    def shot(before, labels, named, *_):
        fitted.extend(label_of(one.effect) for one in labels)
        return list(named)

    def accept(found, before, named, *_, **more):
        given.extend(label_of(one.effect) for one in named)
        return False

    monkeypatch.setattr(searching, "SegmentCandidates", Pieced)
    monkeypatch.setattr(searching, "shooting_fits", shot)
    monkeypatch.setattr(searching, "accept", accept)
    monkeypatch.setattr(searching, "release_constants", lambda *_: None)
    monkeypatch.setattr(searching, "fit_candidates", lambda *_, **more: shown)
    search(fit, trials, Search(KINDS, Monitor()))
    assert given[0] == label_of(DRAG)
    assert fitted == whole
