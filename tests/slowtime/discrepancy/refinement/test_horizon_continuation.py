"""Effects that were fitted while others were missing find back to what they are."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.estimation.candidate_fit import FittedCandidate
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.refinement.horizon_continuation import (
    refit_friction_with_growing_horizon,
    refit_with_growing_horizon,
)
from slowtime.discrepancy.selection.probabilities import answer_of
from slowtime.discrepancy.state import Found
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.test_search import FIRST, RATE, SECOND, TWO, seen

KINDS = catalogue()
BOTH = (
    Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 8e5}),
    Effect("quadratic_damping", FIRST, {"c2_n_s2_per_m2": 30.0}),
)


@pytest.fixture
def stuck():
    """Both laws as a fit to whole records may leave them: far from where they belong."""
    trials = seen(BOTH)
    entries = tuple(effect.entry() for effect in BOTH)
    plant = Plant.of(dataclasses.replace(TWO, effects=entries), kinds=KINDS)
    right = refit(plant, trials, horizons=(1.0,))
    values = plant.values.copy()
    for name, factor in (("k3_n_per_m3", 0.1), ("c2_n_s2_per_m2", 5.0)):
        at = next(i for i, one in enumerate(plant.parameters) if one[-1] == name)
        values[at] *= factor
    runs = [plant.simulate(values, trial.inputs, RATE) for trial in trials]
    left = tuple(trial.measured - run for trial, run in zip(trials, runs, strict=True))
    fit = dataclasses.replace(right, values=values, residual=left, chi2_in_band=80.0)
    answers = [
        answer_of([FittedCandidate(effect, plant.description, fit, 0.0)], [1.0], KINDS)
        for effect in BOTH
    ]
    return Found([fit, fit, fit], trials, answers=answers)


def test_they_are_found_over_ever_longer_records(stuck):
    before = unexplained_by(stuck.fits[-1])
    refit_with_growing_horizon(stuck, KINDS)
    assert unexplained_by(stuck.fits[-1]) < before
    assert stuck.fits[-1].chi2_in_band < 1.2
    told = {a.effect.kind: next(iter(a.numbers.values())).value for a in stuck.answers}
    assert told["cubic_hardening"] == pytest.approx(8e5, rel=0.02)
    assert told["quadratic_damping"] == pytest.approx(30.0, rel=0.1)


def test_what_leaves_noise_is_left_alone_and_so_is_what_was_cut(stuck):
    last = dataclasses.replace(stuck.fits[-1], chi2_in_band=1.1)
    stuck.fits[-1] = last
    refit_with_growing_horizon(stuck, KINDS)
    assert stuck.fits[-1] is last
    stuck.fits[-1] = cut = dataclasses.replace(last, chi2_in_band=80.0)
    stuck.trials = (*stuck.trials, stuck.trials[0])
    refit_with_growing_horizon(stuck, KINDS)
    assert stuck.fits[-1] is cut


def test_what_would_leave_more_is_not_taken(stuck):
    quiet = tuple(np.zeros_like(residual) + 1e-12 for residual in stuck.fits[-1].residual)
    stuck.fits[-1] = best = dataclasses.replace(stuck.fits[-1], residual=quiet)
    refit_with_growing_horizon(stuck, KINDS)
    assert stuck.fits[-1] is best


STICKS = Effect("coulomb", FIRST, {"friction_n": 1.0})


@pytest.fixture
def sticking():
    """Friction alone, in a minimum that is not its own."""
    trials = seen((STICKS,))
    plant = Plant.of(dataclasses.replace(TWO, effects=(STICKS.entry(),)), kinds=KINDS)
    right = refit(plant, trials, horizons=(1.0,))
    values = plant.values.copy()
    values[-1] *= 0.5
    runs = [plant.simulate(values, trial.inputs, RATE) for trial in trials]
    left = tuple(trial.measured - run for trial, run in zip(trials, runs, strict=True))
    fit = dataclasses.replace(right, values=values, residual=left, chi2_in_band=2.0)
    first = dataclasses.replace(fit, chi2_in_band=50.0)
    answer = answer_of([FittedCandidate(STICKS, plant.description, fit, 0.0)], [1.0], KINDS)
    return Found([first, fit], trials, answers=[answer])


def test_friction_is_followed_from_stick_to_stick(sticking):
    refit_friction_with_growing_horizon(sticking, KINDS)
    assert sticking.fits[-1].chi2_in_band < 1.2
    told = sticking.answers[0].numbers["friction_n"]
    assert told.value == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(
    ("chi2", "first"), [(1.0, 1.0), (2.0, 1e4), (9.0, 50.0)], ids=["noise", "hardly", "far"]
)
def test_friction_that_leaves_noise_or_hardly_more_or_very_much_is_left(sticking, chi2, first):
    begun, last = sticking.fits
    sticking.fits = [
        dataclasses.replace(begun, chi2_in_band=first),
        dataclasses.replace(last, chi2_in_band=chi2),
    ]
    last = sticking.fits[-1]
    refit_friction_with_growing_horizon(sticking, KINDS)
    assert sticking.fits[-1] is last


def test_what_does_not_stick_and_what_is_not_alone_is_left(stuck, sticking):
    stuck.answers = stuck.answers[:1]
    stuck.fits = [
        dataclasses.replace(fit, chi2_in_band=chi2)
        for fit, chi2 in zip(stuck.fits[:2], (50.0, 2.0), strict=True)
    ]
    for found in (stuck, sticking):
        if found is sticking:
            found.answers = [*found.answers, *found.answers]
        last = found.fits[-1]
        refit_friction_with_growing_horizon(found, KINDS)
        assert found.fits[-1] is last


def test_what_follows_no_law_is_not_fitted_again(stuck, sticking):
    for found, again in (
        (stuck, refit_with_growing_horizon),
        (sticking, refit_friction_with_growing_horizon),
    ):
        found.ended = True
        last = found.fits[-1]
        again(found, KINDS)
        assert found.fits[-1] is last
