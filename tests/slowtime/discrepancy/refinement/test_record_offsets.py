"""Offsets that differ from record to record are estimated as initial states are."""

import dataclasses

import numpy as np
import pytest
import scipy.integrate

from slowtime.discrepancy.calibration import initial_state_sds, refit
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.constant_offsets import (
    BY_RECORD,
    differing_sensors,
    offsets,
    refit_with_offsets,
    with_mean_offsets,
)
from slowtime.discrepancy.validation.free_run import free_runs, relative_errors
from slowtime.dynamics.effects import catalogue
from slowtime.dynamics.elements import Spring
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import ONE

KINDS = catalogue()
RATE = 64.0
NOISE = 2e-4


def recorded(offset, seed, bent=0.0, level=1.0):
    """Record of the oscillator by another integrator; `bent` is a spring of one side."""
    node, element = ONE.nodes[0], ONE.elements[0]
    assert isinstance(element, Spring)
    rng = np.random.default_rng(seed)
    times = np.arange(640) / RATE
    tones = rng.uniform(0.3, 2.0, 12), rng.uniform(0, 2 * np.pi, 12)

    def push(t):
        return level * np.sum(np.sin(2 * np.pi * tones[0] * t + tones[1]))

    def rate(t, y):
        resisted = element.stiffness_n_per_m * y[0] * (1 + bent * y[0])
        resisted += element.damping_n_s_per_m * y[1]
        return [y[1], (push(t) - resisted) / node.mass_kg]

    moved = scipy.integrate.solve_ivp(
        rate, (0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-12
    )
    force = np.array([push(t) for t in times])[:, None]
    seen = moved.y[0] + offset * moved.y[0].std() + NOISE * rng.standard_normal(len(times))
    return Trial(inputs=force, outputs=seen[:, None], rate_hz=RATE), offset * moved.y[0].std()


OFFSETS = [(-0.5, 0.3), (0.1, -0.1, 0.4), (0.0, 1.5, -0.2)]


@pytest.mark.parametrize("factors", OFFSETS)
def test_each_record_gets_its_own_offset(factors):
    made = [recorded(factor, seed) for seed, factor in enumerate(factors)]
    trials = tuple(trial for trial, _ in made)
    fit = refit_with_offsets(ONE, trials, KINDS, decays=False)
    assert [effect.kind for effect in fit.plant.effects] == [BY_RECORD]
    (named,) = offsets(fit, trials, ONE, KINDS)
    assert list(named.numbers) == [f"record {i + 1}" for i in range(len(made))]
    for number, (_, offset) in zip(named.numbers.values(), made, strict=True):
        assert abs(number.value - offset) < 5 * number.sd
        assert number.sd < 3 * NOISE
    assert fit.chi2_in_band < 1.5


@pytest.mark.parametrize(
    ("factors", "bent"),
    [((0.0, 0.0), 0.0), ((0.4, 0.4), 0.0), ((0.0, 0.0, 0.0), 5.0), ((0.0, 0.0), -5.0)],
    ids=["none", "one for all", "stiffer one way", "stiffer the other way"],
)
def test_no_record_gets_one_where_one_law_shifts_all(factors, bent):
    made = [recorded(f, seed, bent, 1 + seed) for seed, f in enumerate(factors)]
    trials = tuple(trial for trial, _ in made)
    fit = refit(Plant.of(ONE, kinds=KINDS), trials)
    assert differing_sensors(fit, trials) == ()
    assert refit_with_offsets(ONE, trials, KINDS, decays=False).plant.effects == ()


@pytest.mark.parametrize("kept", [0, 3])
def test_a_record_in_which_a_sensor_says_nothing_shows_no_offset_of_it(kept):
    trials = tuple(recorded(factor, seed)[0] for seed, factor in enumerate((-0.5, 0.3)))
    fit = refit(Plant.of(ONE, kinds=KINDS), trials)
    channel = ONE.sensors[0].channel
    assert differing_sensors(fit, trials) == (channel,)
    use = np.zeros((len(trials[1].outputs), 1), dtype=bool)
    use[:kept] = True
    silent = dataclasses.replace(trials[1], use=use)
    assert differing_sensors(fit, (trials[0], silent)) == ()


def test_a_held_out_record_estimates_its_own():
    trials = tuple(recorded(factor, seed)[0] for seed, factor in enumerate((-0.5, 0.3)))
    fit = refit_with_offsets(ONE, trials, KINDS, decays=False)
    others = [recorded(1.2, 7)[0]]
    error = float(relative_errors(others, free_runs(fit, others)).max())
    assert error < 0.05
    common = refit(Plant.of(ONE, kinds=KINDS), trials)
    assert error < 0.1 * float(relative_errors(others, free_runs(common, others)).max())


def test_the_model_that_is_kept_has_the_mean():
    trials = tuple(recorded(factor, seed)[0] for seed, factor in enumerate((-0.5, 0.3)))
    fit = refit_with_offsets(ONE, trials, KINDS, decays=False)
    kept = with_mean_offsets(fit)
    for state, trial, outputs in zip(kept.states, trials, fit.outputs, strict=True):
        run = kept.plant.simulate(kept.values, trial.inputs, RATE, state0=state)
        assert run == pytest.approx(outputs)
    assert sum(state[-1] for state in kept.states) == pytest.approx(0.0)
    told = [
        [n.value for n in offsets(one, trials, ONE, KINDS)[0].numbers.values()]
        for one in (fit, kept)
    ]
    assert told[0] == pytest.approx(told[1])


@pytest.mark.parametrize(
    ("kind", "place"),
    [("sensor_bias_by_record", "sensor"), ("input_bias_by_record", "input")],
)
def test_a_run_is_shifted_by_the_constant_and_its_slopes_are_exact(kind, place):
    channel = (ONE.sensors if place == "sensor" else ONE.inputs)[0].channel
    model = dataclasses.replace(ONE, effects=({"effect": kind, place: channel, "bias": 0.3},))
    plant, bare = Plant.of(model, kinds=KINDS), Plant.of(ONE, kinds=KINDS)
    push = np.sin(np.arange(300) / 7.0)[:, None]
    state = np.array([0.0, 0.0, 0.2])
    run, slopes = plant.sensitivities(plant.values, push, RATE, [], state0=state)
    shifted = push + 0.5 if place == "input" else push
    expected = bare.simulate(bare.values, shifted, RATE, state0=state[:2])
    assert run == pytest.approx(expected + (0.5 if place == "sensor" else 0.0), abs=1e-7)
    more = plant.simulate(plant.values, push, RATE, state0=np.array([0.0, 0.0, 0.201]))
    assert slopes[:, :, 2] == pytest.approx((more - run) / 1e-3, abs=1e-8)


def test_offsets_are_as_well_known_as_their_scatter_over_noise():
    """Standard deviations of initial states are those of repeated fits."""
    found, told = [], []
    for seed in range(12):
        made = [recorded(0.3 * sign, 50 + 2 * seed + i) for i, sign in enumerate((1, -1))]
        trials = tuple(trial for trial, _ in made)
        model = dataclasses.replace(
            ONE, effects=({"effect": BY_RECORD, "sensor": ONE.sensors[0].channel},)
        )
        fit = refit(Plant.of(model, kinds=KINDS), trials)
        for state, sd, (_, offset) in zip(
            fit.states, initial_state_sds(fit, trials), made, strict=True
        ):
            found.append(state[-1] - offset)
            told.append(sd[-1])
    ratio = np.std(found) / np.sqrt(np.mean(np.square(told)))
    assert 0.6 < ratio < 1.6
