"""Which candidates are fitted, and when one of several effects is taken before the others."""

import dataclasses

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.candidates.library_fit import label_of
from slowtime.discrepancy.estimation.candidate_fit import MAX_CANDIDATES
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.search import SearchOptions, SearchSettings
from slowtime.discrepancy.search.next_effect import extend
from slowtime.discrepancy.selection.shortlist import (
    LATER_CANDIDATES,
    QUICK_CANDIDATES,
    SAME_PLACE_CANDIDATES,
    begins,
    begun_with,
    shortlist,
)
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import (
    StubProposer,
    candidate,
    fit_effect,
    fitted_candidate,
    named_effect,
)
from tests.slowtime.discrepancy.two_mass_chain import (
    CUBIC,
    DRAG,
    FIRST,
    KINDS,
    SECOND,
    TWO,
    records_of,
)


@pytest.fixture(scope="module")
def lacking():
    """Records of a spring that hardens, the fit without it, and where a force is missing."""
    trials = records_of((CUBIC,))
    fit = refit(Plant.of(TWO, kinds=KINDS), trials)
    return trials, fit, locate(fit, trials)


def ranked(located, *left):
    """Put the groups of a place that has a law first, then the others, by what they leave."""
    own = next(group for group in located.groups if SECOND in group.places)
    rest = [group for group in located.groups if group is not own]
    groups = [dataclasses.replace(own, left=left[0])]
    groups += [dataclasses.replace(group, left=left[1]) for group in rest]
    return dataclasses.replace(located, groups=tuple(groups))


SIMILAR = [
    candidate(Effect(kind, place, {}), 100.0 + cost)
    for cost, (kind, place) in enumerate(
        (kind, place)
        for place in (FIRST, SECOND)
        for kind in ("coulomb", "bouc_wen", "cubic_hardening", "quadratic_damping")
    )
]


@pytest.mark.parametrize(
    ("left", "number", "quick", "there", "most"),
    [
        (0.9, 0, False, FIRST, MAX_CANDIDATES),
        (1.1, 0, False, FIRST, QUICK_CANDIDATES),
        (0.9, 0, True, FIRST, QUICK_CANDIDATES),
        (0.9, 1, False, FIRST, LATER_CANDIDATES),
        (0.9, 1, False, SECOND, SAME_PLACE_CANDIDATES),
    ],
    ids=["one effect", "several", "quick", "later", "twice at a place"],
)
def test_fewer_are_fitted_of_later_effects_and_where_several_are_missing(
    lacking, left, number, quick, there, most
):
    trials, fit, located = lacking
    shown = ranked(located, left * LIMITS.several_forces_chi2, 10.0)
    effects = (named_effect(dataclasses.replace(CUBIC, place=there), KINDS),)
    found = Hypothesis((fit,), trials, effects=effects[:number])
    labels = shortlist(found, fit, shown, SIMILAR, catalogue(), number=number, quick=quick)
    assert len(labels) == most


def test_a_law_of_the_beginnings_comes_first_only_if_it_explains_some_of_the_rest(lacking):
    trials, bent, _ = lacking
    best = fit_effect(bent, CUBIC, trials, KINDS)
    assert begins(best, label_of(CUBIC), bent)
    assert not begins(best, label_of(DRAG), bent)
    worse = dataclasses.replace(best.fit, chi2_in_band=2 * bent.chi2_in_band)
    assert not begins(dataclasses.replace(best, fit=worse), label_of(CUBIC), bent)


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
def test_an_effect_that_stands_out_among_several_is_taken_before_the_others(
    lacking, at, left, leaves, told
):
    _, fit, located = lacking
    before = dataclasses.replace(fit, chi2_in_band=100.0)
    shown = ranked(located, *left)
    effect = dataclasses.replace(CUBIC, place=at)
    fitted = [fitted_candidate(effect, fit, chi2_in_band=leaves)]
    assert begun_with(fitted, before, shown) is told
    assert not begun_with([], before, shown)


@pytest.mark.parametrize("stands_out", [True, False])
def test_once_an_effect_stands_out_no_other_proposer_is_asked(lacking, stands_out):
    trials, fit, located = lacking
    first = StubProposer("first", candidates=(candidate(CUBIC, cost_without=fit.cost),))
    second = StubProposer("second")
    how = SearchSettings(KINDS, Monitor(), SearchOptions(proposers=(first, second)))
    shown = ranked(located, 30.0, 100.0 if stands_out else 31.0)
    step = extend(Hypothesis((fit,), trials), fit, how, 0, pulled=False, localized=shown)
    assert [one.effect.kind for one in step.hypothesis.effects] == [CUBIC.kind]
    assert len(first.rounds) == 1
    assert len(second.rounds) == (not stands_out)
