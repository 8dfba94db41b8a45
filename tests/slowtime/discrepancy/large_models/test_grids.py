"""Missing parts of a grid of 100 masses whose 440 constants are off within tolerances."""

import pytest

from slowtime.discrepancy.large_models import reduce_for
from slowtime.discrepancy.large_models.basis import MODE_MARGIN, BandModes, band_limit_hz
from slowtime.discrepancy.progress import Monitor
from slowtime.dynamics.description import assemble
from slowtime.dynamics.effects import catalogue
from tests.slowtime.discrepancy.large_models.budgets import MOST_S, diagnosed
from tests.slowtime.discrepancy.large_models.chains import Matrices, link
from tests.slowtime.discrepancy.large_models.grids import BAND_HZ, SIZE, campaign, name, springs

BRACED = (24, 57)
HELD = 40
"""Numbers of the masses that a brace joins, and of one on the frame."""
SHARE = 0.3
"""Stiffness of the brace, and what the frame's spring has lost, of that of other springs."""


def brace(true: Matrices) -> None:
    true.stiffness += SHARE * true.k * link(SIZE**2, *BRACED)


def loosen(true: Matrices) -> None:
    true.stiffness -= SHARE * true.k * link(SIZE**2, None, HELD)


BRACE = "-".join(name(number // SIZE, number % SIZE) for number in BRACED)
SUPPORT = next(
    f"k{i + 1}" for i, (_, _, *ends) in enumerate(springs(SIZE)) if ends == [None, HELD]
)


def test_the_simulated_grid_is_the_model_but_for_its_tolerances():
    kept: list[Matrices] = []
    given = campaign(kept.append, seconds=20.0)
    model, (true,) = assemble(given.description), kept
    modes = BandModes.of(model, band_limit_hz(given.trials))
    assert band_limit_hz(given.trials) == pytest.approx(BAND_HZ, rel=0.05)
    assert modes.kept < 20
    assert MODE_MARGIN * BAND_HZ < 10.0
    off = abs(true.stiffness - model.stiffness).max()
    assert 0 < off < 5 * 0.01 * 4 * true.k
    assert (abs(true.mass - model.mass) < 1e-12).all()


@pytest.mark.long
def test_a_brace_that_a_grid_lacks_is_named_at_its_place_with_its_size():
    kept: list[Matrices] = []

    def changed(true: Matrices) -> None:
        brace(true)
        kept.append(true)

    answer, spent, _ = diagnosed(campaign(changed))
    (named,) = answer.effects
    assert (answer.verdict, named.effect.kind, named.effect.place.id) == (
        "missing_effect", "missing_spring", BRACE,
    )  # fmt: skip
    (number,) = named.numbers.values()
    assert number.value == pytest.approx(SHARE * kept[0].k, abs=4 * number.sd)
    assert spent < MOST_S


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_the_search_is_given_a_spring_for_which_constants_nearly_make_up(seed):
    given = campaign(loosen, seed=seed)
    reduced = reduce_for(given.description, given.trials, catalogue(), Monitor())
    assert SUPPORT in {element.id for element in reduced.small.elements}


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_a_spring_of_the_frame_that_lost_stiffness_is_named_with_its_loss(seed):
    kept: list[Matrices] = []

    def changed(true: Matrices) -> None:
        loosen(true)
        kept.append(true)

    answer, spent, _ = diagnosed(campaign(changed, seed=seed))
    (named,) = answer.effects
    assert (answer.verdict, named.effect.kind, named.effect.place.id) == (
        "missing_effect", "stiffness_loss", SUPPORT,
    )  # fmt: skip
    (number,) = named.numbers.values()
    assert number.value == pytest.approx(SHARE * kept[0].k, abs=4 * number.sd)
    assert spent < MOST_S


@pytest.mark.long
def test_where_a_grid_lacks_nothing_nothing_is_named():
    answer, spent, _ = diagnosed(campaign(lambda true: None))
    assert answer.verdict in ("nothing_missing", "parameters_only")
    assert not answer.effects
    assert spent < MOST_S
