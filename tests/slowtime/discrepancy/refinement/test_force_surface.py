"""A force surface closes the gap that a law outside the list leaves, and none of noise."""

import dataclasses
import math

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.force_surface import (
    fit_force_surface,
    fitting,
    surface_band,
)
from slowtime.discrepancy.validation.free_run import free_runs, relative_errors
from slowtime.dynamics.effects import Effect, Kind, Law, Motion, Parameter, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import ONE, PLACE

RATE, NOISE = 128.0, 0.01
KINDS = catalogue()


def truss(e, v, t, z, p):
    return p[0] * e * (1.0 - 1.08 / (1.0 + (e / p[1]) ** 2) ** 0.5)


def relief(e, v, t, z, p):
    if abs(v) < p[1]:
        return p[0] * v
    return p[0] * (p[1] if v > 0 else -p[1]) + 0.1 * p[0] * (v - (p[1] if v > 0 else -p[1]))


def heated(e, v, t, z, p):
    return -p[0] * e * math.tanh(z[0])


def heating(e, v, t, z, p):
    return ((v / p[1]) ** 2 - z[0]) / p[2]


def outside(name, law, *rates, **values):
    """A law that no list holds, as an effect and a kind."""
    parameters = tuple(Parameter(name=n, unit="", meaning=n) for n in values)
    kind = Kind(
        name=name, family="outside", where="element", parameters=parameters,
        equation=name, source="test", sentence="Outside.", action=Law(force=law, rates=rates),
    )  # fmt: skip
    return kind, Effect(name, PLACE, values)


def records(kind, effect, *, count=3, seconds=20.0, level=12.0):
    """Records of one mass, the last of which, of less motion, is held out."""
    rng = np.random.default_rng(8)
    effects = () if effect is None else (effect.entry(),)
    known = KINDS if kind is None else {**KINDS, kind.name: kind}
    plant = Plant.of(dataclasses.replace(ONE, effects=effects), kinds=known)
    found = []
    for number in range(count):
        push = rng.standard_normal(int(seconds * RATE))
        push = (
            level
            * (0.8 if number == count - 1 else 1.0)
            * np.convolve(push, np.hanning(25) / 5, "same")[:, None]
        )
        clean = plant.simulate(plant.values, push, RATE)
        noise = NOISE * clean.std() * rng.standard_normal(clean.shape)
        found.append(Trial(inputs=push, outputs=clean + noise, rate_hz=RATE))
    return tuple(found)


@pytest.fixture(scope="module")
def closed():
    trials = records(*outside("truss", truss, kt=400.0, height=0.01))
    first = refit(Plant.of(ONE), trials[:2])
    found = fit_force_surface(first, locate(first, trials[:2]), trials[:2], KINDS)
    assert found is not None
    return first, found, trials


def test_a_surface_closes_the_gap_of_a_law_of_position_to_the_noise(closed):
    first, found, trials = closed
    before, after = (
        relative_errors(trials[2:], free_runs(fit, trials[2:]))[0] for fit in (first, found.fit)
    )
    assert before > 8 * NOISE
    assert after < 2 * NOISE
    assert found.finished


def test_only_terms_that_the_force_shows_are_chosen(closed):
    _, found, _ = closed
    groups = {block.group for block in found.regression.blocks}
    assert "position" in groups
    assert not groups & {"friction", "path", "time"}
    assert found.fit.plant.effects[-1].kind == "measured_force"


def test_a_band_widens_outside_the_measured_range(closed):
    _, found, _ = closed
    own = found.fit.plant.effects[-1].parameters
    e = np.array([0.0, own["high_m"], 1.5 * own["high_m"], 3 * own["high_m"]])
    seen = Motion(e=e, v=np.zeros(4), a=np.zeros(4), times=np.arange(4.0))
    force, sd = surface_band(found.fit, seen)
    assert np.isfinite(force).all()
    # An odd surface is chosen here, which has no force in the middle.
    assert 0 <= sd[0] < sd[1] < sd[2] < sd[3]
    truth = 400.0 * e[:1] * (1 - 1.08 / np.sqrt(1 + (e[:1] / 0.01) ** 2))
    assert abs(force[0] - truth[0]) < 0.2 * own["spread_n"]


def test_a_surface_that_begins_flat_closes_the_gap_too(closed):
    """Without the recovered force, whose runs may grow without bound."""
    first, _, trials = closed
    located = locate(first, trials[:2])
    found = fit_force_surface(first, located, trials[:2], KINDS, flat=True)
    assert found is not None
    after = relative_errors(trials[2:], free_runs(found.fit, trials[2:]))[0]
    assert after < 2 * NOISE


def test_a_fit_that_is_cut_ends_no_worse_than_its_start(closed):
    first, _, trials = closed
    located = locate(first, trials[:2])
    found = fit_force_surface(first, located, trials[:2], KINDS, max_work=1.0, flat=True)
    assert found is not None
    assert not found.finished
    left, before = (relative_errors(trials[:2], fit.outputs)[0] for fit in (found.fit, first))
    assert left <= before * (1 + 1e-6)


def stages_from(found, trials, late):
    """Fit in stages, starting where a surface ended."""
    fit = found.fit
    return fitting.fit_stages(
        fit.plant, trials, fit.noise, found.free, fit.values, fit.states, late
    )


def test_a_run_that_is_in_phase_is_fitted_to_whole_records_at_once(closed, monkeypatch):
    _, found, trials = closed
    lengths = []

    def recorded(plant, parts, **how):
        lengths.append([len(part.outputs) for part in parts])
        return found.fit

    monkeypatch.setattr(fitting, "try_refit", recorded)
    given = stages_from(found, trials[:2], lambda: False)
    assert given == (found.fit, True)
    assert lengths == [[len(trial.outputs) for trial in trials[:2]]]


def test_a_budget_that_ends_midway_leaves_what_is_best_over_whole_records(closed, monkeypatch):
    _, found, trials = closed
    worse = dataclasses.replace(found.fit, values=1.5 * found.fit.values)
    begun = []

    def recorded(plant, parts, *, free, values, **how):
        begun.append(values)
        return worse if free else found.fit

    monkeypatch.setattr(fitting, "try_refit", recorded)
    monkeypatch.setattr(fitting, "MAX_LEFT", 0.0)  # no run is in phase
    given = stages_from(found, trials[:2], lambda: True)
    assert given == (found.fit, False)
    assert len(begun) == 2
    np.testing.assert_array_equal(begun[-1], found.fit.values)


def test_no_surface_is_found_where_nothing_but_noise_is_left():
    trials = records(None, None)
    first = refit(Plant.of(ONE), trials[:2])
    assert fit_force_surface(first, locate(first, trials[:2]), trials[:2], KINDS) is None


@pytest.mark.long
def test_a_surface_closes_the_gap_of_a_law_of_speed():
    trials = records(*outside("relief", relief, ca=25.0, v0=0.05))
    first = refit(Plant.of(ONE), trials[:2])
    found = fit_force_surface(first, locate(first, trials[:2]), trials[:2], KINDS)
    assert found is not None
    before, after = (
        relative_errors(trials[2:], free_runs(fit, trials[2:]))[0] for fit in (first, found.fit)
    )
    assert before > 4 * NOISE
    assert after < 2 * NOISE


@pytest.mark.long
def test_a_surface_follows_a_stiffness_that_falls_with_the_recent_vibration():
    slow = outside("slow", heated, heating, dk=160.0, v0=0.4, tau=8.0)
    trials = records(*slow)
    first = refit(Plant.of(ONE), trials[:2])
    found = fit_force_surface(first, locate(first, trials[:2]), trials[:2], KINDS)
    assert found is not None
    before, after = (
        relative_errors(trials[2:], free_runs(fit, trials[2:]))[0] for fit in (first, found.fit)
    )
    assert before > 50 * NOISE
    assert after < 4 * NOISE
    own = found.fit.plant.effects[-1].parameters
    assert own["level_of"] == 0.0
    # Its terms are not quite the law: with 8 s exactly, they leave a third more.
    assert own["level_s"] == pytest.approx(8.0, rel=0.1)


def test_a_fit_that_is_cut_keeps_where_it_is():
    trials = records(*outside("truss", truss, kt=400.0, height=0.01))[:2]
    first = refit(Plant.of(ONE), trials)
    found = fit_force_surface(first, locate(first, trials), trials, KINDS, max_work=1.0)
    assert found is not None
    assert not found.finished
    assert len(found.fit.residual[0]) == len(trials[0].outputs)


@pytest.mark.long
@pytest.mark.parametrize("gap", [0.010, 0.012])
def test_a_surface_is_found_for_a_stop_that_is_harder_than_the_spring(gap):
    """Twice the stiffness of the spring: growing parts of a record lose the phase."""
    stop = Effect("gap_symmetric", PLACE, {"kg_n_per_m": 1600.0, "gap_m": gap})
    trials = records(None, stop, count=2, seconds=10.0)
    first = refit(Plant.of(ONE), trials)
    found = fit_force_surface(first, locate(first, trials), trials, KINDS)
    assert found is not None
    assert relative_errors(trials, first.outputs)[0] > 0.4
    assert relative_errors(trials, found.fit.outputs)[0] < 4 * NOISE
