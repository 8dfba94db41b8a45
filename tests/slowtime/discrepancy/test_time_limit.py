"""What a search out of budget still tries, and what it does not name."""

import threading

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.search import SearchSettings, search
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.two_mass_chain import CUBIC, DRAG, KINDS, TWO, records_of


@pytest.fixture(scope="module")
def lacking():
    """Records of two laws, and the model without them."""
    trials = records_of((CUBIC, DRAG))
    return refit(Plant.of(TWO, kinds=KINDS), trials), trials


def searched(lacking, late=None, over=None, progress=None):
    first, trials = lacking
    monitor = Monitor(progress, late=late, over=over)
    return search(first, trials, SearchSettings(KINDS, monitor))


def test_out_of_budget_from_the_beginning_one_effect_is_found(lacking):
    """What it leaves tells whether there is any."""
    found = searched(lacking, late=lambda: True)
    assert found.exhausted
    assert len(found.effects) == 1


@pytest.mark.long
def test_once_it_is_late_the_likeliest_are_still_tried(lacking):
    found = searched(lacking, late=lambda: True, over=lambda: False)
    assert found.exhausted
    assert {a.effect.kind for a in found.effects} == {CUBIC.kind, DRAG.kind}
    assert found.last.chi2_in_band < 1.2


@pytest.mark.long
def test_a_later_effect_whose_rivals_were_not_tried_is_not_named(lacking):
    """The budget ends while the second effect is sought."""
    stages: list[str] = []
    found = searched(
        lacking,
        late=lambda: True,
        over=lambda: sum(one.startswith("trying effects") for one in stages) == 2,
        progress=lambda stage, _: stages.append(stage),
    )
    assert len(found.effects) == 1
    assert found.exhausted


def test_what_is_likely_missing_is_told_while_the_search_goes_on(lacking):
    first, trials = lacking
    stages: list[str] = []
    enough = threading.Event()

    def progress(stage, _):
        stages.append(stage)
        if "so far" in stage:
            enough.set()

    monitor = Monitor(progress, enough=enough)
    found = search(first, trials, SearchSettings(KINDS, monitor))
    told = [one for one in stages if "so far" in one]
    assert "so far" not in stages[0]
    assert any(str(one.place) in told[0] for one in (CUBIC, DRAG))
    # An answer was asked for at that moment: the likeliest is fitted, and nothing more.
    assert found.exhausted
    assert len(found.effects) <= 1
