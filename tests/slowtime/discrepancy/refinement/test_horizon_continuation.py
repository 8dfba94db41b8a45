"""Effects fitted while others were missing are fitted again to ever longer records."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.refinement.horizon_continuation import (
    refit_friction_with_growing_horizon,
    refit_with_growing_horizon,
)
from slowtime.discrepancy.selection.probabilities import answer_of
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import fit_at, scaled, with_last
from tests.slowtime.discrepancy.two_mass_chain import FIRST, SECOND, TWO, records_of

KINDS = catalogue()
BOTH = (
    Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 8e5}),
    Effect("quadratic_damping", FIRST, {"c2_n_s2_per_m2": 30.0}),
)


def effects_of(plant, fit, *effects):
    return tuple(
        answer_of([FittedCandidate(effect, plant.description, fit, 0.0)], [1.0], KINDS)
        for effect in effects
    )


@pytest.fixture(scope="module")
def stuck():
    """Both laws as a fit to whole records may leave them: far from where they belong."""
    trials = records_of(BOTH)
    entries = tuple(effect.entry() for effect in BOTH)
    plant = Plant.of(dataclasses.replace(TWO, effects=entries), kinds=KINDS)
    right = refit(plant, trials, horizons=(1.0,))
    values = scaled(dataclasses.replace(right, values=plant.values), k3_n_per_m3=0.1,
                    c2_n_s2_per_m2=5.0)  # fmt: skip
    fit = fit_at(right, trials, values, cost=right.cost, chi2_in_band=80.0)
    return Hypothesis((fit, fit, fit), trials, effects=effects_of(plant, fit, *BOTH))


def test_two_laws_are_found_again_by_fits_to_ever_longer_records(stuck):
    found = refit_with_growing_horizon(stuck, KINDS)
    assert unexplained_by(found.last) < unexplained_by(stuck.last)
    assert found.last.chi2_in_band < 1.2
    told = {a.effect.kind: next(iter(a.numbers.values())).value for a in found.effects}
    assert told["cubic_hardening"] == pytest.approx(8e5, rel=0.02)
    assert told["quadratic_damping"] == pytest.approx(30.0, rel=0.1)
    # Nothing is to be gained by the same once more.
    assert refit_with_growing_horizon(found, KINDS) is found


def test_fits_that_leave_noise_or_were_made_to_segments_are_not_repeated(stuck):
    quiet = with_last(stuck, chi2_in_band=1.1)
    assert refit_with_growing_horizon(quiet, KINDS) is quiet
    cut = dataclasses.replace(stuck, trials=(*stuck.trials, stuck.trials[0]))
    assert refit_with_growing_horizon(cut, KINDS) is cut


def test_a_fit_to_growing_records_that_leaves_more_is_not_taken(stuck):
    quiet = tuple(np.zeros_like(residual) + 1e-12 for residual in stuck.last.residual)
    best = with_last(stuck, residual=quiet)
    assert refit_with_growing_horizon(best, KINDS) is best


STICKS = Effect("coulomb", FIRST, {"friction_n": 1.0})


@pytest.fixture(scope="module")
def sticking():
    """Friction alone, in a minimum that is not its own."""
    trials = records_of((STICKS,))
    plant = Plant.of(dataclasses.replace(TWO, effects=(STICKS.entry(),)), kinds=KINDS)
    right = refit(plant, trials, horizons=(1.0,))
    values = scaled(dataclasses.replace(right, values=plant.values), friction_n=0.5)
    fit = fit_at(right, trials, values, cost=right.cost, chi2_in_band=2.0)
    first = dataclasses.replace(fit, chi2_in_band=50.0)
    return Hypothesis((first, fit), trials, effects=effects_of(plant, fit, STICKS))


def test_friction_is_found_by_fits_to_slowly_growing_records(sticking):
    found = refit_friction_with_growing_horizon(sticking, KINDS)
    assert found.last.chi2_in_band < 1.2
    told = found.effects[0].numbers["friction_n"]
    assert told.value == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(
    ("chi2", "first"), [(1.0, 1.0), (2.0, 1e4), (9.0, 50.0)], ids=["noise", "hardly", "far"]
)
def test_friction_that_leaves_noise_or_hardly_more_or_very_much_is_left(sticking, chi2, first):
    bare = dataclasses.replace(sticking.first, chi2_in_band=first)
    found = with_last(dataclasses.replace(sticking, fits=(bare, sticking.last)),
                      chi2_in_band=chi2)  # fmt: skip
    assert refit_friction_with_growing_horizon(found, KINDS) is found


def test_only_friction_that_was_found_alone_is_followed_slowly(stuck, sticking):
    first, last = (
        dataclasses.replace(fit, chi2_in_band=chi2)
        for fit, chi2 in zip(stuck.fits[:2], (50.0, 2.0), strict=True)
    )
    no_friction = dataclasses.replace(stuck, fits=(first, last), effects=stuck.effects[:1])
    beside = dataclasses.replace(sticking, effects=sticking.effects * 2)
    for found in (no_friction, beside):
        assert refit_friction_with_growing_horizon(found, KINDS) is found


def test_a_final_hypothesis_is_not_fitted_again(stuck, sticking):
    for found, again in (
        (stuck, refit_with_growing_horizon),
        (sticking, refit_friction_with_growing_horizon),
    ):
        final = dataclasses.replace(found, final=True)
        assert again(final, KINDS) is final
