"""Near the right law, another is refuted by its shape; the right one, by no noise."""

import dataclasses

import numpy as np
import pytest
import scipy.optimize

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.search import SearchOptions
from slowtime.discrepancy.validation.free_force import FreeForce, ScoreTest
from slowtime.discrepancy.validation.free_force_test import (
    LawDoubt,
    _distance_to_small_force,
    refuted_by_free_force,
)
from slowtime.dynamics.effects import Effect, Kind, Law, Parameter, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import ONE, PLACE

RATE = 50.0


def strange(name, force, *rates):
    """Make a kind that no catalogue holds."""
    return Kind(
        name=name,
        family="strange",
        where="element",
        parameters=(Parameter(name="c", unit="", meaning="strength"),),
        equation="",
        source="",
        sentence="",
        action=Law(force=force, rates=rates),
        strength="c",
    )


def power(e, v, t, z, p):
    return float(p[0] * v * abs(v) ** 0.5)


def displaced(e, v, t, z, p):
    return float(p[0] * e * e * v)


def slipping(e, v, t, z, p):
    return float(p[0] * (e - z[0]))


def slip(e, v, t, z, p):
    return float((e - z[0]) / 0.05)


STRANGE = (
    strange("power", power),
    strange("displaced", displaced),
    strange("maxwell", slipping, slip),
)
KINDS = {**catalogue(), **{kind.name: kind for kind in STRANGE}}
DRAG = Effect("quadratic_damping", PLACE, {"c2_n_s2_per_m2": 9.0})
POWER = Effect("power", PLACE, {"c": 3.0})
DISPLACED = Effect("displaced", PLACE, {"c": 2e4})
MAXWELL = Effect("maxwell", PLACE, {"c": 20.0})
RIDER = Effect(
    "extra_dof",
    Place("node", "m1"),
    {"mass_kg": 0.1, "frequency_hz": 4.0, "damping_n_s_per_m": 2.0},
)
SINGS = Effect("van_der_pol", PLACE, {"cn_n_s_per_m": 1.2, "e0_m": 0.01})


def record_of(true, seed=5, noise=0.01):
    rng = np.random.default_rng(seed)
    push = np.convolve(rng.standard_normal(900), np.hanning(9), "same")[:, None] * 4.0
    truth = Plant.of(dataclasses.replace(ONE, effects=(true.entry(),)), kinds=KINDS)
    seen = truth.simulate(truth.values, push, RATE)
    seen += noise * seen.std() * rng.standard_normal(seen.shape)
    return Trial(inputs=push, outputs=seen, rate_hz=RATE)


def doubt(true, told, seed=5, noise=0.01):
    trials = (record_of(true, seed, noise),)
    model = Plant.of(dataclasses.replace(ONE, effects=(told.entry(),)), kinds=KINDS)
    return refuted_by_free_force(refit(model, trials), 0, trials, KINDS)


def test_the_right_law_stands():
    assert doubt(SINGS, SINGS) is None


def test_a_law_of_another_curve_is_refuted_where_it_sits():
    assert doubt(POWER, DRAG) == LawDoubt(PLACE, ())


@pytest.mark.slow
def test_a_force_of_another_curve_is_unknown_and_drawn_where_the_nearest_law_closes_the_gap():
    said = diagnose(
        Campaign(description=ONE, trials=(record_of(POWER),)), options=SearchOptions(quick=True)
    )
    assert said.white_p_value > 1e-3
    assert (said.verdict, said.effects) == ("unknown_effect", ())
    assert "The nearest, Drag (quadratic_damping)" in said.sentence
    assert "follows another curve" in said.sentence
    assert said.surface is not None
    assert said.surface.place == PLACE
    assert said.surface.law is None


def test_where_no_other_force_can_be_told_a_law_is_asked_for_itself_alone(monkeypatch):
    nothing = ScoreTest(gain=0.0, degrees=0, spread=np.zeros((3, 0)), steps=np.zeros(0))
    monkeypatch.setattr(FreeForce, "score_test", lambda self: nothing)
    assert doubt(POWER, DRAG) is None
    assert doubt(DISPLACED, SINGS) == LawDoubt(PLACE, (0,))


def test_negative_damping_that_is_nowhere_negative_does_nothing_of_its_own():
    assert doubt(DISPLACED, SINGS) == LawDoubt(PLACE, (0,))


@pytest.mark.long
def test_what_lags_in_an_element_is_seen_though_something_on_its_node_was_named():
    seen = [doubt(MAXWELL, RIDER, seed, noise=0.005) for seed in range(12)]
    assert set(seen) <= {None, LawDoubt(PLACE, ())}
    assert sum(one is not None for one in seen) >= 8


@pytest.mark.slow
@pytest.mark.parametrize("told", [DRAG, SINGS, RIDER], ids=lambda effect: effect.kind)
def test_the_right_law_is_hardly_ever_refuted(told):
    assert sum(doubt(told, told, seed) is not None for seed in range(300)) <= 1


@pytest.mark.long
def test_noise_alone_takes_no_law_out_of_what_it_may_be_off(monkeypatch):
    monkeypatch.setattr("slowtime.discrepancy.validation.free_force_test.REFUTED_P_VALUE", 0.9)
    assert sum(doubt(DRAG, DRAG, seed, noise=0.1) is not None for seed in range(20)) <= 1


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("share", [0.0, 0.1, 0.6, 1.5])
def test_the_nearest_force_that_is_small_enough_is_the_one_a_minimiser_finds(seed, share):
    rng = np.random.default_rng(seed)
    forces = rng.standard_normal((40, 4)) * 10 ** rng.uniform(-2, 2, 4)
    power, steps = forces.T @ forces / 40, 5 * rng.standard_normal(4)
    most = share * float(np.sqrt(steps @ power @ steps))
    root = np.linalg.cholesky(power).T

    def size(u):
        return (root @ u) @ (root @ u) / (steps @ power @ steps)

    def far(u):
        return (u - steps) @ (u - steps)

    small = scipy.optimize.NonlinearConstraint(size, -np.inf, share**2)
    other = scipy.optimize.minimize(far, share * steps, constraints=[small], tol=1e-14)
    assert _distance_to_small_force(power, steps, most) == pytest.approx(
        other.fun, rel=1e-4, abs=1e-6
    )
