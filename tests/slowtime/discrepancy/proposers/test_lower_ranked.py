"""Laws that stand low in the library's ranking are proposed where they come near."""

import dataclasses
import math

import numpy as np
import pytest
import scipy.signal

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import FitStart, free_run_chi2
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.candidates.library_fit import label_of
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers import Proposal
from slowtime.discrepancy.proposers.lower_ranked import (
    NEAREST_RUNS,
    NEXT_IN_TURN,
    InitialSegments,
    NearbyRuns,
    NextInRank,
    explains_alone,
)
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import (
    candidate,
    fit_effect,
    fitted_candidate,
    round_of,
)
from tests.slowtime.discrepancy.rigs import ONE, PLACE
from tests.slowtime.discrepancy.three_mass_chain import (
    GROUND,
    MIDDLE,
    THREE,
    TOP,
    recorded,
)

KINDS = catalogue()
CUBIC = Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 1e5})
EVERYONE = (NearbyRuns(), InitialSegments(), NextInRank())


@pytest.fixture(scope="module")
def asked():
    """A round of records of which a law is missing that only the last label names."""
    trials = recorded(ONE, (CUBIC,), level=2.0)
    bent = refit(Plant.of(ONE, kinds=KINDS), trials)
    before = refit_within_tolerances(bent, trials)
    mean = zip(before.prior.names, before.prior.mean.tolist(), strict=True)
    claimed = {(str(name[0]), PLACE.id): value for name, value in mean}
    start = FitStart(claimed, [{} for _ in trials])
    tried = [
        candidate(Effect(name, PLACE, parameters), 1.0, cost_without=1e9, start=start)
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
    given = round_of(before, trials, KINDS, tried=tried, shortlist=tried[:1])
    hypothesis = dataclasses.replace(given.hypothesis, fits=(bent,))
    return with_force_left(dataclasses.replace(given, hypothesis=hypothesis), 1.0)


@pytest.fixture(scope="module")
def right(asked):
    return fit_effect(asked.before, CUBIC, asked.trials, KINDS)


def with_force_left(given, left):
    """Give the round as if a force at the best place left a mean square."""
    groups = given.localized.groups
    first = dataclasses.replace(groups[0], left=left)
    located = dataclasses.replace(given.localized, groups=(first, *groups[1:]))
    return dataclasses.replace(given, localized=located)


def after(given, *fitted, **more):
    return dataclasses.replace(given, fitted=fitted, **more)


def kinds_of(proposal):
    return [one.effect.kind for one in proposal.candidates]


def leaves(given, chi2, effect=None):
    """A fit that leaves what the model without any law does, but for its mean square."""
    return fitted_candidate(effect or given.tried[0].effect, given.before, chi2_in_band=chi2)


def test_the_next_of_the_ranking_and_those_of_the_nearest_free_runs_are_proposed(asked):
    kinds = kinds_of(NextInRank()(asked))
    in_turn = ["coulomb", "viscous_damping", "stiffness_loss"]
    assert kinds[-NEXT_IN_TURN - NEAREST_RUNS : -NEAREST_RUNS] == in_turn
    assert kinds[-NEAREST_RUNS] == "cubic_hardening"


@pytest.mark.parametrize("fitted", [True, False])
def test_where_several_forces_are_missing_the_ranking_counts_only_if_nothing_was_fitted(
    asked, fitted
):
    several = with_force_left(asked, 10.0)
    given = after(several, leaves(asked, 50.0)) if fitted else several
    assert bool(NextInRank()(given).candidates) is not fitted
    assert "cubic_hardening" in kinds_of(NearbyRuns()(given))


@pytest.mark.parametrize(("share", "proposed"), [(0.59, False), (0.61, True)])
def test_the_next_of_the_ranking_is_proposed_where_the_best_explains_little(
    asked, share, proposed
):
    bare = asked.hypothesis.last.chi2_in_band
    given = after(asked, leaves(asked, share * bare))
    assert bool(NextInRank()(given).candidates) is proposed


def test_nothing_is_proposed_where_a_law_leaves_little_or_segments_told_one(asked, right):
    assert right.fit.chi2_in_band < 1.5
    told = (Proposal("segments", asked.tried[-1:], only=True), Proposal("segments", ()))
    for given in (
        after(asked, right),
        dataclasses.replace(asked, proposals=told),
        dataclasses.replace(asked, number=1),
    ):
        for proposer in EVERYONE:
            assert proposer(given).candidates == ()


def test_each_law_of_the_ranking_is_proposed_once():
    trials = recorded(THREE, ())
    bent = refit(Plant.of(THREE, kinds=KINDS), trials)
    start = FitStart({}, [{} for _ in trials])
    many = [
        candidate(Effect(name, place, {parameter: 0.1}), 1.0, cost_without=1e9, start=start)
        for name, parameter in (
            ("coulomb", "friction_n"),
            ("viscous_damping", "dc_n_s_per_m"),
            ("stiffness_loss", "dk_n_per_m"),
        )
        for place in (GROUND, MIDDLE, TOP)
    ]
    proposal = NextInRank()(round_of(bent, trials, KINDS, tried=many))
    labels = [label_of(one.effect) for one in proposal.candidates]
    assert len(set(labels)) == len(labels) == NEXT_IN_TURN + NEAREST_RUNS


@pytest.mark.parametrize("wrong", [0.003, 0.1, 1.0])
def test_a_law_is_proposed_as_strong_as_its_free_run_comes_nearest(asked, wrong):
    """Along a force that was guessed wrongly, its strength is wrong by powers of ten."""
    strength = {"k3_n_per_m3": wrong * 1e5}
    poor = dataclasses.replace(
        asked.tried[-1], effect=dataclasses.replace(CUBIC, parameters=strength)
    )
    assert 5.1 < 0.6 * asked.hypothesis.last.chi2_in_band
    given = after(asked, leaves(asked, 5.1), tried=(asked.tried[0], poor))
    (own,) = (one for one in NearbyRuns()(given).candidates if one.effect.kind == CUBIC.kind)
    assert own.start is None
    assert own.cost == asked.tried[0].cost
    assert 0.25 < own.effect.parameters["k3_n_per_m3"] / 1e5 < 4.0
    assert NearbyRuns()(after(given, leaves(asked, 4.9))).candidates == ()


def test_of_laws_that_come_as_near_the_simpler_is_proposed_first(asked):
    gap = Effect("gap_symmetric", PLACE, {"kg_n_per_m": 500.0, "gap_m": 0.03})
    rich = dataclasses.replace(asked.tried[-1], effect=gap)
    given = after(asked, leaves(asked, 5.1), tried=(rich, asked.tried[-1]))
    named = [kind for kind in kinds_of(NearbyRuns()(given)) if kind in (gap.kind, CUBIC.kind)]
    assert named == ["cubic_hardening", "gap_symmetric"]


def test_no_law_comes_near_what_leaves_only_noise(asked, right):
    much = dataclasses.replace(right, fit=dataclasses.replace(right.fit, chi2_in_band=5.1))
    given = after(asked, much, tried=asked.tried[:-1])
    assert NearbyRuns()(given).candidates == ()


def test_a_law_that_is_stuck_is_proposed_again_from_where_the_model_stood(asked):
    """It explained no less along its force than the best, and leaves far more when fitted."""
    numbers = {  # chi squared along the force, where refitted, and the same over the noise
        "quadratic_damping": (1e3, 1e6, 100.0),
        "coulomb": (2e3, 5e5, 50.0),
        "viscous_damping": (5e3, 1e6, 100.0),
        "stiffness_loss": (1.5e3, 1.4e4, 60.0),
    }
    known = {one.effect.kind: one for one in asked.tried}
    short = tuple(
        dataclasses.replace(known[kind], cost=cost) for kind, (cost, *_) in numbers.items()
    )
    fitted = tuple(
        fitted_candidate(
            label.effect, asked.before,
            cost=numbers[label.effect.kind][1], chi2_in_band=numbers[label.effect.kind][2],
        )
        for label in short
    )  # fmt: skip
    given = with_force_left(after(asked, *fitted, shortlist=short), 10.0)
    listed = {label_of(one.effect) for one in short}
    again = [one for one in NearbyRuns()(given).candidates if label_of(one.effect) in listed]
    assert [one.effect.kind for one in again] == ["quadratic_damping", "coulomb"]
    assert all(one.start is None for one in again)
    unread = tuple(dataclasses.replace(one, start=None) for one in short)
    nothing = dataclasses.replace(given, shortlist=unread, tried=())
    assert NearbyRuns()(nothing).candidates == ()


@pytest.mark.parametrize(
    ("left", "whole", "told"),
    [(1.5, 100.0, True), (2.9, 15.0, False), (4.0, 1e3, True), (4.0, 100.0, False)],
    ids=["noise", "too much", "next to all", "more than noise"],
)
def test_a_law_explains_how_records_begin_if_it_alone_leaves_little_of_them(
    asked, left, whole, told
):
    data = asked.before.data
    one = dataclasses.replace(asked.tried[-1], cost=left * data, cost_without=whole * data)
    label = label_of(one.effect) if told else None
    assert explains_alone(asked, [one, asked.tried[0]]) == label
    assert explains_alone(asked, []) is None


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


@pytest.mark.parametrize("base_moves", [False, True])
def test_a_hidden_oscillator_is_guessed_unless_a_moving_base_would_do_the_same(
    ridden, base_moves
):
    campaign, rider, few = ridden
    bent = refit(Plant.of(campaign.description, kinds=few), campaign.trials)
    label = candidate(Effect("added_mass", rider.place, {"dm_kg": 0.1}), 1.0, cost_without=1e9)
    given = round_of(
        bent, campaign.trials, few, shortlist=[label], base_moves=base_moves,
        tried=[label, dataclasses.replace(label, effect=rider)],
        # How the records begin is not looked at.
        monitor=Monitor(late=lambda: True),
    )  # fmt: skip
    proposal = InitialSegments()(given)
    places = [one.effect.place for one in proposal.candidates if one.effect.kind == rider.kind]
    assert places == [rider.place] * (0 if base_moves else 2)
    assert proposal.begins is None


def test_a_guessed_oscillator_is_light_and_a_little_faster_than_a_mode():
    guesses = KINDS["extra_dof"].guesses(2.0, [3.0, 0.0, 9.0])
    assert [one["frequency_hz"] for one in guesses] == pytest.approx([11.7, 3.9])
    for one in guesses:
        KINDS["extra_dof"].values(one)
        assert one["mass_kg"] < 0.1 * 2.0
        critical = 4 * math.pi * one["frequency_hz"] * one["mass_kg"]
        assert 0.01 < one["damping_n_s_per_m"] / critical < 0.1
    assert KINDS["extra_dof"].guesses(0.0, [3.0]) == []
    assert KINDS["coulomb"].guesses(2.0, [3.0]) == []


def test_a_free_run_of_the_truth_leaves_the_noise():
    effect = Effect("coulomb", GROUND, {"friction_n": 1.5})
    trials = recorded(THREE, (effect,))
    true = refit(Plant.of(THREE, kinds=KINDS), recorded(THREE, (), seed=9))
    start = FitStart({}, [{}, {}])
    left = free_run_chi2(true, effect, start, trials, KINDS)
    still = Effect("viscous_damping", GROUND, {"dc_n_s_per_m": 0.0})
    lacking = free_run_chi2(true, still, start, trials, KINDS)
    assert left < 0.1 * lacking
