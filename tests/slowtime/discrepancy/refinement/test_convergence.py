"""Wherever laws were compared, numbers are told from where the misfit is least."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import WRONG_MODEL_CHI2, refit
from slowtime.discrepancy.calibration.augmentation import simulated_chi2
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.refinement import convergence as bottom
from slowtime.discrepancy.state import Found
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
        assert how["control"].to_convergence
        found.append(dataclasses.replace(fit, values=1.001 * fit.values))
        return found[-1]

    monkeypatch.setattr(bottom, "refit", last)
    number = told(trials, late=lambda: late)
    assert len(found) == (not late)
    for fit in found:
        assert number.value == fit.values[fit.plant.parameters.index(NAME)]


def test_a_model_that_is_wrong_is_left_where_it_was(trials):
    plant = Plant.of(ONE, kinds=KINDS)
    fit = dataclasses.replace(refit(plant, trials), chi2_in_band=1.1 * WRONG_MODEL_CHI2)
    found = Found([fit], trials)
    bottom.converge(found, 0, KINDS)
    assert found.fits[0] is fit


RUBBING = Effect("coulomb", PLACE, {"friction_n": 0.25})
FRICTION = ("effect", 0, "friction_n")


@pytest.fixture(scope="module")
def rubbed():
    """Give records of dry friction, and a fit that ended two standard deviations beside."""
    known, rng = dataclasses.replace(ONE, effects=(RUBBING.entry(),)), np.random.default_rng(3)
    truth, records = Plant.of(known), []
    for _ in range(2):
        push = np.convolve(rng.standard_normal(1280), np.hanning(9), "same")[:, None]
        clean = truth.simulate(truth.values, push, RATE)
        seen = clean + 0.02 * clean.std(axis=0) * rng.standard_normal(clean.shape)
        records.append(Trial(inputs=push, outputs=seen, rate_hz=RATE))
    right = refit(truth, tuple(records))
    values = right.values.copy()
    at = right.prior.names.index(FRICTION)
    values[list(right.prior.index)] += 2 * right.covariance[:, at] / right.sd[at]
    left = simulated_chi2(truth, values, right.states, right.noise, tuple(records))
    return tuple(records), right, dataclasses.replace(right, values=values, cost=left)


@pytest.mark.long
def test_friction_goes_to_the_best_beside_where_it_ended_and_tells_how_those_scatter(rubbed):
    records, right, beside = rubbed
    found = Found([beside], records)
    bottom.converge_stick_slip(found, 1, catalogue(), Monitor())
    best, at = found.fits[-1], right.prior.names.index(FRICTION)
    assert best.cost <= right.cost + 0.1
    assert abs(best.free[at] - RUBBING.parameters["friction_n"]) < 3 * best.sd[at]
    assert best.sd[at] > right.sd[at]
    assert np.linalg.eigvalsh(best.covariance).min() > 0


@pytest.mark.parametrize("why", ["late", "ended", "no friction"])
def test_who_is_late_or_has_no_friction_or_no_law_stays(rubbed, trials, why):
    records, _, fit = rubbed
    if why == "no friction":
        records, fit = trials, refit(Plant.of(TRUTH, kinds=KINDS), trials)
    found = Found([fit], records, ended=why == "ended")
    bottom.converge_stick_slip(found, 1, catalogue(), Monitor(late=lambda: why == "late"))
    assert np.array_equal(found.fits[-1].values, fit.values)
    assert np.array_equal(found.fits[-1].covariance, fit.covariance)


def test_friction_is_not_held_at_less_than_nothing(rubbed, monkeypatch):
    records, right, _ = rubbed
    at = right.prior.names.index(FRICTION)
    faint = dataclasses.replace(right, covariance=right.covariance.copy())
    faint.covariance[at, at] = (0.6 * right.free[at]) ** 2
    held = []

    def kept(plant, trials, *, values, **how):
        held.append(values[right.prior.index[at]])
        return right

    monkeypatch.setattr(bottom, "refit", kept)
    bottom.converge_stick_slip(Found([faint], records), 1, catalogue(), Monitor())
    assert held
    assert min(held) > 0


NEARLY = 3
"""Which of the values beside the best is nearly as good."""


def test_of_friction_the_best_dip_is_told_as_far_as_the_fit_had_ended_from_it(
    rubbed, monkeypatch
):
    """One of the values that are held is better, one beside that nearly as good."""
    records, right, _ = rubbed
    at, index = right.prior.names.index(FRICTION), list(right.prior.index)
    calls = []

    def answered(plant, trials, *, values, control, free=None, **how):
        fine = control.to_convergence
        calls.append((values[index], free, fine))
        better = fine or len(calls) == 2
        nearly = len(calls) == 1 + NEARLY + len(bottom.BESIDE) + 1
        cost = right.cost + (-100 if better else -98 if nearly else 1000)
        return dataclasses.replace(right, values=values, cost=cost)

    monkeypatch.setattr(bottom, "refit", answered)
    found = Found([right], records)
    bottom.converge_stick_slip(found, 1, catalogue(), Monitor())
    best, off = found.fits[-1], bottom.BESIDE[1] * right.covariance[:, at] / right.sd[at]
    assert best.free == pytest.approx(right.free + off)
    near = bottom.BESIDE[NEARLY] * right.covariance[:, at] / right.sd[at]
    # Found twice, as it was held and as it was freed, and one of a chance of exp(-1) beside.
    weight = np.exp(-1) / (2 + np.exp(-1))
    due = right.covariance + weight * np.outer(near, near) + np.outer(off, off) / 2
    assert best.covariance == pytest.approx(due)
    rounds = [values[at] for values, free, _ in calls if free is not None]
    about = np.repeat([right.free[at], best.free[at]], len(bottom.BESIDE))
    assert rounds == pytest.approx(about + right.sd[at] * np.tile(bottom.BESIDE, 2))
    assert all(FRICTION not in free for _, free, _ in calls if free is not None)
