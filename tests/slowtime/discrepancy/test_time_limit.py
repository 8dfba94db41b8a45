"""What is still tried once it is late, in which order, and what is not named then."""

import dataclasses
import math

import pytest
from slowtime.discrepancy.state import Found

from slowtime.discrepancy import search as searching
from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.candidates.library_fit import Candidate, label_of, library_candidates
from slowtime.discrepancy.estimation.candidate_fit import (
    FittedCandidate,
    _heard_again,
    fit_candidates,
)
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.search import Search, search
from slowtime.discrepancy.selection import shortlist as choosing
from slowtime.discrepancy.selection import trial_order as turns
from slowtime.discrepancy.selection.shortlist import labels_of
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant

from .test_search import CUBIC, DRAG, KINDS, SECOND, TWO, named, seen


@pytest.mark.long
def test_who_is_out_of_time_gets_what_was_found_by_then():
    """That is one, be there no time at all: what it leaves tells whether there is any."""
    found = named(seen((CUBIC, DRAG)), late=lambda: True)
    assert found.hurried
    assert len(found.answers) == 1


@pytest.fixture
def rounds(monkeypatch):
    """Of each round of refits: the labels set out with, and those of them begun."""
    told: list[tuple[int, set[str]]] = []

    def counted(before, labels, trials, kinds, tick, **how):
        begun: set[str] = set()
        told.append((len(labels), begun))

        def ticked(effect, number):
            stop = tick(effect, number)
            begun.update([] if stop else [str(label_of(effect))])
            return stop

        return fit_candidates(before, labels, trials, kinds, ticked, **how)

    monkeypatch.setattr(searching, "fit_candidates", counted)
    monkeypatch.setattr(searching, "LOST", math.inf)
    return told


@pytest.mark.long
@pytest.mark.parametrize("within", [False, True], ids=["before", "within"])
@pytest.mark.parametrize("apart", [1.001, 1e9])
def test_once_it_is_late_only_those_that_come_near_the_best_are_tried(
    monkeypatch, rounds, apart, within
):
    """Be it late before the round begins, or while its first label is refitted."""
    monkeypatch.setattr(turns, "APART", apart)
    named(
        seen((CUBIC, DRAG)),
        late=lambda: len(rounds) > 1 and (not within or bool(rounds[1][1])),
        over=lambda: len(rounds) > 2,
    )
    assert (len(rounds[1][1]) == 1) == (apart < 2)


@pytest.mark.parametrize(
    ("untried", "chance", "enough"),
    [("bouc_wen", 0.2, True), ("bouc_wen", 1e-9, False), ("quadratic_damping", 0.2, False)],
    ids=["fewer", "fewer that leave more", "as many"],
)
def test_what_explains_all_needs_no_rival_of_more_numbers(monkeypatch, untried, chance, enough):
    monkeypatch.setattr(turns, "chi2_p_value", lambda _: chance)
    best = FittedCandidate(CUBIC, TWO, refit(Plant.of(TWO, kinds=KINDS), seen(())), 0.0)
    rival = dataclasses.replace(CUBIC, kind=untried)
    assert turns.is_enough(best, rival, catalogue()) == enough


def test_those_of_few_numbers_come_first_and_last_what_is_far_behind():
    found = [
        Candidate(Effect(kind, SECOND, {}), cost, 0.0, 0.0)
        for kind, cost in (("bouc_wen", 10.0), ("coulomb", 11.0), ("cubic_hardening", 30.0))
    ]
    ordered, far = turns.near_first(found, catalogue())
    assert [one.effect.kind for one in ordered] == ["coulomb", "bouc_wen", "cubic_hardening"]
    assert far == {("cubic_hardening", SECOND)}


def test_of_those_that_leave_as_little_the_simpler_is_tried_first():
    costs = (("bouc_wen", 10.0), ("van_der_pol", 10.5), ("coulomb", 10.9), ("stribeck", 11.2),
             ("viscous_damping", 12.0))  # fmt: skip
    found = [Candidate(Effect(kind, SECOND, {}), cost, 0.0, 0.0) for kind, cost in costs]
    ordered = [one.effect.kind for one in turns.simple_first(found, catalogue())]
    assert ordered == ["coulomb", "van_der_pol", "bouc_wen", "stribeck", "viscous_damping"]
    assert turns.simple_first([], catalogue()) == []


@pytest.mark.long
def test_what_one_sensor_cannot_tell_from_the_best_is_tried_as_early(monkeypatch):
    """What is far behind is given up once it is late, and with it what comes after it."""
    one = dataclasses.replace(TWO, sensors=TWO.sensors[:1])
    orders: list[list[float]] = []

    def heard(before, labels, *more, **how):
        orders.append([label.cost for label in labels])
        return fit_candidates(before, labels, *more, **how)

    monkeypatch.setattr(turns, "APART", 1.001)
    monkeypatch.setattr(searching, "fit_candidates", heard)
    monkeypatch.setattr(searching, "LOST", math.inf)
    monkeypatch.setattr(choosing, "mirrored_factor", lambda labels, *_: [labels[0]])
    first = refit(Plant.of(one, kinds=KINDS), trials := seen((CUBIC, DRAG), of=one))
    search(first, trials, Search(KINDS, Monitor(late=lambda: len(orders) > 1)))
    far = [cost >= 1.001 * min(orders[1]) for cost in orders[1]]
    assert any(far)
    assert far.count(False) > 1
    assert far == sorted(far)


@pytest.mark.long
@pytest.mark.parametrize(("left", "few"), [(0.9, False), (1.1, True)])
def test_where_several_are_missing_fewer_are_refitted_before_the_next_is_sought(
    monkeypatch, left, few
):
    monkeypatch.setattr(choosing, "HASTY", 1)
    trials = seen((CUBIC, DRAG))
    first = refit(Plant.of(TWO, kinds=KINDS), trials)
    located = locate(first, trials)
    tried = library_candidates(first, located, KINDS)
    assert len(tried) > 1
    best = dataclasses.replace(located.groups[0], left=left * LIMITS.several_forces_chi2)
    located = dataclasses.replace(located, groups=(best, *located.groups[1:]))
    found = Found([first], trials)
    labels = labels_of(found, first, located, tried, KINDS, number=0, quick=False)
    assert (len(labels) == 1) == few


@pytest.mark.long
def test_once_it_is_late_the_likeliest_are_still_tried():
    found = named(seen((CUBIC, DRAG)), late=lambda: True, over=lambda: False)
    assert found.hurried
    assert {a.effect.kind for a in found.answers} == {CUBIC.kind, DRAG.kind}
    assert found.fits[-1].chi2_in_band < 1.2


@pytest.mark.long
@pytest.mark.parametrize("shaken", [False, True])
def test_what_was_not_tried_with_its_rivals_is_not_named(monkeypatch, shaken):
    """Time is over while the second effect is sought; be it a motion of the base."""
    if shaken:
        monkeypatch.setattr(searching, "base_motion", lambda *_, first: None if first else True)
        monkeypatch.setattr(searching, "placed", lambda *_: False)
        monkeypatch.setattr(searching, "end_with", lambda *_: pytest.fail("it was named"))
    stages: list[str] = []
    found = named(
        seen((CUBIC, DRAG)),
        late=lambda: True,
        over=lambda: stages.count("trying effects") == 2,
        progress=lambda stage, _: stages.append(stage),
    )
    assert len(found.answers) == 1
    assert found.hurried


@pytest.mark.long
def test_who_has_no_time_left_says_that_more_was_not_tried():
    trials = seen((CUBIC,))
    first = refit(Plant.of(TWO, kinds=KINDS), trials)
    found, late = Found([first], trials), Monitor(late=lambda: True, over=lambda: True)
    assert not searching._after(found, first, Search(KINDS, late), 1, pulled=True)
    assert found.hurried


@pytest.mark.parametrize("over", [True, False])
def test_once_time_is_over_what_leaves_much_is_not_fitted_to_its_own_noise(over):
    trials = seen((CUBIC, DRAG))
    before = refit(Plant.of(TWO, kinds=KINDS), trials)
    fit = dataclasses.replace(before, chi2_in_band=50.0)
    found = [FittedCandidate(DRAG, TWO, fit, 0.0)]
    again = _heard_again(before, found, trials, KINDS, anew=True, over=lambda: over)
    assert (again[0].fit is fit) == over
