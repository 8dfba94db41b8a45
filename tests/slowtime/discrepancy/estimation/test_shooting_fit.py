"""A law whose force explains the records, but not its free run, is fitted to pieces as well."""

import dataclasses

import numpy as np
import pytest
from slowtime.discrepancy.state import Found

from slowtime.discrepancy.calibration import cut_segments, refit
from slowtime.discrepancy.calibration.augmentation import FitStart
from slowtime.discrepancy.candidates.library_fit import Candidate
from slowtime.discrepancy.estimation import shooting_fit as further
from slowtime.discrepancy.estimation.candidate_fit import fit_candidates, rescored
from slowtime.discrepancy.estimation.shooting_fit import in_pieces, shooting_fits
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.selection.acceptance import accept
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
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


def nothing(effect, number):
    pass


def test_what_explains_the_records_is_not_fitted_again(before, trials):
    named = fit_candidates(before, [label(CUBIC, 300.0)], trials, KINDS, nothing)
    assert named[0].fit.chi2_in_band < 1.5
    assert shooting_fits(before, [label(CUBIC, 1.0)], named, trials, KINDS, nothing) == named
    assert shooting_fits(before, [], [], trials, KINDS, nothing) == []


def test_a_law_that_explains_little_even_along_the_force_is_not_fitted_again(before, trials):
    """Its free run is as good as it will get."""
    few = label(OTHER, 1e8)
    named = fit_candidates(before, [few], trials, KINDS, nothing)
    assert named[0].fit.chi2_in_band > 5.0
    again = shooting_fits(before, [few], named, trials, KINDS, nothing)
    assert [one.shot for one in again] == [None]


@pytest.mark.parametrize("nearby", [True, False])
def test_what_pieces_told_begins_where_they_told(before, trials, monkeypatch, nearby):
    """What a force told is refitted without that first."""
    asked = []

    def refitted(before, labels, trials, kinds, tick, *, shooting=False):
        asked.append((shooting, [one.start for one in labels]))
        return []

    told = FitStart({}, [{}], from_segments=nearby)
    few = dataclasses.replace(label(CUBIC, 300.0), start=told)
    named = fit_candidates(before, [label(OTHER, 1e8)], trials, KINDS, nothing)
    monkeypatch.setattr(further, "fit_candidates", refitted)
    shooting_fits(before, [few], named, trials, KINDS, nothing)
    assert asked == [(False, [] if nearby else [None]), (True, [told])]


@pytest.mark.slow
def test_a_free_run_that_went_astray_is_fitted_to_pieces(before, trials):
    promising = label(OTHER, 300.0)
    named = fit_candidates(before, [promising], trials, KINDS, nothing)
    again = shooting_fits(before, [promising], named, trials, KINDS, nothing)
    assert again[0].shot is not None
    # Costs compare under one noise only.
    assert again[0].score >= rescored(named[0], again[0].fit, trials, KINDS).score
    assert in_pieces(again, KINDS) == []


@pytest.mark.parametrize("taken", [True, False])
def test_records_stay_whole_unless_a_law_of_their_pieces_is_taken(before, trials, taken):
    (whole,) = fit_candidates(before, [label(CUBIC, 300.0)], trials, KINDS, nothing)
    cut, _ = cut_segments(before.plant, trials)
    short = refit(whole.fit.plant, cut, values=whole.fit.values, horizons=(1.0,))
    astray = dataclasses.replace(whole.fit, chi2_in_band=99.0)
    # Where it explains no more than it costs, it is not taken.
    near = short if taken else dataclasses.replace(short, cost=1e9)
    named = dataclasses.replace(whole, fit=astray, shot=near)
    found = Found([before], trials)
    assert accept(found, before, [named], trials, KINDS, None, pulled=False) is taken
    assert len(cut) > len(trials)
    assert len(found.trials) == len(found.fits[-1].states) == len(cut if taken else trials)
