"""What is out of time, and what is seen only once that is put right."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import library_candidates
from slowtime.discrepancy.estimation.candidate_fit import FittedCandidate
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers import delayed_input as delayed
from slowtime.discrepancy.proposers.delayed_input import (
    CLEARLY,
    MOSTLY,
    OPAQUE,
    _outstanding,
    clocks_alone,
    seen_beside_late,
)
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.search import Search, search
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant

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


def asked(of, effects, seconds=10.0):
    trials = recorded(of, effects, seconds=seconds)
    before = refit_within_tolerances(refit(Plant.of(of, kinds=KINDS), trials), trials)
    located = locate(before, trials)
    return before, located, library_candidates(before, located, KINDS), trials


@pytest.mark.long
def test_a_law_is_seen_once_the_input_that_hides_it_may_be_late():
    before, _, tried, trials = asked(RIG, (LATE, BREAKS))
    assert tried[0].cost > OPAQUE * tried[0].cost_without
    delay, law = next(seen_beside_late(before, tried, trials, KINDS))
    assert (law.effect.kind, law.effect.place) == (BREAKS.kind, TOP)
    assert law.cost < CLEARLY * law.cost_without
    assert delay.effect.place == LATE.place
    assert delay.effect.parameters["delay_s"] == pytest.approx(0.019, rel=0.2)


@pytest.mark.long
def test_where_a_law_is_seen_no_input_is_asked_whether_it_is_late(monkeypatch):
    before, _, tried, trials = asked(RIG, (SINGS,))
    monkeypatch.setattr("slowtime.discrepancy.proposers.delayed_input.fit_candidate", None)
    assert not [*seen_beside_late(before, tried, trials, KINDS)]
    assert not [*seen_beside_late(before, [], trials, KINDS)]


@pytest.mark.long
def test_a_late_input_and_what_it_hides_are_both_found():
    trials = recorded(RIG, (LATE, BREAKS))
    first = refit(Plant.of(RIG, kinds=KINDS), trials)
    found = search(first, trials, Search(KINDS, Monitor()))
    told = {(a.effect.kind, a.effect.place) for a in found.answers}
    assert told == {(LATE.kind, LATE.place), (BREAKS.kind, BREAKS.place)}
    assert found.fits[-1].chi2_in_band < 1.2


@pytest.mark.long
@pytest.mark.parametrize("skew", [-1e-3, 1.3e-3])
def test_of_few_sensors_the_one_whose_clock_explains_all_is_told(skew):
    """Wherever a force was thought to be."""
    few = shaken((1, 3))
    clock = Effect("sensor_clock", Place("sensor", "a3"), {"skew": skew})
    before, located, tried, trials = asked(few, (clock,))
    best = dataclasses.replace(located.groups[0], left=10.0)
    nowhere = dataclasses.replace(located, groups=(best, *located.groups[1:]))
    (label,) = clocks_alone(before, nowhere, tried, trials, KINDS)
    assert (label.effect.kind, label.effect.place) == (clock.kind, clock.place)
    assert label.effect.parameters["skew"] == pytest.approx(skew, rel=0.02)
    assert label.cost < 1.5 * before.data


@pytest.mark.parametrize("heard", [(1, 3), pytest.param((1, 2, 3), marks=pytest.mark.long)])
def test_no_clock_is_asked_where_a_force_explains_all(heard, monkeypatch):
    of = shaken(heard)
    before, located, tried, trials = asked(
        of, (Effect("cubic_hardening", GROUND, {"k3_n_per_m3": 2e8}),)
    )
    monkeypatch.setattr("slowtime.discrepancy.proposers.delayed_input.fit_candidate", None)
    assert clocks_alone(before, located, tried, trials, KINDS) == []


@pytest.mark.long
def test_a_clock_that_hides_something_is_told_where_no_law_is_seen():
    """What it hides comes after."""
    breaks = dataclasses.replace(BREAKS, parameters={"dk_n_per_m": -60.0, "t_jump_s": 5.3})
    clock = Effect("sensor_clock", Place("sensor", "a2"), {"skew": 3e-3})
    before, located, tried, trials = asked(RIG, (clock, breaks), seconds=20.0)
    best = dataclasses.replace(located.groups[0], left=10.0)
    nowhere = dataclasses.replace(located, groups=(best, *located.groups[1:]))
    opaque = [dataclasses.replace(tried[0], cost=OPAQUE * tried[0].cost_without)]
    (label,) = clocks_alone(before, nowhere, opaque, trials, KINDS)
    assert (label.effect.kind, label.effect.place) == (clock.kind, clock.place)
    assert label.effect.parameters["skew"] == pytest.approx(3e-3, rel=0.02)
    assert label.cost > 1.5 * before.data
    seen = [dataclasses.replace(tried[0], cost=0.5 * OPAQUE * tried[0].cost_without)]
    assert clocks_alone(before, nowhere, seen, trials, KINDS) == []


@pytest.mark.parametrize(
    ("left", "told"),
    [((4.0, 200.0, 300.0), True), ((12.0, 200.0, 300.0), False), ((4.0, 30.0, 300.0), False)],
    ids=["one explains nearly all", "much is left", "another comes near"],
)
def test_a_clock_that_leaves_something_has_to_stand_out(left, told):
    trials = recorded(shaken((1, 2, 3)), (), seconds=4.0)
    before = dataclasses.replace(refit(Plant.of(RIG, kinds=KINDS), trials), chi2_in_band=1000.0)
    asked = [
        FittedCandidate(LATE, RIG, dataclasses.replace(before, chi2_in_band=one), 0.0)
        for one in left
    ]
    assert _outstanding(asked, before) is told
    assert not _outstanding([], before)


@pytest.mark.parametrize("opaque", [True, pytest.param(False, marks=pytest.mark.long)])
def test_a_clock_is_fitted_as_far_as_it_would_be_told(monkeypatch, opaque):
    """One that may leave something is not given up for leaving more than the noise."""
    followed = []

    def heard(before, begin, trials, kinds, noise, beat, **_):
        followed.append((begin.place.id, beat))

    monkeypatch.setattr(delayed, "fit_candidate", heard)
    before, located, tried, trials = asked(shaken((1, 3)), (SINGS,))
    best = dataclasses.replace(located.groups[0], left=10.0)
    nowhere = dataclasses.replace(located, groups=(best, *located.groups[1:]))
    one = dataclasses.replace(
        tried[0], cost=(OPAQUE if opaque else 0.1) * tried[0].cost_without
    )
    before = dataclasses.replace(before, cost=1e3 * before.data)
    assert clocks_alone(before, nowhere, [one], trials, KINDS) == []
    beat = MOSTLY * before.cost if opaque else LIMITS.explained_chi2 * before.data
    assert followed == [("a1", beat), ("a3", beat)]
