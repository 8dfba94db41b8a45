"""Springs that the model lacks, between nodes that nothing joins in it."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.estimation.candidate_fit import fit_candidate
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers.missing_link import (
    best_link,
    link_instead_of,
    with_missing_link,
)
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.selection.probabilities import answer_of
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Spring, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered
from tests.slowtime.discrepancy.protocol import named_effect

KINDS = catalogue()
STIFFNESS, RATE, SECONDS = 160.0, 64.0, 20.0
RIG = dataclasses.replace(
    chain([2.0, 1.5, 1.2], [1800.0, 1500.0, 1200.0], dampings_n_s_per_m=[1.5, 1.5, 1.2]),
    inputs=(Input(channel="f", kind="force", node="m1", unit="N"),),
    sensors=tuple(
        Sensor(channel=f"a{i}", quantity="acceleration", node=f"m{i}", unit="m/s^2")
        for i in (1, 2, 3)
    ),
    tolerance=Tolerance(stiffness=0.02, damping=0.15),
)
OSCILLATOR = {"mass_kg": 0.2, "frequency_hz": 2.2, "damping_n_s_per_m": 0.15}


def recorded(truth, seed, noise=0.01):
    rng = np.random.default_rng(seed)
    plant = Plant.of(truth, kinds=KINDS)
    for level in (1.0, 2.0, 1.5):
        push = level * rng.standard_normal((round(SECONDS * RATE), 1))
        clean = plant.simulate(plant.values, push, RATE)
        seen = clean + noise * clean.std(axis=0) * rng.standard_normal(clean.shape)
        yield Trial(inputs=push, outputs=seen, rate_hz=RATE)


def tied(between, stiffness):
    spring = Spring(id="tie", between=between, stiffness_n_per_m=stiffness)
    truth = dataclasses.replace(RIG, elements=(*RIG.elements, spring))
    return tuple(recorded(truth, 5))


@pytest.fixture(scope="module", params=[("base", "m3"), ("m1", "m3")])
def linked(request):
    return request.param, tied(request.param, STIFFNESS)


@pytest.fixture(scope="module")
def ridden():
    effect = Effect("extra_dof", Place("node", "m2"), OSCILLATOR)
    return tuple(recorded(dataclasses.replace(RIG, effects=(effect.entry(),)), 6))


@pytest.mark.long
def test_of_all_springs_between_unjoined_nodes_the_right_one_is_found(linked):
    between, trials = linked
    link = best_link(refit(Plant.of(RIG, kinds=KINDS), trials), None, trials, KINDS)
    assert link is not None
    assert link.between == between
    assert abs(link.stiffness - STIFFNESS) < 4 * link.sd < 0.2 * STIFFNESS
    assert link.named.fit.chi2_in_band < 1.2
    assert f"between {between[0]} and {between[1]}" in str(link)


@pytest.mark.parametrize("stiffness", [5.0, 12.0, 40.0])
def test_a_spring_is_found_that_is_much_softer_than_those_of_the_model(stiffness):
    """Begun far too stiff, it swings out of step for good."""
    trials = tied(("base", "m3"), stiffness)
    link = best_link(refit(Plant.of(RIG, kinds=KINDS), trials), [("base", "m3")], trials, KINDS)
    assert link is not None
    assert abs(link.stiffness - stiffness) < 4 * link.sd < 0.2 * stiffness
    assert link.named.fit.chi2_in_band < 1.2


def oscillator_for(trials, node):
    before = refit(Plant.of(RIG, kinds=KINDS), trials)
    named = fit_candidate(
        before, Effect("extra_dof", Place("node", node), OSCILLATOR), trials, KINDS, None
    )
    assert named is not None
    return named, before


@pytest.mark.long
def test_a_spring_explains_more_than_an_oscillator_in_its_place(linked):
    between, trials = linked
    named, before = oscillator_for(trials, between[1])
    link = link_instead_of(named.fit, 0, before, trials, KINDS)
    assert link is not None
    assert link.between == between
    assert link.named.score > named.score
    again = link_instead_of(named.fit, 0, None, trials, KINDS)
    assert again is not None
    assert again.stiffness == pytest.approx(link.stiffness, rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("holds", [None, ("band_limited",)])
def test_a_spring_is_tried_in_place_of_an_oscillator_under_any_hold(linked, holds):
    between, trials = linked
    named, before = oscillator_for(trials, between[1])
    answer = answer_of([named], [1.0], KINDS)
    found = Hypothesis((before, named.fit), trials, effects=(answer,), holds=holds)
    found = with_missing_link(found, 0, KINDS, Monitor())
    assert found.link is not None
    assert found.link.between == between


@pytest.mark.long
def test_no_spring_does_what_an_oscillator_does(ridden):
    named, before = oscillator_for(ridden, "m2")
    link = link_instead_of(named.fit, 0, before, ridden, KINDS)
    assert link is None or link.named.score < named.score - 100
    assert named.fit.chi2_in_band < 1.2


def test_no_spring_is_tried_in_place_of_an_effect_on_an_element(ridden):
    effect = Effect("stiffness_loss", Place("element", RIG.elements[0].id), {"dk_n_per_m": 1.0})
    plant = Plant.of(dataclasses.replace(RIG, effects=(effect.entry(),)), kinds=KINDS)
    fit = refit(plant, ridden, horizons=(1.0,))
    assert link_instead_of(fit, 0, None, ridden, KINDS) is None


@pytest.mark.slow
def test_the_diagnosis_says_between_which_nodes_a_spring_is_missing(linked):
    between, trials = linked
    campaign = Campaign(description=RIG, trials=trials[:2], holdout=trials[2:])
    found = diagnose(campaign)
    assert found.verdict == "unknown_effect"
    assert f"between {between[0]} and {between[1]}" in found.sentence
    assert "add it to the model" in found.sentence


@pytest.mark.slow
def test_a_hidden_oscillator_keeps_its_name(ridden):
    found = diagnose(Campaign(description=RIG, trials=ridden[:2], holdout=ridden[2:]))
    assert [named.effect.kind for named in found.effects] == ["extra_dof"]
    assert found.effects[0].probability > 0.9


@pytest.mark.long
def test_a_law_that_leaves_more_than_noise_gives_way_to_a_spring():
    """It explains most, and what is left is not white: a spring leaves nothing."""
    spring = Spring(id="tie", between=("m1", "m3"), stiffness_n_per_m=60.0)
    truth = dataclasses.replace(RIG, elements=(*RIG.elements, spring))
    trials = tuple(recorded(truth, 8, noise=0.1))
    before = refit(Plant.of(RIG, kinds=KINDS), trials)
    heavier = Effect("added_mass", Place("node", "m3"), {"dm_kg": -0.05})
    named = fit_candidate(before, heavier, trials, KINDS, None)
    assert named is not None
    assert 1.05 < named.fit.chi2_in_band < before.chi2_in_band
    answer = answer_of([named], [1.0], KINDS)
    found = Hypothesis((before, named.fit), trials, effects=(answer,))
    linked = with_missing_link(found, 0, KINDS, Monitor())
    assert found.link is None
    assert linked.link is not None
    assert linked.link.between == ("m1", "m3")
    assert abs(linked.link.stiffness - 60.0) < 4 * linked.link.sd
    # Where a law leaves noise alone, none is tried: no spring does what a law does.
    law = Effect("cubic_hardening", Place("element", RIG.elements[0].id), {"k3_n_per_m3": 1.0})
    white = Hypothesis(
        (before, linked.link.named.fit), trials, effects=(named_effect(law, KINDS),)
    )
    with metered() as meter:
        assert with_missing_link(white, 0, KINDS, Monitor()) is white
    assert meter.spent == 0
