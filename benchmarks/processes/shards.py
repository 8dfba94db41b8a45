"""What shards give and cost, as ratios to one server measured in the same run.

`python -m benchmarks.processes.shards` takes some minutes, with `--repeats` more or less. Each
shard is a process that takes the features of its assets into a SQLite file. Printed are the
rate of two shards over that of one, from memory; the same from the processor time of the shard
that needs most, which is the rate on cores that do nothing else; and the processor time per
feature of two shards over that of one, from the bus. Publisher and router are processes of
their own.
"""

import argparse
import contextlib
import multiprocessing
import resource
import tempfile
import time
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path

from slowtime_schemas.streams import FEATURES, address_of
from slowtime_services.bus import PartialBus, Sample, ZenohBus
from slowtime_services.shards import Share
from twin_server.__main__ import collect_less_often
from twin_server.persist import open_store
from twin_server.pipeline import Pipeline
from twin_server.settings import ShardSettings, TwinSettings

from .throughput import COUNT, KNOWN, TIMED, payloads, publish
from .transport import free_port

_SPAWN = multiprocessing.get_context("spawn")


def _settings(share: Share | None, folder: Path) -> TwinSettings:
    shards = ShardSettings()
    if share is not None:
        shards = ShardSettings(count=share.count, index=share.index)
    return TwinSettings(database=folder / "twin.sqlite", shards=shards)


def has(share: Share | None, key: str) -> bool:
    """Whether a share, or a single server if None, has the asset of a message's key."""
    address = address_of(key)
    return share is None or (address is not None and share.has(address[1]))


def from_memory(share: Share | None, folder: Path, pipe: Connection) -> None:
    """Take the features of a share from memory into its store, once told to."""
    settings = _settings(share, folder)
    samples = [
        Sample(key, payload, None, True) for key, payload in payloads() if has(share, key)
    ]
    first = len(samples) * KNOWN // COUNT
    with contextlib.closing(open_store(settings.database, share=share)) as store:
        pipeline = Pipeline(settings, store)
        pipeline.start()
        pipeline.ingest(samples[:first])
        collect_less_often()
        pipe.send("ready")
        pipe.recv()
        began_s = _processor_s()
        pipeline.ingest(samples[first:])
        pipe.send((pipeline.counts["accepted"], _processor_s() - began_s))
        pipeline.stop()


def from_bus(share: Share | None, folder: Path, pipe: Connection, endpoint: str) -> None:
    """Take the features of a share from the bus, and tell the processor time of that [s]."""
    settings = _settings(share, folder)
    wanted = sum(has(share, key) for key, _ in payloads())
    with (
        contextlib.closing(open_store(settings.database, share=share)) as store,
        ZenohBus("client", [endpoint]) as bus,
    ):
        part = bus if share is None else PartialBus(bus, share.has)
        pipeline = Pipeline(settings, store, bus=part)
        pipeline.start()
        collect_less_often()
        first = wanted * KNOWN // COUNT
        pipe.send("ready")
        while pipeline.counts["accepted"] < first:
            time.sleep(0.01)
        began_s = _processor_s()
        pipe.send("known")
        while pipeline.counts["accepted"] < wanted:
            time.sleep(0.01)
        pipe.send(_processor_s() - began_s)
        pipeline.stop()


def _processor_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _shares(count: int) -> list[Share | None]:
    return [None] if count == 1 else [Share(index, count) for index in range(count)]


def rates(count: int) -> tuple[float, float]:
    """Features per second that `count` shards take from memory, all together.

    Returns
    -------
    By elapsed time, and by the processor time of the shard that needs most [1/s].
    """
    with tempfile.TemporaryDirectory() as folder:
        started: list[tuple[SpawnProcess, Connection]] = []
        for share in _shares(count):
            here, there = _SPAWN.Pipe()
            process = _SPAWN.Process(target=from_memory, args=(share, Path(folder), there))
            process.start()
            started.append((process, here))
        for _, pipe in started:
            pipe.recv()
        began_s = time.perf_counter()
        for _, pipe in started:
            pipe.send("go")
        answers = [pipe.recv() for _, pipe in started]
        took_s = time.perf_counter() - began_s
        for process, _ in started:
            process.join()
    assert sum(accepted for accepted, _ in answers) == COUNT
    return TIMED / took_s, TIMED / max(used_s for _, used_s in answers)


def processor_time(count: int) -> float:
    """Processor time per feature of `count` shards, from the bus until it is durable [s]."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory() as folder, ZenohBus("router", listen=[endpoint]):
        started: list[tuple[SpawnProcess, Connection]] = []
        for share in _shares(count):
            here, there = _SPAWN.Pipe()
            process = _SPAWN.Process(
                target=from_bus, args=(share, Path(folder), there, endpoint)
            )
            process.start()
            started.append((process, here))
        for _, pipe in started:
            pipe.recv()
        here, there = _SPAWN.Pipe()
        publisher = _SPAWN.Process(target=publish, args=(endpoint, False, there))
        publisher.start()
        time.sleep(3.0)
        here.send("make yourself known")
        for _, pipe in started:
            pipe.recv()
        here.send("go")
        used_s = sum(pipe.recv() for _, pipe in started)
        here.send("end")
        for process, _ in started:
            process.join()
        publisher.join()
    return float(used_s) / TIMED


def main() -> None:
    """Print the ratios, of the best of each so far."""
    parser = argparse.ArgumentParser(description="Print what shards give and cost.")
    parser.add_argument("--repeats", type=int, default=3, help="times that each is measured")
    repeats = parser.parse_args().repeats
    print(f"{TIMED:,} {FEATURES.name} of 100 assets, after {KNOWN:,}; best of {repeats}")
    best: dict[int, tuple[float, float, float]] = {}
    for _ in range(repeats):
        for count in (1, 2):
            by_clock, by_processor = rates(count)
            used_s = processor_time(count)
            print(
                f"    {count} shard(s): {by_clock:,.0f} features/s from memory, "
                f"{by_processor:,.0f}/s by processor time; from the bus {1e6 * used_s:.0f} µs "
                "of processor per feature",
                flush=True,
            )
            before = best.get(count, (0.0, 0.0, used_s))
            best[count] = (
                max(by_clock, before[0]),
                max(by_processor, before[1]),
                min(used_s, before[2]),
            )
    one, two = best[1], best[2]
    print(f"rate of 2 shards over 1: {two[0] / one[0]:.2f} (wanted: 1.5)")
    print(f"the same by processor time: {two[1] / one[1]:.2f}")
    print(f"processor per feature of 2 shards over 1: {two[2] / one[2]:.2f} (at most: 1.2)")


if __name__ == "__main__":
    main()
