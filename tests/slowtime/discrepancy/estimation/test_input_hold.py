"""Holds of the inputs are found, and not mistaken for something missing."""

import dataclasses
import functools

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import with_effect
from slowtime.discrepancy.estimation import model_evidence
from slowtime.discrepancy.estimation.input_hold import (
    HOLD_ERROR_CHI2,
    describe_holds,
    found_holds,
    held_as_well,
    held_better,
    held_instead,
    held_otherwise,
    saying_holds,
)
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.selection.acceptance import Criteria, accept
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import fit_effect

RATE = 200.0
KINDS = catalogue()


def rig():
    made = chain(masses_kg=[1.0, 1.2], stiffnesses_n_per_m=[900.0, 1100.0],
                 dampings_n_s_per_m=[0.8, 0.7])  # fmt: skip
    return dataclasses.replace(
        made,
        inputs=(Input(channel="u", kind="force", node=made.nodes[0].id, unit="N"),),
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=node.id, unit="m/s^2")
            for i, node in enumerate(made.nodes)
        ),
        tolerance=Tolerance(stiffness=0.02, damping=0.15),
    )


def recorded(hold, effects=(), seed=1, band=1.0):
    rng = np.random.default_rng(seed)
    force = rng.standard_normal((1500, 1))
    if band < 1.0:
        spectrum = np.fft.rfft(force, axis=0)
        spectrum[int(band * len(spectrum)) :] = 0
        force = np.fft.irfft(spectrum, 1500, axis=0)
    description = dataclasses.replace(rig(), effects=effects)
    plant = Plant.of(describe_holds(description, [hold]), kinds=KINDS)
    stiffer = [1.01 if name[0] == "stiffness" else 1.0 for name in plant.parameters]
    outputs = plant.simulate(plant.values * stiffer, force, RATE)
    noise = 0.01 * outputs.std(axis=0) * rng.standard_normal(outputs.shape)
    return Trial(inputs=force, outputs=outputs + noise, rate_hz=RATE)


def asked(trial):
    return found_holds(refit(Plant.of(rig(), kinds=KINDS), [trial]), [trial], KINDS)


@pytest.mark.long
@pytest.mark.parametrize(
    "hold", ["zero", pytest.param("first", marks=pytest.mark.long), "band_limited"]
)
@pytest.mark.parametrize("band", [1.0, pytest.param(0.12, marks=pytest.mark.long)])
def test_the_hold_by_which_a_record_was_made_is_found(hold, band):
    found = asked(recorded(hold, band=band))
    # What is straight between samples is smooth, too, where the signal is slow.
    assert found == (None if hold == "band_limited" else (hold,))


def test_a_short_record_of_a_force_that_a_converter_held_tells_the_hold():
    assert asked(recorded("zero").part(0, 300)) == ("zero",)


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param({"effect": "input_delay", "delay_s": 0.004}, marks=pytest.mark.long),
        pytest.param({"effect": "input_delay", "delay_s": 0.01}, marks=pytest.mark.long),
        pytest.param({"effect": "input_gain", "gain": 0.98}, marks=pytest.mark.long),
    ],
)
def test_a_delay_or_a_gain_of_an_input_is_not_taken_for_a_hold(fault):
    assert asked(recorded("band_limited", (fault | {"input": "u"},), band=0.3)) is None


def test_an_input_that_states_its_hold_keeps_it():
    trial = recorded("zero")
    plant = Plant.of(describe_holds(rig(), ["first"]), kinds=KINDS)
    assert found_holds(refit(plant, [trial]), [trial], KINDS) is None


@pytest.mark.long
@pytest.mark.parametrize(("gain", "found"), [(1.0, ("first",)), (0.9, None)])
def test_a_fault_of_an_input_that_another_hold_explains_is_none(gain, found):
    fault = ({"effect": "input_gain", "input": "u", "gain": gain},)
    trial = recorded("first" if gain == 1.0 else "band_limited", fault, band=0.5)
    before = refit(Plant.of(rig(), kinds=KINDS), [trial])
    place = Effect("input_gain", Place("input", "u"), {"gain": 1.0})
    plant = Plant.of(with_effect(rig(), place), kinds=KINDS)
    faulty = refit(plant, [trial], noise=before.noise)
    assert held_instead(faulty, before, [trial], KINDS) == found


@pytest.mark.parametrize("hold", ["band_limited", "first", "zero"])
def test_a_mistaken_hold_is_seen_once_all_effects_are_in_the_model(hold):
    gap = {"effect": "gap_symmetric", "element": rig().elements[1].id,
           "kg_n_per_m": 800.0, "gap_m": 0.02}  # fmt: skip
    trial = recorded(hold, (gap,), band=0.4)
    description = dataclasses.replace(rig(), effects=(gap | {"gap_m": 0.018},))

    def asked_under(supposed):
        plant = Plant.of(describe_holds(description, [supposed]), kinds=KINDS)
        return held_otherwise(refit(plant, [trial]), [trial], KINDS, [None])

    for supposed in ("band_limited", "first", "zero"):
        assert asked_under(supposed) == (None if supposed == hold else (hold,))
    plant = Plant.of(describe_holds(description, ["first"]), kinds=KINDS)
    assert held_otherwise(refit(plant, [trial]), [trial], KINDS, ["first"]) is None


@pytest.mark.parametrize("hold", ["first", "band_limited"])
def test_of_holds_that_do_about_as_well_the_one_stands_that_says_least(hold):
    """Of a slow signal, a straight line between samples is the signal itself."""
    trial = recorded(hold, band=0.05)
    zero = refit(Plant.of(describe_holds(rig(), ["zero"]), kinds=KINDS), [trial])
    assert held_otherwise(zero, [trial], KINDS, [None]) == ("band_limited",)


@pytest.mark.long
def test_no_hold_is_taken_for_two_effects_that_no_single_force_explains():
    gaps = tuple(
        {"effect": "gap_symmetric", "element": element.id, "kg_n_per_m": 800.0, "gap_m": 0.01}
        for element in rig().elements
    )
    assert asked(recorded("band_limited", gaps, band=0.4)) is None


def test_a_model_to_be_used_states_the_holds_that_were_assumed():
    assert [entry.hold for entry in saying_holds(rig()).inputs] == ["band_limited"]
    assert [e.hold for e in saying_holds(describe_holds(rig(), ["zero"])).inputs] == ["zero"]


@pytest.fixture(scope="module")
def straight():
    """A record of straight lines that are taken for curves; what is the right fit of it."""
    trial = recorded("first", band=0.5)
    return trial, *(
        refit(Plant.of(describe_holds(rig(), [hold]), kinds=KINDS), [trial])
        for hold in ("band_limited", "first")
    )


def test_another_hold_comes_before_an_effect_that_brings_no_more(straight):
    trial, wrong, right = straight
    gain = (wrong.cost - model_evidence.misfit(right, wrong.noise, [trial])) / 2
    asked = functools.partial(held_as_well, wrong, right.noise, trials=[trial], kinds=KINDS)
    assert asked(gain / 10, stated=[None]) == ("first",)
    assert asked(100 * gain, stated=[None]) is None
    assert asked(gain / 10, stated=["band_limited"]) is None
    much = dataclasses.replace(wrong, chi2_in_band=HOLD_ERROR_CHI2 + 0.1)
    assert held_as_well(much, right.noise, gain / 10, [trial], KINDS, [None]) is None


def test_the_hold_that_does_better_at_the_end_is_taken(straight):
    trial, wrong, right = straight
    assert held_better(wrong, [trial], KINDS, [None]) == ("first",)
    assert held_better(right, [trial], KINDS, [None]) is None
    assert held_better(wrong, [trial], KINDS, ["band_limited"]) is None


def test_another_hold_is_suggested_before_an_effect_that_brings_no_more(straight):
    """Unless the budget ended, or effects were looked for under it already."""
    trial, wrong, _ = straight
    trials = (trial,)
    kinds = {name: KINDS[name] for name in ("added_mass",)}
    heavier = Effect("added_mass", Place("node", wrong.plant.description.nodes[0].id),
                     {"dm_kg": 0.01})  # fmt: skip
    fitted = fit_effect(wrong, heavier, trials, kinds)
    found = Hypothesis((wrong,), trials)

    def step(**more):
        terms = Criteria(stated=(None,), pulled=False, **({"asked": ()} | more))
        return accept(found, wrong, [fitted], trials, kinds, terms)

    held = step()
    assert held.added == 0
    assert held.hypothesis.suggested_holds == ("first",)
    assert found.suggested_holds is None
    for more in ({"asked": (("first",),)}, {"asked": None}, {"over": lambda: True}):
        assert step(**more).hypothesis.suggested_holds is None
