"""The instant of a switch is found, though the misfit tells of it only close by."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import simulated_chi2
from slowtime.discrepancy.estimation import switching_instant
from slowtime.discrepancy.estimation.switching_instant import (
    MAX_COST_RATIO,
    refine_switching_instant,
)
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered
from tests.slowtime.discrepancy.rigs import ONE, PLACE

KINDS = catalogue()
RATE, STARTS_S, SECONDS = 50.0, (0.0, 60.0, 150.0), 30.0


def records_of_a_jump(jump_s):
    """Give the true plant, and three records of it."""
    jump = Effect("stiffness_jump", PLACE, {"dk_n_per_m": 320.0, "t_jump_s": jump_s})
    truth = Plant.of(dataclasses.replace(ONE, effects=(jump.entry(),)))
    rng = np.random.default_rng(2)
    trials = []
    for start_s in STARTS_S:
        push = np.convolve(rng.standard_normal(int(SECONDS * RATE)), np.hanning(9), "same")
        clean = truth.simulate(truth.values, push[:, None], RATE, start_s=start_s)
        seen = clean + 0.01 * clean.std() * rng.standard_normal(clean.shape)
        trials.append(Trial(inputs=push[:, None], outputs=seen, rate_hz=RATE, start_s=start_s))
    return truth, tuple(trials)


@pytest.mark.long
@pytest.mark.parametrize(
    ("begun_s", "jump_s"),
    [
        (9.0, 72.41),
        *(
            pytest.param(*pair, marks=pytest.mark.long)
            for pair in (
                (9.0, 21.37),
                (9.0, 171.93),
                (80.0, 21.37),
                (80.0, 72.41),
                (80.0, 171.93),
            )
        ),
    ],
)
def test_the_instant_of_a_jump_is_looked_for_in_every_record(jump_s, begun_s):
    truth, trials = records_of_a_jump(jump_s)
    right = refit(truth, trials)
    at = truth.parameters.index(("effect", 0, "t_jump_s"))
    values = right.values.copy()
    values[at] = begun_s
    left = simulated_chi2(truth, values, right.states, right.noise, trials)
    wrong = dataclasses.replace(right, values=values, cost=left, chi2_in_band=50.0)
    found = refine_switching_instant(wrong, trials, KINDS, None, 100.0)
    assert found.values[at] == pytest.approx(jump_s, abs=0.1)
    assert found.chi2_in_band < 1.2
    # Of what leaves most of what there was, one does not know what to look for.
    assert (
        refine_switching_instant(wrong, trials, KINDS, None, 40.0).values[at]
        != found.values[at]
    )
    # Nor of what leaves far more than another law, but about the instant that it has.
    hopeless = refine_switching_instant(
        wrong, trials, KINDS, left / (1.01 * MAX_COST_RATIO), 100.0
    )
    assert (abs(hopeless.values[at] - jump_s) > 1.0) == (abs(begun_s - jump_s) > 10.0)
    near = refine_switching_instant(wrong, trials, KINDS, left / (0.99 * MAX_COST_RATIO), 100.0)
    assert near.values[at] == pytest.approx(jump_s, abs=0.1)
    # Who is late keeps what there is, before one has looked and after.
    assert (
        refine_switching_instant(wrong, trials, KINDS, None, 100.0, late=lambda: True) is wrong
    )
    told = iter([False, *[True] * 99])
    assert (
        refine_switching_instant(wrong, trials, KINDS, None, 100.0, late=lambda: next(told))
        is wrong
    )


@pytest.mark.parametrize(
    "off_s", [-6.0, 4.0, *(pytest.param(off, marks=pytest.mark.long) for off in (-4.0, 6.0))]
)
def test_the_instant_of_a_jump_is_reached_step_by_step(off_s):
    truth, trials = records_of_a_jump(72.41)
    at = truth.parameters.index(("effect", 0, "t_jump_s"))
    right = refit(truth, trials)
    values = right.values.copy()
    values[at] += off_s
    left = simulated_chi2(truth, values, right.states, right.noise, trials)
    wrong = dataclasses.replace(right, values=values, cost=left, chi2_in_band=1.4)
    found = refine_switching_instant(wrong, trials, KINDS, None, 0.0)
    assert found.values[at] == pytest.approx(72.41, abs=0.1)


def test_a_fit_that_leaves_only_noise_costs_no_search_for_an_instant():
    truth, trials = records_of_a_jump(72.41)
    fit = refit(truth, trials)
    with metered() as meter:
        assert refine_switching_instant(fit, trials, KINDS, None, 100.0) is fit
    assert meter.spent == 0


def test_a_refit_that_breaks_down_leaves_the_fit_as_it_is(monkeypatch):
    truth, trials = records_of_a_jump(72.41)
    at = truth.parameters.index(("effect", 0, "t_jump_s"))
    right = refit(truth, trials)
    values = right.values.copy()
    values[at] -= 1.0
    wrong = dataclasses.replace(right, values=values, chi2_in_band=1.4)

    begun = []

    def broken(*given, **how):
        begun.append(how)
        raise FloatingPointError("grows beyond bounds")

    monkeypatch.setattr(switching_instant, "refit", broken)
    assert refine_switching_instant(wrong, trials, KINDS, None, 0.0) is wrong
    assert len(begun) == 1
