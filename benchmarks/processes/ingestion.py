"""What the server pays for a message, from one asset and from a thousand, beside its floor.

`python -m benchmarks.processes.ingestion` takes about a minute. Processor time of the process
alone, from received bytes to durable rows; the wait for the disk is not in it. The floor, in
the same run, receives by bare Zenoh and appends to one table of SQLite: nothing is decoded.
"""

import itertools
import sqlite3
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from slowtime_schemas.codec import decode, encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import Sample
from twin_server.__main__ import collect_less_often
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

from . import throughput
from .transport import running_router

FLEETS = (1, 100, 1_000)
BATCH = 1_000
"""Messages of a batch: of a thousand assets, one each."""
BATCHES = 16
"""Batches that are timed; two buckets of eight states fill for each of a thousand assets."""
LEARNT = 24
"""Messages of each asset before: the nominal is learnt from the first twenty."""


def samples(assets: int, first: int, count: int) -> list[Sample]:
    """Messages of all assets in turn."""
    found = []
    for place in range(first, first + count):
        asset = f"a{place % assets}"
        payload = encode(throughput.message(asset, place // assets))
        found.append(Sample(FEATURES.key("load", asset), payload, None, False))
    return found


def ingested_us(assets: int, folder: Path) -> float:
    """Median processor time of a message through the pipeline [us]."""
    path = folder / f"{assets}.sqlite"
    store = SqliteStore(path)
    pipeline = Pipeline(TwinSettings(database=path), store)
    known = LEARNT * assets
    for first in range(0, known, BATCH):
        pipeline.ingest(samples(assets, first, min(BATCH, known - first)))
    batches = [samples(assets, known + n * BATCH, BATCH) for n in range(BATCHES)]
    batch = iter(batches)
    took = median_us(lambda: pipeline.ingest(next(batch)))
    assert pipeline.counts["accepted"] == known + BATCHES * BATCH
    store.close()
    return took


def appended_us(folder: Path) -> float:
    """Median processor time of a row that is appended to a table [us]."""
    base = sqlite3.connect(folder / "floor.sqlite", isolation_level=None)
    base.execute("pragma journal_mode=wal")
    base.execute("pragma synchronous=full")
    base.execute("create table features (id integer primary key, message blob, state blob)")
    number = itertools.count()
    rows = [sample.payload for sample in samples(1, 0, BATCH)]

    def append() -> None:
        base.execute("begin")
        base.executemany(
            "insert into features values (?,?,?)",
            [(next(number), row, bytes(180)) for row in rows],
        )
        base.execute("commit")

    took = median_us(append)
    base.close()
    return took


def received_us(endpoint: str) -> float:
    """Processor time of a message in an empty callback of bare Zenoh [us]."""
    began_s = time.process_time()
    throughput.bare_zenoh(endpoint)
    return 1e6 * (time.process_time() - began_s) / throughput.COUNT


def decoded_us() -> float:
    """Median processor time of a message that is decoded strictly [us]."""
    payloads = [sample.payload for sample in samples(1, 0, BATCH)]

    def read() -> None:
        for payload in payloads:
            decode(FEATURES, payload)

    return median_us(read)


def median_us(work: Callable[[], object]) -> float:
    """Median processor time of one message of a batch [us]."""
    took = []
    for _ in range(BATCHES):
        began_s = time.process_time()
        work()
        took.append(time.process_time() - began_s)
    return 1e6 * statistics.median(took) / BATCH


def main() -> None:
    """Print processor time of a message, and its ratio to the floor."""
    collect_less_often()
    with running_router() as endpoint:
        received = received_us(endpoint)
    with tempfile.TemporaryDirectory() as folder:
        appended = appended_us(Path(folder))
        floor = received + appended
        print(
            f"floor: {floor:.1f} us a message = Zenoh {received:.1f} + append {appended:.1f}; "
            f"strict decoding alone {decoded_us():.1f}"
        )
        for assets in FLEETS:
            took = ingested_us(assets, Path(folder))
            print(
                f"{assets:,} assets: {took:.1f} us a message, {took / floor:.1f} of the floor"
            )


if __name__ == "__main__":
    main()
