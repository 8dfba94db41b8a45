"""Effects are found one after the other, whichever of them shows first."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import label_of
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.search import SearchOptions, SearchSettings, search
from slowtime.discrepancy.search.loop import grow
from slowtime.discrepancy.search.lost_records import UNTRACKED_CHI2
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import StubProposer, candidate, fitted_chain
from tests.slowtime.discrepancy.two_mass_chain import (
    CUBIC,
    DRAG,
    FIRST,
    KINDS,
    LATE,
    SECOND,
    STRONG,
    TWO,
    records_of,
)

ONLY = Place("sensor", "x_m1")
BOUND = Effect("coulomb", SECOND, {"friction_n": 1.5})
SOFT = Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 6e4})


def searched(trials, *, of=TWO, kinds=KINDS, monitor=None, **more):
    first = refit(Plant.of(of, kinds=kinds), trials)
    return search(first, trials, SearchSettings(kinds, monitor or Monitor(), **more))


@pytest.mark.long
@pytest.mark.parametrize(
    "effects",
    [(CUBIC, DRAG), (LATE, CUBIC), (BOUND, SOFT)],
    ids=["laws", "late", "one place"],
)
def test_both_of_two_effects_are_found(effects):
    found = searched(records_of(effects))
    told = {(a.effect.kind, a.effect.place) for a in found.effects}
    assert told == {(one.kind, one.place) for one in effects}
    assert all(a.probability > 0.9 for a in found.effects)
    assert found.last.chi2_in_band < 1.2
    assert len(found.fits) == 3


@pytest.mark.parametrize("quick", [True, False])
def test_one_effect_is_found_and_the_search_ends_with_what_it_leaves(quick):
    own = StubProposer("own", candidates=(candidate(CUBIC, cost_without=1e6),))
    found = searched(records_of((CUBIC,)), options=SearchOptions(quick=quick, proposers=(own,)))
    assert [label_of(one.effect) for one in found.effects] == [label_of(CUBIC)]
    assert found.last.chi2_in_band < 1.2
    assert not found.exhausted
    # A quick search takes the library's own shortlist, of one effect.
    assert len(own.rounds) == (not quick)


@pytest.mark.parametrize("error", [np.linalg.LinAlgError, FloatingPointError])
def test_a_search_in_which_a_model_diverges_keeps_what_was_found(error):
    def diverging(given):
        raise error("no finite numbers")

    own, monitor = StubProposer("own", proposed=diverging), Monitor()
    options = SearchOptions(proposers=(own,))
    found = searched(records_of((CUBIC,)), monitor=monitor, options=options)
    assert own.rounds
    assert any("'own' failed" in note for note in monitor.notes)
    assert not found.effects
    assert found.last.chi2_in_band > 1.2


def test_a_search_without_anything_missing_is_one_fit():
    found = searched(records_of(()))
    assert found.effects == ()
    assert len(found.fits) == 1
    assert not found.exhausted


def test_a_constant_is_off_only_where_the_misfit_is_least():
    """Of parameters told only in sums a fit may stop where one is far from its claim."""
    trials = records_of((CUBIC,))
    found = fitted_chain(TWO, trials, KINDS, CUBIC)
    last = found.last
    at = last.prior.names.index(("stiffness", FIRST.id))
    values = last.values.copy()
    values[last.prior.index[at]] += 6 * last.prior.sd[at]
    off = dataclasses.replace(last, values=values)
    assert moved_of(off)
    begun = dataclasses.replace(found, fits=(found.first, off))
    told = grow(begun, SearchSettings(KINDS, Monitor()), 1)
    assert len(told.effects) == 1
    assert not moved_of(told.last)


@pytest.mark.long
def test_an_effect_that_shows_in_how_records_go_on_is_localized_too():
    """As where a sensor that drifts was left out, and nothing was named before."""
    trials = records_of((STRONG,))
    first = refit(Plant.of(TWO, kinds=KINDS), trials)
    assert refit_within_tolerances(first, trials).chi2_in_band > UNTRACKED_CHI2
    found = Hypothesis((first,), trials)
    told = grow(found, SearchSettings(KINDS, Monitor()), 1)
    assert [label_of(one.effect) for one in told.effects] == [label_of(CUBIC)]
    assert told.localized is not None
    assert told.localized.best == SECOND


def test_one_sensor_cannot_tell_its_own_factor_from_that_of_the_input():
    one = dataclasses.replace(TWO, sensors=TWO.sensors[:1])
    trials = records_of((Effect("sensor_gain", ONLY, {"gain": 1.3}),), of=one)
    found = searched(trials, of=one)
    assert {rival.effect for rival in found.undecided} == {"sensor_gain", "input_gain"}


@pytest.mark.parametrize("gain", [-1.0, 0.4])
def test_one_sensor_cannot_tell_a_factor_far_from_one_either(gain):
    """One step along what it does then promises far less than a refit holds."""
    one = dataclasses.replace(
        chain([2.0], [900.0], dampings_n_s_per_m=[1.6]),
        inputs=(Input(channel="u", kind="base_acceleration", unit="m/s^2"),),
        sensors=(Sensor(channel="x_m1", quantity="acceleration", node="m1", unit="m/s^2"),),
        tolerance=TWO.tolerance,
    )
    wrong = Effect("sensor_gain", ONLY, {"gain": gain})
    found = searched(records_of((wrong,), of=one, samples=900), of=one)
    assert {rival.effect for rival in found.undecided} == {"sensor_gain", "input_gain"}
    for number in found.effects[0].numbers.values():
        assert number.value == pytest.approx(gain, rel=0.02)


def test_a_mass_is_told_beside_the_factors_that_do_the_same():
    """Stiffness moves a little beside it; that leaves most of what is missing."""
    kinds = KINDS | {"added_mass": catalogue()["added_mass"]}
    one = dataclasses.replace(
        chain([2.0], [900.0], dampings_n_s_per_m=[1.6]),
        inputs=TWO.inputs,
        sensors=(Sensor(channel="x_m1", quantity="acceleration", node="m1", unit="m/s^2"),),
        tolerance=Tolerance(stiffness=0.03, damping=0.15),
    )
    heavier = Effect("added_mass", Place("node", "m1"), {"dm_kg": 0.2})
    found = searched(records_of((heavier,), of=one, samples=1500), of=one, kinds=kinds)
    told = {rival.effect for rival in found.undecided} or {found.effects[0].effect.kind}
    assert "added_mass" in told
