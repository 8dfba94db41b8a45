"""The motion that sensors at every coordinate tell, whatever is missing."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.localization import measured_motion
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.two_mass_chain import (
    DRAG,
    FIRST,
    KINDS,
    SECOND,
    STRONG,
    TWO,
    records_of,
)


@pytest.fixture(scope="module")
def lacking():
    """Records of a rig with two strong laws, and the fit of the model that lacks both."""
    trials = records_of((DRAG, STRONG), samples=1000)
    return refit(Plant.of(TWO, kinds=KINDS), trials), trials


def test_the_motion_is_that_of_the_rig_however_wrong_the_model_is(lacking):
    fit, trials = lacking
    located = measured_motion(fit, trials)
    assert located is not None
    entries = (DRAG.entry(), STRONG.entry())
    truth = Plant.of(dataclasses.replace(TWO, effects=entries))
    for number, trial in enumerate(trials):
        moved = truth.states(truth.values, trial.inputs, trial.rate_hz)
        wrong = fit.plant.states(fit.values, trial.inputs, trial.rate_hz)
        for place in (FIRST, SECOND):
            told = located.latent(place, number).motion
            for name in ("e", "v"):
                right, found = getattr(moved[place], name), getattr(told, name)
                error = np.std(found - right) / np.std(right)
                assert error < 0.08
                assert error < 0.2 * np.std(getattr(wrong[place], name) - right) / np.std(right)


def test_fewer_sensors_than_coordinates_tell_no_motion(lacking):
    _, trials = lacking
    few = dataclasses.replace(TWO, sensors=TWO.sensors[:2])
    cut = [dataclasses.replace(one, outputs=one.outputs[:, :2], use=None) for one in trials]
    assert measured_motion(refit(Plant.of(few, kinds=KINDS), cut), cut) is None


def test_records_with_gaps_tell_no_motion(lacking):
    fit, trials = lacking
    use = np.ones(trials[0].outputs.shape, dtype=bool)
    use[100:120, 0] = False
    holed = [dataclasses.replace(trials[0], use=use), *trials[1:]]
    assert measured_motion(fit, holed) is None
