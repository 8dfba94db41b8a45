"""Laws whose force explains the records, and their free run not, are fitted to segments."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import cut_segments, refit
from slowtime.discrepancy.calibration.augmentation import FitStart
from slowtime.discrepancy.candidates.library_fit import Candidate
from slowtime.discrepancy.estimation.candidate_fit import fit_candidates
from slowtime.discrepancy.estimation.model_evidence import rescored
from slowtime.discrepancy.estimation.shooting_fit import in_pieces, shooting_fits
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.selection.acceptance import Criteria, accept
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered
from tests.slowtime.discrepancy.protocol import in_budget
from tests.slowtime.discrepancy.rigs import ONE, PLACE

RATE = 50.0
KINDS = catalogue()
CUBIC = Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 1e5})
OTHER = Effect("gap_one_sided", PLACE, {"gap_m": 0.02, "kg_n_per_m": 500.0})


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(5)
    push = np.convolve(rng.standard_normal(300), np.hanning(9), "same")[:, None] * 4.0
    truth = Plant.of(dataclasses.replace(ONE, effects=(CUBIC.entry(),)))
    seen = truth.simulate(truth.values, push, RATE) + 2e-5 * rng.standard_normal((300, 1))
    return (Trial(inputs=push, outputs=seen, rate_hz=RATE),)


@pytest.fixture(scope="module")
def before(trials):
    return refit(Plant.of(ONE), trials)


def label(effect, cost):
    return Candidate(effect, cost, -cost / 2, 1e9)


def test_a_law_that_explains_the_records_is_not_fitted_to_segments(before, trials):
    named = fit_candidates(before, [label(CUBIC, 300.0)], trials, KINDS, in_budget)
    assert named[0].fit.chi2_in_band < 1.5
    assert shooting_fits(before, [label(CUBIC, 1.0)], named, trials, KINDS, in_budget) == named
    assert shooting_fits(before, [], [], trials, KINDS, in_budget) == []


def test_a_law_that_explains_little_along_the_force_is_not_fitted_to_segments(before, trials):
    """Its free run is as good as it will get."""
    few = label(OTHER, 1e8)
    named = fit_candidates(before, [few], trials, KINDS, in_budget)
    assert named[0].fit.chi2_in_band > 5.0
    again = shooting_fits(before, [few], named, trials, KINDS, in_budget)
    assert [one.shot for one in again] == [None]


@pytest.mark.long
def test_only_a_start_that_a_force_told_is_given_up_before_segments_are_fitted(before, trials):
    """One that segments told is where fits to segments begin."""
    fits = fit_candidates(before, [label(OTHER, 1e8)], trials, KINDS, in_budget)
    constants = dict(zip(before.plant.parameters, before.values.tolist(), strict=True))
    spent = {}
    for nearby in (True, False):
        start = FitStart(constants, [{}], from_segments=nearby)
        promising = dataclasses.replace(label(OTHER, 300.0), start=start)
        with metered() as meter:
            again = shooting_fits(before, [promising], fits, trials, KINDS, in_budget)
        assert again[0].shot is not None
        spent[nearby] = meter.spent
    assert spent[True] < spent[False]


@pytest.mark.long
def test_a_law_whose_free_run_went_astray_is_fitted_to_segments(before, trials):
    promising = label(OTHER, 300.0)
    named = fit_candidates(before, [promising], trials, KINDS, in_budget)
    again = shooting_fits(before, [promising], named, trials, KINDS, in_budget)
    assert again[0].shot is not None
    # Costs compare under one noise only.
    assert again[0].score >= rescored(named[0], again[0].fit, trials, KINDS).score
    assert in_pieces(again, KINDS) == []


@pytest.mark.parametrize("taken", [True, False])
def test_records_stay_whole_unless_a_law_of_their_segments_is_accepted(before, trials, taken):
    (whole,) = fit_candidates(before, [label(CUBIC, 300.0)], trials, KINDS, in_budget)
    cut, _ = cut_segments(before.plant, trials)
    short = refit(whole.fit.plant, cut, values=whole.fit.values, horizons=(1.0,))
    astray = dataclasses.replace(whole.fit, chi2_in_band=99.0)
    # Where it explains no more than it costs, it is not taken.
    near = short if taken else dataclasses.replace(short, cost=1e9)
    named = dataclasses.replace(whole, fit=astray, shot=near)
    terms = Criteria(stated=None, pulled=False)
    step = accept(Hypothesis((before,), trials), before, [named], trials, KINDS, terms)
    found = step.hypothesis
    assert step.added == taken
    assert len(cut) > len(trials)
    assert len(found.trials) == len(found.last.states) == len(cut if taken else trials)
