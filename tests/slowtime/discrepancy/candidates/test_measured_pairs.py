"""Pairs of laws at different places, along the motion that the sensors tell."""

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import label_of
from slowtime.discrepancy.candidates.measured_pairs import measured_pairs
from slowtime.discrepancy.localization import measured_motion
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
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


def pairs_of(effects, **records):
    """Give the pairs that the records of a rig with some effects suggest."""
    trials = records_of(effects, samples=1000, **records)
    fit = refit_within_tolerances(refit(Plant.of(TWO, kinds=KINDS), trials), trials)
    return measured_pairs(fit, measured_motion(fit, trials), KINDS)


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


def test_shapes_of_both_laws_are_refined_together():
    kinds = KINDS | {"gap_symmetric": catalogue()["gap_symmetric"]}
    stop = Effect("gap_symmetric", SECOND, {"kg_n_per_m": 700.0, "gap_m": 0.006})
    trials = records_of((DRAG, stop), samples=1000)
    fit = refit_within_tolerances(refit(Plant.of(TWO, kinds=kinds), trials), trials)
    best = measured_pairs(fit, measured_motion(fit, trials), kinds)[0]
    told = next(one.effect for one in best if one.effect.kind == "gap_symmetric")
    assert told.place == SECOND
    assert told.parameters["gap_m"] == pytest.approx(0.006, rel=0.1)
