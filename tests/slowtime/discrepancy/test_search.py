"""Two effects as strong as each other are both found, whichever of them shows first."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from slowtime.discrepancy.state import Found

from slowtime.discrepancy import search as searching
from slowtime.discrepancy.calibration import FitAbandoned, FitControl, cut_segments, refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.calibration.tolerances import HELD_TOLERANCES, refit_within_tolerances
from slowtime.discrepancy.candidates.law_pairs import law_pairs
from slowtime.discrepancy.candidates.library_fit import (
    Candidate,
    label_of,
    library_candidates,
)
from slowtime.discrepancy.diagnose import _prune
from slowtime.discrepancy.diagnosis import NamedEffect, Rival
from slowtime.discrepancy.estimation import candidate_fit as naming
from slowtime.discrepancy.estimation.candidate_fit import fit_candidates
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import moved_of
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.search import Search, search
from slowtime.discrepancy.selection import acceptance as accepting
from slowtime.discrepancy.selection.comparison import better
from slowtime.discrepancy.selection.probabilities import answer_of
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant

RATE = 64.0
FEW = (
    "cubic_hardening",
    "quadratic_damping",
    "input_delay",
    "coulomb",
    "sensor_gain",
    "input_gain",
)
KINDS = {name: kind for name, kind in catalogue().items() if name in FEW}
TWO = dataclasses.replace(
    chain([2.0, 1.5], [900.0, 700.0], dampings_n_s_per_m=[1.6, 1.2]),
    inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
    sensors=tuple(
        one
        for n in ("m1", "m2")
        for one in (
            Sensor(channel=f"x_{n}", quantity="displacement", node=n, unit="m"),
            Sensor(channel=f"v_{n}", quantity="velocity", node=n, unit="m/s"),
        )
    ),
    tolerance=Tolerance(stiffness=0.02, damping=0.15),
)
FIRST, SECOND = (Place("element", element.id) for element in TWO.elements)
CUBIC = Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 2e4})
DRAG = Effect("quadratic_damping", FIRST, {"c2_n_s2_per_m2": 30.0})
LATE = Effect("input_delay", Place("input", "u"), {"delay_s": 0.01})


STILL = Effect("sensor_drift", Place("sensor", "v_m2"), {"drift_total": 0.0})
ONLY = Place("sensor", "x_m1")


def seen(effects, *, of=TWO, count=2, samples=500, seed=3, noise=0.005):
    rng = np.random.default_rng(seed)
    entries = (*of.effects, *(e.entry() for e in effects))
    truth = Plant.of(dataclasses.replace(of, effects=entries))
    found = []
    for level in np.linspace(6.0, 14.0, count):
        push = np.convolve(rng.standard_normal(samples), np.hanning(7), "same")[:, None] * level
        clean = truth.simulate(truth.values, push, RATE)
        own = noise * clean.std(axis=0) * rng.standard_normal(clean.shape)
        found.append(Trial(inputs=push, outputs=clean + own, rate_hz=RATE))
    return tuple(found)


def named(trials, late=None, over=None, progress=None):
    first = refit(Plant.of(TWO, kinds=KINDS), trials)
    return search(first, trials, Search(KINDS, Monitor(progress, late=late, over=over)))


@pytest.mark.long
@pytest.mark.parametrize(
    "effects",
    [(CUBIC, DRAG), pytest.param((LATE, CUBIC), marks=pytest.mark.slow)],
    ids=["laws", "late"],
)
def test_both_of_two_effects_are_found(effects):
    found = named(seen(effects))
    told = {(a.effect.kind, a.effect.place) for a in found.answers}
    assert told == {(one.kind, one.place) for one in effects}
    assert found.fits[-1].chi2_in_band < 1.2


@pytest.mark.long
@pytest.mark.parametrize("effects", [(), (CUBIC,)], ids=["nothing", "law"])
def test_beside_a_sensor_that_wanders_the_others_are_heard(effects):
    kinds = KINDS | {"sensor_drift": catalogue()["sensor_drift"]}
    trials = []
    for number, trial in enumerate(seen(effects)):
        wrong = trial.outputs.copy()
        course = np.sin(np.linspace(0.0, 9.0, len(wrong)) + number)
        wrong[:, 3] += 6.0 * wrong[:, 3].std() * course
        trials.append(dataclasses.replace(trial, outputs=wrong))
    first = refit(Plant.of(TWO, kinds=kinds), tuple(trials))
    found = search(first, tuple(trials), Search(kinds, Monitor()))
    told = [(answer.effect.kind, answer.effect.place.id) for answer in found.answers]
    assert told == [*((e.kind, e.place.id) for e in effects), ("sensor_drift", "v_m2")]
    assert found.ended
    assert [len(fit.plant.effects) for fit in found.fits] == list(range(len(told) + 1))
    if effects:
        assert found.answers[0].numbers["k3_n_per_m3"].value == pytest.approx(2e4, rel=0.05)


def with_the_law():
    """Give kinds, records of a law, and the fits without and with it."""
    kinds = KINDS | {"sensor_drift": catalogue()["sensor_drift"]}
    trials = seen((CUBIC,))
    known = dataclasses.replace(TWO, effects=(CUBIC.entry(),))
    first, law = (refit(Plant.of(one, kinds=kinds), trials) for one in (TWO, known))
    return kinds, trials, first, law


def test_a_wandering_that_stands_behind_a_law_is_not_forgotten():
    kinds, trials, first, law = with_the_law()
    found = Found([first, law], trials, answers=[answer_about(CUBIC, kinds)])
    accepting.end_with(found, law, answer_about(STILL, kinds), kinds, STILL)
    _prune(found, trials, kinds)
    assert [a.effect.kind for a in found.answers] == ["cubic_hardening", "sensor_drift"]
    assert [len(fit.plant.effects) for fit in found.fits] == [0, 1, 2]


@pytest.mark.long
@pytest.mark.parametrize("sure", [0.6, 0.95])
def test_doubts_about_what_stays_outlive_what_was_needless(sure):
    trials = seen((CUBIC,))
    fits = [refit(Plant.of(TWO, kinds=KINDS), trials)]
    for effects in ((DRAG,), (DRAG, CUBIC)):
        more = dataclasses.replace(TWO, effects=tuple(e.entry() for e in effects))
        fits.append(refit(Plant.of(more, kinds=KINDS), trials))
    rivals = tuple(
        Rival(kind, CUBIC.place, share * (1 - sure))
        for kind, share in (("gap_symmetric", 0.97), ("bouc_wen", 0.03))
    )
    needless = answer_about(DRAG, KINDS)
    stays = dataclasses.replace(answer_about(CUBIC, KINDS), probability=sure, rivals=rivals)
    found = Found(fits, trials, answers=[needless, stays])
    found.undecided = (Rival(DRAG.kind, DRAG.place, 0.5), rivals[0])
    _prune(found, trials, KINDS)
    assert [answer.effect.kind for answer in found.answers] == ["cubic_hardening"]
    told = [rival.effect for rival in found.undecided]
    assert told == (["cubic_hardening", "gap_symmetric"] if sure < 0.9 else [])


@pytest.fixture
def beside(monkeypatch):
    """Look beside a sensor that wanders; what is found there is made up by a function."""
    kinds, trials, first, law = with_the_law()

    def looked(change, *, found=None, number=0):
        def going_on(rest, how, begun):
            rest.answers.append(answer_about(CUBIC, kinds))
            rest.fits.append(law)
            change(rest)

        found = found or Found([first], trials)
        before = found.fits[-1]
        monkeypatch.setattr(searching, "_go_on", going_on)
        how = Search(kinds, Monitor())
        last = searching._by_the_others(found, before, answer_about(STILL, kinds), how, number)
        return found, last is not before

    return looked


def test_what_the_others_tell_is_taken_with_all_that_goes_with_it(beside):
    found, told = beside(lambda _: None)
    assert told
    assert found.unheard
    assert [a.effect.kind for a in found.answers] == ["cubic_hardening"]
    assert len(found.fits) == 2


@pytest.mark.parametrize(
    "change",
    [
        lambda rest: rest.answers.clear(),
        lambda rest: setattr(rest, "ended", True),
        lambda rest: setattr(rest, "holds", ("first",)),
        lambda rest: setattr(rest, "trials", rest.trials[:1]),
    ],
    ids=["nothing", "no law", "a hold", "records cut"],
)
def test_what_does_not_go_with_a_wandering_sensor_is_not_taken(beside, change):
    found, told = beside(change)
    assert not told
    assert not found.unheard
    assert not found.answers
    assert len(found.fits) == 1


def test_nobody_looks_for_more_than_is_looked_for(beside):
    assert not beside(lambda _: pytest.fail("it was looked for"), number=searching.MOST - 1)[1]


OFF = Effect("sensor_bias", Place("sensor", "v_m2"), {"bias": 0.01})


@pytest.mark.long
def test_what_a_wandering_sensor_was_said_to_be_off_by_gives_way(beside):
    """Its mean was taken for an offset, and hid that a spring is missing."""
    kinds, trials, first, _ = with_the_law()
    kinds |= {"sensor_bias": catalogue()["sensor_bias"]}
    found = Found([first], trials, answers=[answer_about(OFF, kinds)])
    found.fits.append(carry_effect(first, OFF, kinds))
    told_by, other = locate(first, trials), []
    found.located = locate(first, trials)

    def change(rest):
        rest.located = told_by
        other.append(rest.fits[0])

    _, told = beside(change, found=found, number=searching.MOST - 1)
    assert told
    assert not other[0].plant.effects
    assert found.located is told_by
    assert [a.effect.kind for a in found.answers] == ["cubic_hardening"]
    assert [len(fit.plant.effects) for fit in found.fits] == [0, 1]
    assert found.unheard


@pytest.mark.long
@pytest.mark.parametrize(
    ("named", "stays"),
    [
        (OFF, False),
        (dataclasses.replace(OFF, place=Place("sensor", "v_m1")), True),
        (Effect("sensor_gain", OFF.place, {"gain": 1.1}), True),
        (CUBIC, True),
    ],
    ids=["offset", "offset of another", "gain", "law"],
)
def test_nor_is_there_an_offset_beside_a_wandering(monkeypatch, named, stays):
    """Where nothing else is missing, either."""
    kinds, trials, first, _ = with_the_law()
    kinds |= {name: catalogue()[name] for name in ("sensor_bias", "sensor_gain")}
    first = dataclasses.replace(first, values=1.3 * first.values, chi2_in_band=50.0)
    fit = carry_effect(first, named, kinds)
    found = Found([first, fit], trials, answers=[answer_about(named, kinds)])
    monkeypatch.setattr(searching, "_go_on", lambda *_: None)
    drift = answer_about(STILL, kinds)
    assert not searching._wanders(found, fit, drift, Search(kinds, Monitor()), 1)
    told = [answer.effect.kind for answer in found.answers]
    assert told == [named.kind] * stays + ["sensor_drift"]
    assert [len(one.plant.effects) for one in found.fits] == list(range(len(told) + 1))
    # Without the offset, constants make up for it: they are held to what was claimed.
    begun = fit if stays else refit_within_tolerances(first, trials)
    assert begun is not first
    count = len(begun.values)
    np.testing.assert_array_equal(found.fits[-1].values[:count], begun.values)


def test_an_offset_beside_a_law_stays(beside):
    kinds, trials, first, law = with_the_law()
    kinds |= {"sensor_bias": catalogue()["sensor_bias"]}
    answers = [answer_about(CUBIC, kinds), answer_about(OFF, kinds)]
    found = Found([first, law], trials, answers=answers)
    found.fits.append(carry_effect(law, OFF, kinds))
    assert not beside(lambda _: pytest.fail("it was looked for"), found=found, number=1)[1]
    assert found.answers == answers


@pytest.mark.parametrize("error", [FitAbandoned, FloatingPointError])
def test_where_the_others_cannot_be_fitted_the_wandering_stands_alone(
    monkeypatch, beside, error
):
    def failing(*_, **how):
        assert not how["control"].is_late()
        raise error

    monkeypatch.setattr(searching, "refit", failing)
    found, told = beside(lambda _: pytest.fail("it went on"))
    assert not told
    assert found.hurried == (error is FitAbandoned)


def answer_about(effect, kinds):
    family = kinds[effect.kind].family
    return NamedEffect(effect, family, numbers={}, probability=0.95, rivals=(), sentence="so")


def test_constants_that_make_up_for_what_is_missing_are_held_to_their_tolerances():
    strong = dataclasses.replace(CUBIC, parameters={"k3_n_per_m3": 4e5})
    trials = seen((strong,))
    bent = refit(Plant.of(TWO, kinds=KINDS), trials)
    held = refit_within_tolerances(bent, trials)
    assert max(map(abs, bent.pulls.values())) > 5.0
    assert max(map(abs, held.pulls.values())) <= HELD_TOLERANCES
    assert held.prior.names == bent.prior.names


def test_constants_within_their_tolerances_are_left_as_they_are():
    trials = seen(())
    fit = refit(Plant.of(TWO, kinds=KINDS), trials)
    assert refit_within_tolerances(fit, trials) is fit


def test_one_sensor_cannot_tell_its_own_factor_from_that_of_the_input():
    one = dataclasses.replace(TWO, sensors=TWO.sensors[:1])
    trials = seen((Effect("sensor_gain", ONLY, {"gain": 1.3}),), of=one)
    found = search(refit(Plant.of(one, kinds=KINDS), trials), trials, Search(KINDS, Monitor()))
    assert {rival.effect for rival in found.undecided} == {"sensor_gain", "input_gain"}


BOUND = Effect("coulomb", SECOND, {"friction_n": 1.5})
SOFT = Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 6e4})


@pytest.mark.parametrize("gain", [-1.0, 0.4])
def test_nor_can_it_where_the_factor_is_far_from_one(gain):
    """One step along what it does then promises far less than a refit holds."""
    one = dataclasses.replace(
        chain([2.0], [900.0], dampings_n_s_per_m=[1.6]),
        inputs=(Input(channel="u", kind="base_acceleration", unit="m/s^2"),),
        sensors=(Sensor(channel="x_m1", quantity="acceleration", node="m1", unit="m/s^2"),),
        tolerance=TWO.tolerance,
    )
    trials = seen((Effect("sensor_gain", ONLY, {"gain": gain}),), of=one, samples=900)
    found = search(refit(Plant.of(one, kinds=KINDS), trials), trials, Search(KINDS, Monitor()))
    assert {rival.effect for rival in found.undecided} == {"sensor_gain", "input_gain"}
    for number in found.answers[0].numbers.values():
        assert number.value == pytest.approx(gain, rel=0.02)


def test_a_mass_and_the_factors_that_do_the_same_are_told_apart_by_no_one_alone():
    """Stiffness moves a little beside it; that leaves most of what is missing."""
    kinds = KINDS | {"added_mass": catalogue()["added_mass"]}
    one = dataclasses.replace(
        chain([2.0], [900.0], dampings_n_s_per_m=[1.6]),
        inputs=TWO.inputs,
        sensors=(Sensor(channel="x_m1", quantity="acceleration", node="m1", unit="m/s^2"),),
        tolerance=Tolerance(stiffness=0.03, damping=0.15),
    )
    heavier = Effect("added_mass", Place("node", "m1"), {"dm_kg": 0.2})
    trials = seen((heavier,), of=one, samples=1500)
    found = search(refit(Plant.of(one, kinds=kinds), trials), trials, Search(kinds, Monitor()))
    told = {rival.effect for rival in found.undecided} or {found.answers[0].effect.kind}
    assert "added_mass" in told


@pytest.mark.long
@pytest.mark.parametrize(("share", "count"), [(1e-4, 1), (4e-4, 2)])
def test_more_effects_have_to_explain_more_than_a_fleck_of_what_was_missing(share, count):
    trials = seen((CUBIC,))
    fits = [refit(Plant.of(TWO, kinds=KINDS), trials)]
    for effects in ((CUBIC,), (CUBIC, DRAG)):
        more = dataclasses.replace(TWO, effects=tuple(e.entry() for e in effects))
        fits.append(refit(Plant.of(more, kinds=KINDS), trials))

    def leaving(fit, rest):
        """Leave a share of what the model as given left."""
        noise = fits[0].noise
        left = tuple(np.sqrt(rest) * one for one in fits[0].residual)
        made = dataclasses.replace(fit, residual=left, noise=noise)
        return dataclasses.replace(made, cost=naming.misfit(made, noise, trials))

    one, two = leaving(fits[1], 0.02), leaving(fits[2], 0.02 - share)
    answers = [answer_about(effect, KINDS) for effect in (CUBIC, DRAG)]
    found = Found([fits[0], one], trials, answers=answers[:1])
    branch = Found([fits[0], one, two], trials, answers=answers)
    assert (one.cost - two.cost) / 2 > 0
    assert len(better(found, branch, KINDS, -1e9).answers) == count


@pytest.fixture(scope="module")
def shared():
    """Two laws at one place; how they were sought, and the model before."""
    trials = seen((BOUND, SOFT))
    first = refit_within_tolerances(refit(Plant.of(TWO, kinds=KINDS), trials), trials)
    located = locate(first, trials)
    return trials, first, located, library_candidates(first, located, KINDS)


def test_two_laws_at_one_place_are_found_together(shared):
    _, first, located, tried = shared
    (one, other), *_ = law_pairs(first, located, tried, {}, KINDS)
    assert {one.effect.kind, other.effect.kind} == {"coulomb", "cubic_hardening"}
    assert {one.effect.place, other.effect.place} == {SECOND}
    sizes = {e.effect.kind: next(iter(e.effect.parameters.values())) for e in (one, other)}
    assert sizes["cubic_hardening"] == pytest.approx(6e4, rel=0.05)
    assert sizes["coulomb"] == pytest.approx(1.5, rel=0.1)
    assert other.cost < 0.5 * tried[0].cost


def test_a_base_that_explains_no_more_than_a_force_does_not_hide_two_laws(shared):
    _, first, located, tried = shared
    best = located.groups[0]
    base = dataclasses.replace(best, places=(Place("base", "base"),), score=best.score + 30.0)
    told = dataclasses.replace(located, groups=(base, *located.groups))
    assert [c.effect for c in law_pairs(first, told, tried, {}, KINDS)[0]] == [
        c.effect for c in law_pairs(first, located, tried, {}, KINDS)[0]
    ]
    # Where it explains far more, no law at an element does what is left.
    louder = dataclasses.replace(best, left=3 * best.left)
    told = dataclasses.replace(located, groups=(base, louder, *located.groups[1:]))
    assert not law_pairs(first, told, tried, {}, KINDS)


def test_what_leaves_less_than_noise_is_no_reason_to_pass_over_what_leaves_little_more(shared):
    _, first, located, _ = shared
    here, *others = located.groups
    other = next(g for g in others if g.places[0].kind == "element")

    def tried(least, left, twins=()):
        groups = (
            dataclasses.replace(other, left=least, twins=twins),
            dataclasses.replace(here, left=left),
        )
        told = dataclasses.replace(located, groups=groups)
        return {one.effect.place for one in library_candidates(first, told, KINDS)}

    assert here.places[0] in tried(0.7, 1.6)
    assert here.places[0] not in tried(0.7, 1.8)
    # Where the sensors cannot tell the places apart, that is a matter of smoothness.
    assert here.places[0] in tried(0.7, 1.8, here.places)
    assert here.places[0] not in tried(0.7, 3.6, here.places)
    assert here.places[0] in tried(1.2, 1.9)


@pytest.mark.long
def test_a_tone_beside_a_law_is_found_with_it_whatever_its_phase():
    one = dataclasses.replace(
        chain([2.0], [800.0], dampings_n_s_per_m=[1.6]),
        inputs=TWO.inputs,
        sensors=TWO.sensors[:2],
        tolerance=TWO.tolerance,
    )
    kinds = {**KINDS, "harmonic_force": catalogue()["harmonic_force"]}
    hum = {"amplitude_n": 6.0, "frequency_hz": 2.2, "phase_rad": 1.1}
    place, node = Place("element", one.elements[0].id), Place("node", "m1")
    effects = (
        Effect("harmonic_force", node, hum),
        Effect("coulomb", place, {"friction_n": 2.0}),
    )
    trials = seen(effects, of=one, samples=1000)
    first = refit_within_tolerances(refit(Plant.of(one, kinds=kinds), trials), trials)
    located = locate(first, trials)
    (tone, law), *_ = law_pairs(
        first, located, library_candidates(first, located, kinds), {}, kinds
    )
    assert [c.effect.kind for c in (tone, law)] == ["harmonic_force", "coulomb"]
    assert law.effect.parameters["friction_n"] == pytest.approx(2.0, rel=0.1)
    assert tone.effect.parameters == pytest.approx(hum, rel=0.05)


def test_what_promised_more_than_it_holds_is_no_bar_to_a_pair(shared):
    _, first, located, tried = shared
    boast = dataclasses.replace(tried[0], cost=1.0)
    tried = [boast, *tried[1:]]
    assert not law_pairs(first, located, tried, {}, KINDS)
    assert law_pairs(first, located, tried, {label_of(boast.effect): 1e9}, KINDS)


@pytest.mark.long
def test_once_one_explains_half_those_that_would_leave_more_are_given_up():
    trials = seen((dataclasses.replace(CUBIC, parameters={"k3_n_per_m3": 8e4}), DRAG))
    first = refit_within_tolerances(refit(Plant.of(TWO, kinds=KINDS), trials), trials)
    labels = library_candidates(first, locate(first, trials), KINDS)
    asked: list[Effect] = []
    found = fit_candidates(first, labels, trials, KINDS, lambda effect, _: asked.append(effect))
    left = min(naming.misfit(one.fit, first.noise, trials) for one in found)
    assert 3 * first.data < left < naming.MAIN * labels[0].cost_without
    far = {label_of(c.effect) for c in labels if c.cost > 2 * max(left, labels[0].cost)}
    assert far
    assert far.isdisjoint(map(label_of, asked))


@pytest.mark.long
def test_one_law_that_explains_all_is_not_made_two():
    trials = seen((CUBIC,))
    first = refit_within_tolerances(refit(Plant.of(TWO, kinds=KINDS), trials), trials)
    located = locate(first, trials)
    assert not law_pairs(first, located, library_candidates(first, located, KINDS), {}, KINDS)


@pytest.mark.long
def test_two_laws_at_one_place_are_told_with_their_probabilities(shared):
    trials = shared[0]
    found = named(trials)
    assert {a.effect.kind for a in found.answers} == {"coulomb", "cubic_hardening"}
    assert all(a.probability > 0.9 for a in found.answers)
    assert found.fits[-1].chi2_in_band < 1.2
    assert len(found.fits) == 3


def test_where_held_constants_show_no_more_effects_those_that_bent_are_looked_at(monkeypatch):
    strong = dataclasses.replace(CUBIC, parameters={"k3_n_per_m3": 4e5})
    trials = seen((strong,))
    bent = refit(Plant.of(TWO, kinds=KINDS), trials)
    looked = []

    def after(found, before, how, number, *, pulled, begun=(), located=None):
        looked.append(max(map(abs, before.pulls.values())))
        return False

    monkeypatch.setattr(searching, "_after", after)
    monkeypatch.setattr(searching, "later_segment_candidates", lambda before, *_: (before, []))
    searching._go_on(Found([bent], trials), Search(KINDS, Monitor()), 1)
    assert looked == [
        pytest.approx(HELD_TOLERANCES, rel=0.01),
        max(map(abs, bent.pulls.values())),
    ]


def test_an_account_with_an_effect_is_weighed_against_one_without(shared):
    trials, first, *_ = shared
    cubic = fit_candidates(
        first, [Candidate(SOFT, 0.0, 0.0, 0.0)], trials, KINDS, lambda *_: False
    )
    branch = Found([first, cubic[0].fit], trials)
    branch.answers.append(answer_of(cubic, [1.0], KINDS))
    found = Found([first], trials)
    assert better(found, branch, KINDS).answers[0].effect.kind == "cubic_hardening"
    assert better(found, Found([first], trials), KINDS) is found
    # An account that leaves a sensor out leaves less, and is none the likelier.
    branch.unheard = True
    assert better(found, branch, KINDS) is found
    branch.otherwise = ("zero",)
    assert better(found, branch, KINDS) is branch


@pytest.mark.long
def test_an_account_under_another_hold_ends_the_comparison(shared, monkeypatch):
    trials, first, *_ = shared
    named = fit_candidates(
        first, [Candidate(SOFT, 0.0, 0.0, 0.0)], trials, KINDS, lambda *_: False
    )
    compared = []

    def one_effect(found, *_):
        found.named = tuple(named)
        return False

    def explained_otherwise(branch, *_):
        compared.append(branch)
        branch.otherwise = ("zero",)

    monkeypatch.setattr(searching, "_next", one_effect)
    monkeypatch.setattr(searching, "alternative_starts", lambda *_: iter(named * 3))
    monkeypatch.setattr(searching, "accept", lambda *_, **__: True)
    monkeypatch.setattr(searching, "_go_on", explained_otherwise)
    found = search(first, trials, Search(KINDS, Monitor()))
    assert compared == [found]


def test_a_refit_is_given_up_once_it_is_late(shared):
    trials, first, *_ = shared
    asked: list[int] = []

    def late():
        asked.append(len(asked))
        return len(asked) > 1

    with pytest.raises(FitAbandoned):
        refit(first.plant, trials, control=FitControl(is_late=late))
    assert len(asked) == 2
    label = [Candidate(SOFT, 0.0, 0.0, 0.0)]
    ticks = iter([False, True])  # in time when it begins
    assert fit_candidates(first, label, trials, KINDS, lambda *_: next(ticks)) == []


@pytest.mark.long
def test_a_law_that_the_last_look_at_the_noise_leaves_unseen_is_not_named(shared):
    trials, first, *_ = shared
    cubic = fit_candidates(
        first, [Candidate(SOFT, 0.0, 0.0, 0.0)], trials, KINDS, lambda *_: False
    )
    far = dataclasses.replace(cubic[0], fit=dataclasses.replace(cubic[0].fit, chi2_in_band=9.0))
    name = far.effect.kind
    unseen = KINDS | {name: dataclasses.replace(KINDS[name], shown=lambda *_: False)}
    (told,) = naming._heard_again(far.fit, [far], trials, KINDS, anew=True)
    assert told.effect.kind == name
    assert naming._heard_again(far.fit, [far], trials, unseen, anew=True) == []


@pytest.mark.parametrize(("anew", "times"), [(True, 2), (False, 1)])
def test_who_is_late_does_not_fit_the_best_from_the_beginning_again(
    shared, monkeypatch, anew, times
):
    trials, first, *_ = shared
    loud = dataclasses.replace(first, chi2_in_band=99.0)
    before = dataclasses.replace(first, chi2_in_band=1e4)
    asked: list[object] = []

    def again(*_, **how):
        asked.append(how)
        return loud

    monkeypatch.setattr(naming, "refit", again)
    named = naming.FittedCandidate(SOFT, first.plant.description, loud, 0.0)
    naming._heard_again(before, [named], trials, KINDS, anew=anew)
    assert len(asked) == times


@pytest.mark.parametrize("over", [True, False])
def test_once_it_is_over_the_best_is_left_in_its_minimum(shared, monkeypatch, over):
    trials, first, *_ = shared
    loud = dataclasses.replace(first, chi2_in_band=99.0)
    before = dataclasses.replace(first, chi2_in_band=1e4)
    better = dataclasses.replace(loud, residual=tuple(0 * r for r in loud.residual))

    def again(*_, control=None, **__):
        late = None if control is None else control.is_late
        if late is not None and late():
            raise FitAbandoned
        return loud if late is None else better

    monkeypatch.setattr(naming, "refit", again)
    named = naming.FittedCandidate(SOFT, first.plant.description, loud, 0.0)
    (told,) = naming._heard_again(before, [named], trials, KINDS, anew=True, over=lambda: over)
    assert told.fit is (loud if over else better)


@pytest.mark.long
@pytest.mark.parametrize("over", [True, False])
def test_who_refits_laws_is_told_when_it_is_over(shared, monkeypatch, over):
    trials, first, located, _ = shared
    asked: list[bool] = []

    def none(*_, **how):
        asked.append(how["over"]())
        return []

    monkeypatch.setattr(searching, "fit_candidates", none)
    monkeypatch.setattr(searching, "later_segment_candidates", lambda *_: (first, []))
    how = Search(KINDS, Monitor(over=lambda: over))
    found = Found([first], trials)
    searching._after(found, first, how, 0, pulled=False, located=located)
    assert searching._onward(found, first, how) == []
    assert asked == [over, over]


def test_lateness_reaches_the_last_look_at_a_law_and_at_its_instant(shared, monkeypatch):
    trials, first, *_ = shared
    told: list[Callable[[], bool]] = []

    def switched(fit, *_, late):
        told.append(late)
        return fit

    def heard(*_, over, **__):
        told.append(over)
        return []

    def over():
        return True

    monkeypatch.setattr(naming, "refine_switching_instant", switched)
    monkeypatch.setattr(naming, "_heard_again", heard)
    label = [Candidate(SOFT, 0.0, 0.0, 0.0)]
    fit_candidates(first, label, trials, KINDS, lambda *_: False, over=over)
    late, last = told
    assert late() is False
    assert last is over


@pytest.mark.parametrize("settles", [True, False])
def test_a_constant_is_off_only_if_it_is_at_the_bottom(shared, monkeypatch, settles):
    """Of numbers told only in sums a fit may stop where one is far from what is claimed."""
    trials, first, *_ = shared
    white = dataclasses.replace(first, chi2_in_band=1.0)
    at = list(white.prior.names).index(("stiffness", FIRST.id))
    values = white.values.copy()
    values[white.prior.index[at]] += 6 * white.prior.sd[at]
    off = dataclasses.replace(white, values=values)
    assert moved_of(off)
    still = dataclasses.replace(white, values=white.plant.values)
    answer = answer_about(SOFT, KINDS)
    found = Found([first, off], trials, answers=[answer])
    looked: list[bool] = []

    def after(*_, **__):
        looked.append(True)
        return True

    def settled(found, own, kinds):
        assert own == 0
        found.fits[-1] = still if settles else off

    monkeypatch.setattr(searching, "converge", settled)
    monkeypatch.setattr(searching, "refit_within_tolerances", lambda fit, _: fit)
    monkeypatch.setattr(searching, "relearn_force", lambda *_: False)
    monkeypatch.setattr(searching, "_after", after)
    assert searching._next(found, Search(KINDS, Monitor()), 1) is not settles
    assert bool(looked) is not settles


@pytest.mark.long
def test_what_inputs_do_between_samples_is_not_asked_of_pieces(shared, monkeypatch):
    trials, first, *_ = shared
    late = fit_candidates(
        first, [Candidate(SOFT, 0.0, 0.0, 0.0)], trials, KINDS, lambda *_: False
    )
    cut, _ = cut_segments(first.plant, trials)
    monkeypatch.setattr(accepting, "held_instead", lambda *_: pytest.fail("it was asked"))
    found = Found([first], cut)
    whole = refit(late[0].fit.plant, cut, values=late[0].fit.values, horizons=(1.0,))
    named = [dataclasses.replace(late[0], fit=whole)]
    before = refit(first.plant, cut, values=first.values, horizons=(1.0,))
    assert accepting.accept(found, before, named, cut, KINDS, None, pulled=False)


@pytest.mark.long
def test_a_law_that_is_near_the_end_of_its_range_is_named_where_nothing_simpler_is_there():
    kinds = {"van_der_pol": catalogue()["van_der_pol"]}
    sings = Effect("van_der_pol", SECOND, {"cn_n_s_per_m": 0.05, "e0_m": 0.004})
    trials = seen((sings,))
    found = search(refit(Plant.of(TWO, kinds=kinds), trials), trials, Search(kinds, Monitor()))
    assert [(a.effect.kind, a.effect.place) for a in found.answers] == [("van_der_pol", SECOND)]


@pytest.mark.parametrize(
    ("gained", "taken"), [(0.0005, "coulomb"), (0.0011, "stribeck"), (0.5, "stribeck")]
)
def test_what_explains_next_to_nothing_beyond_its_limit_is_taken_for_it(shared, gained, taken):
    _, first, *_ = shared
    missing = 1e5
    costs = {"stribeck": 1e3, "cubic_hardening": 1.2e3, "coulomb": 1e3 + gained * missing}
    named = [
        naming.FittedCandidate(
            Effect(kind, SECOND, {}), first.plant.description,
            dataclasses.replace(first, cost=cost), -cost,
        )
        for kind, cost in costs.items()
    ]  # fmt: skip
    found = accepting._limits_first(named, missing)
    assert found[0].effect.kind == taken
    assert len(found) == 3 - (taken == "coulomb")
    elsewhere = dataclasses.replace(named[2], effect=Effect("coulomb", FIRST, {}))
    assert accepting._limits_first([*named[:2], elsewhere], missing)[0] is named[0]


@pytest.mark.long
@pytest.mark.parametrize(("beside", "taken"), [(0.0, True), (1e9, False)])
def test_a_later_effect_that_explains_a_fleck_is_a_flaw_of_the_first(
    shared, beside, taken, monkeypatch
):
    trials, first, *_ = shared
    named = fit_candidates(
        first, [Candidate(SOFT, 0.0, 0.0, 0.0)], trials, KINDS, lambda *_: False
    )
    found = Found([first], trials)
    assert accepting.accept(found, first, named, trials, KINDS, None, pulled=False)
    gained = first.cost - named[0].fit.cost
    monkeypatch.setattr(accepting, "_at_first", lambda *_: beside * gained)
    again = accepting.accept(found, first, named, trials, KINDS, None, pulled=False)
    assert again == taken
    assert len(found.answers) == 1 + taken


@pytest.mark.long
def test_what_shows_first_in_how_records_go_on_is_located_too(monkeypatch):
    """As where a sensor that wanders was left out, and nothing was named before."""
    trials = seen((CUBIC,))
    first = refit(Plant.of(TWO, kinds=KINDS), trials)
    held = dataclasses.replace(
        refit_within_tolerances(first, trials), chi2_in_band=2 * searching.LOST
    )
    label = Candidate(CUBIC, 0.0, 0.0, 0.0)
    begun = fit_candidates(held, [label], trials, KINDS, lambda *_: False)
    monkeypatch.setattr(searching, "_onward", lambda *_: begun)
    found = Found([first], trials)
    assert searching._next(found, Search(KINDS, Monitor()), 1, held)
    assert [label_of(answer.effect) for answer in found.answers] == [label_of(CUBIC)]
    assert found.located is not None
    assert found.located.best == SECOND


@pytest.mark.parametrize(
    ("answers", "late", "over", "asked"),
    [
        (2, False, False, ["regrow", "relocated"]),
        (2, True, False, ["relocated"]),
        (2, True, True, []),
        (1, False, False, []),
    ],
)
def test_once_there_are_two_each_is_tried_elsewhere(monkeypatch, answers, late, over, asked):
    trials = seen((CUBIC,))
    fit = refit(Plant.of(TWO, kinds=KINDS), trials)
    told = [NamedEffect(CUBIC, "hardening", {}, 1.0, (), "")] * answers
    found = Found([fit], trials, answers=told)
    done = []
    monkeypatch.setattr(searching, "accept", lambda *_, **__: True)
    grown = "refit_with_growing_horizon"
    monkeypatch.setattr(searching, grown, lambda *_: done.append("regrow"))
    monkeypatch.setattr(searching, "relocate", lambda *_: done.append("relocated"))
    how = Search(KINDS, Monitor(late=lambda: late, over=lambda: over))
    assert searching._accepted(found, fit, [], how, pulled=False)
    assert done == asked
