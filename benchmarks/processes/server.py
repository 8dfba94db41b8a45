"""The door of a twin server: long histories, and many callers who ask for what takes long.

    python -m benchmarks.processes.server                       five minutes
    python -m benchmarks.processes.server --readings 100000 --seconds 10

First a history of `--readings` and one of a thousand are asked for in turn, and ratios are
printed: a thinned history, its hash, the latest state and the forecast. Then `--callers` ask
for `--seconds` without a pause: for simulations that cannot be run, for heavy ones, for
forecasts of moments of their own; large bodies at once. Meanwhile /healthz is asked twenty
times a second, features arrive over a real router, and at the end each of them is counted.
Leaves with 1 where one is missing or a bound is passed.
"""

import argparse
import asyncio
import contextlib
import http.client
import itertools
import json
import multiprocessing
import random
import resource
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from slowtime_services import router
from slowtime_services.bus import ZenohBus
from twin_server import __main__ as twin_process
from twin_server.persist import FeatureRow, RunRow, SqliteStore, WriteBatch, open_store
from twin_server.pipeline import Pipeline
from twin_server.registration.nominal import Nominal
from twin_server.registration.twin import Registration
from twin_server.settings import TwinSettings

from .load import ORIGIN_NS, Senders
from .transport import free_port

FEW = 1_000
LONGEST, SHORTEST = "door.long", "door.short"
POINTS = 500
MOST_RATIO = 3.0
"""Of a long history's thinned answer to a short one's."""
HEALTH_P99_S = 0.1
"""Within which /healthz answers, 99 times of 100, whatever others ask for."""
GROWTH = 200 * 2**20
"""Bytes that the server, its workers included, may grow by meanwhile."""
FEATURES_HZ = 20.0
HALF_OPEN = 2_050
_AT_ONCE = 2_000

REGISTRATION = Registration(
    changes="stiffness",
    nominal=Nominal(frequency_hz=3.0, damping_ratio=0.02),
)


def fill(database: Path, readings: int) -> None:
    """Write two histories: their beginning as a twin makes it, the rest made from that."""
    store = SqliteStore(database, synchronous="NORMAL")
    pipeline = Pipeline(TwinSettings(database=database, connect=()), store)
    pipeline.start()
    names = (SHORTEST, LONGEST)
    heard: list[Any] = []
    senders = Senders(_Heard(heard), 0, 1)  # type: ignore[arg-type]
    senders.names = [tuple(name.split(".")) for name in names]  # type: ignore[misc]
    senders.made, senders._kept, senders._sent_s = [0, 0], [{}, {}], [{}, {}]  # type: ignore[list-item]
    for name in names:
        pipeline.register(name, REGISTRATION)
    for _ in range(FEW):
        senders.send(0)
        senders.send(1)
    pipeline.ingest(heard)
    pipeline.give_up()
    pipeline.stop()
    _lengthen(store, LONGEST, readings)
    store.close()


class _Heard:
    """A bus that keeps what is sent."""

    def __init__(self, heard: list[Any]) -> None:
        self._heard = heard

    def publish(self, key: str, payload: bytes, *, encoding: str) -> None:
        from slowtime_services.bus import Sample

        self._heard.append(Sample(key, payload, None, True))

    def subscribe(self, *_: Any) -> None: ...
    def answer(self, *_: Any) -> None: ...
    def announce(self, *_: Any) -> None: ...


def _lengthen(store: SqliteStore, twin_id: str, readings: int) -> None:
    """Append readings that look like those that are there, without estimating each."""
    found = store.history(twin_id)
    rows = store.messages(twin_id, (0, -1), FEW)
    number = rows[0].number
    (run,) = [run for run in store.runs()[0] if run.number == number]
    rng = np.random.default_rng(0)
    for first in range(FEW, readings, _AT_ONCE):
        sequences = np.arange(first, min(first + _AT_ONCE, readings))
        states = found.states[rng.integers(0, FEW, len(sequences))].copy()
        states["sequence"], states["slow_time"] = sequences, sequences
        states["t_ns"] = ORIGIN_NS + sequences * 10**10
        states["missing_before"] = 0
        last = int(sequences[-1])
        features = [
            FeatureRow(
                number, s, int(one["t_ns"]), float(s), rows[s % FEW].message, one.tobytes()
            )
            for s, one in zip(sequences.tolist(), states, strict=True)
        ]
        told = RunRow(*run)._replace(
            next=last + 1, last=last, last_t_ns=int(states["t_ns"][-1]), told=last
        )
        store.write(WriteBatch(runs=[told], features=features))


class KeptConnection:
    """One connection that stays."""

    def __init__(self, url: str) -> None:
        self._at = urlsplit(url)
        self._open()

    def _open(self) -> None:
        self._connection = http.client.HTTPConnection(
            self._at.hostname or "", self._at.port, timeout=120
        )

    def took_s(self, path: str, body: bytes | None = None) -> tuple[float, int]:
        """Ask; give how long the answer took, and its status."""
        began_s = time.perf_counter()
        try:
            self._connection.request(
                "GET" if body is None else "POST",
                path,
                body,
                {"Content-Type": "application/json"},
            )
            answer = self._connection.getresponse()
            answer.read()
        except (OSError, http.client.HTTPException):
            self._connection.close()
            self._open()
            return time.perf_counter() - began_s, 0
        return time.perf_counter() - began_s, answer.status


def compare(client: KeptConnection, readings: int) -> int:
    """Ask for long and short histories in turn; print ratios."""
    wrong = 0
    paths = {
        f"history, {POINTS} points": f"history?max_points={POINTS}",
        "hash": "history/hash",
        "latest state": "",
        "events": "events",
        "forecast": "forecast",
    }
    times: dict[tuple[str, str], list[float]] = {}
    for what, path in paths.items():
        for twin in (SHORTEST, LONGEST):
            client.took_s(f"/api/v1/twins/{twin}/{path}".rstrip("/"))
        for _ in range(30):
            for twin in (SHORTEST, LONGEST):
                took, status = client.took_s(f"/api/v1/twins/{twin}/{path}".rstrip("/"))
                assert status == 200, (path, status)
                times.setdefault((what, twin), []).append(took)
        short, long = (float(np.median(times[what, t])) for t in (SHORTEST, LONGEST))
        ratio = long / short
        print(
            f"{what:25} {1e3 * long:8.1f} ms of {readings:,} readings, {1e3 * short:.1f} ms of "
            f"{FEW:,}: ratio {ratio:.2f}",
            flush=True,
        )
        wrong += ratio > MOST_RATIO
    history = float(np.median(times[f"history, {POINTS} points", LONGEST]))
    forecast = float(np.percentile(times["forecast", LONGEST], 99))
    print(f"{'forecast, p99':25} {1e3 * forecast:8.1f} ms: {forecast / history:.2f} histories")
    return wrong


def bodies() -> dict[str, Callable[[random.Random], tuple[str, bytes | None]]]:
    """Make what callers ask for, another thing every time."""
    base = f"/api/v1/twins/{SHORTEST}"

    def order(**more: Any) -> bytes:
        return json.dumps(more).encode()

    def invalid(rng: random.Random) -> tuple[str, bytes]:
        load = {"kind": "harmonic", "amplitude": 1.0, "frequency_hz": 1.0 + rng.random()}
        wrong: dict[str, Any] = rng.choice(
            [{"outputs": ["nowhere"]}, {"on": "roof"}, {"duration_s": 1e6, "rate_hz": 1e5}]
        )
        return f"{base}/simulate", order(load=load, **wrong)

    def large(rng: random.Random) -> tuple[str, bytes]:
        samples = [round(rng.random(), 2) for _ in range(10_000)] + ["x"]
        load = {"kind": "recorded", "samples": samples}
        return f"{base}/simulate", order(load=load, rate_hz=100.0)

    def heavy(rng: random.Random) -> tuple[str, bytes]:
        load = {"kind": "white", "psd": 1e-3}
        return f"{base}/simulate", order(
            load=load, duration_s=190.0, rate_hz=100.0, draws=400, seed=rng.randrange(2**40)
        )

    def before(rng: random.Random) -> tuple[str, None]:
        return f"{base}/forecast?at=slow:{rng.uniform(100, FEW - 1):.6f}", None

    return {
        "invalid simulations": invalid,
        "large invalid bodies": large,
        "heavy simulations": heavy,
        "forecasts of the past": before,
    }


def call(url: str, what: str, callers: int, seconds: float, told: Any) -> None:
    """Ask as many callers at once, without a pause; in a process of its own."""
    make, at = bodies()[what], urlsplit(url)
    answers: Counter[int] = Counter()

    async def caller(number: int) -> None:
        rng = random.Random(number)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            path, body = make(rng)
            verb = "GET" if body is None else "POST"
            head = f"{verb} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n"
            head += (
                f"Content-Type: application/json\r\nContent-Length: {len(body or b'')}\r\n\r\n"
            )
            status = 0
            with contextlib.suppress(OSError, ValueError, IndexError, TimeoutError):
                async with asyncio.timeout(until - time.monotonic() + 1.0):
                    reader, writer = await asyncio.open_connection(at.hostname, at.port)
                    writer.write(head.encode() + (body or b""))
                    status = int((await reader.readline()).split()[1])
                    await reader.read()
                    writer.close()
            answers[status] += 1

    async def all_of_them() -> None:
        await asyncio.gather(*(caller(n) for n in range(callers)))

    asyncio.run(all_of_them())
    told.put(dict(answers))


class HealthWatch:
    """Asks for /healthz, and sends features, until it is over."""

    def __init__(self, url: str, senders: Senders) -> None:
        self._client, self._senders = KeptConnection(url), senders
        self._over = threading.Event()
        self.took_s: list[float] = []
        self.failed = 0
        self._threads = [
            threading.Thread(target=work, daemon=True) for work in (self._ask, self._send)
        ]

    def __enter__(self) -> "HealthWatch":
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        for thread in self._threads:
            thread.join()

    def _ask(self) -> None:
        while not self._over.wait(0.05):
            took, status = self._client.took_s("/healthz")
            self.took_s.append(took)
            self.failed += status != 200

    def _send(self) -> None:
        for number in itertools.cycle(range(len(self._senders.names))):
            if self._over.wait(1.0 / FEATURES_HZ):
                return
            self._senders.send(number)


def resident(pid: int) -> int:
    """Bytes of a process and all it has begun, what they share counted once."""
    total, todo = 0, [pid]
    while todo:
        one = todo.pop()
        with contextlib.suppress(OSError):
            text = Path(f"/proc/{one}/smaps_rollup").read_text()
            total += 1024 * next(
                int(line.split()[1]) for line in text.splitlines() if line.startswith("Pss:")
            )
            for task in Path(f"/proc/{one}/task").iterdir():
                todo += map(int, (task / "children").read_text().split())
    return total


def besiege(given: argparse.Namespace, url: str, pid: int, senders: Senders) -> int:
    """Let many ask for what takes long; print what the others feel of it."""
    wrong = 0
    client = KeptConnection(url)
    context = multiprocessing.get_context("spawn")
    everyday = [
        f"/api/v1/twins/{SHORTEST}/history?max_points={POINTS}",
        f"/api/v1/twins/{SHORTEST}/forecast",
        "/api/v1/twins",
        "/readyz",
        "/metrics",
    ]

    def usual() -> list[float]:
        for path in everyday:
            client.took_s(path)
        return [
            float(np.median([client.took_s(path)[0] for _ in range(10)])) for path in everyday
        ]

    before, memory = usual(), resident(pid)
    for what in (None, *bodies()):
        answers: dict[int, int] = {}
        most = 0
        with HealthWatch(url, senders) as watch:
            if what is None:
                time.sleep(given.seconds)
            else:
                told: Any = context.Queue()
                callers = context.Process(
                    target=call, args=(url, what, given.callers, given.seconds, told)
                )
                callers.start()
                while callers.is_alive():
                    most = max(most, resident(pid))
                    callers.join(1.0)
                answers = told.get()
        p50, p99 = np.percentile(watch.took_s, [50, 99])
        grown = (most - memory) / 2**20 if most else 0.0
        print(
            f"{what or 'nobody else':25} /healthz p50 {1e3 * p50:.1f} ms, p99 "
            f"{1e3 * p99:.1f} ms, {watch.failed} failed; {grown:+.0f} MiB; answers "
            f"{', '.join(f'{s}: {n}' for s, n in sorted(answers.items())) or 'none'}",
            flush=True,
        )
        wrong += p99 > HEALTH_P99_S or watch.failed > 0 or most - memory > GROWTH
    wrong += _half_open(url, client, everyday)
    time.sleep(given.rest)
    after = usual()
    for path, one, other in zip(everyday, before, after, strict=True):
        print(f"{path[:44]:45} before {1e3 * one:.1f} ms, after {1e3 * other:.1f} ms")
    print(f"memory                    {(resident(pid) - memory) / 2**20:+.0f} MiB after")
    return wrong


def _half_open(url: str, client: KeptConnection, paths: list[str]) -> int:
    """Open `HALF_OPEN` connections from one address and say half a line on each."""
    at = urlsplit(url)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(max(soft, HALF_OPEN + 500), hard), hard))
    with contextlib.ExitStack() as opened:
        for _ in range(HALF_OPEN):
            one = opened.enter_context(
                socket.create_connection((at.hostname or "", at.port or 0), timeout=60)
            )
            one.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-")
        times = [KeptConnection(url).took_s(path) for path in paths for _ in range(5)]
    served = sum(status == 200 for _, status in times)
    slowest = max(took for took, _ in times)
    print(
        f"{HALF_OPEN:,} half-open connections: {served} of {len(times)} others served, the "
        f"slowest in {1e3 * slowest:.0f} ms",
        flush=True,
    )
    return len(times) - served


def measure(given: argparse.Namespace, folder: Path) -> int:
    """Run a router and a server, and ask."""
    database = folder / "twin.sqlite"
    began_s = time.monotonic()
    fill(database, given.readings)
    print(
        f"{given.readings:,} readings written in {time.monotonic() - began_s:.0f} s", flush=True
    )
    with running(database) as (url, pid, endpoint):
        wrong = compare(KeptConnection(url), given.readings)
        with ZenohBus("client", [endpoint], open_timeout_s=30.0) as bus:
            senders = Senders(bus, 4, 2)
            wrong += besiege(given, url, pid, senders)
            until = time.monotonic() + 60
            while senders.waiting and time.monotonic() < until:
                for number in range(len(senders.names)):
                    senders.health(number)
                time.sleep(0.5)
    store = open_store(database)
    sent = sum(senders.made)
    kept = sum(store.count(".".join(name)) for name in senders.names)
    store.close()
    print(f"features                  {sent} sent, {sent - kept} missing")
    return 1 if wrong or sent != kept else 0


@contextlib.contextmanager
def running(database: Path) -> Iterator[tuple[str, int, str]]:
    """Run a router and a server on a history: URL, process and endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    context = multiprocessing.get_context("spawn")
    urls: Any = context.Queue()
    routing = context.Process(target=router.run, args=([endpoint],), daemon=True)
    routing.start()
    time.sleep(3.0)
    serving = context.Process(target=_serve, args=(str(database), endpoint, urls))
    serving.start()
    try:
        yield urls.get(timeout=600), serving.pid or 0, endpoint
    finally:
        serving.terminate()
        serving.join(60)
        routing.terminate()
        routing.join(10)


def _serve(database: str, endpoint: str, urls: Any) -> None:
    settings = TwinSettings(port=0, database=database, connect=(endpoint,))
    sys.exit(twin_process.run(settings, ready=urls.put))


def main(words: list[str] | None = None) -> int:
    """Measure in a temporary folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--readings", type=int, default=1_000_000)
    parser.add_argument("--callers", type=int, default=80)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--rest", type=float, default=60.0, help="seconds after they left")
    given = parser.parse_args(words)
    with tempfile.TemporaryDirectory(prefix="slowtime-door-") as folder:
        return measure(given, Path(folder))


if __name__ == "__main__":
    sys.exit(main())
