"""A refit that is stuck goes on from where a law has led it; no law is named for that."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import levenberg_marquardt, refit
from slowtime.discrepancy.candidates.library_fit import Candidate
from slowtime.discrepancy.estimation.candidate_fit import fit_candidates
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.refinement.constant_release import release_constants
from slowtime.discrepancy.search import Search, search
from slowtime.dynamics.effects import Effect
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.proposers.test_lower_ranked import (
    KINDS,
    THREE,
    TOP,
    nothing,
    recorded,
)

STIFFER = Effect("stiffness_loss", TOP, {"dk_n_per_m": -600.0})
BENDS = Effect("cubic_hardening", TOP, {"k3_n_per_m3": 3e5})


@pytest.fixture(scope="module")
def stuck():
    """A spring 2.2 times as stiff as was claimed, by one sensor; the refit ended too soon."""
    trials = recorded(THREE, (STIFFER,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(levenberg_marquardt, "MAX_STEPS", 1)
        bent = refit(Plant.of(THREE, kinds=KINDS), trials)
    assert bent.chi2_in_band > 1000
    return bent, trials


@pytest.mark.parametrize("gained", [600.0, 2000.0])
def test_a_spring_far_from_its_claim_is_reached_by_steps_that_grow_with_it(gained):
    stiffer = dataclasses.replace(STIFFER, parameters={"dk_n_per_m": -gained})
    fit = refit(Plant.of(THREE, kinds=KINDS), recorded(THREE, (stiffer,)))
    assert fit.chi2_in_band < 1.5


def test_what_a_law_makes_up_for_a_constant_can_do_itself(stuck):
    bent, trials = stuck
    label = Candidate(STIFFER, 1.0, -1.0, 1e12)
    named = fit_candidates(bent, [label], trials, KINDS, nothing)
    loose = release_constants(bent, named, trials)
    assert loose is not None
    assert loose.chi2_in_band < 1.5
    (moved,) = (n for name, n in moved_of(loose).items() if name == f"stiffness {TOP.id}")
    assert moved.value == pytest.approx(1100.0, abs=4 * moved.sd)


@pytest.mark.long
def test_what_is_missing_is_looked_for_from_the_lowest_minimum(stuck):
    bent, trials = stuck
    found = search(bent, trials, Search(KINDS, Monitor()))
    assert found.loosened
    assert found.fits[0].chi2_in_band < 1.5
    assert {answer.effect.kind for answer in found.answers} <= {"stiffness_loss"}


def test_a_law_that_constants_cannot_do_stays():
    trials = recorded(THREE, (BENDS,))
    bent = refit(Plant.of(THREE, kinds=KINDS), trials)
    named = fit_candidates(bent, [Candidate(BENDS, 1.0, -1.0, 1e12)], trials, KINDS, nothing)
    assert named[0].fit.chi2_in_band < 0.5 * bent.chi2_in_band
    assert release_constants(bent, named, trials) is None
    assert release_constants(bent, [], trials) is None
    far = dataclasses.replace(named[0].fit, values=named[0].fit.values * np.where(
        np.arange(len(named[0].fit.values)) < 3, 1.3, 1.0))  # fmt: skip
    assert release_constants(bent, [dataclasses.replace(named[0], fit=far)], trials) is None
