"""Pairs of laws at different places, along the motion that the sensors tell."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.force_space import ForceSpace
from slowtime.discrepancy.candidates.library_fit import label_of
from slowtime.discrepancy.candidates.measured_pairs import act_apart, measured_pairs
from slowtime.discrepancy.localization import measured_motion
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import ONE, PLACE
from tests.slowtime.discrepancy.two_mass_chain import (
    DRAG,
    FIRST,
    KINDS,
    SECOND,
    STRONG,
    TWO,
    records_of,
)

FRICTION = Effect("coulomb", FIRST, {"friction_n": 2.0})


def held(effects):
    """Give records of a rig with some effects, and the fit of the model without."""
    trials = records_of(effects, samples=1000)
    return refit_within_tolerances(refit(Plant.of(TWO, kinds=KINDS), trials), trials), trials


def motion_of(fit, trials):
    """Give the motion that sensors tell, where they tell all of it."""
    located = measured_motion(fit, trials)
    assert located is not None
    return located


def pairs_of(effects):
    """Give the pairs that the records of a rig with some effects suggest."""
    fit, trials = held(effects)
    return measured_pairs(fit, motion_of(fit, trials), KINDS)


@pytest.mark.parametrize("effects", [(DRAG, STRONG), (FRICTION, STRONG)])
def test_two_strong_laws_at_different_places_come_first(effects):
    best = pairs_of(effects)[0]
    assert {label_of(one.effect) for one in best} == {label_of(one) for one in effects}
    for law in effects:
        told = next(one.effect for one in best if one.effect.kind == law.kind)
        for name, value in law.parameters.items():
            assert told.parameters[name] == pytest.approx(value, rel=0.15)


def test_a_pair_leaves_far_less_than_nothing_does_and_says_where_a_fit_begins():
    best = pairs_of((DRAG, STRONG))[0]
    assert best[0].cost == best[1].cost < 0.1 * best[0].cost_without
    start = best[0].start
    assert start is best[1].start
    for name, entry in Plant.of(TWO).entries.items():
        if name[0] == "stiffness":
            assert start.constants[name] == pytest.approx(entry.value, rel=0.05)


def test_one_law_alone_is_no_pair():
    assert not pairs_of((STRONG,))


def test_laws_at_two_places_act_apart_and_those_at_one_do_not():
    fit, trials = held((DRAG, STRONG))
    assert act_apart(fit, trials, KINDS)
    fit, trials = held((dataclasses.replace(DRAG, place=SECOND), STRONG))
    assert not act_apart(fit, trials, KINDS)


@pytest.mark.parametrize("to", ["element", "node"])
def test_of_one_mass_nothing_acts_apart(to):
    friction = Effect("coulomb", PLACE, {"friction_n": 4.0})
    mass = Effect("added_mass", Place("node", "m1"), {"dm_kg": 0.5})
    hard = Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 3e5})
    law = hard if to == "element" else mass
    trials = records_of((friction, law), of=ONE, samples=1000)
    fit = refit_within_tolerances(refit(Plant.of(ONE, kinds=KINDS), trials), trials)
    assert not act_apart(fit, trials, catalogue())


def test_a_space_seen_from_another_place_is_that_of_the_place():
    fit, trials = held((DRAG, STRONG))
    located = motion_of(fit, trials)
    first = ForceSpace(fit, located, FIRST, keeps=True)
    own, seen = ForceSpace(fit, located, SECOND), first.elsewhere(SECOND)
    force = own.lines_of(latent.motion.e[:, None] ** 3 for latent in own.latents)
    for one, other in zip(own.separate_fits(force), seen.separate_fits(force), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)
    with pytest.raises(ValueError, match="keeps=True"):
        own.elsewhere(FIRST)


def test_shapes_of_both_laws_are_refined_together():
    kinds = KINDS | {"gap_symmetric": catalogue()["gap_symmetric"]}
    stop = Effect("gap_symmetric", SECOND, {"kg_n_per_m": 700.0, "gap_m": 0.006})
    trials = records_of((DRAG, stop), samples=1000)
    fit = refit_within_tolerances(refit(Plant.of(TWO, kinds=kinds), trials), trials)
    best = measured_pairs(fit, motion_of(fit, trials), kinds)[0]
    told = next(one.effect for one in best if one.effect.kind == "gap_symmetric")
    assert told.place == SECOND
    assert told.parameters["gap_m"] == pytest.approx(0.006, rel=0.1)
