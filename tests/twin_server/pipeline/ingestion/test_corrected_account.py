"""A database that holds what an earlier server was made to believe."""

import contextlib
import json
import logging

import pytest

from slowtime_schemas.codec import encode
from slowtime_services.bus import MemoryBus
from twin_server.persist import RunRow, WriteBatch, open_store
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

FAR = 2**40 - 1


@pytest.fixture
def poisoned(database, ageing, sample, settings):
    """Three readings, an end that nobody made, and a boot that waits for a trillion."""
    name = database()
    with contextlib.closing(open_store(name)) as store:
        pipeline = Pipeline(TwinSettings(), store)
        pipeline.ingest(map(sample, ageing(3)))
        (run,), following = store.runs()
        far = ageing(1, asset="frame")[0].model_copy(update={"sequence": FAR})
        other = RunRow(following, "lab", "frame", "b1", "s", 0, -1, -1, -1, False, "[]")
        store.write(
            WriteBatch(
                runs=[run._replace(told=2**62), other], held=[(following, FAR, encode(far))]
            )
        )
    return name


def test_it_recovers_at_start_says_so_and_goes_on(
    poisoned, edge, ageing, settings, eventually, caplog
):
    with MemoryBus() as bus, contextlib.closing(open_store(poisoned)) as store:
        pipeline = Pipeline(settings, store, bus=bus)
        with caplog.at_level(logging.WARNING):
            pipeline.start()
            beam = edge(MemoryBus(joins=bus))
            for message in ageing(6):
                beam.make(message, send=message.sequence > 2)
            frame = edge(MemoryBus(joins=bus), asset="frame")
            for message in ageing(2, asset="frame"):
                frame.make(message)
            assert eventually(lambda: store.count("lab.beam") == 6)
            assert eventually(lambda: store.count("lab.frame") == 2)
        pipeline.stop()
        beam.close()
        frame.close()
        events = [json.loads(row.body) for row in store.events()]
        corrected = [e for e in events if e["kind"] == "account_corrected"]
        assert [e["details"]["stated"] for e in corrected] == [2**62, FAR]
        assert not [e for e in events if e["kind"] == "features_lost"]
        assert "The account of boot b1 of lab.beam was corrected" in caplog.text
        assert store.held() == []
        assert all(run.told < 100 for run in store.runs()[0])


def test_it_is_corrected_once(poisoned, settings, eventually):
    for _ in range(2):
        with MemoryBus() as bus, contextlib.closing(open_store(poisoned)) as store:
            pipeline = Pipeline(settings, store, bus=bus)
            pipeline.start()
            pipeline.stop()
            kinds = [json.loads(row.body)["kind"] for row in store.events()]
            assert kinds.count("account_corrected") == 2
