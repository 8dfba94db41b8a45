"""Wherever laws were compared, numbers are told from where the misfit is least."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy import bottom
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.found import Found
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.refit import WRONG, refit
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import ONE, PLACE

RATE = 64.0
KINDS = {name: kind for name, kind in catalogue().items() if name == "cubic_hardening"}
HARDER = Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 4e4})
NAME = ("effect", 0, "k3_n_per_m3")
TRUTH = dataclasses.replace(ONE, effects=(HARDER.entry(),))


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(5)
    plant = Plant.of(TRUTH, kinds=KINDS)
    found = []
    for level in (3.0, 6.0):
        push = level * np.convolve(rng.standard_normal(700), np.hanning(9) / 2, "same")[:, None]
        clean = plant.simulate(plant.values, push, RATE)
        noise = 0.02 * clean.std() * rng.standard_normal(clean.shape)
        found.append(Trial(inputs=push, outputs=clean + noise, rate_hz=RATE))
    return tuple(found)


def told(trials, **more):
    found = diagnose(Campaign(description=ONE, trials=trials), kinds=KINDS, **more)
    (answer,) = found.effects
    return answer.numbers["k3_n_per_m3"]


@pytest.mark.long
@pytest.mark.parametrize("late", [False, True])
def test_what_is_told_is_what_the_last_refit_found_unless_it_is_late(trials, monkeypatch, late):
    found = []

    def last(*given, **how):
        fit = refit(*given, **how)
        assert how["fine"]
        found.append(dataclasses.replace(fit, values=1.001 * fit.values))
        return found[-1]

    monkeypatch.setattr(bottom, "refit", last)
    number = told(trials, late=lambda: late)
    assert len(found) == (not late)
    for fit in found:
        assert number.value == fit.values[fit.plant.parameters.index(NAME)]


def test_a_model_that_is_wrong_is_left_where_it_was(trials):
    plant = Plant.of(ONE, kinds=KINDS)
    fit = dataclasses.replace(refit(plant, trials), chi2_in_band=1.1 * WRONG)
    found = Found([fit], trials)
    bottom.at_bottom(found, 0, KINDS)
    assert found.fits[0] is fit
