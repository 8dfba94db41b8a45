"""Missing parts of a chain of 200 masses whose 402 constants are off within tolerances."""

import numpy as np
import pytest

from slowtime.discrepancy.large_models import reduce_for
from slowtime.discrepancy.large_models.screening import KEPT_PAIRS
from slowtime.discrepancy.progress import Monitor
from slowtime.dynamics.description import OpenJoint, assemble
from slowtime.dynamics.effects import catalogue
from tests.slowtime.discrepancy.large_models.budgets import MOST_KB, MOST_S, WORK, diagnosed
from tests.slowtime.discrepancy.large_models.chains import Matrices, campaign, link

LITTLE_WORK = 140 * 2.3e8
"""[units of work] Budget that ends before a support is compared with its neighbours."""


def add_spring(true):
    true.stiffness += 0.05 * true.k * link(200, 60, 120)


def add_support(true):
    true.stiffness += 0.01 * true.k * link(200, None, 95)


def add_damper(true):
    true.damping += 2.0 * true.c * link(200, 45, 160)


def add_mass(true):
    true.mass += 6.0 * link(200, None, 77)


PLACES = {
    "spring": (add_spring, "n61-n121"),
    "support": (add_support, "base-n96"),
    "damper": (add_damper, "n46-n161"),
    "mass": (add_mass, "base-n78"),
}
CASES = {
    "spring": (add_spring, "missing_spring", "n61-n121", lambda t: 0.05 * t.k),
    "support": (add_support, "missing_spring", "base-n96", lambda t: 0.01 * t.k),
    "damper": (add_damper, "missing_damper", "n46-n161", lambda t: 2.0 * t.c),
    "mass": (add_mass, "added_mass", "n78", lambda t: 6.0),
}


@pytest.mark.long
@pytest.mark.parametrize("case", PLACES)
def test_the_search_is_given_the_place_of_what_is_missing(case):
    change, place = PLACES[case]
    given = campaign(change)
    reduced = reduce_for(given.description, given.trials, catalogue(), Monitor())
    joints = [one.id for one in reduced.small.elements if isinstance(one, OpenJoint)]
    assert place in joints
    assert len(joints) <= KEPT_PAIRS


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_what_is_missing_is_named_at_its_place_with_its_size(case):
    change, kind, place, size = CASES[case]
    kept: list[Matrices] = []

    def changed(true: Matrices) -> None:
        change(true)
        kept.append(true)

    given = campaign(changed)
    answer, spent, peak = diagnosed(given, LITTLE_WORK if case == "support" else WORK)
    (named,) = answer.effects
    assert (answer.verdict, named.effect.kind, named.effect.place.id) == (
        "missing_effect", kind, place,
    )  # fmt: skip
    (number,) = named.numbers.values()
    assert number.value == pytest.approx(size(kept[0]), abs=4 * number.sd)
    assert spent < MOST_S
    assert peak < MOST_KB
    whole = assemble(answer.augmented)
    assert whole.dofs == 200
    assert answer.nominal is given.description


@pytest.mark.long
def test_where_nothing_is_missing_nothing_is_named():
    answer, spent, peak = diagnosed(campaign(lambda true: None))
    assert answer.verdict in ("nothing_missing", "parameters_only")
    assert not answer.effects
    assert spent < MOST_S
    assert peak < MOST_KB
    assert np.isfinite(answer.gap.augmented)
