"""Initial states are found where a record begins unlike all that follows."""

import dataclasses
import math

import numpy as np
import pytest

from slowtime.discrepancy.calibration import (
    first_periods,
    motion_amplitude,
    multistart_initial_state,
    refit,
    state_from_sensors,
)
from slowtime.discrepancy.calibration.initial_states import best_initial_state
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.noise.colour import white_noise
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.refinement.initial_states import restart_initial_states, restarted
from slowtime.discrepancy.search import SearchSettings
from slowtime.discrepancy.search.next_effect import accept_best
from slowtime.discrepancy.selection.probabilities import answer_of
from slowtime.discrepancy.validation.free_run import free_runs
from slowtime.dynamics.description import Input, Sensor
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy import three_mass_chain
from tests.slowtime.discrepancy.protocol import fit_at
from tests.slowtime.discrepancy.rigs import ONE, PLACE, one_mass, two_masses

KINDS = catalogue()
RATE, SD = 100.0, 0.02
SINGS = Effect("van_der_pol", PLACE, {"cn_n_s_per_m": 6.0, "e0_m": 0.01})
HEARD = dataclasses.replace(
    one_mass(),
    sensors=(Sensor(channel="a", quantity="acceleration", node="m1", unit="m/s^2"),),
)


def plant_of(effect, description=HEARD):
    return Plant.of(dataclasses.replace(description, effects=(effect.entry(),)), kinds=KINDS)


def recorded(plant, begins, seconds=20.0, size=0.5, seed=1):
    rng = np.random.default_rng(seed)
    samples, found = int(seconds * RATE), []
    for begin in begins:
        push = size * rng.standard_normal((samples, 1))
        seen = plant.simulate(plant.values, push, RATE, state0=np.array(begin))
        noise = SD * rng.standard_normal(seen.shape)
        found.append(Trial(inputs=push, outputs=seen + noise, rate_hz=RATE))
    return tuple(found)


@pytest.fixture(scope="module")
def thrown():
    """What sings by itself, thrown far beyond where it does; and a fit that began elsewhere."""
    plant = plant_of(SINGS)
    begins = [[0.01, 0.0], [0.09, -2.0]]
    trials = recorded(plant, begins)
    right = refit(plant, trials, states=[np.array(b) for b in begins], horizons=(1.0,))
    states = (right.states[0], np.array([-0.03, 0.9]))
    stray = fit_at(right, trials, right.values, states, cost=right.cost, chi2_in_band=20.0)
    return plant, trials, right, stray


@pytest.mark.long
def test_a_record_whose_beginning_is_explained_badly_gets_another_initial_state(thrown):
    _, trials, right, stray = thrown
    again = restarted(stray, trials)
    assert again is not None
    assert again.chi2_in_band == pytest.approx(right.chi2_in_band, rel=0.01)
    assert again.states[1] == pytest.approx([0.09, -2.0], abs=0.02)


@pytest.fixture(scope="module")
def named(thrown):
    """The same as an effect of a hypothesis."""
    plant, trials, _, stray = thrown
    answer = answer_of([FittedCandidate(SINGS, plant.description, stray, 0.0)], [1.0], KINDS)
    return Hypothesis((stray, stray), trials, effects=(answer,))


@pytest.mark.long
def test_effects_are_quoted_by_the_fit_from_other_initial_states(thrown, named):
    plant, _, right, stray = thrown
    found = restart_initial_states(named, KINDS)
    assert named.last is stray
    told = found.effects[0].numbers["cn_n_s_per_m"]
    values = dict(zip(plant.parameters, right.values.tolist(), strict=True))
    assert told.value == pytest.approx(values["effect", 0, "cn_n_s_per_m"], rel=0.02)
    assert restart_initial_states(found, KINDS) is found


def test_initial_states_of_segments_and_under_another_hold_are_kept(named):
    cut = dataclasses.replace(named, trials=(*named.trials, named.trials[0]))
    assert restart_initial_states(cut, KINDS) is cut
    held = dataclasses.replace(named, holds=("zero",))
    assert restart_initial_states(held, KINDS) is held


def test_a_record_that_begins_as_it_goes_on_keeps_its_initial_state(thrown):
    _, trials, right, stray = thrown
    assert restarted(right, trials) is None
    loud = dataclasses.replace(
        right, residual=tuple(SD * np.ones_like(r) for r in right.residual), chi2_in_band=20.0
    )
    assert restarted(loud, trials) is None
    noise = dataclasses.replace(stray, chi2_in_band=2.0)
    assert restarted(noise, trials) is None
    short = dataclasses.replace(stray, residual=tuple(r[:300] for r in stray.residual))
    assert restarted(short, tuple(t.part(0, 300) for t in trials)) is None


@pytest.mark.long
def test_other_initial_states_that_leave_more_are_not_taken(thrown):
    _, trials, _, stray = thrown
    least = dataclasses.replace(stray, residual=tuple(1e-6 * r for r in stray.residual))
    assert restarted(least, trials) is None


@pytest.mark.long
def test_an_initial_state_is_found_from_far_away_and_a_good_one_is_kept(thrown):
    plant, trials, right, _ = thrown
    (head,) = first_periods(plant, trials[1:])
    noise = right.noise.for_trials([1])
    size = motion_amplitude(plant, trials[1], right.values, np.array([0.02, 0.5]))
    found = multistart_initial_state(
        plant, head, noise, right.values, np.array([-0.03, 0.9]), size
    )
    assert found == pytest.approx([0.09, -2.0], abs=0.03)
    known = refit(
        plant, (head,), free=[], noise=noise, values=right.values, states=(found,),
        horizons=(1.0,),
    ).states[0]  # fmt: skip
    assert multistart_initial_state(plant, head, noise, right.values, known, 0 * size) is known


@pytest.mark.long
def test_initial_states_are_sought_near_what_sensors_read_and_where_runs_stay_bounded():
    sensors = (
        Sensor(channel="x", quantity="displacement", node="m1", unit="m"),
        Sensor(channel="v", quantity="velocity", node="m1", unit="m/s"),
    )
    well = plant_of(
        Effect("quadratic_stiffness", PLACE, {"k2_n_per_m2": -8000.0}),
        dataclasses.replace(HEARD, sensors=sensors),
    )
    turns = plant_of(Effect("pendulum_sine", PLACE, {"k": 800.0}), well.description)
    away, nowhere = np.array([0.3, 0.0]), np.zeros(2)
    noise = white_noise([[1e-8, 1e-8]])
    for plant, begin, size in (
        (well, np.array([0.05, 0.2]), away),
        (turns, np.array([13.0, 1.0]), nowhere),
    ):
        clean = plant.simulate(plant.values, np.zeros((100, 1)), RATE, state0=begin)
        trial = Trial(inputs=np.zeros((100, 1)), outputs=clean, rate_hz=RATE)
        found = multistart_initial_state(plant, trial, noise, plant.values, away, size)
        assert found == pytest.approx(begin, abs=1e-4)


def test_the_size_of_a_motion_is_that_of_its_run_and_at_least_its_initial_state(thrown):
    plant, trials, right, _ = thrown
    still = motion_amplitude(plant, trials[0], right.values, np.array([0.01, 0.0]))
    assert still == pytest.approx([0.0141, 0.0141 * 20.0], rel=0.25)
    far = np.array([0.3, -9.0])
    assert (motion_amplitude(plant, trials[0], right.values, far) >= np.abs(far)).all()


def test_sensors_of_displacement_and_velocity_give_the_initial_state():
    description = dataclasses.replace(
        two_masses(1.6),
        sensors=(
            Sensor(channel="x2", quantity="displacement", node="m2", unit="mm"),
            Sensor(channel="v1", quantity="velocity", node="m1", unit="m/s"),
            Sensor(channel="a1", quantity="acceleration", node="m1", unit="m/s^2"),
        ),
    )
    plant = Plant.of(description, kinds=KINDS)
    outputs = np.tile([3.0, 0.5, 7.0], (64, 1))
    trial = Trial(inputs=np.zeros((64, 1)), outputs=outputs, rate_hz=RATE)
    known = np.array([0.1, 0.2, 0.3, 0.4])
    assert state_from_sensors(plant, trial, known) == pytest.approx([0.1, 0.003, 0.5, 0.4])
    outputs[0, 0] = np.nan
    deaf = dataclasses.replace(trial, outputs=outputs, use=np.isfinite(outputs))
    assert state_from_sensors(plant, deaf, known) == pytest.approx([0.1, 0.2, 0.5, 0.4])


def test_beside_a_moving_base_only_relative_motion_gives_the_initial_state():
    still = Sensor(
        channel="x2", quantity="displacement", node="m2", unit="m", frame="relative_to_base"
    )
    moved = dataclasses.replace(still, channel="x1", node="m1", frame="absolute")
    sensors = (moved, still)
    base = (Input(channel="ab", kind="base_acceleration", unit="m/s^2"),)
    plant = Plant.of(
        dataclasses.replace(two_masses(1.6), sensors=sensors, inputs=base), kinds=KINDS
    )
    trial = Trial(inputs=np.zeros((64, 1)), outputs=np.full((64, 2), 0.7), rate_hz=RATE)
    assert state_from_sensors(plant, trial, np.zeros(4)) == pytest.approx([0.0, 0.7, 0.0, 0.0])


def test_the_nearest_initial_state_has_the_nearest_run_and_a_bounded_one():
    well = plant_of(Effect("quadratic_stiffness", PLACE, {"k2_n_per_m2": -8000.0}))
    (trial,) = recorded(well, [[0.02, 0.1]], seconds=2.0)
    noise = white_noise([[SD**2 * 2 / RATE]])
    right, off, away = np.array([0.02, 0.1]), np.array([0.03, 0.0]), np.array([0.3, 0.0])
    assert not np.isfinite(well.simulate(well.values, trial.inputs, RATE, state0=away)).all()
    assert best_initial_state(well, trial, noise, well.values, [away, off, right]) is right
    assert best_initial_state(well, trial, noise, well.values, [away, off]) is off


@pytest.mark.long
def test_a_record_held_out_is_run_from_its_own_initial_state(thrown):
    """The free run by which a law is judged is lost where it begins in the wrong swing."""
    plant, _, right, _ = thrown
    trials = recorded(plant, [[0.12, -3.0], [-0.1, 2.5]], seed=7)
    for trial, run in zip(trials, free_runs(right, trials), strict=True):
        assert np.std(trial.outputs - run) < 1.1 * SD


@pytest.mark.long
def test_a_law_found_from_a_wrong_initial_state_predicts_a_record_held_out():
    """Without a second look at how the second record begins, the error is ten times that."""
    trials = recorded(plant_of(SINGS), [[0.01, 0.0], [0.09, -3.0], [0.0, 0.1]], seed=2)
    campaign = Campaign(description=HEARD, trials=trials[:2], holdout=trials[2:])
    few = ("van_der_pol", "viscous_damping", "quadratic_damping", "cubic_hardening")
    told = diagnose(campaign, kinds={name: KINDS[name] for name in few})
    assert [one.effect.kind for one in told.effects] == ["van_der_pol"]
    assert told.gap.augmented < 1.1 * told.gap.noise_floor


@pytest.mark.long
@pytest.mark.parametrize("over", [False, True])
def test_an_accepted_law_gets_other_initial_states_while_there_is_budget(thrown, over):
    plant, trials, right, stray = thrown
    first = refit(Plant.of(HEARD, kinds=KINDS), trials)
    fitted = FittedCandidate(SINGS, plant.description, stray, -stray.cost / 2)
    how = SearchSettings(KINDS, Monitor(late=lambda: True, over=lambda: over))
    step = accept_best(Hypothesis((first,), trials), first, [fitted], how, pulled=False)
    assert step.added == 1
    if over:
        assert step.hypothesis.last is stray
    else:
        assert step.hypothesis.last.chi2_in_band == pytest.approx(right.chi2_in_band, rel=0.01)


def test_a_record_held_out_begins_in_motion_though_friction_holds_it():
    """The state of the first samples, though what sticks at zero speed tells of none."""
    rough = Effect("stribeck", PLACE, {"friction_n": 0.8, "static_n": 1.4, "vs_m_per_s": 0.05})
    truth = Plant.of(dataclasses.replace(ONE, effects=(rough.entry(),)), kinds=KINDS)
    rng = np.random.default_rng(2)
    push = 6.0 * np.convolve(rng.standard_normal(800), np.hanning(9) / 2, "same")[:, None]
    outputs = truth.simulate(
        truth.values, push, three_mass_chain.RATE, state0=np.array([0.03, -0.4])
    )
    noise = 0.003 * outputs.std() * rng.standard_normal(outputs.shape)
    trial = Trial(inputs=push, outputs=outputs + noise, rate_hz=three_mass_chain.RATE)
    fit = refit(truth, three_mass_chain.recorded(ONE, (rough,)), values=truth.values)
    (run,) = free_runs(fit, (trial,))
    error = math.sqrt(float(np.mean((run - outputs) ** 2))) / float(outputs.std())
    assert error < 0.05
