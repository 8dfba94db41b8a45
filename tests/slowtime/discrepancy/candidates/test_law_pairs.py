"""Pairs of laws whose forces together explain what neither explains alone."""

import dataclasses

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.law_pairs import law_pairs
from slowtime.discrepancy.candidates.library_fit import label_of, library_candidates
from slowtime.discrepancy.localization import locate
from slowtime.dynamics.builders import chain
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.two_mass_chain import CUBIC, KINDS, SECOND, TWO, records_of

BOUND = Effect("coulomb", SECOND, {"friction_n": 1.5})
SOFT = Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 6e4})


def held_and_located(trials):
    """Give the fit of the model without effects, and what its force may be."""
    fit = refit_within_tolerances(refit(Plant.of(TWO, kinds=KINDS), trials), trials)
    located = locate(fit, trials)
    return fit, located, library_candidates(fit, located, KINDS)


@pytest.fixture(scope="module")
def lacking():
    """A model without two laws at one place."""
    return held_and_located(records_of((BOUND, SOFT)))


def test_two_laws_at_one_place_are_found_together(lacking):
    first, located, tried = lacking
    (one, other), *_ = law_pairs(first, located, tried, {}, KINDS)
    assert {one.effect.kind, other.effect.kind} == {"coulomb", "cubic_hardening"}
    assert {one.effect.place, other.effect.place} == {SECOND}
    sizes = {e.effect.kind: next(iter(e.effect.parameters.values())) for e in (one, other)}
    assert sizes["cubic_hardening"] == pytest.approx(6e4, rel=0.05)
    assert sizes["coulomb"] == pytest.approx(1.5, rel=0.1)
    assert other.cost < 0.5 * tried[0].cost


def test_a_base_that_explains_no_more_than_a_force_hides_no_pair(lacking):
    first, located, tried = lacking
    best = located.groups[0]
    base = dataclasses.replace(best, places=(Place("base", "base"),), score=best.score + 30.0)
    told = dataclasses.replace(located, groups=(base, *located.groups))
    assert [c.effect for c in law_pairs(first, told, tried, {}, KINDS)[0]] == [
        c.effect for c in law_pairs(first, located, tried, {}, KINDS)[0]
    ]
    # Where it explains far more, no law at an element does what is left.
    louder = dataclasses.replace(best, left=3 * best.left)
    told = dataclasses.replace(located, groups=(base, louder, *located.groups[1:]))
    assert not law_pairs(first, told, tried, {}, KINDS)


def test_a_place_that_leaves_little_more_than_the_best_is_not_passed_over(lacking):
    first, located, _ = lacking
    here, *others = located.groups
    other = next(g for g in others if g.places[0].kind == "element")

    def tried(least, left, twins=()):
        groups = (
            dataclasses.replace(other, left=least, twins=twins),
            dataclasses.replace(here, left=left),
        )
        told = dataclasses.replace(located, groups=groups)
        return {one.effect.place for one in library_candidates(first, told, KINDS)}

    assert here.places[0] in tried(0.7, 1.6)
    assert here.places[0] not in tried(0.7, 1.8)
    # Where the sensors cannot tell the places apart, that is a matter of smoothness.
    assert here.places[0] in tried(0.7, 1.8, here.places)
    assert here.places[0] not in tried(0.7, 3.6, here.places)
    assert here.places[0] in tried(1.2, 1.9)


@pytest.mark.long
def test_a_tone_beside_a_law_is_found_with_it_whatever_its_phase():
    one = dataclasses.replace(
        chain([2.0], [800.0], dampings_n_s_per_m=[1.6]),
        inputs=TWO.inputs,
        sensors=TWO.sensors[:2],
        tolerance=TWO.tolerance,
    )
    kinds = {**KINDS, "harmonic_force": catalogue()["harmonic_force"]}
    hum = {"amplitude_n": 6.0, "frequency_hz": 2.2, "phase_rad": 1.1}
    place, node = Place("element", one.elements[0].id), Place("node", "m1")
    effects = (
        Effect("harmonic_force", node, hum),
        Effect("coulomb", place, {"friction_n": 2.0}),
    )
    trials = records_of(effects, of=one, samples=1000)
    first = refit_within_tolerances(refit(Plant.of(one, kinds=kinds), trials), trials)
    located = locate(first, trials)
    (tone, law), *_ = law_pairs(
        first, located, library_candidates(first, located, kinds), {}, kinds
    )
    assert [c.effect.kind for c in (tone, law)] == ["harmonic_force", "coulomb"]
    assert law.effect.parameters["friction_n"] == pytest.approx(2.0, rel=0.1)
    assert tone.effect.parameters == pytest.approx(hum, rel=0.05)


def test_a_law_whose_fit_holds_less_than_its_force_promised_hides_no_pair(lacking):
    first, located, tried = lacking
    boast = dataclasses.replace(tried[0], cost=1.0)
    tried = [boast, *tried[1:]]
    assert not law_pairs(first, located, tried, {}, KINDS)
    assert law_pairs(first, located, tried, {label_of(boast.effect): 1e9}, KINDS)


def test_one_law_that_explains_all_is_not_made_two():
    first, located, tried = held_and_located(records_of((CUBIC,)))
    assert not law_pairs(first, located, tried, {}, KINDS)
