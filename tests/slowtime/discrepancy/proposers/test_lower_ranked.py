"""Where a recovered motion misleads, bent constants and free runs say which law to try."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
import scipy.ndimage
import scipy.signal

from slowtime.discrepancy import search as searching
from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import FitStart, free_run_chi2
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.constant_equivalents import (
    equivalent_laws,
    instead_of_constants,
)
from slowtime.discrepancy.candidates.library_fit import (
    Candidate,
    label_of,
    library_candidates,
    mirrored_factor,
)
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.estimation.candidate_fit import (
    FittedCandidate,
    best_of_each_place,
    fit_candidates,
)
from slowtime.discrepancy.localization import characterise, locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers import lower_ranked as downward
from slowtime.discrepancy.proposers.base_motion import _made, by_a_law, follows
from slowtime.discrepancy.proposers.lower_ranked import IN_TURN, NEAREST, LowerRanked
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.search import Search, search
from slowtime.discrepancy.validation.free_run import free_runs
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import ONE, PLACE

RATE = 80.0
KINDS = catalogue()
THREE = dataclasses.replace(
    chain([2.0, 1.5, 1.0], [900.0, 700.0, 500.0], dampings_n_s_per_m=[1.6, 1.2, 1.0]),
    inputs=(Input(channel="u", kind="force", node="m3", unit="N"),),
    sensors=(Sensor(channel="a3", quantity="acceleration", node="m3", unit="m/s^2"),),
    tolerance=Tolerance(stiffness=0.02, damping=0.1),
)
EVERY = dataclasses.replace(
    THREE,
    sensors=tuple(
        Sensor(channel=f"a{i}", quantity="acceleration", node=f"m{i}", unit="m/s^2")
        for i in (1, 2, 3)
    ),
)
GROUND, MIDDLE, TOP = (Place("element", element.id) for element in THREE.elements)


def recorded(description, effects, *, seed=4, count=2, seconds=12.0, level=8.0):
    """Records of a structure with some effects, pushed at random, at 1 % of noise."""
    rng = np.random.default_rng(seed)
    truth = Plant.of(
        dataclasses.replace(description, effects=tuple(e.entry() for e in effects))
    )
    found = []
    for number in range(count):
        push = rng.standard_normal(int(seconds * RATE))
        push = level * (1 + number) * np.convolve(push, np.hanning(9) / 2, "same")[:, None]
        clean = truth.simulate(truth.values, push, RATE)
        noise = 0.01 * clean.std(axis=0) * rng.standard_normal(clean.shape)
        found.append(Trial(inputs=push, outputs=clean + noise, rate_hz=RATE))
    return tuple(found)


def nothing(effect, number):
    pass


@pytest.fixture
def closed(monkeypatch):
    """How the records begin tells nothing."""
    monkeypatch.setattr(downward, "initial_segment_candidates", lambda *_: [])


def every(more, found):
    """Give all labels, one turn after the other."""
    return list(itertools.chain.from_iterable(iter(lambda: more(found), [])))


@pytest.fixture(scope="module")
def ridden():
    """On the second of two masses rides a third, tuned to about the faster mode."""
    rig = dataclasses.replace(
        chain([1.7, 2.76], [7920.0, 11990.0], dampings_n_s_per_m=[3.3, 4.6]),
        inputs=(Input(channel="u", kind="base_acceleration", unit="m/s^2"),),
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=f"m{i}", unit="m/s^2",
                   frame="absolute") for i in (1, 2)
        ),
        tolerance=Tolerance(stiffness=0.03, damping=0.1),
    )  # fmt: skip
    rider = Effect("extra_dof", Place("node", "m2"), {
        "mass_kg": 0.25, "frequency_hz": 18.86, "damping_n_s_per_m": 1.1
    })  # fmt: skip
    rate, rng = 256.0, np.random.default_rng(3)
    known = chain([1.7, 2.76], [7790.0, 11790.0], dampings_n_s_per_m=[3.4, 4.8])
    truth = Plant.of(
        dataclasses.replace(rig, elements=known.elements, effects=(rider.entry(),))
    )
    trials = []
    for level in (1.0, 2.0):
        band = scipy.signal.butter(4, [1.5, 50.0], "band", fs=rate, output="sos")
        shake = level * scipy.signal.sosfilt(band, rng.standard_normal(int(20 * rate)))
        clean = truth.simulate(truth.values, shake[:, None], rate)
        noise = 0.03 * clean.std(axis=0) * rng.standard_normal(clean.shape)
        trials.append(Trial(inputs=shake[:, None], outputs=clean + noise, rate_hz=rate))
    names = ("extra_dof", "added_mass", "stiffness_loss", "viscous_damping", "stiffness_jump")
    few = {name: KINDS[name] for name in names}
    return Campaign(description=rig, trials=tuple(trials)), rider, few


@pytest.mark.long
def test_a_hidden_oscillator_is_begun_near_the_modes_of_the_model(ridden):
    """Its splitting a mode in two leads the other constants far astray."""
    campaign, rider, few = ridden
    found = diagnose(campaign, kinds=few)
    (told,) = found.effects
    assert (told.effect.kind, told.effect.place) == ("extra_dof", rider.place)
    for name, value in rider.parameters.items():
        assert told.effect.parameters[name] == pytest.approx(value, rel=0.03)
    assert found.white_p_value > 1e-3


@pytest.mark.long
def test_of_laws_that_all_leave_much_none_is_among_those_in_doubt(ridden):
    campaign, rider, few = ridden
    others = {name: kind for name, kind in few.items() if name != rider.kind}
    found = diagnose(campaign, kinds=others)
    assert found.chi2_per_datum > 5
    assert found.verdict == "unknown_effect"
    assert found.undecided == ()
    assert found.experiment is None


@pytest.mark.long
@pytest.mark.usefixtures("closed")
@pytest.mark.parametrize("shaken", [False, True])
def test_what_swings_as_a_shaken_base_makes_it_is_not_taken_to_ride_there(ridden, shaken):
    campaign, rider, few = ridden
    bent = refit(Plant.of(campaign.description, kinds=few), campaign.trials)
    label = Candidate(Effect("added_mass", rider.place, {"dm_kg": 0.1}), 1.0, -1.0, 1e9)
    tried = [label, dataclasses.replace(label, effect=rider)]
    more = LowerRanked(bent, bent, tried, [label], campaign.trials, few, shaken=shaken)
    given = [one.effect for one in every(more, []) if one.effect.kind == rider.kind]
    assert len(given) == (0 if shaken else 2)
    assert all(effect.place == rider.place for effect in given)


def test_what_may_ride_on_a_node_is_light_and_a_little_faster_than_a_mode():
    guesses = KINDS["extra_dof"].guesses(2.0, [3.0, 0.0, 9.0])
    assert [one["frequency_hz"] for one in guesses] == pytest.approx([11.7, 3.9])
    for one in guesses:
        KINDS["extra_dof"].values(one)
        assert one["mass_kg"] < 0.1 * 2.0
        critical = 4 * math.pi * one["frequency_hz"] * one["mass_kg"]
        assert 0.01 < one["damping_n_s_per_m"] / critical < 0.1
    assert KINDS["extra_dof"].guesses(0.0, [3.0]) == []
    assert KINDS["coulomb"].guesses(2.0, [3.0]) == []


@pytest.mark.long
@pytest.mark.parametrize(
    "effect",
    [
        Effect("coulomb", GROUND, {"friction_n": 1.5}),
        Effect("quadratic_damping", GROUND, {"c2_n_s2_per_m2": 25.0}),
        Effect("viscous_damping", MIDDLE, {"dc_n_s_per_m": 3.0}),
        Effect("cubic_hardening", GROUND, {"k3_n_per_m3": 4e4}),
    ],
    ids=lambda effect: effect.kind,
)
def test_bent_constants_tell_the_law_and_about_how_strong_it_is(effect):
    """One sensor, three springs away from the law."""
    trials = recorded(THREE, (effect,))
    bent = refit(Plant.of(THREE, kinds=KINDS), trials)
    found = equivalent_laws(bent, trials, KINDS)
    own = [one.effect for one in found if one.effect.kind == effect.kind]
    assert own[0].place == effect.place
    (truth,) = effect.parameters.values()
    (guess,) = own[0].parameters.values()
    assert 0.5 < guess / truth < 2.0
    assert [one.score for one in found] == sorted((one.score for one in found), reverse=True)


def test_where_no_constant_is_bent_there_is_nothing_to_be_equivalent_to():
    trials = recorded(THREE, ())
    assert equivalent_laws(refit(Plant.of(THREE, kinds=KINDS), trials), trials, KINDS) == []


@pytest.fixture(scope="module")
def steady():
    """One tone at one level, long after its beginning, of a spring that softens."""
    rng = np.random.default_rng(7)
    soft = Effect("cubic_softening", PLACE, {"k3_n_per_m3": -1.2e6})
    rig = dataclasses.replace(ONE, tolerance=Tolerance(stiffness=0.005, damping=0.1))
    truth = Plant.of(dataclasses.replace(rig, effects=(soft.entry(),)))
    times = np.arange(int(60 * RATE)) / RATE
    found = []
    for begins in (0.0, 60.0):
        push = 0.6 * np.sin(2 * np.pi * 2.9 * times)[:, None]
        clean = truth.simulate(truth.values, push, RATE)[-int(20 * RATE) :]
        seen = clean + 0.3 * clean.std() * rng.standard_normal(clean.shape)
        found.append(
            Trial(inputs=push[-len(seen) :], outputs=seen, rate_hz=RATE, start_s=begins)
        )
    return rig, tuple(found)


@pytest.mark.long
def test_constants_that_leave_nothing_may_stand_for_a_law(steady):
    rig, trials = steady
    bent = refit(Plant.of(rig, kinds=KINDS), trials)
    labels = library_candidates(bent, locate(bent, trials), KINDS)[:3]
    others = instead_of_constants(bent, labels, trials, KINDS)
    names = [one.effect.kind for one in others]
    assert "cubic_softening" in {*names, *(one.effect.kind for one in labels)}
    assert "pendulum_sine" not in names
    assert not {label_of(one.effect) for one in others} & {
        label_of(one.effect) for one in labels
    }
    assert {one.cost for one in others} == {labels[0].cost}
    alone = instead_of_constants(bent, [], trials, KINDS)
    assert "cubic_softening" in {one.effect.kind for one in alone}


@pytest.fixture(scope="module")
def hummed():
    """One tone, one sensor at the top; what damps more sits in the middle."""
    rng, times = np.random.default_rng(5), np.arange(int(120 * RATE)) / RATE
    more = Effect("viscous_damping", MIDDLE, {"dc_n_s_per_m": 2.5})
    truth = Plant.of(dataclasses.replace(THREE, effects=(more.entry(),)))
    push = np.sin(2 * np.pi * 1.62 * times)[:, None]
    clean = truth.simulate(truth.values, push, RATE)
    seen = clean + 0.2 * clean.std(axis=0) * rng.standard_normal(clean.shape)
    halves = slice(int(40 * RATE), int(80 * RATE)), slice(int(80 * RATE), None)
    return tuple(
        Trial(inputs=push[half], outputs=seen[half], rate_hz=RATE, start_s=start)
        for half, start in zip(halves, (40.0, 80.0), strict=True)
    )


@pytest.mark.long
def test_one_sensor_does_not_tell_where_a_constant_changed(hummed):
    bent = refit(Plant.of(THREE, kinds=KINDS), hummed)
    labels = library_candidates(bent, locate(bent, hummed), KINDS)[:1]
    others = instead_of_constants(bent, labels, hummed, KINDS)
    damped = [o.effect.place for o in [*labels, *others] if o.effect.kind == "viscous_damping"]
    assert sorted(place.id for place in damped) == sorted(e.id for e in THREE.elements)
    softer = [o.effect.place for o in others if o.effect.kind == "stiffness_loss"]
    assert len(softer) == len(set(softer))
    found = search(bent, hummed, Search(KINDS, Monitor()))
    told = {r.place for r in found.undecided if r.effect == "viscous_damping"}
    assert told >= {GROUND, MIDDLE}


@pytest.mark.long
def test_a_tone_at_one_level_does_not_tell_a_softening_spring_from_a_softer_one(steady):
    rig, trials = steady
    bent = refit(Plant.of(rig, kinds=KINDS), trials)
    found = search(bent, trials, Search(KINDS, Monitor()))
    told = {rival.effect for rival in found.undecided}
    assert {"cubic_softening", "stiffness_loss", "added_mass"} <= told
    assert found.answers[0].probability < 0.9


@pytest.mark.long
def test_laws_that_show_along_nothing_are_refitted_all_the_same(steady, monkeypatch):
    rig, trials = steady
    bent = refit(Plant.of(rig, kinds=KINDS), trials)

    def softer(tried, _):
        return [one for one in tried if one.effect.kind == "stiffness_loss"]

    monkeypatch.setattr(searching, "best_of_each_place", softer)
    found = search(bent, trials, Search(KINDS, Monitor()))
    assert "cubic_softening" in {rival.effect for rival in found.undecided}


def test_a_free_run_of_the_truth_leaves_the_noise():
    effect = Effect("coulomb", GROUND, {"friction_n": 1.5})
    trials = recorded(THREE, (effect,))
    true = refit(Plant.of(THREE, kinds=KINDS), recorded(THREE, (), seed=9))
    start = FitStart({}, [{}, {}])
    left = free_run_chi2(true, effect, start, trials, KINDS)
    nothing = Effect("viscous_damping", GROUND, {"dc_n_s_per_m": 0.0})
    lacking = free_run_chi2(true, nothing, start, trials, KINDS)
    assert left < 0.1 * lacking


@pytest.fixture(scope="module")
def far_off():
    """Fits to records of which a law is missing that only the last label names."""
    trials = recorded(ONE, (Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 1e5}),), level=2.0)
    bent = refit(Plant.of(ONE, kinds=KINDS), trials)
    before = refit_within_tolerances(bent, trials)
    mean = zip(before.prior.names, before.prior.mean.tolist(), strict=True)
    claimed = {(str(name[0]), PLACE.id): value for name, value in mean}
    start = FitStart(claimed, [{} for _ in trials])
    tried = [
        Candidate(Effect(name, PLACE, parameters), 1.0, -1.0, 1e9, start)
        for name, parameters in (
            ("quadratic_damping", {"c2_n_s2_per_m2": 0.1}),
            ("coulomb", {"friction_n": 0.1}),
            ("viscous_damping", {"dc_n_s_per_m": 0.1}),
            ("stiffness_loss", {"dk_n_per_m": 1.0}),
            ("quadratic_stiffness", {"k2_n_per_m2": 10.0}),
            ("gap_one_sided", {"gap_m": 1.0, "kg_n_per_m": 1.0}),
            ("cubic_hardening", {"k3_n_per_m3": 1e5}),
        )
    ]
    return bent, before, tried, trials


@pytest.mark.usefixtures("closed")
def test_further_down_come_the_next_in_turn_and_what_a_free_run_comes_nearest_with(far_off):
    bent, before, tried, trials = far_off
    more = LowerRanked(bent, before, tried, tried[:1], trials, KINDS)
    kinds = [one.effect.kind for one in every(more, [])]
    in_turn = ["coulomb", "viscous_damping", "stiffness_loss"]
    assert kinds[-IN_TURN - NEAREST : -NEAREST] == in_turn
    assert kinds[-NEAREST] == "cubic_hardening"
    assert more([]) == []


@pytest.mark.usefixtures("closed")
def test_further_down_one_goes_too_where_nothing_could_be_refitted(far_off):
    bent, before, tried, trials = far_off
    more = LowerRanked(bent, before, tried, tried[:1], trials, KINDS, several=True)
    kinds = [one.effect.kind for one in every(more, [])]
    assert kinds.index("cubic_hardening") < kinds.index("coulomb")
    assert more([]) == []


@pytest.mark.long
@pytest.mark.usefixtures("closed")
@pytest.mark.parametrize(("share", "goes_down"), [(0.59, False), (0.61, True)])
def test_where_a_law_explains_much_another_is_looked_for_beside_it(far_off, share, goes_down):
    bent, before, tried, trials = far_off
    (named,) = fit_candidates(before, tried[-1:], trials, KINDS, nothing)
    left = dataclasses.replace(named.fit, chi2_in_band=share * bent.chi2_in_band)
    best = dataclasses.replace(named, fit=left)
    more = LowerRanked(bent, before, tried, tried[:1], trials, KINDS)
    assert bool(more([best])) is goes_down


@pytest.mark.long
@pytest.mark.usefixtures("closed")
def test_labels_are_given_once_and_where_one_leaves_little_never(far_off):
    bent, before, tried, trials = far_off
    named = fit_candidates(before, tried[-1:], trials, KINDS, nothing)
    assert named[0].fit.chi2_in_band < 1.5
    assert LowerRanked(bent, before, tried, tried[:1], trials, KINDS)(named) == []
    many = [
        dataclasses.replace(one, effect=dataclasses.replace(one.effect, place=place))
        for one in tried[1:]
        for place in (GROUND, MIDDLE, TOP)
    ]
    bent = refit(Plant.of(THREE, kinds=KINDS), recorded(THREE, ()))
    more = LowerRanked(bent, bent, many, [], recorded(THREE, ()), KINDS)
    batch = every(more, [])
    assert more([]) == []
    labels = [(one.effect.kind, one.effect.place) for one in batch]
    assert len(set(labels)) == len(labels) == IN_TURN + NEAREST


@pytest.mark.usefixtures("closed")
@pytest.mark.parametrize("wrong", [0.003, 0.1, 1.0])
def test_a_law_is_begun_as_strong_as_its_free_run_wants_it(far_off, wrong):
    """Along a force that was guessed wrongly, its strength is wrong by powers of ten."""
    bent, before, tried, trials = far_off
    poor = dataclasses.replace(tried[-1], effect=Effect(
        "cubic_hardening", PLACE, {"k3_n_per_m3": wrong * 1e5}))  # fmt: skip
    fit = dataclasses.replace(before, chi2_in_band=5.1)
    best = FittedCandidate(tried[0].effect, before.plant.description, fit, 0.0)
    assert 5.1 < 0.6 * bent.chi2_in_band
    for several in (False, True):
        more = LowerRanked(bent, before, [tried[0], poor], tried[:1], trials, KINDS,
                        several=several)  # fmt: skip
        given = {one.effect.kind: one for one in more([best])}
        own = given["cubic_hardening"]
        assert own.start is None
        assert own.cost == tried[0].cost
        assert 0.25 < own.effect.parameters["k3_n_per_m3"] / 1e5 < 4.0
        assert more([best]) == []
    little = dataclasses.replace(best, fit=dataclasses.replace(fit, chi2_in_band=4.9))
    assert LowerRanked(bent, before, [poor], tried[:1], trials, KINDS)([little]) == []


def test_of_those_that_come_as_near_the_simpler_is_given_first(far_off):
    bent, before, tried, trials = far_off
    rich = dataclasses.replace(tried[-1], effect=Effect(
        "van_der_pol", PLACE, {"e0_m": 0.01, "cn_n_s_per_m": 0.1}))  # fmt: skip
    both = [rich, tried[-1]]
    costs = {"van_der_pol": 1.0, "cubic_hardening": 2.0}

    class AllAsNear(LowerRanked):
        def _scaled(self):
            for one in both:
                yield dataclasses.replace(one, cost=costs[one.effect.kind], start=None)

    fit = dataclasses.replace(before, chi2_in_band=5.1)
    best = FittedCandidate(tried[0].effect, before.plant.description, fit, 0.0)
    given = AllAsNear(bent, before, both, tried[:1], trials, KINDS, several=True)([best])
    named = [one.effect.kind for one in given if one.effect.kind in costs]
    assert named == ["cubic_hardening", "van_der_pol"]


@pytest.mark.usefixtures("closed")
def test_no_law_comes_near_what_leaves_but_noise(far_off):
    bent, before, tried, trials = far_off
    (named,) = fit_candidates(before, tried[-1:], trials, KINDS, nothing)
    much = dataclasses.replace(named.fit, chi2_in_band=5.1)
    more = LowerRanked(bent, before, tried[:-1], tried[:1], trials, KINDS)
    assert more([dataclasses.replace(named, fit=much)]) == []


@pytest.mark.usefixtures("closed")
def test_a_law_that_is_stuck_is_begun_from_where_the_model_stood(far_off):
    """It explained no less along its force than the best, and leaves far more when fitted."""
    bent, before, tried, trials = far_off
    numbers = {  # chi squared along the force, where refitted, and the same over the noise
        "quadratic_damping": (1e3, 1e6, 100.0),
        "coulomb": (2e3, 5e5, 50.0),
        "viscous_damping": (5e3, 1e6, 100.0),
        "stiffness_loss": (1.5e3, 1.4e4, 60.0),
    }
    known = {one.effect.kind: one for one in tried}
    labels = [
        dataclasses.replace(known[kind], cost=cost) for kind, (cost, *_) in numbers.items()
    ]
    found = []
    for label in labels:
        _, left, over = numbers[label.effect.kind]
        fit = dataclasses.replace(before, cost=left, chi2_in_band=over)
        found.append(FittedCandidate(label.effect, before.plant.description, fit, -left))
    given = LowerRanked(bent, before, tried, labels, trials, KINDS, several=True)(found)
    again = [
        one for one in given if label_of(one.effect) in {label_of(k.effect) for k in labels}
    ]
    assert [one.effect.kind for one in again] == ["quadratic_damping", "coulomb"]
    assert all(one.start is None for one in again)
    unread = [dataclasses.replace(one, start=None) for one in labels]
    assert not LowerRanked(bent, before, [], unread, trials, KINDS, several=True)(found)


@pytest.mark.parametrize("guessed", [0.97, 0.8])
def test_what_swings_wide_is_fitted_to_records_that_grow(guessed):
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
    before = refit_within_tolerances(refit(Plant.of(rig, kinds=KINDS), trials), trials)
    guess = dataclasses.replace(swings, parameters={"k": guessed * 60.0})
    (named,) = fit_candidates(
        before, [Candidate(guess, 1.0, -1.0, 1e12)], trials, KINDS, nothing
    )
    assert named.fit.chi2_in_band < 1.5
    assert named.fit.values[-1] == pytest.approx(60.0, rel=1e-2)


def test_more_labels_are_refitted_when_the_first_are_done(far_off):
    _, before, tried, trials = far_off
    asked = []

    def more(found):
        asked.append([one.effect.kind for one in found])
        return tried[-1:] if len(asked) == 1 else []

    named = fit_candidates(before, tried[1:2], trials, KINDS, nothing, more=more)
    assert named[0].effect.kind == "cubic_hardening"
    assert len(asked) == 2
    assert "cubic_hardening" in asked[1]


def test_more_labels_are_asked_for_though_there_were_none_to_begin_with(far_off):
    _, before, tried, trials = far_off
    more = [tried[-1:], []]
    named = fit_candidates(before, [], trials, KINDS, nothing, more=lambda _: more.pop(0))
    assert [one.effect.kind for one in named] == ["cubic_hardening"]


def test_laws_are_tried_though_no_force_anywhere_is_worth_what_it_costs(far_off):
    _, before, _, trials = far_off
    located = locate(before, trials)
    groups = tuple(
        dataclasses.replace(group, score=-1e5, left=20.0) for group in located.groups
    )
    found = library_candidates(before, dataclasses.replace(located, groups=groups), KINDS)
    assert {one.effect.place for one in found} >= {PLACE}


def test_of_one_label_tried_from_two_starts_the_better_is_kept(far_off):
    _, before, tried, trials = far_off
    named = fit_candidates(before, [tried[-1], tried[-1]], trials, KINDS, nothing)
    assert [one.effect.kind for one in named] == ["cubic_hardening"]


def test_a_place_is_not_left_for_others_where_there_are_none():
    def label(i, place):
        return Candidate(Effect(f"kind{i}", place, {}), 10.0 + i, -5.0 - i, 1e9)

    one = [label(i, PLACE) for i in range(8)]
    assert best_of_each_place(one, 6) == one[:6]
    several = [label(i, PLACE) for i in range(5)]
    several += [label(5 + i, place) for i, place in enumerate((GROUND, MIDDLE, TOP))]
    several += [label(9, Place("node", "m1")), label(10, Place("node", "m2"))]
    assert several[4] not in best_of_each_place(several, 6)


@pytest.mark.parametrize(("left", "made"), [(0.52, True), (0.58, True), (0.72, False)])
def test_of_what_the_base_does_no_law_explains_two_fifths(far_off, left, made):
    _, before, tried, trials = far_off
    (named,) = fit_candidates(before, tried[-1:], trials, KINDS, nothing)
    law = named.fit
    bar = refit(before.plant, trials, noise=law.noise, values=before.values,
                states=before.states, horizons=(1.0,))  # fmt: skip
    poor = dataclasses.replace(law, cost=law.data + left * (bar.cost - bar.data))
    assert follows(poor, before, trials) is made


@pytest.mark.parametrize(
    ("left", "elsewhere", "law"),
    [(6.0, False, False), (6.0, True, True), (4.0, False, True), (None, True, False)],
)
def test_where_only_the_base_leaves_nothing_a_law_that_leaves_much_is_none(
    far_off, monkeypatch, left, elsewhere, law
):
    """`elsewhere`: a force at another place leaves as little."""
    _, before, tried, trials = far_off
    (named,) = fit_candidates(before, tried[-1:], trials, KINDS, nothing)
    fit = dataclasses.replace(named.fit, chi2_in_band=left or 1.0)
    fitted = [dataclasses.replace(named, fit=fit)] if left else []
    monkeypatch.setattr(
        "slowtime.discrepancy.proposers.base_motion.apart", lambda _: not elsewhere
    )
    assert by_a_law(fitted, tried, before, trials, locate(before, trials)) is law


@pytest.mark.parametrize(("share", "law"), [(0.05, False), (0.3, True)])
def test_a_law_whose_free_run_follows_has_to_explain_the_force_too(
    far_off, monkeypatch, share, law
):
    """What swings with a mode by itself goes with what shakes it, and makes no such force."""
    _, before, tried, trials = far_off
    named = fit_candidates(before, tried[-1:], trials, KINDS, nothing)
    label = dataclasses.replace(tried[-1], cost=(1 - share) * tried[-1].cost_without)
    monkeypatch.setattr("slowtime.discrepancy.proposers.base_motion.apart", lambda _: False)
    assert by_a_law(named, [label], before, trials, locate(before, trials)) is law


def test_what_a_law_explains_by_half_in_a_free_run_is_no_motion_of_the_base(far_off):
    _, before, tried, trials = far_off
    cubic, drag = (fit_candidates(before, [one], trials, KINDS, nothing) for one in
                   (tried[-1], tried[2]))  # fmt: skip
    assert follows(cubic[0].fit, before, trials)
    assert not any(follows(one.fit, before, trials) for one in drag)


@pytest.mark.long
def test_friction_to_the_ground_is_not_taken_for_a_motion_of_it():
    """Any force of the ground's spring is some motion of the ground."""
    few = {name: KINDS[name] for name in ("coulomb", "base_motion", "added_mass")}
    trials = recorded(
        EVERY, (Effect("coulomb", GROUND, {"friction_n": 2.0}),), level=4.0, seconds=8.0
    )
    first = refit(Plant.of(EVERY, kinds=few), trials)
    found = search(first, trials, Search(few, Monitor()))
    assert [(a.effect.kind, a.effect.place) for a in found.answers] == [("coulomb", GROUND)]


@pytest.mark.long
def test_a_force_that_its_own_motion_makes_is_no_motion_of_the_ground():
    """Whatever the law, and though none is known that does it."""
    few = {name: KINDS[name] for name in ("base_motion", "added_mass")}
    trials = recorded(
        EVERY, (Effect("cubic_hardening", GROUND, {"k3_n_per_m3": 3e5}),), seconds=16.0
    )
    found = search(refit(Plant.of(EVERY, kinds=few), trials), trials, Search(few, Monitor()))
    assert found.located is not None
    assert found.located.with_base_first().best.kind == "base"
    assert found.located.best_structural == GROUND
    assert "base_motion" not in [answer.effect.kind for answer in found.answers]


@pytest.mark.long
@pytest.mark.parametrize(
    ("surface", "filtered", "linear", "made"),
    [(0.97, 0.91, False, True), (0.7, 0.47, False, True), (0.7, 0.65, False, False),
     (0.99, 1.0, True, False), (0.2, 0.95, False, False)],
)  # fmt: skip
def test_what_bends_with_the_motion_where_it_acts_is_made_there(
    surface, filtered, linear, made
):
    trials = recorded(THREE, (Effect("coulomb", GROUND, {"friction_n": 1.5}),), seconds=4.0)
    located = locate(refit(Plant.of(THREE, kinds=KINDS), trials), trials)
    there = dataclasses.replace(
        characterise(located, GROUND),
        static_share=surface,
        linear_share=filtered,
        linear=linear,
    )
    assert _made(there) is made


def test_one_sensors_factor_is_a_rival_also_where_it_was_tried_and_fared_badly():
    known = Effect("input_gain", Place("input", "u"), {"gain": 1.4})
    own = Effect("sensor_gain", Place("sensor", "x"), {"gain": 1.1})
    labels = [Candidate(known, 10.0, -5.0, 1e4), Candidate(own, 4e3, -2e3, 1e4)]
    (mirror,) = mirrored_factor(labels, labels, KINDS)
    assert (mirror.effect.kind, mirror.effect.parameters) == ("sensor_gain", {"gain": 1.4})
    assert mirror.cost == 10.0


@pytest.mark.long
@pytest.mark.parametrize("times", [0.7, 1.3, 2.2])
def test_a_hidden_oscillator_is_found_among_the_modes_and_above_them_all(times):
    highest = 6.1
    rides = {"mass_kg": 0.3, "frequency_hz": times * highest, "damping_n_s_per_m": 0.6}
    effect = Effect("extra_dof", Place("node", "m3"), rides)
    trials = recorded(EVERY, (effect,))
    before = refit_within_tolerances(refit(Plant.of(EVERY, kinds=KINDS), trials), trials)
    tried = library_candidates(before, locate(before, trials), KINDS)
    best = max((one for one in tried if one.effect.kind == "extra_dof"), key=lambda c: c.score)
    assert best.effect.place == effect.place
    assert best.effect.parameters["frequency_hz"] == pytest.approx(times * highest, rel=0.15)


def test_a_record_that_begins_in_motion_is_begun_so_though_friction_holds():
    """The state of the first samples, though what sticks at zero speed tells of none."""
    rough = Effect("stribeck", PLACE, {"friction_n": 0.8, "static_n": 1.4, "vs_m_per_s": 0.05})
    truth = Plant.of(dataclasses.replace(ONE, effects=(rough.entry(),)), kinds=KINDS)
    rng = np.random.default_rng(2)
    push = 6.0 * np.convolve(rng.standard_normal(800), np.hanning(9) / 2, "same")[:, None]
    outputs = truth.simulate(truth.values, push, RATE, state0=np.array([0.03, -0.4]))
    noise = 0.003 * outputs.std() * rng.standard_normal(outputs.shape)
    trial = Trial(inputs=push, outputs=outputs + noise, rate_hz=RATE)
    fit = refit(truth, recorded(ONE, (rough,)), values=truth.values)
    (run,) = free_runs(fit, (trial,))
    error = math.sqrt(float(np.mean((run - outputs) ** 2))) / float(outputs.std())
    assert error < 0.05


@pytest.mark.long
@pytest.mark.parametrize("measured", [False, True])
def test_a_motion_of_the_base_is_unmeasured_only_where_it_is_no_input(measured):
    ground = Input(channel="u", kind="base_acceleration", unit="m/s^2")
    every = dataclasses.replace(EVERY, inputs=(ground,)) if measured else EVERY
    few = {name: KINDS[name] for name in ("base_motion", "added_mass")}
    plant = Plant.of(every, kinds=few)
    rng = np.random.default_rng(8)
    push, shake = (
        level * np.convolve(rng.standard_normal(1000), np.hanning(9) / 2, "same")
        for level in (3.0, 2.0)
    )
    if measured:
        clean = plant.simulate(plant.values, (push + shake)[:, None], RATE)
    else:
        clean = plant.simulate(plant.values, push[:, None], RATE, base=shake)
    noise = 0.01 * clean.std(axis=0) * rng.standard_normal(clean.shape)
    trials = (Trial(inputs=push[:, None], outputs=clean + noise, rate_hz=RATE),)
    found = search(refit(plant, trials), trials, Search(few, Monitor()))
    named = [answer.effect.kind for answer in found.answers]
    assert ("base_motion" in named) is not measured


@pytest.mark.long
def test_a_slow_error_of_the_only_sensor_is_its_drift_and_no_motion_of_the_base():
    """The base would do the same to one accelerometer."""
    sensor = Sensor(channel="a", quantity="acceleration", node="m1", unit="m/s^2")
    one = dataclasses.replace(ONE, sensors=(sensor,))
    few = {name: KINDS[name] for name in ("sensor_drift", "base_motion", "coulomb")}
    rng = np.random.default_rng(14)
    trials = []
    for trial in recorded(one, (), seconds=20.0):
        walk = np.cumsum(rng.standard_normal(len(trial.outputs)))
        smooth = scipy.ndimage.gaussian_filter1d(walk, 0.8 * RATE)[:, None]
        trials.append(dataclasses.replace(trial, outputs=trial.outputs + 0.05 * smooth))
    seen = tuple(trials)
    found = search(refit(Plant.of(one, kinds=few), seen), seen, Search(few, Monitor()))
    assert [answer.effect.kind for answer in found.answers] == ["sensor_drift"]


@pytest.mark.long
def test_the_size_of_a_motion_of_the_base_is_told_by_the_records_that_show_it():
    few = {name: KINDS[name] for name in ("base_motion", "added_mass")}
    plant = Plant.of(EVERY, kinds=few)
    rng = np.random.default_rng(11)
    trials = []
    for loud in (0.01, 3.0):
        push, shake = (
            level * np.convolve(rng.standard_normal(2000), np.hanning(9) / 2, "same")
            for level in (3.0, 2.0)
        )
        clean = plant.simulate(plant.values, push[:, None], RATE, base=shake)
        noise = loud * clean.std(axis=0) * rng.standard_normal(clean.shape)
        trials.append(Trial(inputs=push[:, None], outputs=clean + noise, rate_hz=RATE))
    seen = tuple(trials)
    found = search(refit(plant, seen), seen, Search(few, Monitor()))
    (answer,) = found.answers
    told = answer.numbers["rms_m_per_s2"]
    assert answer.effect.kind == "base_motion"
    assert abs(told.value - 2.0 * np.sqrt(np.sum(np.hanning(9) ** 2) / 4)) < 2 * told.sd
    assert told.sd < 0.1 * told.value


def test_constants_within_their_tolerance_need_no_law():
    """A damping far off, a stiffness a little: what both add is mostly the stiffness's."""
    drag = Effect("quadratic_damping", PLACE, {"c2_n_s2_per_m2": 40.0})
    rig = dataclasses.replace(ONE, tolerance=Tolerance(stiffness=0.02, damping=0.05))
    known = chain([2.0], [824.0], dampings_n_s_per_m=[1.6])
    stiffer = dataclasses.replace(rig, elements=known.elements)
    bent = refit(Plant.of(rig, kinds=KINDS), recorded(stiffer, (drag,), level=0.5))
    assert abs(bent.pulls["stiffness", "k1"]) < 3
    assert bent.pulls["damping", "k1"] > 4
    found = equivalent_laws(bent, recorded(stiffer, (drag,), level=0.5), KINDS)
    assert "quadratic_damping" in {one.effect.kind for one in found}


@pytest.mark.long
@pytest.mark.parametrize(("sharp", "apart"), [(2e-4, False), (0.2, True)])
def test_of_friction_it_is_said_whether_its_curve_at_low_speed_shows(sharp, apart):
    """Far above the speed of Stribeck's curve, it is dry friction."""
    static = 1.5 if apart else 1.05
    numbers = {"friction_n": 1.0, "static_n": static, "vs_m_per_s": sharp}
    true = Effect("stribeck", PLACE, numbers)
    trials = recorded(ONE, (true,), seconds=8.0)
    few = {name: KINDS[name] for name in ("coulomb", "stribeck", "viscous_damping")}
    said = diagnose(Campaign(description=ONE, trials=trials), kinds=few)
    told = [note for note in said.notes if "would do as well" in note]
    assert [one.effect.kind for one in said.effects] == ["stribeck" if apart else "coulomb"]
    assert [note.split(" (")[1].split(")")[0] for note in told] == (
        [] if apart else ["stribeck"]
    )


@pytest.mark.parametrize(
    ("left", "whole", "told"),
    [(1.5, 100.0, True), (2.9, 15.0, False), (4.0, 1e3, True), (4.0, 100.0, False)],
    ids=["noise", "too much", "next to all", "more than noise"],
)
def test_a_law_is_begun_with_if_it_alone_explains_how_records_begin(far_off, left, whole, told):
    bent, before, tried, trials = far_off
    more = LowerRanked(bent, before, tried, tried[:1], trials, KINDS)
    data = before.data
    one = dataclasses.replace(tried[-1], cost=left * data, cost_without=whole * data)
    assert more._alone([one, tried[0]]) == (label_of(one.effect) if told else None)
    assert more._alone([]) is None
