"""Samples that are not there cost the information that they would have held, and no more."""

import dataclasses

import numpy as np
import pytest

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification.options import IdentifyOptions
from slowtime_services.files import Gap, Record
from slowtime_services.modal.identification import identify_record
from slowtime_services.modal.losses import LOUD, completed

RATE = 20.0
NATURAL_HZ, DAMPING = (1.5, 4.2), 0.01


def heard(seed, seconds=900.0):
    rng, count = np.random.default_rng(seed), round(seconds * RATE)
    samples = 0.1 * rng.standard_normal((count, 3))
    for hz, shape in zip(NATURAL_HZ, ([1.0, 0.8, 0.3], [0.7, -0.5, -0.9]), strict=True):
        ringing = ambient_acceleration(Oscillator.from_modal(hz, DAMPING), count, RATE, rng)
        samples = samples + np.outer(ringing / ringing.std(), shape)
    return samples


def record_of(samples, present=None):
    present = np.ones(len(samples), dtype=bool) if present is None else present
    rows = np.flatnonzero(present)
    jumps = np.diff(rows) - 1
    gaps = tuple(Gap(int(k) + 1, int(jumps[k])) for k in np.flatnonzero(jumps))
    names = tuple("abcdefgh"[: samples.shape[1]])
    units = ("m/s2",) * len(names)
    return Record(
        samples=samples[present], rate_hz=RATE, channels=names, units=units, gaps=gaps
    )


def losses(count, share, rng, shortest=1, longest=40):
    present = np.ones(count, dtype=bool)
    while (~present).mean() < share:
        first = rng.integers(1, count - longest - 1)
        present[first : first + rng.integers(shortest, longest + 1)] = False
    return present


def modes_of(record, gaps="use", method="modes"):
    found = identify_record(record, IdentifyOptions(method=method, gaps=gaps))
    assert not found.record.gaps
    return found.single.modes if found.whole is None else found.whole.modes


@pytest.mark.parametrize(("share", "shortest"), [(0.06, 10), (0.2, 1)])
def test_losses_move_modes_by_less_than_they_say_and_cost_their_share(share, shortest):
    samples = heard(1)
    present = losses(len(samples), share, np.random.default_rng(2), shortest)
    complete = modes_of(record_of(samples))
    lossy = modes_of(record_of(samples, present))
    assert len(lossy) == len(complete) == 2
    costs = []
    for one, other in zip(complete, lossy, strict=True):
        for name in ("frequency_hz", "damping_ratio"):
            before, after = getattr(one, name), getattr(other, name)
            assert abs(after.value - before.value) < before.sd
            costs.append((after.sd / before.sd) ** 2)
    # One error in twenty is widened by chance, where narrow windows contradict wide ones.
    assert 1.0 - 0.5 * share < np.median(costs) < 1.0 + 4.0 * share, costs


@pytest.mark.parametrize("method", ["ambient", "efdd"])
def test_other_methods_use_all_samples_too(method):
    samples = heard(3)
    present = losses(len(samples), 0.06, np.random.default_rng(4), 10)
    complete = modes_of(record_of(samples), method=method)
    lossy = modes_of(record_of(samples, present), method=method)
    for one, other in zip(complete, lossy, strict=True):
        hz = one.frequency_hz
        assert abs(other.frequency_hz.value - hz.value) < hz.sd


def test_a_decay_is_predicted_within_its_gaps_and_not_drawn():
    t = np.arange(3000) / RATE
    decay = np.exp(-0.01 * 2 * np.pi * 1.5 * t) * np.cos(2 * np.pi * 1.5 * t)
    samples = decay[:, None] + 1e-4 * np.random.default_rng(5).standard_normal((3000, 1))
    present = losses(len(samples), 0.06, np.random.default_rng(6), 3, 10)
    present[:50] = True
    whole = completed(record_of(samples, present), "use")
    assert "were predicted" in whole.note
    assert np.abs(whole.record.samples[:, 0] - decay).max() < 0.02


def test_every_gap_cuts_and_short_ones_are_filled_where_that_is_asked_for():
    samples = heard(7, 200.0)
    present = np.ones(len(samples), dtype=bool)
    present[1000:1030] = False
    record = record_of(samples, present)
    assert completed(record, "split").record is record
    assert completed(record, "fill").record.gaps == record.gaps
    assert completed(record, "use").inflation(0, 500) == 1.0
    assert completed(record, "use").inflation(1000, 1060) > 1.4


def test_records_that_are_mostly_missing_are_left_with_a_reason():
    samples = heard(8, 200.0)
    present = np.ones(len(samples), dtype=bool)
    present[500:3500] = False
    whole = completed(record_of(samples, present), "use")
    assert whole.record.gaps
    assert "more than 50 % of the record" in whole.note


def test_samples_that_are_missing_where_the_level_is_high_are_told():
    samples = heard(9)
    loud = np.abs(samples[:, 0]) > 3.5
    overflow = ~np.convolve(loud, np.ones(8), "same").astype(bool)
    overflow[[0, -1]] = True
    assert completed(record_of(samples, overflow), "use").flags == (LOUD,)
    by_chance = losses(len(samples), 0.1, np.random.default_rng(10))
    assert completed(record_of(samples, by_chance), "use").flags == ()


def test_the_record_that_was_given_stays_as_it_is():
    samples = heard(11, 200.0)
    present = losses(len(samples), 0.06, np.random.default_rng(12))
    record = record_of(samples, present)
    before = dataclasses.replace(record, samples=record.samples.copy())
    completed(record, "use")
    np.testing.assert_array_equal(record.samples, before.samples)
