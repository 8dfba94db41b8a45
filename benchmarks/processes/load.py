"""Ten thousand assets on one small machine: what is lost, how long it takes, what it needs.

    python -m benchmarks.processes.load                       30 minutes
    python -m benchmarks.processes.load --seconds 300 --database postgresql://user@host/name
    python -m benchmarks.processes.load --assets 100000 --period-s 100 --unannounced

Each of `--assets`, spread over `--sites`, sends a feature every `--period-s`, evenly, through a
real router to a real twin server, each a process of its own, over TCP on this machine; the
senders are one more. A router looks a key up first among all sites, then among the assets of
one: many assets of one site cost it more than as many of several.
Each is let in with a first feature; the time counts from when all of these are acknowledged.
From the middle on, for `--burst-s`, ten times as many. The time until a feature is durable is
told by its acknowledgement, REST's by asking for a random twin's latest state a few times a
second, memory by the kernel. Senders keep what is not acknowledged, answer for it as an edge's
spool does, and at the end every history is counted. Leaves with 1 where anything is missing.
Memory and processor time are those of the server, or of all shards together; not of the front,
the router and the senders.
"""

import argparse
import collections
import contextlib
import functools
import json
import multiprocessing
import os
import random
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Health, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import ACK, FEATURES, HEALTH, address_of, alive_key, request_key
from slowtime_services import router
from slowtime_services.bus import Query, Sample, ZenohBus
from slowtime_services.shards import Share
from twin_server import __main__ as twin_process
from twin_server import shards
from twin_server.persist import is_url, open_store
from twin_server.settings import ShardSettings, TwinSettings
from twin_server.shards.supervisor import Supervisor

from .router_lookup import LEASE, LEASE_S, NOBODY, PER_SESSION
from .transport import free_port

DECLARED_AT_ONCE = 100
"""Tokens that are declared before the router is waited for."""

BOOT = "b1"
PATIENCE_S = 900.0
ORIGIN_NS = 1_767_225_600_000_000_000


class Senders:
    """All edges as one process: they send, keep, answer, and note when they were heard.

    Parameters
    ----------
    bus
        Through which they send and answer.
    assets, sites
        How many there are.
    session
        Opens a session for the tokens of each `PER_SESSION` of them, as a router takes the
        longer for a declaration the more the session has; all are of `bus` where None.
    announced
        Whether each declares that it is online.
    """

    def __init__(
        self,
        bus: ZenohBus,
        assets: int,
        sites: int,
        session: Callable[[], ZenohBus] | None = None,
        announced: bool = True,
    ) -> None:
        self._bus, self._began_ns = bus, time.time_ns()
        self.names = [(f"s{number % sites:03d}", f"a{number:05d}") for number in range(assets)]
        self.made = [0] * assets
        self._kept: list[collections.OrderedDict[int, bytes]] = [
            collections.OrderedDict() for _ in range(assets)
        ]
        self._sent_s: list[dict[int, float]] = [{} for _ in range(assets)]
        self.took_s: list[tuple[float, float]] = []
        self._lock = threading.Lock()
        self.again = 0
        self.sessions: list[ZenohBus] = []
        self.handles = [
            bus.subscribe(ACK.everywhere, self._hear),
            bus.answer(request_key("*", "*", "account"), self._account),
            bus.answer(request_key("*", "*", "features"), self._features),
        ]
        if announced:
            self._announce(session)

    def _announce(self, session: Callable[[], ZenohBus] | None) -> None:
        for first in range(0, len(self.names), PER_SESSION):
            own = self._bus if session is None else session()
            self.sessions.append(own)
            for number, name in enumerate(self.names[first : first + PER_SESSION], 1):
                self.handles.append(own.announce(alive_key(*name)))
                if number % DECLARED_AT_ONCE == 0:
                    # Answered by the router after what was declared before: faster than that
                    # for five seconds, Zenoh would close the link, and declare all of it again.
                    own.ask(NOBODY, timeout_s=PATIENCE_S)

    def send(self, number: int) -> None:
        """Make and send the next feature of one asset."""
        sequence = self.made[number]
        t_ns = ORIGIN_NS + sequence * 10**10
        mode = Mode(
            frequency_hz=Quantity(value=3.0 + 1e-3 * random.gauss(), sd=2e-3),
            damping_ratio=Quantity(value=0.02, sd=1e-3),
        )
        site, asset = self.names[number]
        payload = encode(
            Features(
                site=site, asset=asset, boot=BOOT, sequence=sequence, t_ns=t_ns,
                start_ns=t_ns - 10**9, time_base="simulated", slow_time=float(sequence),
                method="ambient", modes=(mode,), quality=Quality(samples=1000),
            )
        )  # fmt: skip
        with self._lock:
            self._kept[number][sequence] = payload
            self._sent_s[number][sequence] = time.monotonic()
            self.made[number] = sequence + 1
        key = FEATURES.key(site, asset)
        self._bus.publish(key, payload, encoding=FEATURES.encoding)

    def health(self, number: int) -> None:
        """Say where the account of one asset ends."""
        with self._lock:
            first = next(iter(self._kept[number]), -1)
        site, asset = self.names[number]
        now_ns = time.time_ns()
        # Another start than before would be that of a second agent of this asset.
        message = Health(
            site=site, asset=asset, boot=BOOT, sequence=0, t_ns=now_ns, first_held=first,
            last_sequence=self.made[number] - 1, uptime_s=(now_ns - self._began_ns) / 1e9,
        )  # fmt: skip
        key = HEALTH.key(site, asset)
        self._bus.publish(key, encode(message), encoding=HEALTH.encoding)

    @property
    def waiting(self) -> int:
        """How many features are not acknowledged."""
        with self._lock:
            return sum(map(len, self._sent_s))

    def _hear(self, sample: Sample) -> None:
        number = int(sample.key.split("/")[-1][1:])
        last = json.loads(sample.payload)["sequence"]
        now_s = time.monotonic()
        with self._lock:
            for sequence in [s for s in self._sent_s[number] if s <= last]:
                sent_s = self._sent_s[number].pop(sequence)
                self._kept[number].pop(sequence, None)
                self.took_s.append((sent_s, now_s - sent_s))

    def _account(self, query: Query) -> Iterator[tuple[str, bytes]]:
        number = int(query.key.split("/")[-1][1:])
        with self._lock:
            first, last = next(iter(self._kept[number]), -1), self.made[number] - 1
        if first >= 0:
            held = {"boot": BOOT, "first": first, "last": last}
            yield query.key, json.dumps(held).encode()

    def _features(self, query: Query) -> Iterator[tuple[str, bytes]]:
        site, name = address_of(query.key) or ("", "")
        first, last = int(query.parameters["first"]), int(query.parameters["last"])
        with self._lock:
            kept = self._kept[int(name[1:])].items()
            found = [payload for sequence, payload in kept if first <= sequence <= last]
            self.again += len(found)
        for payload in found:
            yield FEATURES.key(site, name), payload


def measure(given: argparse.Namespace, folder: Path) -> int:
    """Run the load and print what was seen."""
    database = given.database or str(folder / "twin.sqlite")
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    context = multiprocessing.get_context("spawn")
    urls: Any = context.Queue()
    routing = context.Process(
        target=router.run, args=([endpoint],), kwargs={"options": LEASE}, daemon=True
    )
    routing.start()
    time.sleep(3.0)
    # No daemon: those have no children, which shards are.
    serving = context.Process(target=_serve, args=(database, endpoint, given.shards, urls))
    serving.start()
    url, pids = urls.get(timeout=120)
    session = functools.partial(
        ZenohBus, "client", [endpoint], open_timeout_s=30.0, lease_s=LEASE_S
    )
    with session() as bus:
        began_s = time.monotonic()
        senders = Senders(bus, given.assets, given.sites, session, not given.unannounced)
        print(
            f"all assets announced       after {time.monotonic() - began_s:.1f} s", flush=True
        )
        asker = Asker(url, senders.names)
        for number in range(given.assets):
            senders.send(number)
            time.sleep(0.001)
        let_in_s = _wait(given, senders)
        print(
            f"all assets let in          {let_in_s:.1f} s after the first was sent", flush=True
        )
        senders.took_s.clear()
        before_s = sum(map(_processor_s, pids))
        memory = _send_all(given, senders, asker, pids)
        used_s = sum(map(_processor_s, pids)) - before_s
        healed_s = _wait(given, senders)
        asker.stop()
    serving.terminate()
    serving.join(60)
    routing.terminate()
    routing.join(10)
    return _report(given, database, senders, asker, memory, (healed_s, used_s))


def _wait(given: argparse.Namespace, senders: Senders) -> float:
    """Say how far each asset is until all is acknowledged, or patience ends; give the time."""
    began_s, told = time.monotonic(), 0
    while senders.waiting and (now_s := time.monotonic() - began_s) < PATIENCE_S:
        while told < now_s * given.assets / given.period_s:
            senders.health(told % given.assets)
            told += 1
        time.sleep(0.02)
    return time.monotonic() - began_s


def _serve(database: str, endpoint: str, count: int, urls: Any) -> None:
    settings = TwinSettings(port=0, database=database, connect=(endpoint,))
    if count == 1:
        sys.exit(twin_process.run(settings, ready=lambda url: urls.put((url, [os.getpid()]))))

    def ready(url: str, supervisor: Any) -> None:
        threading.Thread(target=_when_up, args=(url, supervisor, urls)).start()

    divided = settings.model_copy(update={"shards": ShardSettings(count=count)})
    sys.exit(shards.run(divided, ready=ready))


def _when_up(url: str, supervisor: Supervisor, urls: Any) -> None:
    while not all(map(supervisor.url, range(supervisor.count))):
        time.sleep(0.1)
    urls.put((url, [supervisor.pid(index) for index in range(supervisor.count)]))


def _send_all(
    given: argparse.Namespace, senders: Senders, asker: "Asker", pids: list[int]
) -> list[int]:
    """Send as asked for, tenfold during the burst; give resident bytes every ten seconds."""
    rate_hz = given.assets / given.period_s
    memory: list[int] = []
    began_s, sent, told = time.monotonic(), 0.0, 0.0
    number = telling = 0
    middle_s = given.seconds / 2
    before_s = 0.0
    while (now_s := time.monotonic() - began_s) < given.seconds:
        bursts = middle_s <= now_s < middle_s + given.burst_s
        sent += (now_s - before_s) * rate_hz * (10 if bursts else 1)
        told += (now_s - before_s) * rate_hz
        before_s = now_s
        while sent >= 1:
            senders.send(number)
            number, sent = (number + 1) % given.assets, sent - 1
        while told >= 1:
            senders.health(telling)
            telling, told = (telling + 1) % given.assets, told - 1
        if now_s >= 10 * len(memory):
            memory.append(sum(map(_resident, pids)))
        if now_s > 2 * given.period_s:
            asker.start()
        time.sleep(0.02)
    return memory


class Asker:
    """Asks for the latest state of a random twin five times a second, and takes the time."""

    def __init__(self, url: str, names: list[tuple[str, str]]) -> None:
        self._url, self._names = url, names
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.took_s: list[float] = []
        self.failed = 0

    def start(self) -> None:
        """Begin, once."""
        if not self._thread.ident:
            self._thread.start()

    def stop(self) -> None:
        """Ask no more."""
        self._over.set()

    def _run(self) -> None:
        while not self._over.wait(0.2):
            name = ".".join(random.choice(self._names))
            began_s = time.monotonic()
            try:
                path = f"{self._url}/api/v1/twins/{name}"
                with urllib.request.urlopen(path, timeout=30) as answer:
                    answer.read()
            except OSError:
                self.failed += 1
            self.took_s.append(time.monotonic() - began_s)


def _resident(pid: int) -> int:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * 4096


def _processor_s(pid: int) -> float:
    """Processor time of a process so far, of the system's part too [s]."""
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def _missing(database: str, count: int, senders: Senders) -> int:
    """Count what was sent and is in no history."""
    shares = [None] if count == 1 else [Share(index, count) for index in range(count)]
    missing = 0
    for share in shares:
        with contextlib.closing(open_store(database, share=share)) as store:
            for name, made in zip(senders.names, senders.made, strict=True):
                if share is None or share.has(name[1]):
                    missing += made - store.count(".".join(name))
    return missing


def _size(database: str) -> int:
    """Bytes of the files of a SQLite database, of all shards; 0 of PostgreSQL."""
    if is_url(database):
        return 0
    path = Path(database)
    return sum(file.stat().st_size for file in path.parent.glob(f"{path.stem}*"))


def _report(
    given: argparse.Namespace,
    database: str,
    senders: Senders,
    asker: Asker,
    memory: list[int],
    times_s: tuple[float, float],
) -> int:
    missing = _missing(database, given.shards, senders)
    healed_s, used_s = times_s
    sent_s, took_s = np.array(senders.took_s).T
    middle = sent_s.min() + given.seconds / 2
    took = {"steady": took_s}
    if given.burst_s:
        bursts = (sent_s >= middle) & (sent_s < middle + given.burst_s)
        took = {"steady": took_s[sent_s < middle], "burst": took_s[bursts]}
    mebibytes = [size / 2**20 for size in memory]
    late = mebibytes[len(memory) // 3 :]
    assets = f"{given.assets:,} of {given.sites:,} sites"
    print(f"assets                     {assets}, one feature per {given.period_s:g} s each")
    print(f"features                   {sum(senders.made):,} in {given.seconds:g} s")
    print(f"servers                    {given.shards} of {given.assets:,} twins together")
    print(f"missing in history         {missing}")
    print(f"asked for again            {senders.again:,}")
    for what, times in took.items():
        p50, p99 = np.percentile(times, [50, 99]) if len(times) else (np.nan, np.nan)
        print(f"sent to acknowledged       {what}: p50 {p50:.3f} s, p99 {p99:.3f} s")
    p50, p99 = np.percentile(asker.took_s, [50, 99]) * 1e3
    print(
        f"REST, latest state         p50 {p50:.1f} ms, p99 {p99:.1f} ms, {asker.failed} failed"
    )
    print(f"all acknowledged           {healed_s:.1f} s after the last was sent")
    print(
        f"memory of the server       {mebibytes[0]:.0f} MiB at first, from a third on "
        f"{late[0]:.0f} to {late[-1]:.0f} MiB, at most {max(mebibytes):.0f}"
    )
    print(
        f"twins per GB of memory     {given.assets / (max(memory) / 1e9):,.0f}, the software "
        f"of {given.shards} process(es) included"
    )
    timed = len(senders.took_s)
    print(f"processor per feature      {1e6 * used_s / max(timed, 1):.0f} us of the server")
    if size := _size(database):
        print(f"disk per feature           {size / sum(senders.made):.0f} bytes")
    print(f"load of the machine        {os.getloadavg()[2]:.1f} in the last 15 minutes")
    return 1 if missing or senders.waiting else 0


def main(words: list[str] | None = None) -> int:
    """Run the load in a temporary folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--assets", type=int, default=10_000)
    parser.add_argument("--sites", type=int, default=100)
    parser.add_argument("--period-s", type=float, default=10.0)
    parser.add_argument("--seconds", type=float, default=1800.0)
    parser.add_argument("--burst-s", type=float, default=10.0)
    parser.add_argument("--shards", type=int, default=1, help="processes of the server")
    parser.add_argument(
        "--unannounced",
        action="store_true",
        help="no asset declares that it is online; a router takes a quarter of an hour for the "
        "declarations of 100,000",
    )
    parser.add_argument("--database", help="file or URL; a file of its own by default")
    given = parser.parse_args(words)
    with tempfile.TemporaryDirectory(prefix="slowtime-load-") as folder:
        return measure(given, Path(folder))


if __name__ == "__main__":
    sys.exit(main())
