"""As long as nothing that was tried explains the records, the list is gone down further."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.candidates import Candidate
from slowtime.discrepancy.further import further
from slowtime.discrepancy.naming import refit_all
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refit import refit
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant

RATE = 50.0
KINDS = catalogue()
ONE = dataclasses.replace(
    chain([2.0], [800.0], dampings_n_s_per_m=[1.6]),
    inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
    sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="m"),),
    tolerance=Tolerance(stiffness=0.02, damping=0.15),
)
PLACE = Place("element", ONE.elements[0].id)
CUBIC = Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 1e5})
OTHERS = [
    Effect("stiffness_loss", PLACE, {"dk_n_per_m": 5.0}),
    Effect("viscous_damping", PLACE, {"dc_n_s_per_m": 0.5}),
    Effect("quadratic_damping", PLACE, {"c2_n_s2_per_m2": 1.0}),
]


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


def ranked(*effects):
    return [Candidate(effect, float(i), -float(i), 100.0) for i, effect in enumerate(effects)]


def nothing(effect, number):
    pass


@pytest.mark.slow
def test_the_right_law_is_found_where_it_stands_low(before, trials):
    tried = ranked(*OTHERS, CUBIC)
    named = refit_all(before, tried[:1], trials, KINDS, nothing)
    found = further(before, tried, named, trials, KINDS, nothing)
    assert found[0].effect.kind == "cubic_hardening"
    assert found[0].fit.chi2_in_band < 1.5 < 5.0 < named[0].fit.chi2_in_band
    assert len(found) == 4


def test_nothing_more_is_tried_where_the_first_explains_it_all(before, trials):
    tried = ranked(CUBIC, *OTHERS)
    named = refit_all(before, tried[:1], trials, KINDS, nothing)
    assert further(before, tried, named, trials, KINDS, nothing) == named
    assert further(before, tried, [], trials, KINDS, nothing) == []
