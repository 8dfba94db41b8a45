"""The first swings of the records tell a law, where nothing comes near the whole of them."""

import dataclasses
import math

import numpy as np
import pytest

from slowtime.discrepancy.calibration import first_periods, refit
from slowtime.discrepancy.calibration.initial_states import refit_initial_states
from slowtime.discrepancy.calibration.multiple_shooting import FIRST_PERIODS
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import label_of
from slowtime.discrepancy.candidates.parameter_scan import (
    MAX_START_SHAPES,
    effects_of_strength,
    has_strength,
)
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.estimation.shooting_fit import first_of_each
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.proposers.initial_segments import (
    MAX_PROPOSED,
    SEGMENT_HORIZONS,
    initial_segment_candidates,
)
from slowtime.discrepancy.proposers.lower_ranked import InitialSegments
from slowtime.discrepancy.records import MIN_SAMPLES, Campaign, Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Node, assemble
from slowtime.dynamics.effects import Effect, Motion, Place, catalogue, force_along
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import (
    candidate,
    fitted_candidate,
    in_budget,
    round_of,
)
from tests.slowtime.discrepancy.three_mass_chain import (
    GROUND,
    MIDDLE,
    RATE,
    THREE,
    TOP,
    recorded,
)

NAMES = (
    "quadratic_stiffness",
    "cubic_hardening",
    "quadratic_damping",
    "viscous_damping",
    "stiffness_loss",
    "bouc_wen",
    "coulomb",
    "gap_symmetric",
)
KINDS = {name: kind for name, kind in catalogue().items() if name in NAMES}
STRONG = {
    "quadratic_stiffness": ({"k2_n_per_m2": -2.5e3}, 4.0),
    "cubic_hardening": ({"k3_n_per_m3": 3e6}, 8.0),
    "quadratic_damping": ({"c2_n_s2_per_m2": 300.0}, 8.0),
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("share", [0.56, -0.1])
def test_a_law_is_begun_with_a_share_of_the_force(name, share):
    rng = np.random.default_rng(3)
    times = np.arange(400) / RATE
    e = np.cumsum(rng.standard_normal(400)) * 1e-3
    motion = Motion(e=e, v=np.gradient(e, 1 / RATE), a=np.zeros(400), times=times)
    force = 700.0 * e
    kind = KINDS[name]
    assert has_strength(kind)
    assert kind.strength is not None
    found = list(effects_of_strength(kind, MIDDLE, motion, force, THREE, (share, -share)))
    assert 1 <= len(found) <= 2 * MAX_START_SHAPES
    for effect in found:
        size = np.std(force_along(kind, effect.parameters, motion))
        assert size == pytest.approx(abs(share) * np.std(force))
        assert not kind.parameter(kind.strength).refuses(effect.parameters[kind.strength])
    assert not list(effects_of_strength(kind, MIDDLE, motion, 0.0 * force, THREE, (share,)))


def test_a_kind_with_a_phase_or_without_a_force_has_no_strength():
    kinds = catalogue()
    assert not any(
        has_strength(kinds[name]) for name in ("harmonic_force", "sensor_gain", "parametric")
    )


def lacking(name, place):
    """Fit the model, without a law that is strong, to what one accelerometer has heard."""
    parameters, level = STRONG[name]
    law = Effect(name, place, parameters)
    trials = recorded(THREE, (law,), level=level, seconds=20.0)
    return refit_within_tolerances(refit(Plant.of(THREE, kinds=KINDS), trials), trials), trials


@pytest.fixture(scope="module")
def hard():
    return lacking("cubic_hardening", TOP)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "place"),
    [
        pytest.param("quadratic_stiffness", GROUND, marks=pytest.mark.long),
        pytest.param("quadratic_stiffness", MIDDLE, marks=pytest.mark.long),
        pytest.param("cubic_hardening", GROUND, marks=pytest.mark.long),
        pytest.param("cubic_hardening", MIDDLE, marks=pytest.mark.long),
        pytest.param("cubic_hardening", TOP, marks=pytest.mark.long),
        ("quadratic_damping", GROUND),
        pytest.param("quadratic_damping", MIDDLE, marks=pytest.mark.long),
        pytest.param("quadratic_damping", TOP, marks=pytest.mark.long),
    ],
)
def test_a_strong_law_explains_how_records_begin_and_no_other_does(name, place):
    before, trials = lacking(name, place)
    found = initial_segment_candidates(before, trials, KINDS, in_budget)
    assert len(found) <= MAX_PROPOSED
    assert label_of(found[0].effect) == (name, place)
    assert found[0].cost < 1.2 * before.data
    assert all(one.cost > 2.0 * before.data for one in found[1:])
    ((number, true),) = STRONG[name][0].items()
    assert found[0].effect.parameters[number] == pytest.approx(true, rel=0.15)


@pytest.mark.long
def test_a_law_that_the_recovered_motion_misses_is_told_by_how_records_begin(hard):
    _, trials = hard
    (told,) = diagnose(Campaign(description=THREE, trials=trials), kinds=KINDS).effects
    assert label_of(told.effect) == ("cubic_hardening", TOP)
    assert told.effect.parameters["k3_n_per_m3"] == pytest.approx(3e6, rel=0.02)


@pytest.mark.long
def test_laws_are_tried_at_the_places_that_are_asked_for(hard):
    before, trials = hard
    found = initial_segment_candidates(
        before, trials, KINDS, in_budget, [MIDDLE, Place("node", "m1")]
    )
    assert found
    assert {one.effect.place for one in found} == {MIDDLE}
    assert initial_segment_candidates(before, trials, KINDS, in_budget, []) == []


def test_out_of_budget_no_law_is_fitted_to_the_first_swings(hard):
    before, trials = hard
    assert initial_segment_candidates(before, trials, KINDS, lambda: True) == []


def test_records_begin_with_a_few_swings_of_the_slowest_mode(hard):
    before, trials = hard
    system = assemble(THREE)
    lowest = math.sqrt(min(np.linalg.eigvals(np.linalg.solve(system.mass, system.stiffness))))
    lowest /= 2 * math.pi
    for head, trial in zip(first_periods(before.plant, trials), trials, strict=True):
        assert len(head.outputs) == int(FIRST_PERIODS / lowest * RATE)
        assert np.array_equal(head.outputs, trial.outputs[: len(head.outputs)])
        assert head.start_s == trial.start_s
    short = [trial.part(0, MIN_SAMPLES + 3) for trial in trials]
    assert [len(head.outputs) for head in first_periods(before.plant, short)] == [
        MIN_SAMPLES + 3
    ] * 2


def test_records_of_what_floats_and_does_not_swing_are_taken_whole(hard):
    before, trials = hard
    free = dataclasses.replace(
        chain([2.0], [1.0]), elements=(), nodes=(Node(id="m3", mass_kg=2.0),),
        inputs=THREE.inputs, sensors=THREE.sensors,
    )  # fmt: skip
    alone = dataclasses.replace(before, plant=Plant.of(free))
    assert [len(head.outputs) for head in first_periods(alone.plant, trials)] == [1600, 1600]


@pytest.mark.long
@pytest.mark.parametrize(("left", "some"), [(0.9, False), (0.3, True)])
def test_where_a_law_explains_some_only_the_likely_places_are_tried(hard, left, some):
    before, trials = hard
    few = {name: KINDS[name] for name in ("stiffness_loss", "cubic_hardening")}
    label = candidate(
        Effect("stiffness_loss", MIDDLE, {"dk_n_per_m": 1.0}), 40.0, cost_without=1e9
    )
    chi2 = max(left * before.chi2_in_band, 2 * LIMITS.far_off_chi2)
    located = locate(before, trials)
    own = next(group for group in located.groups if MIDDLE in group.places)
    rest = [dataclasses.replace(one, left=99.0) for one in located.groups if one is not own]
    groups = (dataclasses.replace(own, places=(MIDDLE,), left=1.0), *rest)
    given = round_of(
        before, trials, few, shortlist=[label],
        localized=dataclasses.replace(located, groups=groups),
        fitted=(fitted_candidate(label.effect, before, chi2_in_band=chi2),),
    )  # fmt: skip
    proposal = InitialSegments()(given)
    laws = [one for one in proposal.shot if one.effect.place.kind == "element"]
    assert laws
    assert ({one.effect.place for one in laws} == {MIDDLE}) is some
    # They come as early as the best along the force does.
    assert all(one.cost <= 40.0 for one in laws)


def test_of_several_rankings_the_foremost_are_taken_once_each():
    def ranked(*costs):
        return [
            candidate(Effect("coulomb", Place("element", f"k{c}"), {"friction_n": 1.0}), c)
            for c in costs
        ]

    costs = [
        one.cost for one in first_of_each(ranked(1.0, 2.0, 3.0), [], ranked(2.0, 4.0, 5.0))
    ]
    assert costs == [1.0, 2.0, 4.0]


def test_the_initial_state_of_a_record_is_that_of_its_first_samples():
    """That of a whole record makes up for what the model lacks in all of it."""
    begin = np.array([0.03, -0.02, 0.04, 0.2, 0.3, -0.4])
    rng = np.random.default_rng(3)
    push = rng.standard_normal((4000, 1))
    plant = Plant.of(THREE, kinds=KINDS)
    clean = plant.simulate(plant.values, push, RATE, state0=begin)
    noise = 0.01 * clean.std() * rng.standard_normal(clean.shape)
    trial = Trial(inputs=push, outputs=clean + noise, rate_hz=RATE)
    fit = refit(plant, [trial], horizons=(1.0,))
    astray = dataclasses.replace(fit, states=(fit.states[0] + 0.5,))
    heads = first_periods(astray.plant, [trial])
    found = refit_initial_states(astray, heads)
    assert np.array_equal(found.values, astray.values)
    head = heads[0].part(0, max(int(SEGMENT_HORIZONS[0] * len(heads[0].outputs)), MIN_SAMPLES))

    def left(state):
        told = plant.simulate(found.values, head.inputs, RATE, state0=state)
        return float((told - head.outputs).std())

    assert left(found.states[0]) < 0.02 * left(astray.states[0])
