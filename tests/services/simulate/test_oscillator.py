"""A structure in software only: its truth is right, its epochs independent of each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from slowtime_services.simulate import (
    FatigueLoss,
    FillingAndEmptying,
    Linear,
    SensorErrors,
    SimulatedStructure,
    StepLoss,
    Temperature,
    Unchanged,
)

SPOILT = SensorErrors(spikes_per_epoch=3.0, dropouts_per_epoch=2.0)


def same(one, other):
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.samples, b.samples)
        assert (a.first_index, a.start_ns, a.epoch) == (b.first_index, b.start_ns, b.epoch)
        assert (a.covariates, a.truth) == (b.covariates, b.truth)


def signal(structure, epoch=0):
    return np.concatenate([block.samples[:, 0] for block in structure.epoch(epoch)]).astype(
        float
    )


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10**9),
    epoch=st.integers(0, 50),
    excitation=st.sampled_from(["ambient", "hammer"]),
)
def test_an_epoch_is_the_same_however_many_came_before_it(seed, epoch, excitation):
    made = {"seed": seed, "excitation": excitation, "sensor": SPOILT, "seconds": 5.0}
    structure = SimulatedStructure(**made, epochs=epoch + 1)
    asked = structure.epoch(epoch)
    same(asked, SimulatedStructure(**made, epochs=None).epoch(epoch))
    same(asked, [block for block in structure.blocks() if block.epoch == epoch])
    same(asked, list(structure.blocks(first_epoch=epoch)))


def test_another_seed_or_epoch_is_another_record():
    structure = SimulatedStructure(seconds=5.0)
    other = SimulatedStructure(seconds=5.0, seed=1)
    first = signal(structure)
    assert np.abs(np.corrcoef(first, signal(structure, 1))[0, 1]) < 0.5
    assert np.abs(np.corrcoef(first, signal(other))[0, 1]) < 0.5


@pytest.mark.parametrize(
    ("evolution", "slow_time", "change"),
    [
        (Unchanged(change=0.1), 5.0, 0.1),
        (Linear(rate=-1e-3, limit=-0.2), 100.0, -0.1),
        (Linear(rate=-1e-3, limit=-0.2), 900.0, -0.2),
        (Linear(rate=1e-3, limit=0.2), 900.0, 0.2),
        (Linear(rate=-1e-3, begins=50.0), 49.0, 0.0),
        (Linear(rate=-1e-3, begins=50.0), 150.0, -0.1),
        (StepLoss(at_slow_time=10.0, change=-0.3), 9.9, 0.0),
        (StepLoss(at_slow_time=10.0, change=-0.3), 10.0, -0.3),
        (FatigueLoss(), 1000.0, -0.3486),
        (FatigueLoss(renewed_after=1500.0), 2500.0, -0.3486),
        (FatigueLoss(renewed_after=1000.0), 2000.0, 0.0),
        (FillingAndEmptying(), 0.0, 0.0),
    ],
)
def test_evolutions_say_what_they_promise(evolution, slow_time, change):
    assert evolution.at(slow_time) == pytest.approx(change, abs=1e-4)


def test_truth_follows_from_stiffness_and_mass_with_the_damping_coefficient_as_built():
    structure = SimulatedStructure(
        frequency_hz=5.0,
        damping_ratio=0.03,
        stiffness=Unchanged(change=-0.19),
        mass=Unchanged(change=0.21),
    )
    truth = structure.truth(7)
    assert truth["frequency_hz"] == pytest.approx(5.0 * 0.9 / 1.1, rel=1e-12)
    assert truth["damping_ratio"] == pytest.approx(0.03 / (0.9 * 1.1), rel=1e-12)
    assert (truth["stiffness_change"], truth["mass_change"]) == (-0.19, 0.21)


def test_the_record_rings_at_the_true_frequency_and_decays_at_the_true_rate():
    structure = SimulatedStructure(
        frequency_hz=4.0,
        damping_ratio=0.02,
        stiffness=Unchanged(change=0.44),
        excitation="hammer",
        seconds=10.0,
        rate_hz=200.0,
        sensor=SensorErrors(noise=0.0, dtype="<f8"),
    )
    truth = structure.truth(0)
    # Samples of one decaying oscillation obey x[k+2] = (p + p*) x[k+1] - |p|^2 x[k].
    x = signal(structure)
    rows = np.column_stack([x[1:-1], x[:-2]])
    two_real, minus_square = np.linalg.lstsq(rows, x[2:], rcond=None)[0]
    pole = np.log(np.roots([1.0, -two_real, -minus_square])[0]) * 200.0
    assert abs(pole) / (2 * np.pi) == pytest.approx(truth["frequency_hz"], rel=1e-9)
    assert -pole.real / abs(pole) == pytest.approx(truth["damping_ratio"], rel=1e-7)
    assert np.abs(x).max() == pytest.approx(0.1, rel=0.6)


def test_ambient_response_has_the_strength_asked_for_and_starts_as_it_goes_on():
    structure = SimulatedStructure(
        frequency_hz=5.0, seconds=60.0, acceleration_rms=0.25, sensor=SensorErrors(noise=0.0)
    )
    records = np.stack([signal(structure, epoch) for epoch in range(30)])
    # The resonant part asked for, and the force itself within half the sampling rate.
    expected = 0.25 * np.sqrt(1 + 8 * 0.02 / (2 * np.pi * 5.0) * 50.0)
    assert records.std() == pytest.approx(expected, rel=0.06)
    assert records[:, :500].std() == pytest.approx(records[:, -500:].std(), rel=0.15)


def test_the_sensor_adds_its_noise_spikes_and_dropouts():
    quiet = {"seconds": 60.0, "rate_hz": 100.0, "seed": 3}
    clean = signal(SimulatedStructure(**quiet, sensor=SensorErrors(noise=0.0, dtype="<f8")))
    noisy = signal(SimulatedStructure(**quiet, sensor=SensorErrors(noise=0.1, dtype="<f8")))
    assert (noisy - clean).std() == pytest.approx(0.01, rel=0.05)
    spiked = SimulatedStructure(**quiet, sensor=SensorErrors(noise=0.0, spikes_per_epoch=4.0))
    counts = [
        int((np.abs(signal(spiked, n) - signal(SimulatedStructure(**quiet), n)) > 0.5).sum())
        for n in range(25)
    ]
    assert 2.5 < np.mean(counts) < 5.5
    dropping = SimulatedStructure(**quiet, sensor=SensorErrors(dropouts_per_epoch=3.0))
    lost = [6000 - sum(len(b.samples) for b in dropping.epoch(n)) for n in range(25)]
    assert 10 < np.mean(lost) < 20
    for before, block in zip(*(lambda b: (b, b[1:]))(dropping.epoch(1)), strict=False):
        assert block.first_index > before.next_index
        assert (
            block.start_ns == before.start_ns + (block.first_index - before.first_index) * 10**7
        )


def test_temperature_travels_as_a_covariate_and_moves_the_frequency():
    swing = Temperature(mean_c=10.0, swing_c=20.0, period=4.0, stiffness_per_c=-0.005)
    structure = SimulatedStructure(seconds=5.0, temperature=swing)
    (warm,), (cold,) = structure.epoch(1), structure.epoch(3)
    assert warm.covariates == {"temperature_c": pytest.approx(30.0)}
    assert cold.covariates == {"temperature_c": pytest.approx(-10.0)}
    assert warm.truth["stiffness_change"] == pytest.approx(-0.1)
    assert cold.truth["frequency_hz"] > 5.0 > warm.truth["frequency_hz"]


def test_below_freezing_a_structure_may_stiffen_faster():
    frozen = Temperature(
        mean_c=10.0, swing_c=20.0, period=4.0, stiffness_per_c=-0.001,
        stiffness_per_c_below=-0.004, freezing_c=-2.0,
    )  # fmt: skip
    structure = SimulatedStructure(seconds=5.0, temperature=frozen)
    assert structure.truth(1)["stiffness_change"] == pytest.approx(-0.02)
    assert structure.truth(3)["stiffness_change"] == pytest.approx(0.012 + 8 * 0.004)


def test_the_truth_tells_what_lasts_from_what_the_weather_does():
    swing = Temperature(swing_c=20.0, period=4.0, stiffness_per_c=-0.005)
    loss = {"kind": "constant", "change": -0.1}
    truth = SimulatedStructure(temperature=swing, stiffness=loss).truth(1)
    assert truth["lasting.stiffness_change"] == -0.1
    assert truth["stiffness_change"] == pytest.approx(0.9 * 0.9 - 1)
    assert "lasting.stiffness_change" not in SimulatedStructure(stiffness=loss).truth(1)


def test_each_day_has_weather_of_its_own_and_the_same_one_whenever_it_is_asked_for():
    weather = Temperature(daily_c=3.0)
    structure = SimulatedStructure(seconds=5.0, temperature=weather)
    days = [structure.temperature_at(i) for i in range(300)]
    assert np.std(np.array(days, dtype=float)) == pytest.approx(3.0, rel=0.15)
    assert (
        structure.temperature_at(7)
        == days[7]
        == structure.epoch(7)[0].covariates["temperature_c"]
    )


def test_blocks_are_cut_where_asked_and_dated_by_the_simulators_own_clock():
    structure = SimulatedStructure(seconds=10.0, block_s=3.0, interval_s=60.0, start_ns=10**18)
    blocks = structure.epoch(2)
    assert [len(block.samples) for block in blocks] == [300, 300, 300, 100]
    assert [block.first_index for block in blocks] == [2000, 2300, 2600, 2900]
    assert blocks[1].start_ns == 10**18 + 123 * 10**9
    assert {block.slow_time for block in blocks} == {2.0}


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"frequency_hz": 45.0}, "not below 0.4 of rate_hz=100.0. Sample faster"),
        ({"seconds": 0.1}, "has 10 samples; at least 16 are needed"),
        ({"interval_s": 10.0}, "records would overlap"),
        ({"damping_ratio": 2.0}, "less than 1"),
        ({"mass": {"kind": "sawtooth"}}, "does not match any of the expected tags"),
        ({"colour": "red"}, "Extra inputs are not permitted"),
    ],
)
def test_a_structure_that_cannot_be_says_why(wrong, says):
    with pytest.raises(ValidationError, match=says):
        SimulatedStructure(**wrong)
