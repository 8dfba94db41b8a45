"""What a forecast needs is kept: nobody waits for learning, nothing is read, the same after."""

import threading

import numpy as np
import pytest

from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline, TwinKnowledge
from twin_server.pipeline.analysis.forecast_cache import ForecastCache
from twin_server.registration.twin import Registration
from twin_server.settings import TwinSettings

TWIN = "lab.beam"
BEAM = Registration.model_validate({"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}})


@pytest.fixture
def opened(tmp_path):
    """Open a pipeline over a store, as often as asked."""
    stores = []

    def start(name="twin"):
        store = SqliteStore(tmp_path / f"{name}.sqlite")
        stores.append(store)
        pipeline = Pipeline(TwinSettings(), store)
        pipeline.register(TWIN, BEAM)
        return pipeline, store

    yield start
    for store in stores:
        store.close()


@pytest.fixture
def behind():
    """Start what learns behind the work, and end it."""
    running = []

    def start(*arguments, **more):
        prospects = ForecastCache(*arguments, **more)
        arguments[0].listen(prospects)
        prospects.start()
        running.append(prospects)
        return prospects

    yield start
    for prospects in running:
        prospects.stop()


def asked(prospects, thresholds=()):
    told = prospects.foresee(TWIN, 20.0, 5, thresholds)
    return None if told is None else told.foresight


def same(one, other):
    assert one.since == other.since
    assert one.until == other.until
    for name, band in one.bands.items():
        np.testing.assert_array_equal(band, other.bands[name])


def test_however_readings_arrive_the_forecast_is_the_same_and_so_after_a_restart(
    opened, ageing, sample, tmp_path
):
    messages = [sample(message) for message in ageing(73)]
    found = []
    for name, portion in (("one", 1), ("seven", 7), ("all", 73)):
        pipeline, store = opened(name)
        prospects = ForecastCache(pipeline, store)
        pipeline.listen(prospects)
        for first in range(0, 73, portion):
            pipeline.ingest(messages[first : first + portion])
            if first > 30:
                asked(prospects)
        found.append(asked(prospects))
        assert found[-1].since == 72.0
        again = ForecastCache(Pipeline(TwinSettings(), store), store)
        found.append(asked(again))
    for one in found[1:]:
        same(one, found[0])


def test_nobody_waits_for_learning_but_the_first(opened, ageing, sample, behind, eventually):
    messages = [sample(message) for message in ageing(80)]
    pipeline, store = opened()
    gate, called = threading.Event(), []

    def run(function, *arguments):
        called.append(threading.current_thread().name)
        assert gate.wait(60)
        return function(*arguments)

    prospects = behind(pipeline, store, run=run)
    pipeline.ingest(messages[:60])
    gate.set()
    assert asked(prospects).since == 59.0
    gate.clear()
    pipeline.ingest(messages[60:])
    # Learning anew is due and stands still; the answer is of the last reading all the same.
    assert asked(prospects).since == 79.0
    assert eventually(lambda: len(called) == 2)
    assert called[1] == "forecasts"
    assert asked(prospects).since == 79.0
    gate.set()
    assert eventually(lambda: prospects.due == 0)
    same(asked(prospects), asked(ForecastCache(pipeline, store)))


def test_many_who_ask_at_first_share_one_learning(opened, ageing, sample):
    pipeline, store = opened()
    pipeline.ingest(sample(message) for message in ageing(40))
    learnt: list[None] = []
    begun = threading.Barrier(6, timeout=60)

    def run(function, *arguments):
        learnt.append(None)
        return function(*arguments)

    prospects, found = ForecastCache(pipeline, store, run=run), []

    def ask():
        begun.wait()
        found.append(asked(prospects))

    threads = [threading.Thread(target=ask) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert len(learnt) == 1
    assert len(found) == 6
    for one in found[1:]:
        same(one, found[0])


def test_what_is_kept_is_asked_without_reading_the_history(opened, ageing, sample, monkeypatch):
    messages = [sample(message) for message in ageing(74)]
    pipeline, store = opened()
    prospects = ForecastCache(pipeline, store)
    pipeline.listen(prospects)
    pipeline.ingest(messages[:55])
    assert asked(prospects).since == 54.0

    def refuse(*_, **__):
        raise AssertionError

    monkeypatch.setattr(store, "history", refuse)
    monkeypatch.setattr(store, "events", refuse)
    for first in range(55, 74):
        pipeline.ingest(messages[first : first + 1])
        assert asked(prospects).since == float(first)


def test_readings_of_an_older_boot_are_put_in_their_place(opened, features, sample):
    def of(boot, numbers, first):
        return [
            sample(features(n, boot=boot, frequency_hz=3.0 - 1e-3 * n, slow_time=first + n))
            for n in numbers
        ]

    pipeline, store = opened()
    prospects = ForecastCache(pipeline, store)
    pipeline.listen(prospects)
    pipeline.ingest(of("b1", range(30), 0.0))
    pipeline.ingest(of("b2", range(12), 100.0))
    assert asked(prospects).since == 111.0
    pipeline.ingest(of("b1", range(30, 36), 0.0))
    pipeline.ingest(of("b2", range(12, 15), 100.0))
    late = asked(prospects)
    assert late.since == 114.0
    same(late, asked(ForecastCache(pipeline, store)))


def test_a_twin_registered_anew_is_forecast_anew(opened, ageing, sample):
    pipeline, store = opened()
    knowledge = TwinKnowledge(pipeline, store)
    pipeline.ingest(sample(message) for message in ageing(40))
    before = knowledge.outlook(TWIN, 10.0, 3)
    softer = {"nominal": {"frequency_hz": 2.9, "damping_ratio": 0.02}}
    pipeline.register(TWIN, Registration.model_validate(softer))
    after = knowledge.outlook(TWIN, 10.0, 3)
    name = "stiffness_change"
    assert before is not None
    assert after is not None
    assert after.bands[name][0, 0] > before.bands[name][0, 0] + 0.05
    pipeline.delete(TWIN)
    assert knowledge.outlook(TWIN, 10.0, 3) is None


def test_a_past_instant_is_learnt_from_so_many_readings_at_most(
    opened, ageing, sample, monkeypatch
):
    pipeline, store = opened()
    pipeline.ingest(sample(message) for message in ageing(60))
    read = []
    whole = store.history

    def history(*arguments, **more):
        read.append(more["limit"])
        return whole(*arguments, **more)

    monkeypatch.setattr(store, "history", history)
    prospects = ForecastCache(pipeline, store)
    found = prospects.at(TWIN, None, 44.5)
    assert found is not None
    prospect, unit = found
    assert prospect.since == 44.0
    assert unit == "s"
    assert read == [1_000]
    assert prospects.at(TWIN, None, -1.0) is None
