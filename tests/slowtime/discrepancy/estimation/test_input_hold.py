"""What inputs do between samples is found out, and never mistaken for something missing."""

import dataclasses
import functools
from unittest.mock import Mock

import numpy as np
import pytest
from slowtime.discrepancy.state import Found

from slowtime.discrepancy import diagnose as diagnosing
from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import with_effect
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.estimation import candidate_fit as naming
from slowtime.discrepancy.estimation import input_hold as between
from slowtime.discrepancy.estimation.input_hold import (
    SLIGHT,
    describe_holds,
    found_holds,
    held_as_well,
    held_better,
    held_instead,
    held_otherwise,
    saying_holds,
)
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.search import Search, reheld, search
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant

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
    "hold", ["zero", pytest.param("first", marks=pytest.mark.slow), "band_limited"]
)
@pytest.mark.parametrize("band", [1.0, pytest.param(0.12, marks=pytest.mark.slow)])
def test_the_hold_by_which_a_record_was_made_is_found(hold, band):
    found = asked(recorded(hold, band=band))
    # What is straight between samples is smooth, too, where the signal is slow.
    assert found == (None if hold == "band_limited" else (hold,))


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param({"effect": "input_delay", "delay_s": 0.004}, marks=pytest.mark.slow),
        pytest.param({"effect": "input_delay", "delay_s": 0.01}, marks=pytest.mark.slow),
        pytest.param({"effect": "input_gain", "gain": 0.98}, marks=pytest.mark.slow),
    ],
)
def test_an_input_that_is_late_or_weak_is_not_taken_for_a_hold(fault):
    assert asked(recorded("band_limited", (fault | {"input": "u"},), band=0.3)) is None


def test_an_input_that_states_its_hold_keeps_it():
    trial = recorded("zero")
    plant = Plant.of(describe_holds(rig(), ["first"]), kinds=KINDS)
    assert found_holds(refit(plant, [trial]), [trial], KINDS) is None


@pytest.mark.slow
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
def test_a_hold_mistaken_while_much_was_missing_is_seen_once_the_effects_are_in(hold):
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


@pytest.mark.parametrize(
    ("costs", "chosen"),
    [
        ({"first": 100.0, "band_limited": 120.0}, "band_limited"),
        ({"first": 120.0, "band_limited": 100.0}, "band_limited"),
        ({"first": 100.0, "band_limited": 200.0}, "first"),
        ({"first": 970.0, "band_limited": 980.0}, None),
    ],
)
def test_of_holds_that_do_about_as_well_the_one_stands_that_says_least(
    monkeypatch, costs, chosen
):
    trial = recorded("zero")
    fit = refit(Plant.of(describe_holds(rig(), ["zero"]), kinds=KINDS), [trial])
    last = dataclasses.replace(fit, cost=1000.0, chi2_in_band=1.0, in_band_sd=0.0)
    wrong = dataclasses.replace(last, chi2_in_band=1.1)

    def as_costly(fit, holds, *_):
        plant = Plant.of(describe_holds(rig(), holds), kinds=KINDS)
        return dataclasses.replace(last, plant=plant, cost=costs[holds[0]])

    monkeypatch.setattr(between, "with_holds", as_costly)
    found = held_otherwise(wrong, [trial], KINDS, [None])
    assert found == (None if chosen is None else (chosen,))


@pytest.fixture(scope="module")
def mistaken():
    """A gap in a record of straight lines, searched for under another hold."""
    gap = {"effect": "gap_symmetric", "element": rig().elements[1].id,
           "kg_n_per_m": 400.0, "gap_m": 0.001}  # fmt: skip
    trial = recorded("first", (gap,), band=0.4)
    return refit(Plant.of(describe_holds(rig(), ["zero"]), kinds=KINDS), [trial]), trial


@pytest.mark.slow
def test_a_search_ends_where_another_hold_would_explain_all_that_was_found(mistaken):
    first, trial = mistaken
    found = search(first, (trial,), Search(KINDS, Monitor(), stated=(None,)))
    assert found.otherwise == ("first",)
    under = reheld(found, ("first",), KINDS)
    assert {fit.plant.description.inputs[0].hold for fit in under.fits} == {"first"}
    assert under.fits[-1].chi2_in_band < 1.5 < found.fits[-1].chi2_in_band


@pytest.mark.slow
@pytest.mark.parametrize("how", [{"stated": ("zero",)}, {"asked": (("first",),)}])
def test_a_search_goes_on_where_the_hold_is_stated_or_was_tried(mistaken, how):
    first, trial = mistaken
    found = search(first, (trial,), Search(KINDS, Monitor(), **({"stated": (None,)} | how)))
    assert found.otherwise is None


def test_no_hold_is_searched_under_twice(monkeypatch):
    trial = recorded("zero")
    searched = []

    def once_more(first, trials, how):
        searched.append(first.plant.description.inputs[0].hold)
        assert len(searched) < 4
        return Found([first], trials, answers=[Mock(spec=NamedEffect)])

    def each_other(last, *_):
        (supposed,) = last.plant.description.inputs
        return ("zero",) if supposed.hold == "first" else ("first",)

    monkeypatch.setattr(diagnosing, "found_holds", lambda *_: ("first",))
    monkeypatch.setattr(diagnosing, "held_otherwise", each_other)
    monkeypatch.setattr(diagnosing, "search", once_more)
    campaign = Campaign(description=rig(), trials=(trial,))
    told, _ = diagnosing._searched(campaign, (trial,), KINDS, Monitor(), quick=False)
    assert searched == ["first", "zero"]
    assert told.description.inputs[0].hold == "zero"


@pytest.mark.slow
def test_where_time_runs_out_under_the_better_hold_what_was_found_first_stands(
    mistaken, monkeypatch
):
    trial = mistaken[1]
    searched = []

    def once(first, trials, how):
        searched.append(first)
        late = len(searched) == 2
        return Found([first], trials, hurried=True) if late else search(first, trials, how)

    monkeypatch.setattr(diagnosing, "found_holds", lambda *_: ("zero",))
    monkeypatch.setattr(diagnosing, "search", once)
    said = diagnose(Campaign(description=rig(), trials=(trial,)))
    assert len(searched) == 2
    assert [answer.effect.kind for answer in said.effects] == ["gap_symmetric"]
    assert [entry.hold for entry in said.augmented.inputs] == ["first"]
    assert said.white_p_value > 1e-6


@pytest.mark.slow
def test_what_a_mistaken_hold_was_taken_for_is_forgotten():
    trial = recorded("first", band=0.4)
    first = refit(Plant.of(describe_holds(rig(), ["zero"]), kinds=KINDS), [trial])
    found = search(first, (trial,), Search(KINDS, Monitor(), stated=(None,)))
    assert found.answers
    assert found.otherwise == ("first",)
    assert diagnose(Campaign(description=rig(), trials=(trial,))).verdict == "nothing_missing"


@pytest.mark.slow
def test_effects_are_named_under_the_hold_that_explains_them(mistaken):
    said = diagnose(Campaign(description=rig(), trials=(mistaken[1],)))
    assert [answer.effect.kind for answer in said.effects] == ["gap_symmetric"]
    assert [entry.hold for entry in said.augmented.inputs] == ["first"]


def test_a_model_to_be_used_says_what_its_inputs_were_taken_to_do():
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
    gain = (wrong.cost - naming.misfit(right, wrong.noise, [trial])) / 2
    asked = functools.partial(held_as_well, wrong, right.noise, trials=[trial], kinds=KINDS)
    assert asked(gain / 10, stated=[None]) == ("first",)
    assert asked(100 * gain, stated=[None]) is None
    assert asked(gain / 10, stated=["band_limited"]) is None
    much = dataclasses.replace(wrong, chi2_in_band=SLIGHT + 0.1)
    assert held_as_well(much, right.noise, gain / 10, [trial], KINDS, [None]) is None


def test_the_hold_that_does_better_at_the_end_is_taken_and_no_other(straight):
    trial, wrong, right = straight
    assert held_better(wrong, [trial], KINDS, [None]) == ("first",)
    assert held_better(right, [trial], KINDS, [None]) is None
    assert held_better(wrong, [trial], KINDS, ["band_limited"]) is None


@pytest.mark.parametrize(
    ("chi2", "counts", "less"),
    [
        (1.2, (1, 1), True), (90.0, (1, 1), True), (9.0, (1, 1), False),
        (9.0, (2, 1), True), (9.0, (1, 2), False), (1.2, (1, 2), True),
    ],
)  # fmt: skip
def test_of_two_accounts_that_which_leaves_less_is_kept(straight, chi2, counts, less):
    """What explains all leaves nothing that counts; what explains pieces stands for all."""
    trial, wrong, right = straight
    left = 0.5 if chi2 == 90.0 else 2.0
    fit = dataclasses.replace(
        right, chi2_in_band=chi2, residual=tuple(left * one for one in wrong.residual)
    )
    account, other = (
        Found([one], (trial,) * count) for one, count in zip((fit, wrong), counts, strict=True)
    )
    assert diagnosing._leaves_less(account, other) is less


@pytest.mark.long
@pytest.mark.parametrize(
    ("least", "share", "found"),
    [(10.0, 0.5, ("first",)), (10.0, 0.9, None), (2.0, 0.9, ("first",))],
    ids=["clearly less", "a little less", "a force does it"],
)
def test_where_no_force_does_it_a_hold_has_to_leave_clearly_less(
    straight, monkeypatch, least, share, found
):
    trial, wrong, _ = straight

    def leaving(fit, *more):
        one = locate(fit, *more)
        hold = fit.plant.description.inputs[0].hold
        left = least if hold is None else share * least
        groups = tuple(dataclasses.replace(group, left=left) for group in one.groups)
        return dataclasses.replace(one, groups=groups)

    plain = dataclasses.replace(wrong, plant=Plant.of(rig(), kinds=KINDS))
    monkeypatch.setattr(between, "locate", leaving)
    assert found_holds(plain, [trial], KINDS) == found
