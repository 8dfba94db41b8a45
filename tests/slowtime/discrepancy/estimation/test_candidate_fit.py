"""Candidates are fitted to the free run, batch after batch, and ranked by one noise."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import FitAbandoned, refit
from slowtime.discrepancy.calibration.augmentation import FitStart, carry_effect
from slowtime.discrepancy.calibration.levenberg_marquardt import FitControl
from slowtime.discrepancy.calibration.tolerances import HELD_TOLERANCES, refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import label_of, library_candidates
from slowtime.discrepancy.estimation.candidate_fit import (
    MAIN_EFFECT_SHARE,
    Fitting,
    best_of_each_place,
    fit_candidates,
)
from slowtime.discrepancy.estimation.model_evidence import misfit
from slowtime.discrepancy.localization import locate
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered
from tests.slowtime.discrepancy.protocol import (
    candidate,
    fit_effect,
    fitted_candidate,
    in_budget,
)
from tests.slowtime.discrepancy.three_mass_chain import recorded
from tests.slowtime.discrepancy.two_mass_chain import (
    CUBIC,
    DRAG,
    FIRST,
    KINDS,
    SECOND,
    STRONG,
    TWO,
    records_of,
)

ALL = catalogue()


@pytest.fixture(scope="module")
def lacking():
    """Records of a spring that hardens, and the fit without it."""
    trials = records_of((CUBIC,))
    return trials, refit(Plant.of(TWO, kinds=KINDS), trials)


@pytest.fixture(scope="module")
def fitted(lacking):
    trials, before = lacking
    return fit_effect(before, CUBIC, trials, KINDS)


def fitting(lacking, tick=in_budget, kinds=KINDS, **more):
    trials, before = lacking
    return Fitting(before=before, trials=trials, kinds=kinds, tick=tick, **more)


def test_a_fitting_is_a_new_one_after_each_batch(lacking):
    begun = fitting(lacking)
    first = begun.fit([candidate(CUBIC)])
    both = first.fit([candidate(DRAG)])
    assert (begun.count, first.count, both.count) == (0, 1, 2)
    assert begun.found == ()
    assert [one.effect.kind for one in first.found] == [CUBIC.kind]
    assert both.found[:1] == first.found
    assert both.noise is first.noise is first.found[0].fit.noise
    assert both.ranked()[0].effect.kind == CUBIC.kind


def test_out_of_budget_no_further_candidate_is_fitted(lacking):
    asked = []

    def once(effect, number):
        asked.append((effect.kind, number))
        return number > 0

    stopped = fitting(lacking, once).fit([candidate(CUBIC), candidate(DRAG), candidate(CUBIC)])
    assert stopped.stopped
    assert [one.effect.kind for one in stopped.found] == [CUBIC.kind]
    assert asked[-1] == (DRAG.kind, 1)
    assert stopped.fit([candidate(DRAG)]).count == stopped.count


def test_a_fit_is_given_up_once_the_budget_ends(lacking):
    trials, before = lacking
    asked: list[int] = []

    def late():
        asked.append(len(asked))
        return len(asked) > 1

    with pytest.raises(FitAbandoned):
        refit(before.plant, trials, control=FitControl(is_late=late))
    assert len(asked) == 2
    ticks = iter([False, True])  # in time when it begins
    assert (
        fit_candidates(before, [candidate(CUBIC)], trials, KINDS, lambda *_: next(ticks)) == []
    )


def test_the_budget_ends_the_search_for_a_better_instant_of_a_switch_too(lacking):
    """Whoever fits candidates is asked again until the last of a fit."""
    trials, before = tuple(one.part(0, 130) for one in lacking[0]), lacking[1]
    kinds = {"stiffness_jump": catalogue()["stiffness_jump"]}
    jump = Effect("stiffness_jump", SECOND, {"dk_n_per_m": 100.0, "t_jump_s": 4.0})
    asked = []

    def tick(effect, number):
        asked.append((effect, number))

    with metered() as in_time:
        fit_candidates(before, [candidate(jump)], trials, kinds, tick)
    last = len(asked) - 1
    asked.clear()

    def late(effect, number):
        asked.append((effect, number))
        return len(asked) > last

    with metered() as hurried:
        fit_candidates(before, [candidate(jump)], trials, kinds, late)
    assert hurried.spent < in_time.spent


def test_of_one_law_fitted_from_two_starts_the_better_is_kept(lacking):
    trials, before = lacking
    twice = [candidate(CUBIC), candidate(CUBIC)]
    fits = fit_candidates(before, twice, trials, KINDS, in_budget)
    assert [one.effect.kind for one in fits] == [CUBIC.kind]


@pytest.mark.parametrize("over", [True, False])
def test_once_the_budget_ended_the_best_is_not_fitted_to_the_noise_it_leaves(
    lacking, fitted, over
):
    far = fitted_candidate(CUBIC, fitted.fit, chi2_in_band=50.0)
    (best, *_) = fitting(lacking, found=(far,)).ranked(lambda: over)
    assert (best is far) == over


def test_a_best_fit_far_from_noise_is_fitted_anew_only_if_no_candidate_was_left_out(lacking):
    """One period off over a long record, the misfit has a minimum too."""
    strong = records_of((STRONG,))
    bent = refit(Plant.of(TWO, kinds=KINDS), strong)
    before = dataclasses.replace(bent, chi2_in_band=1e4 * bent.chi2_in_band)
    spent = {}
    for stopped in (False, True):
        wrong = fitted_candidate(DRAG, carry_effect(bent, DRAG, KINDS))
        made = fitting((strong, before), found=(wrong,), stopped=stopped)
        with metered() as meter:
            made.ranked()
        spent[stopped] = meter.spent
    assert spent[True] < spent[False]


def test_a_law_that_its_last_fit_does_not_show_is_not_among_the_ranked(lacking, fitted):
    far = fitted_candidate(CUBIC, fitted.fit, chi2_in_band=9.0)
    unseen = KINDS | {
        CUBIC.kind: dataclasses.replace(KINDS[CUBIC.kind], shown=lambda *_: False)
    }
    (kept,) = fitting(lacking, found=(far,)).ranked()
    assert kept.effect.kind == CUBIC.kind
    assert fitting(lacking, found=(far,), kinds=unseen).ranked() == []


def test_a_law_near_the_end_of_its_range_is_ranked_where_no_simpler_law_does_the_same():
    kinds = {"van_der_pol": catalogue()["van_der_pol"]}
    sings = Effect("van_der_pol", SECOND, {"cn_n_s_per_m": 0.05, "e0_m": 0.004})
    trials = records_of((sings,))
    before = refit(Plant.of(TWO, kinds=kinds), trials)
    (named,) = fit_candidates(before, [candidate(sings)], trials, kinds, in_budget)
    assert (named.effect.kind, named.effect.place) == ("van_der_pol", SECOND)


@pytest.mark.long
def test_once_one_law_explains_half_those_that_would_leave_more_are_given_up():
    trials = records_of((dataclasses.replace(CUBIC, parameters={"k3_n_per_m3": 8e4}), DRAG))
    first = refit_within_tolerances(refit(Plant.of(TWO, kinds=KINDS), trials), trials)
    labels = library_candidates(first, locate(first, trials), KINDS)
    asked: list[Effect] = []
    found = fit_candidates(first, labels, trials, KINDS, lambda effect, _: asked.append(effect))
    left = min(misfit(one.fit, first.noise, trials) for one in found)
    assert 3 * first.data < left < MAIN_EFFECT_SHARE * labels[0].cost_without
    far = {label_of(c.effect) for c in labels if c.cost > 2 * max(left, labels[0].cost)}
    assert far
    assert far.isdisjoint(map(label_of, asked))


@pytest.mark.parametrize(("kind", "slowly"), [("cubic_hardening", False), ("coulomb", True)])
def test_a_law_known_from_segments_is_fitted_to_shares_of_the_records_that_grow(
    lacking, kind, slowly
):
    """Those of friction more slowly; one that is known along the force at once to much."""
    _, before = lacking
    effect = Effect(kind, SECOND, {KINDS[kind].names[0]: 1e4 if not slowly else 0.1})
    constants = {
        name: value
        for name, value in zip(before.plant.parameters, before.values.tolist(), strict=True)
        if len(name) == 2
    }
    spent = {}
    for nearby in (True, False):
        start = FitStart(constants, [{}, {}], from_segments=nearby)
        with metered() as meter:
            fitting(lacking).fit([candidate(effect, start=start)])
        spent[nearby] = meter.spent
    assert spent[True] > spent[False]


def test_constants_that_make_up_for_what_is_missing_are_held_to_their_tolerances():
    trials = records_of((STRONG,))
    bent = refit(Plant.of(TWO, kinds=KINDS), trials)
    held = refit_within_tolerances(bent, trials)
    assert max(map(abs, bent.pulls.values())) > 5.0
    assert max(map(abs, held.pulls.values())) <= HELD_TOLERANCES
    assert held.prior.names == bent.prior.names


def test_constants_within_their_tolerances_are_left_as_they_are():
    trials = records_of(())
    fit = refit(Plant.of(TWO, kinds=KINDS), trials)
    assert refit_within_tolerances(fit, trials) is fit


def test_one_place_takes_all_candidates_only_where_there_are_few_places():
    places = (FIRST, SECOND, *(Place("element", f"k{i}") for i in (3, 4)))

    def law(i, place):
        return candidate(Effect(f"kind{i}", place, {}), 10.0 + i, cost_without=1e9)

    one = [law(i, FIRST) for i in range(8)]
    assert best_of_each_place(one, 6) == one[:6]
    several = [law(i, FIRST) for i in range(5)]
    several += [law(5 + i, place) for i, place in enumerate(places[1:])]
    several += [law(9, Place("node", "m1")), law(10, Place("node", "m2"))]
    assert several[4] not in best_of_each_place(several, 6)


@pytest.mark.parametrize("guessed", [0.97, 0.8])
def test_a_pendulum_that_swings_wide_is_fitted_to_parts_of_the_records_that_grow(guessed):
    """Near its top a pendulum's free run goes another way at the least error."""
    rig = dataclasses.replace(
        chain([1.0], [60.0], dampings_n_s_per_m=[0.4]),
        unit_of_coordinate="rad",
        inputs=(Input(channel="u", kind="force", node="m1", unit="N m"),),
        sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="rad"),),
        tolerance=Tolerance(stiffness=0.02, damping=0.1),
    )
    swings = Effect("pendulum_sine", Place("element", rig.elements[0].id), {"k": 60.0})
    trials = recorded(rig, (swings,), count=1, seconds=30.0, level=22.0)
    assert 2.5 < np.abs(trials[0].outputs).max() < np.pi
    before = refit_within_tolerances(refit(Plant.of(rig, kinds=ALL), trials), trials)
    guess = dataclasses.replace(swings, parameters={"k": guessed * 60.0})
    named = fit_effect(before, guess, trials, ALL)
    assert named.fit.chi2_in_band < 1.5
    assert named.fit.values[-1] == pytest.approx(60.0, rel=1e-2)
