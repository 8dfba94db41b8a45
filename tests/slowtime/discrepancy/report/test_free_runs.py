"""The report says how sure a diagnosis is, and what it rests on."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.data.clock_overrun import mask_clock_overrun
from slowtime.discrepancy.data.screening import Finding
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate, evidence, misfit
from slowtime.discrepancy.estimation.occam_factor import leniency
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.report.free_runs import report
from slowtime.discrepancy.report.notes import HURRIED, LOUD, NOT_KEPT
from slowtime.discrepancy.selection.probabilities import (
    answer_of,
    fault_of,
    rivals_within,
    shares_of,
)
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import named_effect
from tests.slowtime.discrepancy.rigs import ONE, PLACE
from tests.slowtime.discrepancy.three_mass_chain import recorded

KINDS = catalogue()


@pytest.fixture(scope="module")
def named():
    rng = np.random.default_rng(2)
    rig = dataclasses.replace(
        chain([2.0], [800.0], dampings_n_s_per_m=[1.6]),
        inputs=(Input(channel="f", kind="force", node="m1", unit="N"),),
        sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="m"),),
    )
    effect = Effect("added_mass", Place("node", "m1"), {"dm_kg": 0.4})
    plant = Plant.of(dataclasses.replace(rig, effects=(effect.entry(),)))
    push = rng.standard_normal((200, 1))
    seen = plant.simulate(plant.values, push, 64.0) + 1e-5 * rng.standard_normal((200, 1))
    trials = (Trial(inputs=push, outputs=seen, rate_hz=64.0),)
    fit = refit(plant, trials, horizons=(1.0,))
    return FittedCandidate(effect, plant.description, fit, evidence(fit, KINDS))


def noisy(plant, values, push, more, rng):
    """A record with 5 % of noise, under a push and so much that was not recorded."""
    clean = plant.simulate(values, push + more * rng.standard_normal(push.shape), 64.0)
    noise = 0.05 * clean.std() * rng.standard_normal(clean.shape)
    return Trial(inputs=push, outputs=clean + noise, rate_hz=64.0)


def test_constants_that_may_be_off_take_their_share(named):
    assert shares_of([named], KINDS) == [1.0]
    (share,) = shares_of([named], KINDS, [named.score + leniency(named, KINDS)])
    assert share == pytest.approx(0.5)
    lesser = dataclasses.replace(named, score=named.score - 100.0)
    shares = shares_of([named, lesser], KINDS, [named.score])
    assert [rival.effect for rival in rivals_within([named, lesser], shares)] == ["added_mass"]


@pytest.mark.parametrize(("given", "told"), [(6e4, False), (5.85e4, False), (4e4, True)])
def test_a_parameter_of_a_given_effect_that_is_off_is_reported(given, told):
    rng = np.random.default_rng(7)
    rig = dataclasses.replace(
        chain([2.0], [800.0], dampings_n_s_per_m=[1.6]),
        inputs=(Input(channel="f", kind="force", node="m1", unit="N"),),
        sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="m"),),
        tolerance=Tolerance(stiffness=0.02, damping=0.1),
    )
    stiffer = Effect(
        "cubic_hardening", Place("element", rig.elements[0].id), {"k3_n_per_m3": 6e4}
    )
    true = Plant.of(dataclasses.replace(rig, effects=(stiffer.entry(),)))
    push = 10 * rng.standard_normal((1500, 1))
    clean = true.simulate(true.values, push, 64.0)
    noise = 0.01 * clean.std() * rng.standard_normal(clean.shape)
    trial = Trial(inputs=push, outputs=clean + noise, rate_hz=64.0)
    claimed = dataclasses.replace(stiffer, parameters={"k3_n_per_m3": given})
    model = dataclasses.replace(rig, effects=(claimed.entry(),))
    fit = refit(Plant.of(model), (trial,))
    found = Hypothesis((fit,), (trial,), localized=locate(fit, (trial,)))
    answer = report(Campaign(description=model, trials=(trial,)), (trial,), (), found, KINDS)
    name = f"k3_n_per_m3 of cubic_hardening at {stiffer.place}"
    assert answer.verdict == ("parameters_only" if told else "nothing_missing")
    assert list(answer.moved) == ([name] if told else [])
    if told:
        assert abs(answer.moved[name].value - 6e4) < 4 * answer.moved[name].sd
        assert name in answer.sentence
        assert answer.augmented.inputs[0].hold == "band_limited"


@pytest.mark.parametrize(("damping", "told"), [(1.6, False), (-0.3, True)])
def test_a_damper_that_feeds_energy_is_noted(damping, told):
    rng = np.random.default_rng(3)
    model = dataclasses.replace(
        chain([2.0], [800.0], dampings_n_s_per_m=[1.6]),
        inputs=(Input(channel="f", kind="force", node="m1", unit="N"),),
        sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="m"),),
        tolerance=Tolerance(stiffness=0.02, damping=2.0),
    )
    plant = Plant.of(model)
    spring, push = model.elements[0].id, rng.standard_normal((800, 1))
    values = plant.values.copy()
    values[plant.parameters.index(("damping", spring))] = damping
    clean = plant.simulate(values, push, 64.0)
    noise = 0.01 * clean.std() * rng.standard_normal(clean.shape)
    trial = Trial(inputs=push, outputs=clean + noise, rate_hz=64.0)
    fit = refit(plant, (trial,))
    found = Hypothesis((fit,), (trial,), localized=locate(fit, (trial,)))
    answer = report(Campaign(description=model, trials=(trial,)), (trial,), (), found, KINDS)
    notes = [note for note in answer.notes if f"damping of {spring} is negative" in note]
    assert len(notes) == told
    assert all("N s/m" in note for note in notes)


@pytest.mark.parametrize(("off", "told"), [(0.0, False), (1.5, False), (2.8, True)])
def test_a_constant_that_is_rarely_as_far_off_is_noted(off, told):
    rng = np.random.default_rng(6)
    plant = Plant.of(ONE)
    spring = PLACE.id
    values = plant.values.copy()
    values[plant.parameters.index(("stiffness", spring))] *= 1 + off * 0.02
    push = rng.standard_normal((2000, 1))
    clean = plant.simulate(values, push, 64.0)
    noise = 0.01 * clean.std() * rng.standard_normal(clean.shape)
    trial = Trial(inputs=push, outputs=clean + noise, rate_hz=64.0)
    fit = refit(plant, (trial,))
    found = Hypothesis((fit,), (trial,), localized=locate(fit, (trial,)))
    answer = report(Campaign(description=ONE, trials=(trial,)), (trial,), (), found, KINDS)
    assert answer.verdict == "nothing_missing"
    notes = [note for note in answer.notes if "times its tolerance" in note]
    assert len(notes) == told
    assert all(
        f"stiffness of {spring} had to be changed by 2.8 times" in note for note in notes
    )


def test_undecided_effects_have_nineteen_twentieths_of_the_probability_together(named):
    several = [named] * 3
    for shares, told in (
        ([0.91, 0.06, 0.03], 2),
        ([0.96, 0.03, 0.01], 1),
        ([0.80, 0.12, 0.08], 3),
        # Of what they have together: an answer without any effect takes its share first.
        ([0.58, 0.01, 0.01], 1),
    ):
        assert len(rivals_within(several, shares)) == told


@pytest.mark.parametrize(
    ("unseen", "chi2", "chance", "verdict"),
    [
        (0.0, 2.4, 0.0, "nothing_missing"),
        (2.0, 2.4, 0.0, "unknown_effect"),
        (2.0, 4.0, 1.0, "unknown_effect"),
        (2.0, 2.4, 1.0, "nothing_missing"),
    ],
)
def test_noise_of_another_colour_is_no_effect_where_no_record_shows_an_error(
    unseen, chi2, chance, verdict
):
    rng = np.random.default_rng(4)
    rig = dataclasses.replace(ONE, tolerance=Tolerance(stiffness=0.01, damping=0.1))
    plant = Plant.of(rig)

    def record(more):
        return noisy(plant, plant.values, rng.standard_normal((400, 1)), more, rng)

    trials = (record(0.0), record(0.0))
    fit = refit(plant, trials)
    loud = dataclasses.replace(fit, chi2_in_band=chi2, in_band_sd=0.02)
    left = locate(fit, trials)
    sure = dataclasses.replace(left.groups[0], p_value=chance)
    left = dataclasses.replace(left, groups=(sure, *left.groups[1:]))
    found = Hypothesis((loud,), trials, localized=left, rest=left)
    told = report(
        Campaign(description=rig, trials=trials, holdout=(record(unseen),)),
        trials,
        (),
        found,
        KINDS,
    )
    assert told.verdict == verdict
    assert (LOUD in told.notes) == (unseen == 0.0)


@pytest.mark.parametrize(
    ("unseen", "unknown", "kept"),
    [(800.0, True, False), (880.0, True, True), (800.0, False, True), (None, True, True)],
    ids=["no better", "better", "nothing unknown", "none held out"],
)
def test_constants_bent_by_an_unknown_effect_are_kept_where_they_predict_better(
    unseen, unknown, kept
):
    """Unless a record that was never seen says that they do not."""
    rng = np.random.default_rng(4)
    plant = Plant.of(ONE)

    def record(*stiffness):
        push = rng.standard_normal((400, 1))
        values = plant.values.copy()
        parts = []
        for one in stiffness:
            values[plant.parameters.index(("stiffness", PLACE.id))] = one
            parts.append(noisy(plant, values, push, 0.0, rng))
        later = np.arange(400)[:, None] >= 267
        outputs = np.where(later, parts[-1].outputs, parts[0].outputs)
        return dataclasses.replace(parts[0], outputs=outputs)

    # The last third, which no fit to be judged sees where no record is held out, is as given.
    trials = tuple(record(880.0, 880.0 if unseen else 800.0) for _ in range(2))
    fit = refit(plant, trials)
    found = Hypothesis(
        (dataclasses.replace(fit, chi2_in_band=99.0 if unknown else 1.0),), trials,
        localized=locate(fit, trials), refuted_at=PLACE if unknown else None,
    )  # fmt: skip
    campaign = Campaign(
        description=ONE, trials=trials, holdout=(record(unseen),) if unseen else ()
    )
    told = report(campaign, trials, (), found, KINDS)
    assert (told.verdict == "unknown_effect") == unknown
    # Of an unknown effect, that nothing is missing is as probable as so much from noise.
    assert (told.nothing_probability == told.white_p_value) == unknown
    gap = told.gap
    assert (gap.refitted_nominal > gap.nominal) == (unseen != 880.0)
    assert (NOT_KEPT in told.notes) == (not kept)
    assert bool(told.moved) == kept
    assert (told.augmented == ONE) == (not kept)
    assert gap.augmented == gap.worst == (gap.refitted_nominal if kept else gap.nominal)
    for traces in told.traces:
        ran = traces.refitted if kept else traces.nominal
        np.testing.assert_array_equal(traces.augmented, ran)
    assert np.array_equal(told.spectra.after, told.spectra.before) == kept
    shown = 100 * gap.augmented
    assert (f"{shown:.0f} %" if shown >= 10 else f"{shown:.2g} %") in told.sentence


@pytest.mark.parametrize(
    ("chi2", "exhausted", "verdict"),
    [
        (30.0, True, "unknown_effect"),
        (30.0, False, "missing_effect"),
        (1.0, True, "missing_effect"),
    ],
)
def test_an_effect_that_leaves_far_more_than_noise_is_not_named_out_of_budget(
    named, chi2, exhausted, verdict
):
    rng = np.random.default_rng(3)
    plant = named.fit.plant
    push = rng.standard_normal((200, 1))
    seen = plant.simulate(plant.values, push, 64.0) + 1e-5 * rng.standard_normal((200, 1))
    trials = (Trial(inputs=push, outputs=seen, rate_hz=64.0),)
    rig = dataclasses.replace(plant.description, effects=())
    first = refit(Plant.of(rig), trials)
    last = dataclasses.replace(refit(plant, trials), chi2_in_band=chi2)
    located = locate(first, trials)
    found = Hypothesis(
        (first, last), trials, localized=located, rest=locate(last, trials),
        effects=(answer_of([named], [1.0], KINDS),), exhausted=exhausted,
    )  # fmt: skip
    told = report(Campaign(description=rig, trials=trials), trials, (), found, KINDS)
    assert told.verdict == verdict
    assert (HURRIED in told.notes) == exhausted
    assert told.exhausted == exhausted
    if chi2 == 1.0:
        # One law that leaves noise is no patchwork of many.
        assert [effect.probability for effect in told.effects] == [1.0]


def test_samples_of_a_fast_clock_after_the_end_of_a_record_are_no_error():
    rng, rig = np.random.default_rng(5), ONE
    fast = Effect("sensor_clock", Place("sensor", "x"), {"skew": 0.002})
    plant = Plant.of(dataclasses.replace(rig, effects=(fast.entry(),)))

    def record(start_s):
        # Longer than what is given: what the clock tells at the end is of what came after.
        push = np.convolve(rng.standard_normal(2200), np.hanning(5), "same")[:, None]
        clean = plant.simulate(plant.values, push, 64.0, start_s=start_s)
        seen = clean + 0.005 * clean.std() * rng.standard_normal(clean.shape)
        return Trial(inputs=push[:1900], outputs=seen[:1900], rate_hz=64.0, start_s=start_s)

    trials = (record(0.0), record(60.0))
    own = mask_clock_overrun(trials, ("x",), (fast,), KINDS)
    first, last = refit(Plant.of(rig), own), refit(plant, own)
    named = FittedCandidate(fast, plant.description, last, evidence(last, KINDS))
    found = Hypothesis(
        (first, last), own, localized=locate(first, own), rest=locate(last, own),
        effects=(answer_of([named], [1.0], KINDS),),
    )  # fmt: skip
    campaign = Campaign(description=rig, trials=trials, holdout=(record(200.0),))
    told = report(campaign, own, (), found, KINDS)
    assert told.verdict == "sensor_fault"
    assert told.gap.augmented == pytest.approx(told.gap.noise_floor, rel=0.1)


@pytest.mark.parametrize(
    ("fault", "told"),
    [("clipped", {"clip": 0.2}), ("zero", {"from_s": 0.3, "for_s": 0.3 * 2**0.5, "held": 0.0})],
)
def test_faults_found_by_screening_are_quoted_with_their_errors(fault, told):
    finding = Finding(
        fault=fault, channel="x", spans_s=((1.0, 3.0),), share=0.1, level=5.0, level_sd=0.2,
        instant_sd=0.3,
    )  # fmt: skip
    answer = fault_of(finding, ONE, KINDS)
    assert answer is not None
    assert {number.unit for number in answer.numbers.values()} <= {"m", "s", ""}
    sds = {name: number.sd for name, number in answer.numbers.items()}
    assert sds == pytest.approx(told)


@pytest.mark.parametrize(
    ("effect", "share", "unknown"),
    [
        (Effect("coulomb", PLACE, {"friction_n": 1.0}), 0.002, False),
        (Effect("coulomb", PLACE, {"friction_n": 1.0}), 0.004, True),
        (Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 1.0}), 0.002, True),
        (Effect("cubic_hardening", PLACE, {"k3_n_per_m3": 1.0}), 0.0005, False),
    ],
)
def test_friction_may_leave_a_little_more_at_its_place_than_what_does_not_stick(
    effect, share, unknown
):
    """Its misfit has a minimum for each time that it might have stuck."""
    rng = np.random.default_rng(8)
    few = {effect.kind: KINDS[effect.kind]}
    plant = Plant.of(ONE, kinds=few)
    trial = noisy(plant, plant.values, rng.standard_normal((300, 1)), 0.0, rng)
    last = carry_effect(refit(plant, (trial,)), effect, few)
    last = dataclasses.replace(
        last, chi2_in_band=1.5, in_band_sd=0.01, residual=tuple(1.3 * r for r in last.residual)
    )
    # What the model as given left, so that the share of it is left.
    beyond = misfit(last, last.noise, (trial,)) - last.data
    loud = np.sqrt((beyond / share + last.data) / (beyond + last.data))
    assert beyond > 0
    first = dataclasses.replace(
        refit(plant, (trial,)), chi2_in_band=1e4,
        residual=tuple(loud * one for one in last.residual),
    )  # fmt: skip
    rest = locate(first, (trial,))
    here = dataclasses.replace(rest.groups[0], places=(PLACE,), p_value=0.0, left=9.0)
    rest = dataclasses.replace(rest, groups=(here, *rest.groups[1:]))
    found = Hypothesis(
        (first, last), (trial,), localized=rest, rest=rest,
        effects=(named_effect(effect, few),),
    )  # fmt: skip
    told = report(Campaign(description=ONE, trials=(trial,)), (trial,), (), found, few)
    assert (told.verdict == "unknown_effect") is unknown


@pytest.mark.long
@pytest.mark.parametrize(("sharp", "apart"), [(2e-4, False), (0.2, True)])
def test_a_law_of_more_parameters_that_would_do_as_well_is_noted(sharp, apart):
    """Far above the speed of Stribeck's curve, it is dry friction."""
    static = 1.5 if apart else 1.05
    numbers = {"friction_n": 1.0, "static_n": static, "vs_m_per_s": sharp}
    true = Effect("stribeck", PLACE, numbers)
    trials = recorded(ONE, (true,), seconds=8.0)
    few = {name: KINDS[name] for name in ("coulomb", "stribeck", "viscous_damping")}
    said = diagnose(Campaign(description=ONE, trials=trials), kinds=few)
    told = [note for note in said.notes if "would fit equally well" in note]
    assert [one.effect.kind for one in said.effects] == ["stribeck" if apart else "coulomb"]
    assert [note.split(" (")[1].split(")")[0] for note in told] == (
        [] if apart else ["stribeck"]
    )
