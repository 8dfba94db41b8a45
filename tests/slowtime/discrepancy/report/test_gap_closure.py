"""A gap without a name is closed by a surface where that does better, and a note says so."""

import dataclasses
import itertools

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.candidates.library_fit import Candidate
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.force_surface import (
    MAX_WORK,
    SurfaceFit,
    SurfaceShape,
    fit_force_surface,
)
from slowtime.discrepancy.report import gap_closure
from slowtime.discrepancy.report.gap_closure import (
    NO_ELEMENT,
    UNTRIED,
    ClosedGap,
    close_gap,
    describe_gap_closure,
)
from slowtime.discrepancy.report.likeness import likenesses
from slowtime.discrepancy.report.surface_cuts import measured_force
from slowtime.discrepancy.time_limit import TimeLimit, limited
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered
from tests.slowtime.discrepancy.rigs import ONE, PLACE

KINDS, RATE = catalogue(), 128.0
STOPS = Effect("gap_symmetric", PLACE, {"kg_n_per_m": 400.0, "gap_m": 0.005})


def records(effects, count=3):
    rng = np.random.default_rng(3)
    plant = Plant.of(dataclasses.replace(ONE, effects=tuple(e.entry() for e in effects)))
    found = []
    for number in range(count):
        push = (3.0 - 0.6 * number) * np.convolve(rng.standard_normal(1500), np.hanning(25) / 5)
        clean = plant.simulate(plant.values, push[:1500, None], RATE)
        seen = clean + 0.01 * clean.std() * rng.standard_normal(clean.shape)
        found.append(Trial(inputs=push[:1500, None], outputs=seen, rate_hz=RATE))
    return tuple(found)


def hypothesis(trials):
    first = refit(Plant.of(ONE), trials)
    laws = (STOPS, Effect("stiffness_drift", PLACE, {"dk_n_per_m": 300.0}))
    tried = tuple(Candidate(effect, 1.0, 0.0, 100.0) for effect in laws)
    return Hypothesis((first,), trials, localized=locate(first, trials), tried=tried)


@pytest.fixture(scope="module")
def closed():
    *trials, test = records([STOPS])
    found = hypothesis(tuple(trials))
    told = close_gap(found, tuple(trials), (test,), KINDS, held_out=True, error=0.8)
    assert isinstance(told, ClosedGap)
    return told, found, tuple(trials), test


def test_a_surface_that_does_better_is_adopted_and_described(closed):
    told, found, _, _ = closed
    assert told.error < 0.05
    like = likenesses(told.fit, PLACE, found, KINDS)
    text = describe_gap_closure(told, 1.0, like, KINDS)
    assert f"a force surface was fitted at {PLACE} (measured_force)" in text
    assert "it is extrapolated linearly, which no record supports" in text
    assert "most resembles" in text
    assert "gap_symmetric" in text


def test_the_shape_of_a_surface_is_described(closed):
    told, _, _, _ = closed
    odd = dataclasses.replace(told.shaped, shape=SurfaceShape(-1, 1, -1), gain=12.0)
    text = describe_gap_closure(dataclasses.replace(told, shaped=odd), 1.0, [], KINDS)
    assert "odd and monotone (it rises with the elongation and falls with the rate)" in text
    assert "log evidence is 12 higher" in text
    assert "does not fit these records" not in text


@pytest.mark.parametrize(
    ("level_of", "cause", "change"),
    [
        (0.0, "recent vibration (the last 8 s): at vibration of mean level", "+75"),
        (
            1.0,
            "largest elongation so far (since a record began): at the largest elongation",
            "+3e+02",
        ),
        (2.0, "age (a time constant of 8 s): at long times", "+3e+02"),
    ],
)
def test_what_a_stiffness_slowly_changes_with_is_told_with_the_change(
    closed, level_of, cause, change
):
    told, _, trials, _ = closed
    scales = {
        "vs_m_per_s": 0.01, "eq_m": 2e-4, "centre_m": 0.0, "dense_m": 5e-4, "low_m": -0.01,
        "high_m": 0.008, "dense_m_per_s": 0.02, "high_m_per_s": 0.1, "spread_n": 4.0,
        "path_m": 1e-3, "lag_s": 0.05, "lag_of": 0.0, "level_s": 8.0, "level_of": level_of,
    }  # fmt: skip
    slow = Effect("measured_force_with_memory", PLACE, scales | {"xl2_n": 3.0})
    plant = Plant.of(dataclasses.replace(ONE, effects=(slow.entry(),)))
    fit = refit(plant, trials, free=[])
    terms = dataclasses.replace(told.shaped.terms, leading={"xl1_n": 0.0, "xl2_n": 3.0})
    shaped = dataclasses.replace(told.shaped, terms=terms)
    text = describe_gap_closure(
        dataclasses.replace(told, fit=fit, shaped=shaped), 1.0, [], KINDS
    )
    assert f"changes with the {cause} it is {change} N/m beside the element's own." in text


def test_a_demanded_shape_that_does_not_fit_is_named_with_what_it_costs(closed):
    told, _, _, _ = closed
    bent = dataclasses.replace(told.shaped, refused=(("even", 40.2),))
    text = describe_gap_closure(dataclasses.replace(told, shaped=bent), 1.0, [], KINDS)
    assert "The demanded shape, even, does not fit these records" in text
    assert "by 40" in text
    assert "Use --setting surface=auto" in text


def test_a_picture_of_a_surface_has_its_measured_range_and_opening_bands(closed):
    told, found, _, _ = closed
    like = likenesses(told.fit, PLACE, found, KINDS)
    shown = measured_force(told, like, found, KINDS)
    at, sd = shown.over_e.at, shown.over_e.sd
    inside = (at >= shown.low) & (at <= shown.high)
    assert 0 < inside.sum() < len(at)
    beyond = sd[at > shown.high]
    assert (np.diff(beyond) > 0).all()
    assert beyond[-1] > sd[inside].max()
    law = shown.over_e.law
    assert law is not None
    assert np.isfinite(law[inside]).all()
    assert np.isnan(law[~inside]).all()
    assert "gap_symmetric" in shown.law
    assert shown.low <= shown.e.min() < shown.e.max() <= shown.high
    seen = np.isfinite(shown.grid_force)
    corner = np.hypot(shown.grid_e[None] / shown.high, shown.grid_v[:, None] / shown.most) > 1.3
    assert seen.any()
    assert not seen[corner].any()


def test_a_law_is_drawn_where_the_surface_is_like_it(closed):
    """The stops, and a spring and a damper beside them, are near the surface in the middle."""
    told, found, _, _ = closed
    shown = measured_force(told, likenesses(told.fit, PLACE, found, KINDS), found, KINDS)
    middle = np.abs(shown.over_e.at) < 0.5 * shown.high
    assert shown.over_e.law is not None
    off = shown.over_e.law[middle] - shown.over_e.force[middle]
    assert np.sqrt(np.mean(off**2)) < 0.1 * np.ptp(shown.over_e.force)


def test_a_law_with_a_clock_of_its_own_is_like_no_surface(closed):
    told, found, _, _ = closed
    like = likenesses(told.fit, PLACE, found, KINDS)
    assert [one.kind for one in like] == ["gap_symmetric"]
    assert like[0].share > 0.8
    assert like[0].unlike_above[1] == np.inf


def test_a_law_is_like_a_surface_up_to_where_it_is(closed):
    """A stiffer spring behind the stops is like them up to where it begins."""
    told, found, _, _ = closed
    late = dataclasses.replace(STOPS, parameters={"kg_n_per_m": 400.0, "gap_m": 0.01})
    kept = dataclasses.replace(found, tried=(Candidate(late, 1.0, 0.0, 100.0),))
    (near,), like = (
        likenesses(told.fit, PLACE, found, KINDS),
        likenesses(told.fit, PLACE, kept, KINDS),
    )
    assert not like or like[0].share < near.share


def test_why_no_surface_is_adopted_is_said(closed):
    _, found, trials, test = closed
    told = close_gap(found, trials, (test,), KINDS, held_out=True, error=1e-6)
    assert isinstance(told, str)
    assert "not adopted" in told
    assert str(PLACE) in told


def test_a_recovered_force_that_runs_away_is_replaced_by_a_flat_start(closed, monkeypatch):
    _, found, trials, test = closed
    asked = []

    def diverging(*given, flat=False, **how):
        asked.append(flat)
        return fit_force_surface(*given, flat=True, **how) if flat else None

    monkeypatch.setattr(gap_closure, "fit_force_surface", diverging)
    told = close_gap(found, trials, (test,), KINDS, held_out=True, error=0.8)
    assert asked == [False, True]
    assert isinstance(told, ClosedGap)
    assert told.error < 0.05


def test_a_surface_that_leaves_more_than_without_it_is_not_adopted(closed, monkeypatch):
    told, found, trials, test = closed
    worse = dataclasses.replace(
        told.fit, residual=tuple(100 * one for one in told.fit.residual)
    )
    fitted = SurfaceFit(told.place, worse, (), True, told.shaped)
    monkeypatch.setattr(gap_closure, "fit_force_surface", lambda *_, **__: fitted)
    said = close_gap(found, trials, (test,), KINDS, held_out=True, error=0.8)
    assert isinstance(said, str)
    assert "leaves more of the training records than without it" in said
    assert str(PLACE) in said


def test_a_time_limit_ends_the_fit_of_a_surface_and_says_so(closed):
    """The limit is reached before a surface is fitted, or after four questions for it."""
    _, found, trials, test = closed
    asked = itertools.count()
    none = TimeLimit(is_reached=lambda: True)
    some = TimeLimit(is_reached=lambda: next(asked) >= 4)
    with limited(none):
        told = close_gap(found, trials, (test,), KINDS, held_out=True, error=0.8)
    assert told == UNTRIED
    with metered() as meter, limited(some):
        told = close_gap(found, trials, (test,), KINDS, held_out=True, error=0.8)
    assert "convergence of the force surface" in some.note
    assert meter.spent < 0.2 * MAX_WORK
    assert isinstance(told, str) or not told.finished


def test_a_short_diagnosis_fits_a_surface_for_a_short_time(closed):
    told, found, trials, test = closed
    with limited(TimeLimit(budget_share=1e-6)):
        short = close_gap(found, trials, (test,), KINDS, held_out=True, error=0.8)
    assert isinstance(short, ClosedGap)
    assert not short.finished
    like = likenesses(short.fit, PLACE, found, KINDS)
    with limited(TimeLimit(budget_share=1e-6)):
        said = describe_gap_closure(short, 0.8, like, KINDS)
    assert "grows with --patience" in said
    assert told.finished


def test_where_nothing_but_noise_is_left_no_surface_is_fitted():
    *trials, test = records([])
    found = hypothesis(tuple(trials))
    told = close_gap(found, tuple(trials), (test,), KINDS, held_out=True, error=0.8)
    assert told == NO_ELEMENT
