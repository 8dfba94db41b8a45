"""Constants stuck in a local minimum are refitted from where a law has led them."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.refinement.constant_release import release_constants
from slowtime.discrepancy.search import SearchSettings, search
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import fit_at, fit_effect
from tests.slowtime.discrepancy.three_mass_chain import THREE, TOP, recorded

KINDS = catalogue()
STIFFER = Effect("stiffness_loss", TOP, {"dk_n_per_m": -600.0})
BENDS = Effect("cubic_hardening", TOP, {"k3_n_per_m3": 3e5})


@pytest.fixture(scope="module")
def stuck():
    """A spring 2.2 times as stiff as was claimed; a fit that stayed where it was claimed."""
    trials = recorded(THREE, (STIFFER,))
    plant = Plant.of(THREE, kinds=KINDS)
    bent = fit_at(refit(plant, trials), trials, plant.values)
    assert bent.chi2_in_band > 1000
    return bent, trials


@pytest.mark.parametrize("gained", [600.0, 2000.0])
def test_a_refit_reaches_a_stiffness_far_from_its_claim(gained):
    stiffer = dataclasses.replace(STIFFER, parameters={"dk_n_per_m": -gained})
    fit = refit(Plant.of(THREE, kinds=KINDS), recorded(THREE, (stiffer,)))
    assert fit.chi2_in_band < 1.5


def test_a_stuck_stiffness_is_released_from_where_a_law_of_stiffness_led_it(stuck):
    bent, trials = stuck
    loose = release_constants(bent, [fit_effect(bent, STIFFER, trials, KINDS)], trials)
    assert loose is not None
    assert loose.chi2_in_band < 1.5
    (moved,) = (n for name, n in moved_of(loose).items() if name == f"stiffness {TOP.id}")
    assert moved.value == pytest.approx(1100.0, abs=4 * moved.sd)


@pytest.mark.long
def test_a_search_that_began_in_a_local_minimum_goes_on_from_the_released_constants(stuck):
    bent, trials = stuck
    found = search(bent, trials, SearchSettings(KINDS, Monitor()))
    assert found.released
    assert found.first.chi2_in_band < 1.5
    assert {answer.effect.kind for answer in found.effects} <= {"stiffness_loss"}


def test_nothing_is_released_where_no_constant_does_what_the_law_does():
    trials = recorded(THREE, (BENDS,))
    bent = refit(Plant.of(THREE, kinds=KINDS), trials)
    law = fit_effect(bent, BENDS, trials, KINDS)
    assert law.fit.chi2_in_band < 0.5 * bent.chi2_in_band
    assert release_constants(bent, [law], trials) is None
    assert release_constants(bent, [], trials) is None
    constants = np.where(np.arange(len(law.fit.values)) < 3, 1.3, 1.0)
    far = dataclasses.replace(law.fit, values=law.fit.values * constants)
    assert release_constants(bent, [dataclasses.replace(law, fit=far)], trials) is None
