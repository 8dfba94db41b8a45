"""What is said of constants that are off, of second laws at a place, of curves in pieces."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy import search as searching
from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.candidates.constant_equivalents import is_single_changed_constant
from slowtime.discrepancy.candidates.library_fit import Candidate
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.estimation.candidate_fit import FittedCandidate, fit_candidates
from slowtime.discrepancy.estimation.input_hold import FAINT
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.search import Search
from slowtime.discrepancy.selection import acceptance as accepting
from slowtime.discrepancy.selection.acceptance import MUCH, _explains_much, _still_off, accept
from slowtime.discrepancy.selection.doubts import SLIGHTLY, doubt_pieces
from slowtime.discrepancy.state import Found
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.test_search import CUBIC, FIRST, SECOND, TWO, seen

KINDS = catalogue()
LOST = Effect("stiffness_loss", SECOND, {"dk_n_per_m": 30.0})
HARD, LEVEL, SKEW = (
    Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 2e4}),
    Effect("saturating_stiffness", SECOND, {"ks_n_per_m": 100.0, "es_m": 0.01}),
    Effect("quadratic_damping", SECOND, {"c2_n_s2_per_m2": 3.0}),
)


@pytest.fixture(scope="module")
def fit():
    return refit(Plant.of(TWO), seen(()))


def never(*_):
    return False


def pulled(fit, **by):
    """Let constants of the elements be off by so many tolerances, and no others."""
    values = fit.values.copy()
    for name, mean, sd in zip(fit.prior.names, fit.prior.mean, fit.prior.sd, strict=True):
        key = "_".join(str(part) for part in name)
        values[fit.plant.parameters.index(name)] = mean + by.get(key, 0.0) * sd
    return dataclasses.replace(fit, values=values)


def of(fit, element, off):
    return pulled(fit, **{f"stiffness_{element.id}": off})


def test_one_constant_that_is_far_off_by_itself_is_an_effect(fit):
    assert is_single_changed_constant(of(fit, SECOND, LIMITS.alone_tolerances + 0.1), LOST)
    assert is_single_changed_constant(of(fit, SECOND, -LIMITS.alone_tolerances - 0.1), LOST)
    assert not is_single_changed_constant(of(fit, SECOND, LIMITS.alone_tolerances - 0.1), LOST)
    assert not is_single_changed_constant(of(fit, FIRST, LIMITS.alone_tolerances + 0.1), LOST)
    assert not is_single_changed_constant(of(fit, SECOND, LIMITS.alone_tolerances + 0.1), CUBIC)
    two = {
        f"stiffness_{FIRST.id}": LIMITS.moved_tolerances + 0.1,
        f"stiffness_{SECOND.id}": LIMITS.alone_tolerances + 0.1,
    }
    assert not is_single_changed_constant(pulled(fit, **two), LOST)


@pytest.mark.long
@pytest.mark.parametrize(("lost", "told"), [(250.0, True), (30.0, False)])
def test_a_constant_that_is_far_off_is_told_beside_a_law_that_leaves_something(
    monkeypatch, lost, told
):
    """What the law leaves at its place is no reason to keep silent of the constant."""
    effects = (HARD, Effect("stiffness_loss", SECOND, {"dk_n_per_m": lost}))
    trials = seen(effects)
    first = refit(Plant.of(TWO), trials)
    (hard,) = fit_candidates(first, [Candidate(HARD, 0.0, 0.0, 0.0)], trials, KINDS, never)
    found = Found([first, hard.fit], trials, answers=answered(HARD))
    named = fit_candidates(
        hard.fit, [Candidate(effects[1], 0.0, 0.0, 0.0)], trials, KINDS, never
    )
    monkeypatch.setattr(accepting, "chi2_p_value", lambda _: 0.0)
    pulled = bool(moved_of(hard.fit))
    assert (
        accept(found, hard.fit, named, trials, KINDS, None, pulled=pulled, twice=True) is told
    )
    assert len(found.answers) == 1 + told


def test_what_leaves_the_constant_as_far_off_is_no_other_answer(fit):
    assert _still_off(of(fit, SECOND, LIMITS.moved_tolerances + 0.1), LOST)
    assert not _still_off(of(fit, SECOND, LIMITS.moved_tolerances - 0.1), LOST)
    assert not _still_off(of(fit, FIRST, 9.0), LOST)


def answered(*effects):
    return [NamedEffect(e, KINDS[e.kind].family, {}, 1.0, (), "") for e in effects]


def leaving(fit, *chi2):
    return [dataclasses.replace(fit, chi2_in_band=one) for one in chi2]


@pytest.mark.parametrize(
    ("effect", "left", "much"),
    [
        (SKEW, 0.9 * MUCH, True),
        (SKEW, 1.1 * MUCH, False),
        (LEVEL, 0.9 * MUCH, False),  # another curve over the same elongation
    ],
)
def test_a_second_law_at_a_place_takes_most_of_what_is_left_there(fit, effect, left, much):
    found = Found(leaving(fit, 1e3, 101.0), (), answers=answered(HARD))
    (last,) = leaving(fit, 1 + 100 * left)
    named = FittedCandidate(effect, fit.plant.description, last, 0.0)
    assert _explains_much(found, named, KINDS) is much


def test_what_is_hardly_any_is_no_reason_for_a_second_law(fit):
    found = Found(leaving(fit, 1e6, 101.0), (), answers=answered(HARD))
    named = FittedCandidate(SKEW, fit.plant.description, leaving(fit, 1.0)[0], 0.0)
    assert not _explains_much(found, named, KINDS)


@pytest.mark.parametrize(
    ("second", "share", "doubted"),
    [(LEVEL, 2 * SLIGHTLY, True), (LEVEL, SLIGHTLY / 2, False), (SKEW, 0.5, False)],
    ids=["halves", "a correction", "of another variable"],
)
def test_two_curves_that_share_a_place_may_be_one_that_is_unknown(fit, second, share, doubted):
    fits = leaving(fit, 101.0, 1 + 100 * share, 1.0)
    found = Found(fits, (), answers=answered(HARD, second))
    doubt_pieces(found, KINDS)
    assert found.near is doubted
    assert [rival.effect for rival in found.undecided] == (
        ["cubic_hardening", "saturating_stiffness"] if doubted else []
    )
    assert all(answer.probability < 1 for answer in found.answers) is doubted


@pytest.mark.long
def test_once_the_time_is_up_what_was_fitted_last_is_compared_with(monkeypatch):
    """What it is compared with is not fitted anew; no other hold is asked."""
    effects = (HARD, Effect("stiffness_loss", SECOND, {"dk_n_per_m": 250.0}))
    trials = seen(effects)
    first = refit(Plant.of(TWO), trials)
    (hard,) = fit_candidates(first, [Candidate(HARD, 0.0, 0.0, 0.0)], trials, KINDS, never)
    named = fit_candidates(
        hard.fit, [Candidate(effects[1], 0.0, 0.0, 0.0)], trials, KINDS, never
    )
    calls: dict[str, list[object]] = {"refit": [], "held_as_well": []}

    def counted(name):
        inner = getattr(accepting, name)

        def run(*given, **by):
            result = inner(*given, **by)
            calls[name].append(result)
            return result

        monkeypatch.setattr(accepting, name, run)

    counted("refit")
    counted("held_as_well")

    def taken(over):
        found = Found([first, hard.fit], trials, answers=answered(HARD))
        assert accept(
            found, hard.fit, named, trials, KINDS, (), pulled=True, asked=(), over=over
        )
        return found

    in_time, late = taken(bool), taken(lambda: True)
    assert [len(seen) for seen in calls.values()] == [1, 1]
    assert [one.effect for one in late.answers] == [one.effect for one in in_time.answers]
    np.testing.assert_array_equal(late.fits[-1].values, in_time.fits[-1].values)


@pytest.mark.long
@pytest.mark.parametrize(("k3", "told"), [(20.0, True), (5.0, False)])
def test_a_faint_law_after_which_all_is_noise_is_told_beside_a_loud_fault(k3, told):
    """Louder noise would be left by any law."""
    wrong = Effect("sensor_gain", Place("sensor", "x_m1"), {"gain": 0.96})
    faint = Effect("cubic_hardening", SECOND, {"k3_n_per_m3": k3})
    trials = seen((wrong, faint), samples=2000)
    first = refit(Plant.of(TWO), trials)
    (gain,) = fit_candidates(first, [Candidate(wrong, 0.0, 0.0, 0.0)], trials, KINDS, never)
    named = fit_candidates(gain.fit, [Candidate(faint, 0.0, 0.0, 0.0)], trials, KINDS, never)
    assert gain.fit.cost - named[0].fit.cost < FAINT * gain.fit.data
    found = Found([first, gain.fit], trials, answers=answered(wrong))
    assert accept(found, gain.fit, named, trials, KINDS, None, pulled=False) is told
    again = Found([first, gain.fit], trials, answers=answered(wrong))
    assert not accept(again, gain.fit, named, trials, KINDS, None, pulled=False, twice=True)


@pytest.mark.parametrize("first", [(), (HARD,)])
def test_time_is_up_for_further_effects_and_not_for_the_first(monkeypatch, fit, first):
    told = []

    def heard(*_, over, **__):
        told.append(over())
        return False

    monkeypatch.setattr(searching, "accept", heard)
    how = Search(KINDS, Monitor(over=lambda: True))
    found = Found([fit], (), answers=answered(*first))
    assert not searching._accepted(found, fit, [], how, pulled=False)
    assert told == [bool(first)]
