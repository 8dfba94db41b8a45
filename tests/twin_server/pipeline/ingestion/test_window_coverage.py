"""A window of time is one measurement, under whatever boot and however often it is sent."""

import contextlib
import json
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from twin_server.estimate import past_of
from twin_server.history.states import MEASURED_BEFORE, covered_share
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.registration.twin import Registration
from twin_server.settings import TwinSettings

ORIGIN_NS = 1_700_000_000_000_000_000
NOMINAL = {"frequency_hz": 4.0, "frequency_relative_sd": 1e-4, "damping_ratio": 0.01}
SD_HZ = 0.004


def window(sequence, begins_s, seconds=30.0, *, boot="b1", frequency_hz=4.0, base="recorded"):
    """Features of the samples from `begins_s` on."""
    begins_ns = ORIGIN_NS + round(begins_s * 1e9)
    mode = Mode(
        frequency_hz=Quantity(value=frequency_hz, sd=SD_HZ),
        damping_ratio=Quantity(value=0.01, sd=0.001),
    )
    return Features(
        site="lab", asset="beam", boot=boot, sequence=sequence,
        start_ns=begins_ns, t_ns=begins_ns + round((seconds - 0.02) * 1e9),
        slow_time=begins_s, time_base=base, method="ambient", modes=(mode,),
        quality=Quality(samples=1500),
    )  # fmt: skip


def record(
    count,
    *,
    boot="b1",
    seconds=30.0,
    hop=None,
    begins_s=0.0,
    seed=1,
    base="recorded",
    loss=2e-4,
):
    """Windows of one record: where they begin at the same time they say the same."""
    hop = hop or seconds
    rng = np.random.default_rng(seed)
    noise = SD_HZ * rng.standard_normal(count)
    return [
        window(
            i, begins_s + i * hop, seconds, boot=boot, base=base,
            frequency_hz=float(4.0 * (1.0 - loss * i) + noise[i]),
        )
        for i in range(count)
    ]  # fmt: skip


@pytest.fixture
def twin(store):
    """A twin without a bus, with a given nominal model."""
    pipeline = Pipeline(TwinSettings(), store)
    pipeline.register("lab.beam", Registration(nominal=NOMINAL))
    return pipeline


def events(store, kind):
    bodies = [json.loads(row.body) for row in store.events("lab.beam")]
    return [body for body in bodies if body["kind"] == kind]


def known(pipeline):
    return pipeline.twin("lab.beam").checkpoint.known


def past(pipeline, store):
    return past_of(store.history("lab.beam").states, known(pipeline))["stiffness_change"]


def information(one):
    """Sum of the weights of all readings."""
    return float(np.sum(one.own_sd**-2.0))


def test_a_record_that_is_sent_again_under_another_boot_leaves_all_as_it_was(
    twin, store, sample
):
    twin.ingest(map(sample, record(50)))
    before, digest = past(twin, store), store.digest("lab.beam")
    twin.ingest(map(sample, record(50, boot="again")))
    assert store.digest("lab.beam") == digest
    assert np.array_equal(past(twin, store).value, before.value)
    assert twin.refusals.counts["measured_before"] == 50
    (event,) = events(store, "measured_before")
    assert (event["boot"], event["severity"]) == ("again", "info")
    assert events(store, "features_lost") == []


def test_what_is_new_behind_a_repeated_part_is_taken_in(twin, store, sample):
    twin.ingest(map(sample, record(20)))
    twin.ingest(map(sample, record(30, boot="again")))
    states = store.history("lab.beam").states
    assert len(states) == 30
    assert np.array_equal(states["slow_time"], np.arange(30) * 30.0)
    assert not states["missing_before"].any()
    assert not states["reasons"].any()


def test_other_numbers_of_the_same_window_are_a_question_and_are_not_used(twin, store, sample):
    twin.ingest(map(sample, record(20)))
    digest = store.digest("lab.beam")
    twin.ingest(map(sample, record(20, boot="again", seed=2)))
    assert store.digest("lab.beam") == digest
    (event,) = events(store, "measured_differently")
    assert event["severity"] == "warning"
    assert "Which are right?" in event["message"]
    assert event["details"]["boots"] == ["again", "b1"]


def test_a_twin_that_is_fed_live_and_by_its_own_recording_counts_each_window_once(
    twin, store, sample
):
    twin.ingest(map(sample, record(20, base="live")))
    twin.ingest(map(sample, record(20, boot="file", base="recorded")))
    assert store.count("lab.beam") == 20


def test_the_clock_of_a_simulator_is_another_than_that_of_the_structure(twin, store, sample):
    twin.ingest(map(sample, record(20, base="live")))
    twin.ingest(map(sample, record(20, boot="model", base="simulated")))
    assert store.count("lab.beam") == 40


def test_windows_of_other_lengths_over_the_same_samples_are_no_further_evidence(
    twin, store, sample
):
    twin.ingest(map(sample, record(40)))
    before = past(twin, store)
    twin.ingest(map(sample, record(20, boot="long", seconds=60.0, seed=3)))
    twin.ingest(map(sample, record(75, boot="short", seconds=16.0, seed=4)))
    states = store.history("lab.beam").states
    assert len(states) == 135
    assert (states["reasons"][40:] & MEASURED_BEFORE).all()
    assert np.array_equal(past(twin, store).own_sd, before.own_sd)
    assert [e["boot"] for e in events(store, "windows_overlap")] == ["long", "short"]


def test_a_window_that_is_half_new_counts_half(twin, store, sample):
    twin.ingest(map(sample, record(20)))
    alone = information(past(twin, store))
    twin.ingest(map(sample, [window(0, 585.0, boot="later")]))
    (covered,) = covered_share(store.history("lab.beam").states[-1:])
    assert covered == pytest.approx(0.5, abs=0.005)
    assert information(past(twin, store)) / alone == pytest.approx(1.0 + 0.5 / 20, abs=2e-3)


@pytest.mark.parametrize("hops", [1, 2, 4])
def test_overlapping_windows_of_one_boot_hold_as_much_as_their_samples(
    twin, store, sample, hops
):
    count = 40 * hops
    twin.ingest(map(sample, record(count, hop=30.0 / hops, loss=0.0)))
    assert information(past(twin, store)) == pytest.approx(40.0 / SD_HZ**2 * 4.0, rel=0.05)


def test_nothing_is_learnt_from_what_was_measured_before(store, sample):
    pipeline = Pipeline(TwinSettings(), store)
    pipeline.register("lab.beam", Registration(learn_epochs=20))
    pipeline.ingest(map(sample, record(15)))
    pipeline.ingest(map(sample, record(30, boot="short", seconds=15.0, seed=5)))
    assert known(pipeline) is None
    pipeline.ingest(map(sample, record(5, boot="new", begins_s=450.0)))
    assert known(pipeline) is not None


def test_estimating_anew_finds_again_what_was_found_when_readings_came(twin, store, sample):
    twin.ingest(map(sample, record(20)))
    twin.ingest(map(sample, record(10, boot="long", seconds=60.0, begins_s=300.0, seed=3)))
    before = store.history("lab.beam").states
    registration = Registration(nominal=NOMINAL, changes="both")
    twin.register("lab.beam", registration)
    twin.register("lab.beam", Registration(nominal=NOMINAL))
    assert store.history("lab.beam").states.tobytes() == before.tobytes()


@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_cuts_and_restarts_change_nothing(tmp_path, sample, data):
    boots = [
        record(12, hop=20.0),
        record(9, boot="b2", begins_s=100.0, hop=20.0, seed=2),
        record(10, boot="b3", seconds=60.0, begins_s=130.0, seed=3),
        record(12, boot="b4", hop=20.0),
    ]
    arriving = [message for boot in boots for message in boot]

    def run(cuts):
        path = tmp_path / f"{time.monotonic_ns()}.sqlite"
        with contextlib.closing(SqliteStore(path)) as store:
            begin = 0
            for cut in [*sorted(cuts), len(arriving)]:
                pipeline = Pipeline(TwinSettings(), store)  # as after a SIGKILL
                pipeline.ingest(map(sample, arriving[begin:cut]))
                begin = cut
            pipeline.give_up()
            kinds = ("measured_before", "windows_overlap")
            said = [e["boot"] for kind in kinds for e in events(store, kind)]
            return store.digest("lab.beam"), store.history("lab.beam").states.tobytes(), said

    cuts = data.draw(st.sets(st.integers(1, len(arriving) - 1), max_size=5))
    assert run(cuts) == run(())


def test_the_way_of_readings_whose_time_goes_on_asks_the_store_nothing(
    twin, store, sample, monkeypatch
):
    twin.ingest(map(sample, record(10)))
    asked = []
    for name in ("boots", "neighbours"):
        monkeypatch.setattr(store, name, lambda *a, name=name: asked.append(name))
    twin.ingest(map(sample, record(10, boot="b2", begins_s=300.0)))
    assert asked == []


def test_a_window_of_all_times_costs_a_bounded_number_of_questions(
    twin, store, sample, monkeypatch
):
    for number in range(40):
        twin.ingest(map(sample, record(3, boot=f"b{number}", begins_s=1_000.0 * number)))
    asked, neighbours = [], store.neighbours

    def counted(*where):
        asked.append(where)
        return neighbours(*where)

    monkeypatch.setattr(store, "neighbours", counted)
    twin.ingest(map(sample, [window(0, 0.0, 100_000.0, boot="all")]))
    assert 0 < len(asked) <= 2 * 16
