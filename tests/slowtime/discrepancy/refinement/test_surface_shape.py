"""Shapes of a force surface: words, needed coefficients, and what the records allow."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.refinement.force_surface import (
    SurfaceDemand,
    fit_force_surface,
    surface_band,
)
from slowtime.discrepancy.refinement.force_surface.shape import (
    EVEN,
    FREE,
    NEITHER,
    ODD,
    SurfaceShape,
    groups_of,
    scales_of,
)
from slowtime.dynamics.description import Spring
from slowtime.dynamics.effects import Motion, catalogue, force_along
from slowtime.dynamics.effects.library.measured_force import TERMS
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.refinement import test_force_surface as rig
from tests.slowtime.discrepancy.rigs import ONE

KINDS = catalogue()
GROUPS = {group: tuple(name for name, _ in terms) for group, terms in TERMS}
SCALES = {
    "vs_m_per_s": 0.01, "eq_m": 2e-4, "centre_m": 0.0, "dense_m": 5e-4, "low_m": -3e-3,
    "high_m": 3e-3, "dense_m_per_s": 0.02, "high_m_per_s": 0.1, "spread_n": 4.0,
}  # fmt: skip


def progressive(e, v, t, z, p):
    """Odd, and rises with the elongation; no law of the catalogue."""
    return p[0] * e * abs(e / p[1]) ** 0.5


def one_way(e, v, t, z, p):
    """Damping that is larger in one direction: rises with the rate, and is not odd."""
    return p[0] * (v if v > 0 else 0.3 * v)


def bump(e, v, t, z, p):
    """Odd, and rises and falls."""
    return p[0] * e / (1.0 + (e / p[1]) ** 4)


def short_records(name, law, seconds=6.0, noise=0.05, **values):
    """Two short, noisy records to learn from."""
    plain, rig.NOISE = rig.NOISE, noise
    try:
        return rig.records(*rig.outside(name, law, **values), seconds=seconds)[:2]
    finally:
        rig.NOISE = plain


def fitted(trials, *words):
    first = refit(Plant.of(ONE), trials)
    located = locate(first, trials)
    found = fit_force_surface(first, located, trials, KINDS, demand=SurfaceDemand.of(words))
    assert found is not None
    return found


def still(e):
    return Motion(e=e, v=np.zeros_like(e), a=np.zeros_like(e), times=np.arange(len(e)) * 1.0)


def error_of(found, law, *values):
    """Error of the whole force of the element at rest, over the middle of the motion [N]."""
    e = np.linspace(-0.01, 0.01, 41)
    force, sd = surface_band(found.fit, still(e))
    spring = ONE.elements[0]
    assert isinstance(spring, Spring)
    spare = found.fit.values[0] - spring.stiffness_n_per_m
    truth = np.array([law(x, 0.0, 0.0, None, values) for x in e])
    off = force + spare * e - truth
    return float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean(sd**2)))


@pytest.mark.parametrize(
    ("words", "parity", "monotone"),
    [
        ((), None, False), (("auto",), None, False), (("free",), NEITHER, False),
        (("odd",), ODD, False), (("even",), EVEN, False), (("odd", "monotone"), ODD, True),
        (("monotone",), None, True),
    ],
)  # fmt: skip
def test_words_say_a_shape(words, parity, monotone):
    assert SurfaceDemand.of(words) == SurfaceDemand(parity, monotone)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("round",), "No shape of a surface is called 'round'"),
        (("odd", "even"), "contradict each other"),
        (("even", "monotone"), "contradict each other"),
    ],
)
def test_words_that_say_no_shape_are_refused(words, told):
    with pytest.raises(ValueError, match=told):
        SurfaceDemand.of(words)


@pytest.mark.parametrize("parity", [ODD, EVEN])
@pytest.mark.parametrize("group", [*GROUPS])
def test_the_coefficients_that_are_kept_make_all_that_the_others_can(group, parity):
    rng = np.random.default_rng(2)
    e, v = 3e-3 * rng.uniform(-1, 1, 400), 0.1 * rng.uniform(-1, 1, 400)
    points = dataclasses.replace(still(e), v=v)
    scales = scales_of(SCALES, SurfaceShape(parity))

    def columns(names):
        return [force_along(KINDS["measured_force"], scales | {n: 1.0}, points) for n in names]

    every = np.stack(columns(GROUPS[group]), axis=1)
    kept = groups_of({group: GROUPS[group]}, parity, monotone=False).get(group, ())
    rank = np.linalg.matrix_rank(every, tol=1e-9)
    assert len(kept) == rank
    if kept:
        assert np.linalg.matrix_rank(np.stack(columns(kept), axis=1), tol=1e-9) == rank


def test_a_monotone_surface_has_no_terms_of_elongation_and_motion_together():
    kept = groups_of(GROUPS, NEITHER, monotone=True)
    assert kept["friction"] == ("mu1_n",)
    assert kept["side"] == ("q_n",)
    assert "damping" not in kept


def test_an_odd_surface_reaches_as_far_to_either_side():
    own = scales_of(SCALES | {"low_m": -1e-3, "centre_m": 1e-3}, SurfaceShape(ODD))
    assert (own["low_m"], own["high_m"], own["centre_m"]) == (-3e-3, 3e-3, 0.0)
    assert own["parity"] == -1.0
    assert scales_of(SCALES, FREE) == SCALES


def test_an_odd_truth_is_met_better_by_an_odd_surface_with_narrower_bands():
    trials = short_records("progressive", progressive, k=400.0, h=0.01)
    free, odd = fitted(trials, "free"), fitted(trials, "odd")
    assert odd.shape.parity == ODD
    assert not odd.shaped.refused
    (error_free, sd_free), (error_odd, sd_odd) = (
        error_of(one, progressive, 400.0, 0.01) for one in (free, odd)
    )
    assert error_odd < error_free
    assert sd_odd < 0.95 * sd_free


def test_a_monotone_truth_is_met_by_a_monotone_surface_with_narrower_bands():
    trials = short_records("progressive", progressive, k=400.0, h=0.01)
    free, held = fitted(trials, "free"), fitted(trials, "monotone")
    assert (held.shape.monotone_e, held.shaped.refused) == (1, ())
    (_, sd_free), (error_held, sd_held) = (
        error_of(one, progressive, 400.0, 0.01) for one in (free, held)
    )
    assert error_held < sd_held < sd_free
    high = held.fit.plant.effects[-1].parameters["high_m"]
    force, _ = surface_band(held.fit, still(np.linspace(-1.5 * high, 1.5 * high, 301)))
    assert (np.diff(force) >= -1e-12 * np.abs(force).max()).all()


def test_a_truth_that_is_not_odd_is_not_made_odd():
    trials = short_records("one_way", one_way, c=5.0)
    asked, free = fitted(trials, "odd"), fitted(trials, "free")
    ((words, loss),) = asked.shaped.refused
    assert (words, asked.shape) == ("odd", FREE)
    assert loss > 5
    np.testing.assert_array_equal(asked.fit.values, free.fit.values)


def test_a_truth_that_rises_and_falls_is_not_made_monotone():
    trials = short_records("bump", bump, seconds=10.0, noise=0.01, k=300.0, h=0.006)
    found = fitted(trials, "monotone")
    assert [words for words, _ in found.shaped.refused][-1].endswith("monotone")
    assert found.shape.monotone_e == 0


def test_records_choose_an_odd_surface_where_it_explains_them_as_well():
    trials = short_records("truss", rig.truss, seconds=20.0, noise=0.01, kt=400.0, height=0.01)
    found = fitted(trials)
    assert found.shape == SurfaceShape(ODD)
    assert found.shaped.gain > 3
    assert fitted(short_records("one_way", one_way, c=5.0)).shape == FREE
