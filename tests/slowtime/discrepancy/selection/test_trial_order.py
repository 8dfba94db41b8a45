"""In which order candidates are fitted, and which of them once the budget ends."""

import dataclasses

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.candidates.library_fit import label_of
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.selection.trial_order import (
    TrialOrder,
    is_enough,
    near_first,
    simple_first,
)
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import candidate, fitted_candidate
from tests.slowtime.discrepancy.two_mass_chain import (
    CUBIC,
    DRAG,
    KINDS,
    SECOND,
    TWO,
    records_of,
)


def laws(**costs):
    return [candidate(Effect(kind, SECOND, {}), cost) for kind, cost in costs.items()]


@pytest.fixture(scope="module")
def fit():
    return refit(Plant.of(TWO, kinds=KINDS), records_of(()))


@pytest.mark.parametrize(
    ("untried", "left", "enough"),
    [("bouc_wen", 1.0, True), ("bouc_wen", 2.0, False), ("quadratic_damping", 1.0, False)],
    ids=["fewer", "fewer that leave more", "as many"],
)
def test_a_law_that_explains_all_needs_no_rival_of_more_parameters(fit, untried, left, enough):
    best = fitted_candidate(CUBIC, fit, chi2_in_band=left)
    rival = dataclasses.replace(CUBIC, kind=untried)
    assert is_enough(best, rival, catalogue()) == enough


def test_laws_of_few_parameters_come_first_and_those_far_behind_last():
    found = laws(bouc_wen=10.0, coulomb=11.0, cubic_hardening=30.0)
    ordered, far = near_first(found, catalogue())
    assert [one.effect.kind for one in ordered] == ["coulomb", "bouc_wen", "cubic_hardening"]
    assert far == {("cubic_hardening", SECOND)}
    assert near_first([], catalogue()) == ([], set())


def test_of_laws_that_leave_about_as_little_the_simpler_is_tried_first():
    found = laws(
        bouc_wen=10.0, van_der_pol=10.5, coulomb=10.9, stribeck=11.2, viscous_damping=12.0
    )
    ordered = [one.effect.kind for one in simple_first(found, catalogue())]
    assert ordered == ["coulomb", "van_der_pol", "bouc_wen", "stribeck", "viscous_damping"]
    assert simple_first([], catalogue()) == []


@pytest.mark.parametrize(
    ("number", "late", "over", "stops"),
    [
        (0, False, False, {"near": False, "far": False, "second": False}),
        (0, True, False, {"near": False, "far": True, "second": True}),
        (1, True, False, {"near": False, "far": True, "second": False}),
        (1, True, True, {"near": True, "far": True, "second": True}),
    ],
    ids=["in time", "late for the first", "late for a later", "over"],
)
def test_out_of_budget_the_likeliest_are_tried_and_of_the_first_effect_one(
    number, late, over, stops
):
    monitor = Monitor(late=lambda: late, over=lambda: over)
    turn = TrialOrder(monitor, number, 2, 0.1, {label_of(DRAG)})
    asked = {"near": turn(CUBIC, 0), "far": turn(DRAG, 0), "second": turn(CUBIC, 1)}
    assert asked == stops
    # A law far behind the best is no loss; of others it is known what was not tried.
    assert turn.cut == [CUBIC] * (stops["near"] + stops["second"])


def test_each_trial_is_told_with_a_share_that_grows():
    told = []
    monitor = Monitor(lambda stage, share: told.append((stage, share)))
    turn = TrialOrder(monitor, 0, 2, 0.1, set())
    turn(CUBIC, 0)
    turn(DRAG, 1)
    assert [stage for stage, _ in told] == [
        f"refitting {one.kind} at {one.place}" for one in (CUBIC, DRAG)
    ]
    assert told[0][1] < told[1][1] < 0.37
