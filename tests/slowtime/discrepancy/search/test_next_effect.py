"""One step of the search: candidates of the proposers are fitted, and the best is accepted."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.candidates.library_fit import label_of
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers import Proposal
from slowtime.discrepancy.search import SearchOptions, SearchSettings
from slowtime.discrepancy.search.lost_records import (
    UNTRACKED_CHI2,
    fit_later_segments,
    those_of_beginnings,
    worth_shooting,
)
from slowtime.discrepancy.search.next_effect import accept_best, extend
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import (
    StubProposer,
    candidate,
    fit_effect,
    fitted_candidate,
    fitted_chain,
    round_of,
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


def extended(lacking, *proposers, monitor=None, **more):
    trials, fit, located = lacking
    how = SearchSettings(KINDS, monitor or Monitor(), SearchOptions(proposers=proposers))
    given = {"pulled": False, "localized": located} | more
    return extend(Hypothesis((fit,), trials), fit, how, 0, **given)


def test_a_proposer_of_the_caller_is_asked_and_its_candidate_is_named(lacking):
    own = StubProposer("own", candidates=(candidate(CUBIC, cost_without=lacking[1].cost),))
    step = extended(lacking, own)
    (named,) = step.hypothesis.effects
    assert label_of(named.effect) == label_of(CUBIC)
    assert named.effect.parameters["k3_n_per_m3"] == pytest.approx(2e4, rel=0.05)
    assert step.hypothesis.last.chi2_in_band < 1.2
    (asked,) = own.rounds
    assert asked.number == 0
    assert asked.hypothesis.effects == ()
    assert {label_of(one.effect) for one in asked.shortlist} <= {
        label_of(one.effect) for one in asked.tried
    }


@pytest.mark.parametrize("error", [np.linalg.LinAlgError, FloatingPointError])
def test_a_proposer_whose_numbers_break_down_is_noted_and_the_others_are_asked(lacking, error):
    def diverging(given):
        raise error("no finite numbers")

    monitor = Monitor()
    broken = StubProposer("camera", proposed=diverging)
    own = StubProposer("own", candidates=(candidate(CUBIC, cost_without=lacking[1].cost),))
    step = extended(lacking, broken, own, monitor=monitor)
    assert [label_of(one.effect) for one in step.hypothesis.effects] == [label_of(CUBIC)]
    (note,) = monitor.notes
    assert "'camera'" in note
    assert "no finite numbers" in note


def test_a_mistake_in_a_proposer_is_no_numerical_failure(lacking):
    def mistaken(given):
        raise KeyError("cubic")

    with pytest.raises(KeyError, match="cubic"):
        extended(lacking, StubProposer("own", proposed=mistaken))


def test_each_proposer_is_told_what_was_proposed_and_fitted_before_it(lacking):
    first = StubProposer("first", candidates=(candidate(CUBIC, cost_without=lacking[1].cost),))
    none, last = StubProposer("none"), StubProposer("last")
    extended(lacking, first, none, last)
    (of_none,), (of_last,) = none.rounds, last.rounds
    assert [one.source for one in of_none.proposals] == ["first"]
    assert [one.source for one in of_last.proposals] == ["first", "none"]
    assert [label_of(one.effect) for one in of_last.fitted] == [label_of(CUBIC)]
    assert of_last.first_batch == first.candidates
    assert of_last.best() is of_last.fitted[0].fit


def test_where_nobody_proposes_anything_the_hypothesis_has_no_effect_more(lacking):
    step = extended(lacking, StubProposer("none"))
    assert step.added == 0
    assert step.hypothesis.effects == ()
    assert not step.hypothesis.exhausted


def test_where_nothing_is_missing_no_proposer_is_asked():
    trials = records_of(())
    fit = refit(Plant.of(TWO, kinds=KINDS), trials)
    own = StubProposer("own")
    step = extended((trials, fit, locate(fit, trials)), own)
    assert step.added == 0
    assert own.rounds == []


def test_out_of_budget_one_candidate_is_fitted_and_others_are_known_to_be_missing(lacking):
    other = candidate(DRAG, cost_without=lacking[1].cost)
    both = StubProposer(
        "both", candidates=(candidate(CUBIC, cost_without=lacking[1].cost), other)
    )
    late = extended(lacking, both, monitor=Monitor(late=lambda: True))
    assert [one.effect.kind for one in late.hypothesis.fitted] == [CUBIC.kind]
    # What it leaves tells that nothing else is missing.
    assert late.added == 1


def test_out_of_budget_a_later_effect_is_not_looked_for(lacking):
    trials, fit, _ = lacking
    how = SearchSettings(KINDS, Monitor(late=lambda: True, over=lambda: True))
    step = extend(Hypothesis((fit,), trials), fit, how, 1, pulled=True)
    assert step.added == 0
    assert step.hypothesis.exhausted


def test_out_of_budget_no_later_segments_are_looked_at(lacking):
    trials, fit, _ = lacking
    how = SearchSettings(KINDS, Monitor(late=lambda: True))
    assert fit_later_segments(Hypothesis((fit,), trials), fit, how) == []


def law_of(kind, left, fit):
    return fitted_candidate(kind, fit, chi2_in_band=left)


@pytest.fixture(scope="module")
def asked(lacking):
    trials, fit, located = lacking
    short = (
        candidate(CUBIC),
        candidate(DRAG),
        candidate(dataclasses.replace(CUBIC, place=FIRST)),
    )
    bare = dataclasses.replace(fit, chi2_in_band=100.0)
    return round_of(bare, trials, KINDS, shortlist=short, localized=located)


def proposed(given, source, *candidates, **more):
    return dataclasses.replace(
        given, proposals=(*given.proposals, Proposal(source, candidates, **more))
    )


def test_laws_of_the_segments_are_shot_only_where_whole_records_tell_nothing(asked):
    _, drag, _ = asked.shortlist
    told = proposed(asked, "segments", drag, shot=(drag,))
    # The same proposer that is asked again and has nothing to add hides nothing.
    again = proposed(told, "segments")
    for given in (told, again):
        near, lost = (
            worth_shooting(given, [law_of(CUBIC, left, asked.before)])
            for left in (0.9 * UNTRACKED_CHI2, 1.1 * UNTRACKED_CHI2)
        )
        assert (near, lost) == ((), (drag,))


def test_without_segments_the_law_of_the_beginnings_is_shot_or_the_foremost_of_each_kind(asked):
    cubic, drag, other = asked.shortlist
    told = proposed(asked, "initial segments", other, shot=(other,))
    assert worth_shooting(told, []) == [other]
    told = proposed(proposed(asked, "library", cubic, drag), "initial segments", other,
                    shot=(other,))  # fmt: skip
    assert worth_shooting(told, []) == [other, cubic, drag]
    alone = proposed(proposed(asked, "library", cubic, drag), "initial segments", other, drag,
                     shot=(other, drag), begins=label_of(drag.effect))  # fmt: skip
    assert worth_shooting(alone, []) == [drag]


@pytest.mark.parametrize("source", ["segments", "initial segments"])
def test_the_law_of_segments_or_beginnings_comes_first_where_the_best_leaves_much(
    asked, source
):
    """It is one of two effects, though another leaves less of the whole."""
    _, drag, _ = asked.shortlist
    told = proposed(asked, source, drag, begins=label_of(DRAG))
    much, little = LIMITS.far_off_chi2 + 1, LIMITS.far_off_chi2 - 1
    for given in (told, proposed(told, source)):
        best, law = law_of(CUBIC, much, asked.before), law_of(DRAG, 50.0, asked.before)
        assert those_of_beginnings(given, [best, law]) == [law]
        assert those_of_beginnings(given, [best]) == [best]
        near = law_of(CUBIC, little, asked.before)
        assert those_of_beginnings(given, [near, law]) == [near, law]
    assert those_of_beginnings(told, []) == []
    assert those_of_beginnings(asked, [best, law]) == [best, law]


def test_the_simpler_law_stays_beside_the_one_of_the_beginnings(asked):
    friction = Effect("coulomb", DRAG.place, {"friction_n": 1.0})
    stribeck = Effect("stribeck", DRAG.place, {**friction.parameters, "static_n": 2.0})
    told = proposed(asked, "segments", asked.shortlist[1], begins=label_of(stribeck))
    best, general, simple = (
        law_of(effect, LIMITS.far_off_chi2 + more, asked.before)
        for effect, more in ((CUBIC, 1), (stribeck, 2), (friction, 3))
    )
    assert those_of_beginnings(told, [best, general, simple]) == [general, simple]


def test_a_law_of_the_beginnings_that_explains_nothing_of_the_rest_does_not_come_first(asked):
    told = proposed(asked, "initial segments", asked.shortlist[1], begins=label_of(DRAG))
    best, worse = law_of(CUBIC, 20.0, asked.before), law_of(DRAG, 200.0, asked.before)
    assert those_of_beginnings(told, [best, worse]) == [best, worse]


@pytest.mark.parametrize(
    ("late", "over", "stages"),
    [(False, False, True), (True, False, True), (True, True, False)],
    ids=["in time", "late", "over"],
)
def test_once_there_are_two_laws_other_places_are_tried_while_there_is_budget(
    late, over, stages
):
    trials = records_of((CUBIC, DRAG), samples=300)
    found = fitted_chain(TWO, trials, KINDS, DRAG)
    law = fit_effect(found.last, CUBIC, trials, KINDS)
    told = []
    monitor = Monitor(lambda stage, _: told.append(stage), None, lambda: late, lambda: over)
    step = accept_best(found, found.last, [law], SearchSettings(KINDS, monitor), pulled=False)
    assert step.added == 1
    tried = [stage for stage in told if stage.startswith("trying")]
    assert bool(tried) is stages
    assert [one.effect.place for one in step.hypothesis.effects] == [FIRST, SECOND]
