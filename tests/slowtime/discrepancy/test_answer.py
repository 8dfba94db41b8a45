"""How sure an answer is, and how it is said."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.naming import Named, evidence
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refit import refit
from slowtime.discrepancy.verdict import rivals_within, shares_of
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant

KINDS = catalogue()


@pytest.fixture(scope="module")
def named():
    rng = np.random.default_rng(2)
    rig = dataclasses.replace(
        chain([2.0], [800.0], dampings_n_s_per_m=[1.6]),
        inputs=(Input(channel="f", kind="force", node="m1", unit="N"),),
        sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="m"),),
    )
    effect = Effect("added_mass", Place("node", "m1"), {"dm_kg": 0.4})
    plant = Plant.of(dataclasses.replace(rig, effects=(effect.entry(),)))
    push = rng.standard_normal((200, 1))
    seen = plant.simulate(plant.values, push, 64.0) + 1e-5 * rng.standard_normal((200, 1))
    trials = (Trial(inputs=push, outputs=seen, rate_hz=64.0),)
    fit = refit(plant, trials, horizons=(1.0,))
    return Named(effect, plant.description, fit, evidence(fit, KINDS))


def test_constants_that_may_be_off_take_their_share(named):
    assert shares_of([named]) == [1.0]
    (share,) = shares_of([named], [named.score])
    assert share == pytest.approx(0.5)
    lesser = dataclasses.replace(named, score=named.score - 100.0)
    shares = shares_of([named, lesser], [named.score])
    assert [rival.effect for rival in rivals_within([named, lesser], shares)] == ["added_mass"]
