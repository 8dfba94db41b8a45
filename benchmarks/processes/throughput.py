"""What the whole flow costs, as ratios to the floor made of its own parts in the same run.

`python -m benchmarks.processes.throughput` takes about a minute. The floor of throughput is
bare Zenoh into an empty callback, the decoding of the same messages, and a batched insert of as
many rows of the same size, one after the other with nothing between them. Publisher and router
are processes of their own, as they are in the field.
"""

import gc
import json
import multiprocessing
import multiprocessing.connection
import resource
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from slowtime.evolution import (
    mass_from_frequency,
    stiffness_and_mass,
    stiffness_from_frequency,
)
from slowtime_schemas.codec import decode, encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import Sample, ZenohBus
from twin_server.__main__ import collect_less_often
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

from .transport import bare_config, free_port, running_router, seconds

ASSETS = 100
EACH, FIRST = 425, 25
COUNT, KNOWN = ASSETS * EACH, ASSETS * FIRST
TIMED = COUNT - KNOWN
ORIGIN_NS = 1_767_225_600_000_000_000


def message(asset: str, sequence: int) -> Features:
    """One epoch's features, as an edge sends them."""
    t_ns = ORIGIN_NS + sequence * 10**9
    return Features(
        site="load",
        asset=asset,
        boot="b1",
        sequence=sequence,
        t_ns=t_ns,
        start_ns=t_ns - 10**9,
        time_base="simulated",
        slow_time=sequence / 7,
        method="ambient",
        modes=(
            Mode(
                frequency_hz=Quantity(value=3.0123456 + sequence / 7e6, sd=0.0021456789),
                damping_ratio=Quantity(value=0.0213456789, sd=0.000912345),
                correlation=-0.0123,
                snr_db=31.72345,
            ),
        ),
        quality=Quality(samples=6000),
    )


def payloads() -> list[tuple[str, bytes]]:
    """Messages of all assets, in turn."""
    return [
        (FEATURES.key("load", f"a{asset}"), encode(message(f"a{asset}", sequence)))
        for sequence in range(EACH)
        for asset in range(ASSETS)
    ]


def publish(endpoint: str, bare: bool, pipe: multiprocessing.connection.Connection) -> None:
    """Publish everything as fast as it goes, once told to; in a process of its own."""
    messages = payloads()
    with zenoh.open(bare_config(endpoint)) as session, ZenohBus("client", [endpoint]) as bus:

        def send(key: str, payload: bytes) -> None:
            if bare:
                session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
            else:
                bus.publish(key, payload, encoding=FEATURES.encoding)

        for part in (messages[:KNOWN], messages[KNOWN:]):
            pipe.recv()
            for key, payload in part:
                send(key, payload)
        pipe.recv()


def published(endpoint: str, bare: bool, arrived: Callable[[], int]) -> float:
    """Time all but the first messages of each asset, of which its nominal is learnt [s]."""
    here, there = multiprocessing.get_context("spawn").Pipe()
    process = multiprocessing.get_context("spawn").Process(
        target=publish, args=(endpoint, bare, there)
    )
    process.start()
    time.sleep(3.0)
    here.send("make yourself known")
    while arrived() < KNOWN:
        time.sleep(0.01)
    began = time.perf_counter()
    here.send("go")
    while arrived() < COUNT:
        time.sleep(0.002)
    took = time.perf_counter() - began
    here.send("end")
    process.join()
    return took


def bare_zenoh(endpoint: str) -> float:
    """Time publisher to empty callback [s]."""
    count = 0

    def receive(_sample: zenoh.Sample) -> None:
        nonlocal count
        count += 1

    with zenoh.open(bare_config(endpoint)) as session:
        subscriber = session.declare_subscriber(FEATURES.everywhere, receive)
        took = published(endpoint, True, lambda: count)
        subscriber.undeclare()  # type: ignore[no-untyped-call]
    return took


def decoding() -> float:
    """Time the decoding of every message [s]."""
    messages = payloads()[KNOWN:]
    began = time.perf_counter()
    for _, payload in messages:
        decode(FEATURES, payload)
    return time.perf_counter() - began


def inserting(folder: Path) -> float:
    """Time as many rows of the same size, in transactions of 2,000 [s]."""
    rows = [
        (number, ORIGIN_NS, 1.0, payload, bytes(180))
        for number, (_, payload) in enumerate(payloads()[KNOWN:])
    ]
    base = sqlite3.connect(folder / "bare.sqlite", isolation_level=None)
    base.execute("pragma journal_mode=wal")
    base.execute("pragma synchronous=normal")
    base.execute(
        "create table features (id integer primary key, t_ns integer, slow_time real, "
        "message blob, state blob)"
    )
    began = time.perf_counter()
    for first in range(0, len(rows), 2000):
        base.execute("begin")
        base.executemany("insert into features values (?,?,?,?,?)", rows[first : first + 2000])
        base.execute("commit")
    took = time.perf_counter() - began
    base.close()
    return took


def whole_flow(endpoint: str, folder: Path) -> float:
    """Time publisher → router → collect → estimate → durable [s]."""
    settings = TwinSettings(database=folder / "flow.sqlite")
    store = SqliteStore(Path(settings.database))
    with ZenohBus("client", [endpoint]) as bus:
        pipeline = Pipeline(settings, store, bus=bus)
        pipeline.start()
        took = published(endpoint, False, lambda: pipeline.counts["accepted"])
        pipeline.stop()
    assert sum(store.count(f"load.a{asset}") for asset in range(ASSETS)) == COUNT
    store.close()
    return took


def compare_throughput(endpoint: str, folder: Path) -> None:
    """Features per second against the floor."""
    collect_less_often()
    ratios = []
    for number in range(3):
        inside = folder / str(number)
        inside.mkdir()
        parts = bare_zenoh(endpoint), decoding(), inserting(inside)
        ours = whole_flow(endpoint, inside)
        ratios.append(sum(parts) / ours)
        print(
            f"    {TIMED / ours:,.0f} features/s; floor {TIMED / sum(parts):,.0f}/s = Zenoh "
            f"{1e6 * parts[0] / TIMED:.1f} + decoding {1e6 * parts[1] / TIMED:.1f} + insert "
            f"{1e6 * parts[2] / TIMED:.1f} us each"
        )
    print(
        f"throughput, publish to durable / floor of its parts: {statistics.median(ratios):.2f} "
        "(aim 0.5)"
    )


def compare_latency(endpoint: str, folder: Path) -> None:
    """From publishing to being visible over REST, against bare Zenoh one way."""
    port = free_port()
    server = subprocess.Popen(
        [sys.executable, "-m", "slowtime_cli", "-q", "twin", "--connect", endpoint,
         "--port", str(port), "--database", str(folder / "latency.sqlite")],
    )  # fmt: skip
    url = f"http://127.0.0.1:{port}"
    try:
        _wait_for(f"{url}/readyz")
        with ZenohBus("client", [endpoint]) as bus:
            ours = [_visible_after(bus, url, number) for number in range(200)][20:]
    finally:
        server.terminate()
        server.wait()
    bare = _bare_one_way(endpoint, 500)
    for name, percent in (("p50", 50), ("p99", 99)):
        a, b = (statistics.quantiles(times, n=100)[percent - 1] for times in (ours, bare))
        print(
            f"latency {name}, publish to visible over REST: {1e3 * a:.2f} ms; bare Zenoh one "
            f"way {1e3 * b:.2f} ms; ratio {a / b:.1f}"
        )


def _visible_after(bus: ZenohBus, url: str, sequence: int) -> float:
    payload = encode(message("quick", sequence))
    began = time.perf_counter()
    bus.publish(FEATURES.key("load", "quick"), payload, encoding=FEATURES.encoding)
    while True:
        state = _ask(f"{url}/api/v1/twins/load.quick")
        if state is not None and state.get("sequence") == sequence:
            return time.perf_counter() - began


def _bare_one_way(endpoint: str, count: int) -> list[float]:
    times: list[float] = []
    came = threading.Event()
    sent = 0.0

    def receive(_sample: zenoh.Sample) -> None:
        times.append(time.perf_counter() - sent)
        came.set()

    with zenoh.open(bare_config(endpoint)) as out, zenoh.open(bare_config(endpoint)) as back:
        subscriber = back.declare_subscriber("bench/latency", receive)
        time.sleep(0.5)
        for _ in range(count):
            came.clear()
            sent = time.perf_counter()
            out.put("bench/latency", b"x" * 500, express=True)
            came.wait(2.0)
        subscriber.undeclare()  # type: ignore[no-untyped-call]
    return times


def _wait_for(url: str) -> None:
    deadline = time.monotonic() + 30
    while _ask(url) is None and time.monotonic() < deadline:
        time.sleep(0.1)


def _ask(url: str) -> Any:
    try:
        with urllib.request.urlopen(url, timeout=5) as answer:
            return json.loads(answer.read())
    except (urllib.error.URLError, ConnectionError):
        return None


def tell_wire() -> None:
    """Bytes on the wire against the samples behind them."""
    size = len(encode(message("tower", 123)))
    for what, raw in (
        ("3 channels, 200 Hz, 10 min, 4 bytes", 3 * 200 * 600 * 4),
        ("3 channels, 1 kHz, 1 min, 4 bytes", 3 * 1000 * 60 * 4),
        ("1 channel, 50 Hz, 1 min, 4 bytes (the demo)", 50 * 60 * 4),
    ):
        print(
            f"wire: {size} bytes of features for {raw:,} of samples, "
            f"1/{raw / size:,.0f} ({what})"
        )


def compare_estimates(readings: int = 1000) -> None:
    """Print what making readings into changes costs, beside validating as many messages."""
    rng = np.random.default_rng(1)
    ratio, zeta = rng.normal(0.95, 0.02, readings), rng.normal(0.02, 0.001, readings)
    payload = encode(message("beam", 1))

    def read() -> None:
        for _ in range(readings):
            Features.model_validate_json(payload)

    estimates: dict[str, Callable[[], object]] = {
        "stiffness": lambda: stiffness_from_frequency(ratio, 0.001),
        "mass": lambda: mass_from_frequency(ratio, 0.001),
        "both": lambda: stiffness_and_mass(ratio, 0.001, zeta, 0.05, damping_ratio_0=0.02),
    }
    floor, *own = seconds(read, *estimates.values(), rounds=5)
    for name, took in zip(estimates, own, strict=True):
        print(
            f"estimate of {name}, {readings:,} readings: {1e3 * took:.2f} ms, "
            f"{took / floor:.3f} of validating as many messages"
        )


def tell_memory(folder: Path) -> None:
    """Memory of a thousand twins, by a process that holds them and one that holds none."""
    grown = []
    for twins in (1, 1001):
        code = (
            "from benchmarks.processes import throughput; from pathlib import Path;"
            f"throughput.hold({twins}, Path({str(folder)!r}) / 'hold-{twins}.sqlite')"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        grown.append(int(done.stdout))
    print(f"memory: {(grown[1] - grown[0]) / 1000:.1f} KiB per twin at 1,000 twins")


def hold(twins: int, database: Path) -> None:
    """Hold some twins with fifty readings each, and print the memory in use [KiB]."""
    settings = TwinSettings(database=database)
    store = SqliteStore(database)
    pipeline = Pipeline(settings, store)
    pipeline.start()
    for sequence in range(50):
        pipeline.ingest(
            Sample(
                FEATURES.key("load", f"a{twin}"),
                encode(message(f"a{twin}", sequence)),
                None,
                False,
            )
            for twin in range(twins)
        )
    pipeline.stop()
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    print(pages * resource.getpagesize() // 1024)


def main() -> None:
    """Print all ratios."""
    with running_router() as endpoint:
        with tempfile.TemporaryDirectory() as folder:
            compare_throughput(endpoint, Path(folder))
            compare_latency(endpoint, Path(folder))
            tell_memory(Path(folder))
        tell_wire()
        compare_estimates()


if __name__ == "__main__":
    main()
