"""What records cannot decide, a measurement decides; it is proposed, the easiest first."""

import dataclasses
import math

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.diagnosis import Number
from slowtime.discrepancy.estimation.model_evidence import (
    FittedCandidate,
    evidence,
    undetermined_parameters,
)
from slowtime.discrepancy.experiment_design.options import (
    BLOW_PEAK,
    experiment_options,
    experiment_trial,
)
from slowtime.discrepancy.experiment_design.proposal import (
    AMPLE_SEPARATION,
    propose_experiment,
    separations,
)
from slowtime.discrepancy.quoting import numbers_of, sentence_of
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Kind, Law, Parameter, Place, catalogue
from slowtime.dynamics.plant import Plant

RATE = 64.0
KINDS = catalogue()
SHAKEN = dataclasses.replace(
    chain([2.0], [800.0], dampings_n_s_per_m=[1.6]),
    inputs=(Input(channel="ab", kind="base_acceleration", unit="m/s^2"),),
    sensors=(Sensor(channel="a1", quantity="acceleration", node="m1", unit="m/s^2"),),
    tolerance=Tolerance(stiffness=0.01, damping=0.1),
)
SOFTER = Effect(
    "stiffness_loss", Place("element", SHAKEN.elements[0].id), {"dk_n_per_m": 130.0}
)
HEAVIER = Effect("added_mass", Place("node", "m1"), {"dm_kg": 0.4})


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(5)
    push = np.convolve(rng.standard_normal(400), np.hanning(7), "same")[:, None]
    truth = Plant.of(dataclasses.replace(SHAKEN, effects=(SOFTER.entry(),)))
    seen = truth.simulate(truth.values, push, RATE)
    seen = seen + 0.02 * seen.std() * rng.standard_normal(seen.shape)
    return (Trial(inputs=push, outputs=seen, rate_hz=RATE),)


@pytest.fixture(scope="module")
def rivals(trials):
    found = []
    for effect in (SOFTER, HEAVIER):
        description = dataclasses.replace(SHAKEN, effects=(effect.entry(),))
        fit = refit(Plant.of(description), trials)
        found.append(FittedCandidate(effect, description, fit, evidence(fit, KINDS)))
    return found


def test_mass_and_stiffness_on_a_shaken_base_are_told_by_a_measured_force(rivals, trials):
    chosen = propose_experiment(rivals, trials, KINDS)
    assert chosen is not None
    assert chosen.separation > AMPLE_SEPARATION
    assert [entry.kind for entry in chosen.add_inputs] == ["force"]
    assert "force" in chosen.sentence
    for option in experiment_options(SHAKEN, trials)[0]:
        assert separations(rivals, option, trials, KINDS)[-1] < 1


def test_of_rivals_each_must_part_from_each(rivals, trials):
    option = propose_experiment(rivals, trials, KINDS)
    assert option is not None
    two, three = separations([*rivals, rivals[0]], option, trials, KINDS)
    assert two == pytest.approx(option.separation)
    assert three == pytest.approx(0.0, abs=1e-6)


@pytest.mark.long
def test_a_rival_that_goes_with_another_everywhere_does_not_hinder(rivals, trials):
    assert propose_experiment([*rivals, rivals[1]], trials, KINDS) == propose_experiment(
        rivals, trials, KINDS
    )
    assert propose_experiment([rivals[0], rivals[0], rivals[1]], trials, KINDS) is None
    assert propose_experiment(rivals[:1], trials, KINDS) is None


def test_nothing_on_the_menu_is_there_already_or_cannot_be_run(trials):
    for effort in experiment_options(SHAKEN, trials):
        for option in effort:
            inputs = experiment_trial(option, trials[0], SHAKEN).inputs
            assert np.isfinite(inputs).all()
            assert inputs.any()
            assert inputs.shape[1] == 1 + len(option.add_inputs)
            if option.add_inputs:
                assert not inputs[:, 0].any()
            assert not {s.channel for s in option.add_sensors} & {"ab", "a1"}
            if option.excitation == "free_decay":
                peak = BLOW_PEAK * trials[0].inputs.std()
                assert inputs.max() == pytest.approx(peak, rel=0.2)


def test_an_effect_is_named_in_words_and_by_its_name():
    told = sentence_of(
        KINDS["coulomb"], Place("element", "j2"), {"friction_n": Number(1.50123, 0.0021, "N")}
    )
    assert told.startswith("Dry friction (coulomb) at element j2: 1.5012 ± 0.0021 N. ")
    several = {"kg_n_per_m": Number(3e3, 2.0, "N/m"), "gap_m": Number(8e-3, 1e-5, "m")}
    told = sentence_of(KINDS["gap_symmetric"], Place("element", "j1"), several)
    assert "stiffness of the stop 3000.0 ± 2.0 N/m, gap before the stop 0.008000" in told


def test_an_effect_of_a_users_own_goes_by_its_name():
    own = Kind(
        name="maxwell_branch", family="own", where="element", equation="", source="",
        parameters=(Parameter(name="k", unit="N/m", meaning="stiffness"),),
        sentence="It relaxes.", action=Law(force=lambda e, v, t, z, p: e),
    )  # fmt: skip
    told = sentence_of(own, Place("element", "j1"), {"k": Number(2.0, 0.1, "N/m")})
    assert told == "Maxwell branch at element j1: 2.00 ± 0.10 N/m. It relaxes."


def test_an_instant_between_two_records_costs_nothing_and_is_not_told():
    rng = np.random.default_rng(1)
    effect = Effect("stiffness_jump", SOFTER.place, {"dk_n_per_m": 60.0, "t_jump_s": 20.0})
    jumping = Plant.of(dataclasses.replace(SHAKEN, effects=(effect.entry(),)))
    told = []
    for start in (0.0, 30.0, 19.0):
        push = np.convolve(rng.standard_normal(200), np.hanning(7), "same")[:, None]
        seen = jumping.simulate(jumping.values, push, RATE, start_s=start)
        seen = seen + 0.01 * seen.std() * rng.standard_normal(seen.shape)
        told.append(Trial(inputs=push, outputs=seen, rate_hz=RATE, start_s=start))
    fit = refit(jumping, told[:2], horizons=(1.0,))
    assert undetermined_parameters(fit) == (("effect", 0, "t_jump_s"),)
    assert numbers_of(fit, 0)["t_jump_s"].sd == pytest.approx(20.0)
    charged = -fit.cost / 2 - math.log(fit.data) / 2
    assert evidence(fit, KINDS) == pytest.approx(charged)
    assert undetermined_parameters(refit(jumping, told, horizons=(1.0,))) == ()


def test_a_fault_of_a_sensor_is_told_in_its_unit(trials):
    bias = Effect("sensor_bias", Place("sensor", "a1"), {"bias": 0.1})
    plant = Plant.of(dataclasses.replace(SHAKEN, effects=(bias.entry(),)))
    assert numbers_of(refit(plant, trials, horizons=(1.0,)), 0)["bias"].unit == "m/s^2"
