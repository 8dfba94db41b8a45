"""Motion of the base that nobody measured is told from forces, laws and faults of sensors."""

import dataclasses

import numpy as np
import pytest
import scipy.ndimage

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.estimation.candidate_fit import fit_candidates
from slowtime.discrepancy.localization import characterise, locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers.base_motion import (
    apart,
    by_a_law,
    follows,
    is_made_by_motion,
)
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.search import SearchSettings, search
from slowtime.dynamics.description import Input, Sensor
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import candidate, fit_effect, in_budget
from tests.slowtime.discrepancy.rigs import ONE, PLACE
from tests.slowtime.discrepancy.three_mass_chain import EVERY, GROUND, RATE, THREE, recorded

KINDS = catalogue()
CUBIC = Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 1e5})


@pytest.fixture(scope="module")
def hardening():
    """A spring that hardens strongly: its records, the fit without it, and with it."""
    trials = recorded(ONE, (CUBIC,), level=2.0)
    before = refit_within_tolerances(refit(Plant.of(ONE, kinds=KINDS), trials), trials)
    return trials, before, fit_effect(before, CUBIC, trials, KINDS)


def others_left(located, left):
    """Let forces at other places leave so many times what one at the best place does."""
    first = dataclasses.replace(located.groups[0], left=1.0, twins=())
    rest = (dataclasses.replace(one, left=left) for one in located.groups[1:])
    return dataclasses.replace(located, groups=(first, *rest))


@pytest.mark.parametrize(("left", "made"), [(0.52, True), (0.58, True), (0.72, False)])
def test_no_law_explains_two_fifths_of_what_a_moving_base_does(hardening, left, made):
    trials, before, fitted = hardening
    law = fitted.fit
    bar = refit(before.plant, trials, noise=law.noise, values=before.values,
                states=before.states, horizons=(1.0,))  # fmt: skip
    poor = dataclasses.replace(law, cost=law.data + left * (bar.cost - bar.data))
    assert follows(poor, before, trials) is made


def test_a_law_whose_free_run_explains_half_is_no_motion_of_the_base(hardening):
    trials, before, fitted = hardening
    assert follows(fitted.fit, before, trials)
    damping = Effect("viscous_damping", PLACE, {"dc_n_s_per_m": 0.1})
    drag = fit_candidates(before, [candidate(damping)], trials, KINDS, in_budget)
    assert not any(follows(one.fit, before, trials) for one in drag)


@pytest.mark.parametrize(
    ("left", "elsewhere", "law"),
    [(6.0, False, False), (6.0, True, True), (4.0, False, True), (None, True, False)],
)
def test_a_law_that_leaves_much_is_none_where_only_the_base_leaves_nothing(
    hardening, left, elsewhere, law
):
    """`elsewhere`: a force at another place leaves as little."""
    trials, before, fitted = hardening
    fit = dataclasses.replace(fitted.fit, chi2_in_band=left or 1.0)
    fits = [dataclasses.replace(fitted, fit=fit)] if left else []
    located = others_left(locate(before, trials), 1.0 if elsewhere else 10.0)
    assert apart(located) is not elsewhere
    label = candidate(CUBIC, 1.0, cost_without=1e9)
    assert by_a_law(fits, [label], before, trials, located) is law


@pytest.mark.parametrize(("share", "law"), [(0.05, False), (0.3, True)])
def test_a_law_whose_free_run_follows_has_to_explain_the_force_too(hardening, share, law):
    """What swings with a mode by itself goes with what shakes it, and makes no such force."""
    trials, before, fitted = hardening
    label = candidate(CUBIC, (1 - share) * 1e9, cost_without=1e9)
    located = others_left(locate(before, trials), 1.0)
    assert by_a_law([fitted], [label], before, trials, located) is law


@pytest.mark.long
def test_friction_to_the_ground_is_not_taken_for_a_motion_of_it():
    """Any force of the ground's spring is some motion of the ground."""
    few = {name: KINDS[name] for name in ("coulomb", "base_motion", "added_mass")}
    trials = recorded(
        EVERY, (Effect("coulomb", GROUND, {"friction_n": 2.0}),), level=4.0, seconds=8.0
    )
    first = refit(Plant.of(EVERY, kinds=few), trials)
    found = search(first, trials, SearchSettings(few, Monitor()))
    assert [(a.effect.kind, a.effect.place) for a in found.effects] == [("coulomb", GROUND)]


@pytest.mark.long
def test_a_force_that_its_own_motion_makes_is_no_motion_of_the_ground():
    """Whatever the law, and though none is known that does it."""
    few = {name: KINDS[name] for name in ("base_motion", "added_mass")}
    trials = recorded(
        EVERY, (Effect("cubic_hardening", GROUND, {"k3_n_per_m3": 3e5}),), seconds=16.0
    )
    found = search(
        refit(Plant.of(EVERY, kinds=few), trials), trials, SearchSettings(few, Monitor())
    )
    assert found.localized is not None
    assert found.localized.with_base_first().best.kind == "base"
    assert found.localized.best_structural == GROUND
    assert "base_motion" not in [answer.effect.kind for answer in found.effects]


@pytest.mark.long
@pytest.mark.parametrize(
    ("surface", "filtered", "linear", "made"),
    [(0.97, 0.91, False, True), (0.7, 0.47, False, True), (0.7, 0.65, False, False),
     (0.99, 1.0, True, False), (0.2, 0.95, False, False)],
)  # fmt: skip
def test_a_force_that_curves_with_the_motion_where_it_acts_is_made_there(
    surface, filtered, linear, made
):
    trials = recorded(THREE, (Effect("coulomb", GROUND, {"friction_n": 1.5}),), seconds=4.0)
    located = locate(refit(Plant.of(THREE, kinds=KINDS), trials), trials)
    there = dataclasses.replace(
        characterise(located, GROUND),
        static_share=surface,
        linear_share=filtered,
        linear=linear,
    )
    assert is_made_by_motion(there) is made


@pytest.mark.long
@pytest.mark.parametrize("measured", [False, True])
def test_a_motion_of_the_base_is_unmeasured_only_where_it_is_no_input(measured):
    ground = Input(channel="u", kind="base_acceleration", unit="m/s^2")
    every = dataclasses.replace(EVERY, inputs=(ground,)) if measured else EVERY
    few = {name: KINDS[name] for name in ("base_motion", "added_mass")}
    plant = Plant.of(every, kinds=few)
    rng = np.random.default_rng(8)
    push, shake = (
        level * np.convolve(rng.standard_normal(1000), np.hanning(9) / 2, "same")
        for level in (3.0, 2.0)
    )
    if measured:
        clean = plant.simulate(plant.values, (push + shake)[:, None], RATE)
    else:
        clean = plant.simulate(plant.values, push[:, None], RATE, base=shake)
    noise = 0.01 * clean.std(axis=0) * rng.standard_normal(clean.shape)
    trials = (Trial(inputs=push[:, None], outputs=clean + noise, rate_hz=RATE),)
    found = search(refit(plant, trials), trials, SearchSettings(few, Monitor()))
    named = [answer.effect.kind for answer in found.effects]
    assert ("base_motion" in named) is not measured


@pytest.mark.long
def test_a_slow_error_of_the_only_sensor_is_its_drift_and_no_motion_of_the_base():
    """The base would do the same to one accelerometer."""
    sensor = Sensor(channel="a", quantity="acceleration", node="m1", unit="m/s^2")
    one = dataclasses.replace(ONE, sensors=(sensor,))
    few = {name: KINDS[name] for name in ("sensor_drift", "base_motion", "coulomb")}
    rng = np.random.default_rng(14)
    trials = []
    for trial in recorded(one, (), seconds=20.0):
        walk = np.cumsum(rng.standard_normal(len(trial.outputs)))
        smooth = scipy.ndimage.gaussian_filter1d(walk, 0.8 * RATE)[:, None]
        trials.append(dataclasses.replace(trial, outputs=trial.outputs + 0.05 * smooth))
    seen = tuple(trials)
    found = search(refit(Plant.of(one, kinds=few), seen), seen, SearchSettings(few, Monitor()))
    assert [answer.effect.kind for answer in found.effects] == ["sensor_drift"]


@pytest.mark.long
def test_the_size_of_a_motion_of_the_base_is_told_by_the_records_that_show_it():
    few = {name: KINDS[name] for name in ("base_motion", "added_mass")}
    plant = Plant.of(EVERY, kinds=few)
    rng = np.random.default_rng(11)
    trials = []
    for loud in (0.01, 3.0):
        push, shake = (
            level * np.convolve(rng.standard_normal(2000), np.hanning(9) / 2, "same")
            for level in (3.0, 2.0)
        )
        clean = plant.simulate(plant.values, push[:, None], RATE, base=shake)
        noise = loud * clean.std(axis=0) * rng.standard_normal(clean.shape)
        trials.append(Trial(inputs=push[:, None], outputs=clean + noise, rate_hz=RATE))
    seen = tuple(trials)
    found = search(refit(plant, seen), seen, SearchSettings(few, Monitor()))
    (answer,) = found.effects
    told = answer.numbers["rms_m_per_s2"]
    assert answer.effect.kind == "base_motion"
    assert abs(told.value - 2.0 * np.sqrt(np.sum(np.hanning(9) ** 2) / 4)) < 2 * told.sd
    assert told.sd < 0.1 * told.value
