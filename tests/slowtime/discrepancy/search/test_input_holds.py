"""The search is repeated under another hold of the inputs, where what was found suggests it."""

import dataclasses

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import with_effect
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.estimation.input_hold import describe_holds, with_holds
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Campaign
from slowtime.discrepancy.search import SearchOptions, SearchSettings, search
from slowtime.discrepancy.search.input_holds import (
    leaves_less,
    search_with_holds,
    with_best_holds,
)
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.estimation.test_input_hold import recorded, rig
from tests.slowtime.discrepancy.protocol import named_effect

KINDS = catalogue()
FEW = {name: KINDS[name] for name in ("gap_symmetric", "input_gain", "input_delay")}


GAIN = Effect("input_gain", Place("input", "u"), {"gain": 1.0})


def fit_with_gain(trial, hold):
    """Fit the model with a gain of its input, under a hold."""
    described = describe_holds(with_effect(rig(), GAIN), [hold])
    return refit(Plant.of(described, kinds=FEW), [trial])


def settings(**more):
    return SearchSettings(FEW, Monitor(), **({"stated": (None,)} | more))


@pytest.fixture(scope="module")
def mistaken():
    """A gap in a record of straight lines, searched for under another hold."""
    gap = {"effect": "gap_symmetric", "element": rig().elements[1].id,
           "kg_n_per_m": 400.0, "gap_m": 0.001}  # fmt: skip
    trial = recorded("first", (gap,), band=0.4)
    return refit(Plant.of(describe_holds(rig(), ["zero"]), kinds=KINDS), [trial]), trial


def test_a_search_ends_where_another_hold_would_explain_all_that_was_found(mistaken):
    first, trial = mistaken
    found = search(first, (trial,), settings(options=SearchOptions(quick=True)))
    assert found.suggested_holds == ("first",)
    under = with_holds(found.last, ("first",), (trial,), FEW)
    assert under.chi2_in_band < 1.5 < found.last.chi2_in_band


@pytest.mark.parametrize("how", [{"stated": ("zero",)}, {"asked": (("first",),)}])
def test_a_search_goes_on_where_the_hold_is_stated_or_was_tried(mistaken, how):
    first, trial = mistaken
    assert (
        search(
            first, (trial,), settings(options=SearchOptions(quick=True), **how)
        ).suggested_holds
        is None
    )


@pytest.mark.long
def test_effects_are_named_under_the_hold_that_explains_them(mistaken):
    campaign = Campaign(description=rig(), trials=(mistaken[1],))
    said = diagnose(campaign, kinds=FEW)
    assert [named.effect.kind for named in said.effects] == ["gap_symmetric"]
    assert [entry.hold for entry in said.augmented.inputs] == ["first"]
    assert said.white_p_value > 1e-6


@pytest.mark.long
def test_an_effect_that_a_mistaken_hold_was_taken_for_is_not_named():
    trial = recorded("first", band=0.4)
    first = refit(Plant.of(describe_holds(rig(), ["zero"]), kinds=KINDS), [trial])
    found = search(first, (trial,), settings())
    assert ("first",) in (found.holds, found.suggested_holds)
    campaign = Campaign(description=rig(), trials=(trial,))
    assert diagnose(campaign, kinds=FEW).verdict == "nothing_missing"


def test_the_hold_of_the_records_is_found_before_the_search_and_asked_once():
    trial = recorded("zero", band=0.6)
    stages = []
    how = dataclasses.replace(
        settings(),
        monitor=Monitor(lambda stage, _: stages.append(stage)),
        options=SearchOptions(proposers=()),
    )
    campaign = Campaign(description=rig(), trials=(trial,))
    told, found = search_with_holds(campaign, (trial,), how)
    assert [entry.hold for entry in told.description.inputs] == ["zero"]
    assert [entry.hold for entry in campaign.description.inputs] == [None]
    assert found.effects == ()
    assert stages.count("looking at what inputs do between samples") == 1


@pytest.fixture(scope="module")
def straight():
    """A record of straight lines that are taken for curves; what is the right fit of it."""
    trial = recorded("first", band=0.5)
    return trial, *(
        refit(Plant.of(describe_holds(rig(), [hold]), kinds=KINDS), [trial])
        for hold in ("band_limited", "first")
    )


@pytest.mark.parametrize(
    ("chi2", "counts", "less"),
    [
        (1.2, (1, 1), True), (90.0, (1, 1), True), (9.0, (1, 1), False),
        (9.0, (2, 1), True), (9.0, (1, 2), False), (1.2, (1, 2), True),
    ],
)  # fmt: skip
def test_of_two_hypotheses_the_one_that_leaves_less_is_kept(straight, chi2, counts, less):
    """What explains all leaves nothing that counts; what explains segments stands for all."""
    trial, wrong, right = straight
    left = 0.5 if chi2 == 90.0 else 2.0
    fit = dataclasses.replace(
        right, chi2_in_band=chi2, residual=tuple(left * one for one in wrong.residual)
    )
    one, other = (
        Hypothesis((fit,), (trial,) * count)
        for fit, count in zip((fit, wrong), counts, strict=True)
    )
    assert leaves_less(one, other) is less


def test_the_hold_that_does_best_with_all_effects_is_taken_at_the_end(straight):
    trial, wrong, right = straight
    campaign = Campaign(description=rig(), trials=(trial,))
    gain = named_effect(GAIN, FEW)
    entries = {hold: fit_with_gain(trial, hold) for hold in ("band_limited", "first")}
    for hold, taken in (("band_limited", True), ("first", False)):
        fit = entries[hold]
        first = wrong if taken else right
        found = Hypothesis((first, fit), (trial,), effects=(gain,))
        told, held = with_best_holds(campaign, found, (None,), settings())
        assert (told is not campaign) is taken
        assert (held is not found) is taken
        if taken:
            assert [entry.hold for entry in told.description.inputs] == ["first"]
            assert {one.plant.description.inputs[0].hold for one in held.fits} == {"first"}
            assert held.last.cost < found.last.cost
            assert held.effects[0].numbers["gain"].value == pytest.approx(1.0, abs=0.02)
    bare = Hypothesis((wrong,), (trial,))
    assert with_best_holds(campaign, bare, (None,), settings()) == (campaign, bare)
