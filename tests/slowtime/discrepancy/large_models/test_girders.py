"""Missing parts of three girders of 60 beams whose 156 constants are off within tolerances."""

import numpy as np
import pytest

from slowtime.discrepancy.large_models import is_large, reasons_against
from slowtime.discrepancy.large_models.screening import kept_parts
from slowtime.dynamics.description import assemble
from tests.slowtime.discrepancy.large_models.budgets import MOST_S, diagnosed
from tests.slowtime.discrepancy.large_models.chains import TOLERANCE, Matrices
from tests.slowtime.discrepancy.large_models.girders import (
    AT_HZ,
    LOWEST_HZ,
    ZETA,
    campaign,
    coordinates,
    name,
)


def test_the_simulated_girders_are_the_model_but_for_their_tolerances():
    kept: list[Matrices] = []
    given = campaign(kept.append, seconds=4.0)
    model, (true,) = assemble(given.description), kept
    assert is_large(given.description)
    assert reasons_against(given.description) == ""
    assert model.names == tuple(coordinates())
    assert model.mass == pytest.approx(true.mass, rel=1e-9, abs=1e-9 * abs(true.mass).max())
    for own, simulated, tolerance in (
        (model.stiffness, true.stiffness, TOLERANCE.stiffness),
        (model.damping, true.damping, TOLERANCE.damping),
    ):
        off = abs(simulated - own).max() / abs(own).max()
        assert 0 < off < 5 * tolerance


def test_the_simulated_girders_bend_as_a_beam_on_pins():
    kept: list[Matrices] = []
    campaign(kept.append, seconds=2.0)
    squares = np.linalg.eigvals(np.linalg.solve(kept[0].mass, kept[0].stiffness)).real
    lowest = np.sqrt(squares.min()) / (2 * np.pi)
    assert lowest == pytest.approx(LOWEST_HZ, rel=2 * TOLERANCE.stiffness)
    share = kept[0].c / kept[0].k * 2 * np.pi * AT_HZ / 2
    assert share == pytest.approx(ZETA)


def test_beams_are_not_kept_as_springs_across_their_ends():
    model = campaign(lambda true: None, seconds=2.0).description
    kept = kept_parts(model, [(name(0, 3), name(0, 4)), (name(0, 4), name(1, 4))])
    assert [joint.between for joint in kept.joints] == [(name(0, 3), name(0, 4))]
    assert kept.elements == ("k1.4",)


@pytest.mark.long
def test_where_girders_lack_nothing_nothing_is_named():
    answer, spent, _ = diagnosed(campaign(lambda true: None))
    assert answer.verdict in ("nothing_missing", "parameters_only")
    assert not answer.effects
    assert spent < MOST_S
