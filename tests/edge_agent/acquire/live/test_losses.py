"""Every loss is counted exactly where there is a counter or a stamp, whatever else happens.

Where a narrow counter and the times of arrival leave more than one answer, the least is counted
and the rest told apart.
"""

import numpy as np
import pytest

from edge_agent.acquire.live.batch import Batch
from edge_agent.acquire.live.counts import SampleCounts
from edge_agent.acquire.live.indexing.assembly import Assembler
from edge_agent.acquire.live.indexing.counters import ByCounter
from edge_agent.acquire.live.indexing.positions import ByArrival, ByStamp
from edge_agent.layouts import CounterField, Stamp

from .devices import START_NS, device

RATE_HZ = 100.0
HORIZON = 25


def assembled(sent, positions, tally):
    """Runs that come out of the messages of a device."""
    assembler, runs = Assembler(((0, 1),), 50, HORIZON, tally), []

    def put(placements):
        for index, batch, restarts in placements:
            if restarts:
                runs.extend(assembler.take(all_of_it=True))
                assembler.restart(index)
            assembler.put(index, batch.rows)

    for arrival_ns, counter, stamp, rows in sent.messages:
        put(positions.place(Batch(rows, arrival_ns, counter, stamp)))
        runs.extend(assembler.take())
    put(positions.finish())
    return [*runs, *assembler.take(all_of_it=True)]


def positions_of(kind, tally):
    if kind == "stamp":
        return ByStamp(Stamp(), RATE_HZ, HORIZON, tally)
    return ByCounter(CounterField(bits=int(kind)), RATE_HZ, HORIZON, tally)


def hold_to_account(kind, seed, samples, *, stalls=0):
    """One seeded run; what is counted is what has happened. Whether it was decidable."""
    rng, tally = np.random.default_rng(seed), SampleCounts()
    per_message = (1, 1, 5, 20)[seed % 4]
    begins = rng.integers(samples // 10, samples - 600, stalls) // per_message
    sent = device(
        rng,
        samples=samples,
        bits=64 if kind == "stamp" else int(kind),
        per_message=per_message,
        bursts=3,
        restart_at=0.5 if seed % 3 else None,
        off_s=float(rng.uniform(2.0, 6.0)),
        error=float(rng.uniform(-0.01, 0.01)),
        duplicates=0.001,
        reorder=0.001,
        pauses=[(int(begin), float(rng.uniform(1.0, 5.0))) for begin in begins],
    )
    runs = assembled(sent, positions_of(kind, tally), tally)
    unsure = tally["samples_lost_unsure"]
    if unsure:
        assert tally["samples_lost"] <= sent.lost <= tally["samples_lost"] + unsure
        return False
    counted = {name: tally[name] for name in ("samples_lost", "sensor_restarts")}
    assert counted == {"samples_lost": sent.lost, "sensor_restarts": sent.restarts}
    assert tally["samples_duplicated"] == sent.duplicated
    assert tally["samples_late"] == tally["samples_refused"] == 0
    rows = np.concatenate([run.rows[:, 0] for run in runs])
    assert len(rows) == tally["samples_received"] - sent.duplicated
    # Within a boot, an index says which sample it is: the device numbers its own.
    shifts = {int(run.rows[0, 0]) - run.first_index for run in runs}
    assert len(shifts) == 1 + sent.restarts
    for run in runs:
        assert (np.diff(run.rows[:, 0]) == 1).all()
    return True


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["8", "16", "32", "stamp"])
def test_every_loss_is_counted_over_wraps_bursts_and_restarts(kind, seed):
    assert hold_to_account(kind, seed, 3_000) or kind == "8"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 180))
@pytest.mark.parametrize("kind", ["8", "16", "32", "stamp"])
def test_every_loss_is_counted_in_hundreds_of_runs(kind, seed):
    assert hold_to_account(kind, seed, 20_000) or kind == "8"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["8", "16", "stamp"])
def test_stalls_of_seconds_are_no_losses_and_hide_none(kind):
    decided = [hold_to_account(kind, seed, 6_000, stalls=2) for seed in range(1000, 1080)]
    # A restart looks like a loss to an 8-bit counter where its time fits by chance.
    assert np.mean(decided) > (0.75 if kind == "8" else 0.999)


def arrivals(numbers, counters, times):
    """Single samples that come at times in sample periods."""
    rows = [np.full((1, 2), float(number)) for number in numbers]
    came = zip(times, counters, rows, strict=True)
    return [(START_NS + round(t * 1e7), counter % 256, 0, row) for t, counter, row in came]


def counted_of(messages):
    """What is counted of messages with a counter of 8 bits."""
    sent, tally = device(np.random.default_rng(1), samples=10), SampleCounts()
    sent.messages = messages
    assembled(sent, positions_of("8", tally), tally)
    names = ("samples_lost", "samples_lost_unsure", "sensor_restarts")
    return tuple(tally[name] for name in names)


def test_a_loss_of_as_many_samples_as_the_counter_is_wide_is_counted():
    numbers = [*range(400), *range(656, 1_000)]
    assert counted_of(arrivals(numbers, numbers, numbers)) == (256, 0, 0)


def test_wraps_of_a_minute_are_told_by_a_rate_that_was_learnt_for_a_minute():
    numbers = [*range(6_000), *range(12_000, 12_500)]
    assert counted_of(arrivals(numbers, numbers, numbers)) == (6_000, 0, 0)


def test_a_gap_longer_than_the_rate_is_known_for_is_told_as_unsure():
    numbers = [*range(500), *range(6_500, 7_000)]
    least, unsure, restarts = counted_of(arrivals(numbers, numbers, numbers))
    assert (least + unsure, restarts) == (6_000, 0)
    assert unsure > 0


def test_a_stall_as_long_as_the_counter_is_wide_is_no_loss():
    times = [*range(400), *[656] * 256, *range(656, 1_000)]
    assert counted_of(arrivals(range(1_000), range(1_000), times)) == (0, 0, 0)


def test_a_loss_within_a_stall_is_counted():
    numbers = [n for n in range(1_000) if not 500 <= n < 540]
    times = [656 if 400 <= n < 656 else n for n in numbers]
    assert counted_of(arrivals(numbers, numbers, times)) == (40, 0, 0)


def test_a_restart_that_a_loss_would_explain_as_well_is_told_as_unsure():
    counters = [*range(400), *range(200)]
    times = [*range(400), *range(512, 712)]
    assert counted_of(arrivals(range(600), counters, times)) == (0, 112, 1)


def test_a_restart_that_no_loss_explains_is_sure():
    counters = [*range(400), *range(200)]
    times = [*range(400), *range(600, 800)]
    assert counted_of(arrivals(range(600), counters, times)) == (0, 0, 1)


def test_a_counter_that_is_wrong_once_costs_its_own_samples_only():
    sent, tally = device(np.random.default_rng(1), samples=500, loss=0.0), SampleCounts()
    arrival_ns, _, stamp, rows = sent.messages[200]
    sent.messages[200] = arrival_ns, 10**9, stamp, rows
    runs = assembled(sent, positions_of("64", tally), tally)
    assert (tally["samples_refused"], tally["sensor_restarts"]) == (1, 0)
    assert next(run.first_index for run in runs if run.first_index > 150) == 201
    assert tally["samples_lost"] == 1


def test_without_a_counter_a_pause_that_is_not_made_up_for_is_a_loss():
    messages = [
        (START_NS + n * 50_000_000 + 40_000_000, None, None, np.zeros((5, 2)))
        for n in [*range(200), *range(260, 400)]
    ]
    sent, tally = device(np.random.default_rng(1), samples=10), SampleCounts()
    sent.messages = messages
    assembled(sent, ByArrival(RATE_HZ, tally), tally)
    assert tally["samples_lost_inferred"] == pytest.approx(300, abs=5)
    assert tally["samples_lost"] == tally["samples_lost_inferred"]


def test_without_a_counter_a_burst_after_a_pause_is_no_loss():
    held_back = [13_000 + n // 2 for n in range(61)]
    times = [*range(0, 10_000, 50), *held_back, *range(13_050, 20_000, 50)]
    messages = [(START_NS + t * 1_000_000, None, None, np.zeros((5, 2))) for t in times]
    sent, tally = device(np.random.default_rng(1), samples=10), SampleCounts()
    sent.messages = messages
    assembled(sent, ByArrival(RATE_HZ, tally), tally)
    assert tally["samples_lost"] == 0


def test_channels_on_topics_of_their_own_meet_in_one_row():
    tally = SampleCounts()
    assembler = Assembler(((0,), (1,)), 4, 4, tally)
    for n in range(8):
        assembler.put(n, [[float(n)]], 0)
        if n != 2:
            assembler.put(n, [[10.0 * n]], 1)
    rows = np.concatenate([run.rows for run in assembler.take(all_of_it=True)])
    assert rows[:, 0].tolist() == list(range(8))
    assert np.isnan(rows[2, 1])
    assert rows[3].tolist() == [3.0, 30.0]
