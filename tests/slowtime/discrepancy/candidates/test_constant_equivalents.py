"""Laws for which bent constants may stand, where no force along the motion tells of them."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.candidates.constant_equivalents import (
    equivalent_laws,
    instead_of_constants,
)
from slowtime.discrepancy.candidates.library_fit import label_of, library_candidates
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.search import SearchSettings, search
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Tolerance
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import ONE, PLACE
from tests.slowtime.discrepancy.three_mass_chain import (
    GROUND,
    MIDDLE,
    RATE,
    THREE,
    recorded,
)

KINDS = catalogue()


@pytest.mark.long
@pytest.mark.parametrize(
    "effect",
    [
        Effect("coulomb", GROUND, {"friction_n": 1.5}),
        Effect("quadratic_damping", GROUND, {"c2_n_s2_per_m2": 25.0}),
        Effect("viscous_damping", MIDDLE, {"dc_n_s_per_m": 3.0}),
        Effect("cubic_hardening", GROUND, {"k3_n_per_m3": 4e4}),
    ],
    ids=lambda effect: effect.kind,
)
def test_bent_constants_tell_the_law_and_about_how_strong_it_is(effect):
    """One sensor, three springs away from the law."""
    trials = recorded(THREE, (effect,))
    bent = refit(Plant.of(THREE, kinds=KINDS), trials)
    found = equivalent_laws(bent, trials, KINDS)
    own = [one.effect for one in found if one.effect.kind == effect.kind]
    assert own[0].place == effect.place
    (truth,) = effect.parameters.values()
    (guess,) = own[0].parameters.values()
    assert 0.5 < guess / truth < 2.0
    assert [one.score for one in found] == sorted((one.score for one in found), reverse=True)


def test_where_no_constant_is_bent_there_is_nothing_to_be_equivalent_to():
    trials = recorded(THREE, ())
    assert equivalent_laws(refit(Plant.of(THREE, kinds=KINDS), trials), trials, KINDS) == []


def test_constants_within_their_tolerance_need_no_law():
    """A damping far off, a stiffness a little: what both add is mostly the stiffness's."""
    drag = Effect("quadratic_damping", PLACE, {"c2_n_s2_per_m2": 40.0})
    rig = dataclasses.replace(ONE, tolerance=Tolerance(stiffness=0.02, damping=0.05))
    known = chain([2.0], [824.0], dampings_n_s_per_m=[1.6])
    stiffer = dataclasses.replace(rig, elements=known.elements)
    bent = refit(Plant.of(rig, kinds=KINDS), recorded(stiffer, (drag,), level=0.5))
    assert abs(bent.pulls["stiffness", "k1"]) < 3
    assert bent.pulls["damping", "k1"] > 4
    found = equivalent_laws(bent, recorded(stiffer, (drag,), level=0.5), KINDS)
    assert "quadratic_damping" in {one.effect.kind for one in found}


@pytest.fixture(scope="module")
def steady():
    """One tone at one level, long after its beginning, of a spring that softens."""
    rng = np.random.default_rng(7)
    soft = Effect("cubic_softening", PLACE, {"k3_n_per_m3": -1.2e6})
    rig = dataclasses.replace(ONE, tolerance=Tolerance(stiffness=0.005, damping=0.1))
    truth = Plant.of(dataclasses.replace(rig, effects=(soft.entry(),)))
    times = np.arange(int(60 * RATE)) / RATE
    found = []
    for begins in (0.0, 60.0):
        push = 0.6 * np.sin(2 * np.pi * 2.9 * times)[:, None]
        clean = truth.simulate(truth.values, push, RATE)[-int(20 * RATE) :]
        seen = clean + 0.3 * clean.std() * rng.standard_normal(clean.shape)
        found.append(
            Trial(inputs=push[-len(seen) :], outputs=seen, rate_hz=RATE, start_s=begins)
        )
    return rig, tuple(found)


@pytest.mark.long
def test_constants_that_leave_nothing_may_stand_for_a_law(steady):
    rig, trials = steady
    bent = refit(Plant.of(rig, kinds=KINDS), trials)
    labels = library_candidates(bent, locate(bent, trials), KINDS)[:3]
    others = instead_of_constants(bent, labels, trials, KINDS)
    names = [one.effect.kind for one in others]
    assert "cubic_softening" in {*names, *(one.effect.kind for one in labels)}
    assert "pendulum_sine" not in names
    assert not {label_of(one.effect) for one in others} & {
        label_of(one.effect) for one in labels
    }
    assert {one.cost for one in others} == {labels[0].cost}
    alone = instead_of_constants(bent, [], trials, KINDS)
    assert "cubic_softening" in {one.effect.kind for one in alone}


@pytest.fixture(scope="module")
def hummed():
    """One tone, one sensor at the top; what damps more sits in the middle."""
    rng, times = np.random.default_rng(5), np.arange(int(120 * RATE)) / RATE
    more = Effect("viscous_damping", MIDDLE, {"dc_n_s_per_m": 2.5})
    truth = Plant.of(dataclasses.replace(THREE, effects=(more.entry(),)))
    push = np.sin(2 * np.pi * 1.62 * times)[:, None]
    clean = truth.simulate(truth.values, push, RATE)
    seen = clean + 0.2 * clean.std(axis=0) * rng.standard_normal(clean.shape)
    halves = slice(int(40 * RATE), int(80 * RATE)), slice(int(80 * RATE), None)
    return tuple(
        Trial(inputs=push[half], outputs=seen[half], rate_hz=RATE, start_s=start)
        for half, start in zip(halves, (40.0, 80.0), strict=True)
    )


@pytest.mark.long
def test_one_sensor_does_not_tell_where_a_constant_changed(hummed):
    bent = refit(Plant.of(THREE, kinds=KINDS), hummed)
    labels = library_candidates(bent, locate(bent, hummed), KINDS)[:1]
    others = instead_of_constants(bent, labels, hummed, KINDS)
    damped = [o.effect.place for o in [*labels, *others] if o.effect.kind == "viscous_damping"]
    assert sorted(place.id for place in damped) == sorted(e.id for e in THREE.elements)
    softer = [o.effect.place for o in others if o.effect.kind == "stiffness_loss"]
    assert len(softer) == len(set(softer))
    found = search(bent, hummed, SearchSettings(KINDS, Monitor()))
    told = {r.place for r in found.undecided if r.effect == "viscous_damping"}
    assert told >= {GROUND, MIDDLE}


@pytest.mark.long
def test_a_tone_at_one_level_does_not_tell_a_softening_spring_from_a_softer_one(steady):
    rig, trials = steady
    bent = refit(Plant.of(rig, kinds=KINDS), trials)
    found = search(bent, trials, SearchSettings(KINDS, Monitor()))
    told = {rival.effect for rival in found.undecided}
    assert {"cubic_softening", "stiffness_loss", "added_mass"} <= told
    assert found.effects[0].probability < 0.9
