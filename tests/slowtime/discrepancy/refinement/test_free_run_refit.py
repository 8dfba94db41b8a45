"""Constants are refitted to free runs, where pieces left out are predicted better."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.quoting import requoted_by_place
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.free_run_refit import (
    MAX_RATIO,
    are_constants_alike,
    contradicted_constants,
    estimate_of,
    plain_weights,
    refit_plainly,
    refit_to_free_runs,
)
from slowtime.discrepancy.validation.free_run import free_runs, relative_errors
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import fit_at, named_effect
from tests.slowtime.discrepancy.refinement.test_constant_offsets import drive
from tests.slowtime.discrepancy.rigs import ONE

KINDS = catalogue()
RATE, FINE = 100.0, 20


def motion(force, mass, resists):
    """Motion of a mass without support, by short explicit steps of its own.

    `resists` gives the force against the motion at a place and a speed.
    """
    place = speed = 0.0
    found = np.empty(len(force))
    step = 1 / (RATE * FINE)
    for number, push in enumerate(force):
        found[number] = place
        for _ in range(FINE):
            speed += step * (push - resists(place, speed)) / mass
            place += step * speed
    return found


def driven(seed, seconds, resists):
    """Record of a drive that steps to and fro, with an offset of its force."""
    rng = np.random.default_rng(seed)
    times = np.arange(int(seconds * RATE)) / RATE
    levels = np.tile([1.0, -1.0], 40) * rng.uniform(0.6, 1.0, 80)
    force = 8.0 * np.repeat(levels, int(0.8 * RATE))[: len(times)]
    force += 4.0 * np.sin(2 * np.pi * 0.7 * times)
    outputs = motion(force - 0.3, 10.0, resists)[:, None]
    outputs = outputs + 1e-6 * rng.standard_normal(outputs.shape)
    return Trial(inputs=force[:, None], outputs=outputs, rate_hz=RATE)


def fitted(trials):
    bias = {"effect": "input_bias", "input": "force", "bias": 0.0}
    return refit(Plant.of(drive(bias, damping=25.0), kinds=KINDS), trials)


def held_out_error(fit, trials):
    return float(np.mean(relative_errors(trials, free_runs(fit, trials))))


DRAGS = {
    "friction": lambda place, speed: 20.0 * speed + 0.5 * np.tanh(speed / 1e-3),
    "drag": lambda place, speed: 20.0 * speed + 20.0 * abs(speed) * speed,
    "wear": lambda place, speed: 20.0 * speed * (1 + 0.4 * np.sin(9.0 * place)),
}
BIAS, DAMPING = ("effect", 0, "bias"), ("damping", "guide")
BENT = {"bias": (BIAS, 1.6), "damping": (DAMPING, 1.3), "none": (BIAS, 1.0)}


@pytest.mark.long
@pytest.mark.parametrize("law", DRAGS)
def test_what_is_kept_predicts_other_records_better(law):
    """Over drives that the model has not the law of, fitted well and bent by wrong weights."""
    gains = {}
    for bent, (name, factor) in BENT.items():
        trials = (driven(1, 24.0, DRAGS[law]),)
        before = fitted(trials)
        values = before.values.copy()
        values[before.plant.parameters.index(name)] *= factor
        before = fit_at(before, trials, values, chi2_in_band=before.chi2_in_band)
        found = refit_to_free_runs(before, trials)
        if found is not None:
            others = [driven(100 + n, 24.0, DRAGS[law]) for n in range(2)]
            errors = [held_out_error(fit, others) for fit in (before, found.fit)]
            gains[bent] = np.log(errors[0] / errors[1])
    assert all(gain > -0.05 for gain in gains.values())
    assert "none" not in gains
    if law != "wear":  # whose pieces differ more among themselves
        assert set(gains) == {"bias", "damping"}


def test_a_model_that_leaves_noise_only_stays_as_it_is():
    rng = np.random.default_rng(2)
    plant = Plant.of(ONE, kinds=KINDS)
    push = np.convolve(rng.standard_normal(1024), np.hanning(9) / 2, "same")[:, None]
    clean = plant.simulate(plant.values, push, RATE)
    seen = clean + 0.02 * clean.std() * rng.standard_normal(clean.shape)
    trials = (Trial(inputs=push, outputs=seen, rate_hz=RATE),)
    assert refit_to_free_runs(refit(plant, trials), trials) is None


@pytest.mark.parametrize("seconds", [4.0])
def test_a_record_too_short_for_pieces_stays_as_it_is(seconds):
    trials = (driven(1, seconds, DRAGS["wear"]),)
    assert refit_to_free_runs(fitted(trials), trials) is None


def test_a_number_is_quoted_from_the_refit_only_where_pieces_agree_on_it():
    fit = fitted((driven(1, 6.0, DRAGS["wear"]),))
    names = list(fit.prior.names)
    bias, damping = names.index(BIAS), names.index(DAMPING)

    def changed(of_bias, of_damping):
        values = fit.values.copy()
        values[fit.prior.index[bias]] += of_bias
        values[fit.prior.index[damping]] += of_damping
        return dataclasses.replace(fit, values=values)

    again = changed(0.5, 3.0)
    others = [changed(0.5 + 0.02 * off, 3.0 + 4.0 * off) for off in (-1.0, 0.5, 1.0, -0.5)]
    moves = contradicted_constants(fit, again, others)
    assert moves[bias]
    assert not moves[damping]
    told = estimate_of(fit, again, moves)
    assert told.free[damping] == fit.free[damping]
    assert told.sd[damping] == fit.sd[damping]
    assert told.free[bias] == again.free[bias]
    # Two weights told different values: half the square of the change is added.
    assert told.inflated_sd[bias] > 0.5 / np.sqrt(2)


def test_plain_weights_lead_downhill_on_the_mean_relative_error():
    """One small change of a residual changes chi squared and the judged error alike."""
    trial = driven(3, 6.0, DRAGS["wear"])
    both = np.hstack([trial.outputs, 7 * trial.outputs**2])
    two = Trial(inputs=trial.inputs, outputs=both, rate_hz=RATE)
    rng = np.random.default_rng(4)
    left = rng.standard_normal(two.outputs.shape) * [1e-3, 0.5]
    fit = dataclasses.replace(fitted((trial,)), residual=(left,), outputs=(both,))
    noise = plain_weights(fit, (two,))
    variance = noise.sd(0, RATE) ** 2

    def judged(residual):
        return np.mean(np.sqrt(np.mean(residual**2, axis=0)) / two.outputs.std(axis=0))

    def weighed(residual):
        return np.sum(residual**2 / variance)

    slopes = []
    for direction in rng.standard_normal((4, *left.shape)):
        moved = left + 1e-6 * direction * left.std(axis=0)
        slopes.append((judged(moved) - judged(left)) / (weighed(moved) - weighed(left)))
    assert slopes == pytest.approx([slopes[0]] * 4, rel=1e-3)
    assert weighed(left) == pytest.approx(left.size)


@pytest.mark.parametrize(
    ("factor", "alike"),
    [(1.3, True), (0.9 * MAX_RATIO, True), (1.1 * MAX_RATIO, False), (-1.0, False)],
)
def test_constants_that_changed_sign_or_size_are_others(factor, alike):
    trials = (driven(5, 8.0, DRAGS["drag"]),)
    before = fitted(trials)
    values = before.values.copy()
    values[before.prior.index[0]] *= factor
    assert are_constants_alike(before, dataclasses.replace(before, values=values)) is alike


@pytest.mark.long
def test_the_change_counts_among_what_is_not_known():
    trials = (driven(1, 24.0, DRAGS["friction"]),)
    right = fitted(trials)
    values = right.values.copy()
    values[right.plant.parameters.index(BIAS)] *= 1.6
    before = fit_at(right, trials, values, chi2_in_band=right.chi2_in_band)
    found = refit_to_free_runs(before, trials)
    assert found is not None
    off = found.fit.free - before.free
    assert (found.fit.inflated_sd**2 >= 0.49 * off**2).all()
    plain = refit_plainly(before, trials, trials)
    assert plain is not None
    assert found.fit.free == pytest.approx(plain.free)


def test_answers_are_quoted_from_the_refit_wherever_their_effect_stands():
    """Offsets stand before the laws in the model, and behind them among the answers."""
    trials = (driven(1, 12.0, DRAGS["drag"]),)
    drag = {"effect": "quadratic_damping", "element": "guide", "c2_n_s2_per_m2": 18.0}
    bias = {"effect": "input_bias", "input": "force", "bias": 0.0}
    fit = refit(Plant.of(drive(bias, drag), kinds=KINDS), trials)
    other = refit_plainly(fit, trials, trials)
    assert other is not None
    law = Effect("quadratic_damping", Place("element", "guide"), {"c2_n_s2_per_m2": 1.0})
    offset = Effect("input_bias", Place("input", "force"), {"bias": 1.0})
    fault = Effect("sensor_bias", Place("sensor", "x"), {"bias": 1.0})
    answers = [named_effect(one, KINDS) for one in (law, offset, fault)]
    told = requoted_by_place(answers, other, KINDS)
    values = dict(zip(other.plant.parameters, other.values.tolist(), strict=True))
    assert told[0].numbers["c2_n_s2_per_m2"].value == values["effect", 1, "c2_n_s2_per_m2"]
    assert told[1].numbers["bias"].value == values["effect", 0, "bias"]
    assert told[2] is answers[2]
