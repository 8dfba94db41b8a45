"""From records to an answer, on rigs that another integrator has moved."""

import dataclasses
import threading

import numpy as np
import pytest

from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.progress import Cancelled
from slowtime.discrepancy.records import Campaign
from slowtime.discrepancy.search import SearchOptions
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.signals.interpolation import at_instants
from tests.slowtime.discrepancy.protocol import StubProposer, candidate

QUICK = SearchOptions(quick=True)
LOSS = 400.0


def cubic(e, v, t):
    return 4e6 * e**3


def softer(e, v, t):
    return -LOSS * e


def answered(rig, trials, **more):
    return diagnose(
        Campaign(description=rig.description, trials=trials[:-1], holdout=trials[-1:]), **more
    )


@pytest.fixture(scope="module")
def hardened(campaign, wrong):
    rig, trials = campaign(
        11, wrong(element=0, force=cubic), masses=1, levels=(1.0, 2.0, 1.5), seconds=8.0
    )
    stages = []
    found = answered(rig, trials, progress=lambda stage, share: stages.append((stage, share)))
    return found, stages


@pytest.mark.slow
def test_a_hardening_spring_is_named_where_it_is(hardened):
    found, _ = hardened
    assert found.verdict == "missing_effect"
    assert [named.effect.kind for named in found.effects] == ["cubic_hardening"]
    assert found.effects[0].effect.place == Place("element", "j0")
    number = found.effects[0].numbers["k3_n_per_m3"]
    assert abs(number.value - 4e6) < max(4 * number.sd, 0.02 * 4e6)


@pytest.mark.slow
def test_the_gap_on_the_record_held_out_falls_to_the_floor(hardened):
    found, _ = hardened
    assert found.gap.on == "holdout"
    assert found.gap.augmented < 1.1 * found.gap.noise_floor
    assert found.gap.augmented < 0.5 * found.gap.refitted_nominal


@pytest.mark.slow
def test_progress_only_grows_and_is_in_words(hardened):
    _, stages = hardened
    shares = [share for _, share in stages]
    assert shares == sorted(shares)
    assert 0 <= shares[0] <= shares[-1] <= 1
    assert any("cubic_hardening" in stage for stage, _ in stages)


def test_where_nothing_is_missing_nothing_is_named(campaign):
    rig, trials = campaign(12, masses=2, levels=(1.0, 2.0, 1.5), seconds=10.0)
    found = answered(rig, trials, options=QUICK)
    assert found.verdict == "nothing_missing"
    assert not found.effects
    assert found.gap.augmented <= 1.02 * found.gap.nominal


@pytest.mark.long
def test_a_sensor_that_fell_silent_is_named(campaign):
    rig, trials = campaign(13, masses=1, levels=(1.0, 2.0, 1.5), seconds=10.0)
    outputs = trials[0].outputs.copy()
    outputs[300:420, 1] = 0.0
    silent = dataclasses.replace(trials[0], outputs=outputs, use=None)
    found = answered(rig, (silent, *trials[1:]), options=QUICK)
    assert found.verdict == "sensor_fault"
    assert found.effects[0].effect.kind == "sensor_dropout"
    assert found.effects[0].effect.place == Place("sensor", rig.description.sensors[1].channel)


def test_a_proposer_of_the_caller_is_asked_and_its_candidate_is_named(campaign, wrong):
    rig, trials = campaign(
        11, wrong(element=0, force=cubic), masses=1, levels=(1.0, 1.5), seconds=6.0
    )
    law = Effect("cubic_hardening", Place("element", "j0"), {"k3_n_per_m3": 2e6})
    own = StubProposer("own", candidates=(candidate(law, cost_without=1e6),))
    few = {name: catalogue()[name] for name in ("cubic_hardening", "viscous_damping")}
    found = answered(rig, trials, kinds=few, options=SearchOptions(proposers=(own,)))
    assert [named.effect.kind for named in found.effects] == ["cubic_hardening"]
    number = found.effects[0].numbers["k3_n_per_m3"]
    assert abs(number.value - 4e6) < max(4 * number.sd, 0.03 * 4e6)
    assert len(own.rounds) == 1


def test_a_diagnosis_stops_when_it_is_told_to(campaign):
    rig, trials = campaign(12, masses=2, levels=(1.0, 2.0, 1.5), seconds=10.0)
    stop = threading.Event()
    stop.set()
    with pytest.raises(Cancelled, match="was stopped"):
        answered(rig, trials, stop=stop)


def test_a_diagnosis_does_not_change_the_records(campaign):
    rig, trials = campaign(14, masses=1, levels=(1.0, 1.5), seconds=6.0)
    before = [trial.outputs.copy() for trial in trials]
    answered(rig, trials, options=QUICK)
    for trial, outputs in zip(trials, before, strict=True):
        np.testing.assert_array_equal(trial.outputs, outputs)


@pytest.mark.slow
def test_a_clock_that_turns_the_phase_many_times_is_found(campaign, wrong):
    skew = 8e-3

    def fast(series):
        return at_instants(series, np.arange(len(series)) * (1 + skew))

    rig, trials = campaign(
        15, wrong(sensor=0, fault=fast), masses=1, levels=(1.0, 2.0, 1.5), seconds=16.0
    )
    found = answered(rig, trials, options=QUICK)
    assert found.verdict == "sensor_fault"
    assert [named.effect.kind for named in found.effects] == ["sensor_clock"]
    number = found.effects[0].numbers["skew"]
    assert abs(number.value - skew) < max(4 * number.sd, 0.01 * skew)


@pytest.mark.slow
def test_a_constant_that_moved_alone_is_named_where_it_is(campaign, wrong):
    rig, trials = campaign(
        16, wrong(element=1, force=softer), masses=2, levels=(1.0, 2.0, 1.5), seconds=8.0
    )
    found = answered(rig, trials, options=QUICK)
    assert found.verdict == "missing_effect"
    assert [named.effect.kind for named in found.effects] == ["stiffness_loss"]
    assert found.effects[0].effect.place == Place("element", "j1")
    number = found.effects[0].numbers["dk_n_per_m"]
    assert abs(number.value - LOSS) < 4 * number.sd


@pytest.mark.slow
@pytest.mark.parametrize("creeps", [0.001, 0.003])
def test_friction_that_creeps_where_it_should_stick_is_still_dry(campaign, wrong, creeps):
    rig, trials = campaign(
        18, wrong(element=0, force=lambda e, v, t: 0.8 * np.tanh(v / creeps)),
        masses=1, levels=(1.0, 2.0, 1.5), seconds=10.0,
    )  # fmt: skip
    found = answered(rig, trials)
    assert [named.effect.kind for named in found.effects] == ["coulomb"]
    assert abs(found.effects[0].numbers["friction_n"].value - 0.8) < 0.05


@pytest.mark.long
def test_nothing_is_missing_in_another_simulation_without_noise(campaign):
    rig, trials = campaign(19, stiffness_sd=1e-9, snr_db=300.0, levels=(1.0, 2.0, 1.5))
    found = answered(rig, trials, options=QUICK)
    assert found.verdict == "nothing_missing"


@pytest.mark.slow
def test_smoothed_friction_is_named_in_another_simulation_without_noise(campaign, wrong):
    rig, trials = campaign(
        20, wrong(element=1, force=lambda e, v, t: 0.4 * np.tanh(v / 1e-3)),
        mode="accelerations", stiffness_sd=1e-9, snr_db=300.0, levels=(1.0, 2.0, 1.5),
        seconds=20.0,
    )  # fmt: skip
    found = answered(rig, trials)
    (named,) = found.effects
    assert named.effect.kind in ("coulomb", "friction_with_creep")
    assert named.effect.place == Place("element", "j1")
    assert abs(named.numbers["friction_n"].value - 0.4) < 0.01


@pytest.mark.long
def test_a_shaken_mass_cannot_tell_a_softer_spring_from_a_heavier_mass(campaign, wrong):
    rig, trials = campaign(
        17,
        wrong(element=0, force=lambda e, v, t: 0.15 * softer(e, v, t)),
        masses=1,
        drive="base",
        levels=(1.0, 2.0, 1.5),
        seconds=12.0,
    )
    found = answered(rig, trials, options=QUICK)
    assert found.verdict == "undecided"
    assert {rival.effect for rival in found.undecided} == {"stiffness_loss", "added_mass"}
    assert found.experiment is not None
    assert found.experiment.add_inputs
