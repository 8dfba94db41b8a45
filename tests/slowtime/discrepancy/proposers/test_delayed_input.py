"""Clocks that are off, late inputs, and laws that are seen only beside those."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import library_candidates
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers.delayed_input import (
    EXPLAINED_SHARE,
    UNEXPLAINED_SHARE,
    SensorClocks,
    pairs_with_delayed_input,
    stands_out,
)
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.search import SearchSettings, search
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered
from tests.slowtime.discrepancy.protocol import fitted_candidate, round_of

RATE = 128.0
NAMES = ("input_delay", "sensor_clock", "van_der_pol", "cubic_hardening", "added_mass",
         "quadratic_damping", "stiffness_jump")  # fmt: skip
KINDS = {name: catalogue()[name] for name in NAMES}


def shaken(heard):
    return dataclasses.replace(
        chain([2.0, 1.8, 1.5], [5400.0, 5000.0, 3200.0], dampings_n_s_per_m=[2.0] * 3),
        inputs=(Input(channel="ab", kind="base_acceleration", unit="m/s^2"),),
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=f"m{i}", unit="m/s^2")
            for i in heard
        ),
        tolerance=Tolerance(stiffness=0.02, damping=0.1),
    )


RIG = shaken((1, 2, 3))
TOP, GROUND = (Place("element", RIG.elements[i].id) for i in (2, 0))
LATE = Effect("input_delay", Place("input", "ab"), {"delay_s": 0.019})
SINGS = Effect("van_der_pol", TOP, {"cn_n_s_per_m": 7.0, "e0_m": 6e-4})
BREAKS = Effect("stiffness_jump", TOP, {"dk_n_per_m": -900.0, "t_jump_s": 5.3})


def recorded(of, effects, *, seconds=10.0, seed=5):
    """Two levels of a base that shakes at random, up to 16 Hz."""
    rng = np.random.default_rng(seed)
    plant = Plant.of(dataclasses.replace(of, effects=tuple(e.entry() for e in effects)))
    stiffer = [1.008 if name[0] == "stiffness" else 1.0 for name in plant.parameters]
    found = []
    for level in (0.5, 0.8):
        lines = np.fft.rfft(rng.standard_normal(int(seconds * RATE)))
        lines[int(16.0 * seconds) :] = 0.0
        base = level * np.fft.irfft(lines, int(seconds * RATE))[:, None]
        clean = plant.simulate(plant.values * stiffer, base, RATE)
        noise = 0.02 * clean.std(axis=0) * rng.standard_normal(clean.shape)
        found.append(Trial(inputs=base, outputs=clean + noise, rate_hz=RATE))
    return tuple(found)


def lacking(of, effects, seconds=10.0, *, nowhere=False, **more):
    """Give a round of a model that lacks effects; where no single force explains them."""
    trials = recorded(of, effects, seconds=seconds)
    before = refit_within_tolerances(refit(Plant.of(of, kinds=KINDS), trials), trials)
    located = locate(before, trials)
    if nowhere:
        best = dataclasses.replace(located.groups[0], left=10.0)
        located = dataclasses.replace(located, groups=(best, *located.groups[1:]))
    tried = library_candidates(before, located, KINDS)
    return round_of(before, trials, KINDS, tried=tried, localized=located, **more)


def seen_as_well(given, share):
    """Give the round as it would be, did the best law leave a share of the force."""
    best = given.tried[0]
    return dataclasses.replace(
        given, tried=(dataclasses.replace(best, cost=share * best.cost_without),)
    )


def costs_nothing(ask, given):
    with metered() as meter:
        assert not [*ask(given)]
    return meter.spent == 0


@pytest.mark.long
def test_a_law_is_seen_once_the_input_that_hides_it_may_be_late():
    given = lacking(RIG, (LATE, BREAKS))
    assert given.tried[0].cost > UNEXPLAINED_SHARE * given.tried[0].cost_without
    delay, law = next(pairs_with_delayed_input(given))
    assert (law.effect.kind, law.effect.place) == (BREAKS.kind, TOP)
    assert law.cost < EXPLAINED_SHARE * law.cost_without
    assert delay.effect.place == LATE.place
    assert delay.effect.parameters["delay_s"] == pytest.approx(0.019, rel=0.2)
    # Out of budget, no input is asked.
    late = dataclasses.replace(given, monitor=Monitor(late=lambda: True))
    assert costs_nothing(pairs_with_delayed_input, late)


@pytest.mark.long
def test_where_a_law_is_seen_no_input_is_asked_whether_it_is_late():
    given = lacking(RIG, (SINGS,))
    assert costs_nothing(pairs_with_delayed_input, given)
    assert costs_nothing(pairs_with_delayed_input, dataclasses.replace(given, tried=()))


@pytest.mark.long
def test_a_late_input_and_what_it_hides_are_both_found():
    trials = recorded(RIG, (LATE, BREAKS))
    first = refit(Plant.of(RIG, kinds=KINDS), trials)
    found = search(first, trials, SearchSettings(KINDS, Monitor()))
    told = {(a.effect.kind, a.effect.place) for a in found.effects}
    assert told == {(LATE.kind, LATE.place), (BREAKS.kind, BREAKS.place)}
    assert found.last.chi2_in_band < 1.2


@pytest.mark.long
@pytest.mark.parametrize("skew", [-1e-3, 1.3e-3])
def test_of_few_sensors_the_one_whose_clock_explains_all_is_proposed(skew):
    """Wherever a force was thought to be."""
    clock = Effect("sensor_clock", Place("sensor", "a3"), {"skew": skew})
    given = lacking(shaken((1, 3)), (clock,), nowhere=True)
    proposal = SensorClocks()(given)
    (label,) = proposal.candidates
    assert proposal.only
    assert (label.effect.kind, label.effect.place) == (clock.kind, clock.place)
    assert label.effect.parameters["skew"] == pytest.approx(skew, rel=0.02)
    assert label.cost < 1.5 * given.before.data


@pytest.mark.parametrize("heard", [(1, 3), pytest.param((1, 2, 3), marks=pytest.mark.long)])
def test_no_clock_is_fitted_where_a_force_explains_all_or_an_effect_was_found(heard):
    hard = Effect("cubic_hardening", GROUND, {"k3_n_per_m3": 2e8})
    given = lacking(shaken(heard), (hard,))
    assert costs_nothing(lambda given: SensorClocks()(given).candidates, given)
    later = dataclasses.replace(lacking(shaken(heard), (hard,), nowhere=True), number=1)
    assert costs_nothing(lambda given: SensorClocks()(given).candidates, later)


@pytest.mark.long
def test_a_clock_that_hides_something_is_proposed_where_no_law_is_seen():
    """What it hides comes after."""
    breaks = dataclasses.replace(BREAKS, parameters={"dk_n_per_m": -60.0, "t_jump_s": 5.3})
    clock = Effect("sensor_clock", Place("sensor", "a2"), {"skew": 3e-3})
    given = lacking(RIG, (clock, breaks), seconds=20.0, nowhere=True)
    (label,) = SensorClocks()(seen_as_well(given, UNEXPLAINED_SHARE)).candidates
    assert (label.effect.kind, label.effect.place) == (clock.kind, clock.place)
    assert label.effect.parameters["skew"] == pytest.approx(3e-3, rel=0.02)
    assert label.cost > 1.5 * given.before.data
    assert SensorClocks()(seen_as_well(given, 0.5 * UNEXPLAINED_SHARE)).candidates == ()


@pytest.mark.parametrize(
    ("left", "told"),
    [((4.0, 200.0, 300.0), True), ((12.0, 200.0, 300.0), False), ((4.0, 30.0, 300.0), False)],
    ids=["one explains nearly all", "much is left", "another comes near"],
)
def test_a_clock_that_leaves_something_has_to_stand_out(left, told):
    trials = recorded(shaken((1, 2, 3)), (), seconds=4.0)
    fit = refit(Plant.of(RIG, kinds=KINDS), trials)
    before = dataclasses.replace(fit, chi2_in_band=1000.0)
    fits = [fitted_candidate(LATE, before, chi2_in_band=one) for one in left]
    assert stands_out(fits, before) is told
    assert not stands_out([], before)


def test_a_clock_is_fitted_only_as_far_as_it_would_be_proposed():
    """One that may leave something is not given up for leaving more than the noise."""
    given = lacking(shaken((1, 3)), (SINGS,), nowhere=True)
    loud = dataclasses.replace(given.before, cost=1e3 * given.before.data)
    given = dataclasses.replace(given, before=loud)
    spent = []
    for share in (UNEXPLAINED_SHARE, 0.1):
        with metered() as meter:
            assert SensorClocks()(seen_as_well(given, share)).candidates == ()
        spent.append(meter.spent)
    assert spent[0] > spent[1]
