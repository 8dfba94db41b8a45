"""Laws that every proposer of the registry obeys."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.candidates.library_fit import library_candidates
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers import LATER_PROPOSERS, PROPOSERS, Proposal, Proposer
from slowtime.dynamics.effects import catalogue
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered
from tests.slowtime.discrepancy.protocol import fitted_candidate, round_of
from tests.slowtime.discrepancy.three_mass_chain import THREE, recorded
from tests.slowtime.discrepancy.two_mass_chain import CUBIC, TWO, records_of

NAMES = (
    "cubic_hardening",
    "coulomb",
    "sensor_clock",
    "input_delay",
    "stiffness_jump",
    "extra_dof",
)
KINDS = {name: catalogue()[name] for name in NAMES}
LATER = {one.name for one in LATER_PROPOSERS}
BUT_LIBRARY = tuple(one for one in PROPOSERS if one.name != "library")
OF_FIRST_EFFECT = tuple(one for one in BUT_LIBRARY if one.name not in LATER)


def whole_round(description, trials):
    """Give a round as the search puts it together."""
    fit = refit(Plant.of(description, kinds=KINDS), trials)
    located = locate(fit, trials)
    tried = library_candidates(fit, located, KINDS)
    return round_of(fit, trials, KINDS, tried=tried, shortlist=tried[:3], localized=located)


@pytest.fixture(scope="module")
def lacking():
    """A round of a model that lacks a law."""
    return whole_round(TWO, records_of((CUBIC,), samples=150))


@pytest.fixture(scope="module", params=["nothing is missing", "a law is missing"])
def given(request, lacking):
    """Rounds of a model that lacks nothing, and of one that does."""
    if request.param == "a law is missing":
        return lacking
    return whole_round(THREE, recorded(THREE, (), seconds=3.0))


def of_name(proposer):
    return f"{proposer.name}{' only' if getattr(proposer, 'only', False) else ''}"


@pytest.mark.parametrize("proposer", PROPOSERS, ids=of_name)
def test_a_proposal_has_its_proposers_name_and_the_round_stays_as_it_was(proposer, given):
    """Whether or not anything is missing."""
    assert isinstance(proposer, Proposer)
    fit = given.before
    known = fit.values.copy(), [one.copy() for one in fit.residual]
    proposal = proposer(given)
    assert isinstance(proposal, Proposal)
    assert proposal.source == proposer.name
    assert {one.effect.kind for one in proposal.candidates} <= set(KINDS)
    np.testing.assert_array_equal(fit.values, known[0])
    for one, other in zip(fit.residual, known[1], strict=True):
        np.testing.assert_array_equal(one, other)
    assert given.fitted == given.proposals == ()


@pytest.mark.parametrize("proposer", OF_FIRST_EFFECT, ids=of_name)
def test_proposers_of_the_first_effect_propose_nothing_for_later_ones(proposer, lacking):
    with metered() as meter:
        proposal = proposer(dataclasses.replace(lacking, number=1))
    assert proposal.candidates == proposal.shot == ()
    assert meter.spent == 0


@pytest.mark.parametrize("proposer", BUT_LIBRARY, ids=of_name)
def test_nothing_is_proposed_once_a_law_explains_all(proposer, lacking):
    """Nor is anything fitted: a clock is asked where no force explains what is missing."""
    white = fitted_candidate(CUBIC, lacking.before, chi2_in_band=1.0)
    near = tuple(
        dataclasses.replace(one, cost=float(lacking.before.data)) for one in lacking.shortlist
    )
    with metered() as meter:
        given = dataclasses.replace(lacking, fitted=(white,), shortlist=near)
        assert proposer(given).candidates == ()
    assert meter.spent == 0


@pytest.mark.parametrize("proposer", PROPOSERS, ids=of_name)
def test_out_of_budget_a_proposer_answers_all_the_same(proposer, lacking):
    late = dataclasses.replace(lacking, monitor=Monitor(late=lambda: True, over=lambda: True))
    assert proposer(late).source == proposer.name


def test_proposers_of_one_name_are_told_apart_by_whether_they_stand_in_place_of_the_library():
    names = [of_name(one) for one in PROPOSERS]
    assert len(set(names)) == len(names)
    # Those that stand in place of the library are asked before it.
    assert names.index("segments only") < names.index("library") < names.index("segments")
