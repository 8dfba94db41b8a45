"""Real processes over real Zenoh, each of which may be killed, frozen, cut off or lied to."""

import collections
import contextlib
import multiprocessing
import multiprocessing.connection
import os
import random
import resource
import signal
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from . import processes
from .gate import Gate
from .instruments import Dial
from .ledger import Ledger
from .schedule import ASSETS, RATE_HZ, Plan, shard_names

PRELOADED = ["tests.faults.processes"]
UNLIMITED = resource.RLIM_INFINITY
START_S = 300.0
"""How long the shards of a fleet may take to answer at first; a busy machine takes minutes."""


def context() -> Any:
    """Make processes quickly: forked off one that has imported everything and runs nothing."""
    made = multiprocessing.get_context("forkserver")
    made.set_forkserver_preload(PRELOADED)
    return made


class House:
    """Router, twin server or fleet of shards, and two edges under one plan."""

    def __init__(self, plan: Plan, home: Path, database: str) -> None:
        self.plan, self.home, self.database = plan, home, database
        self.ledger = Ledger()
        self.said: list[str] = []
        self._context = context()
        self._port = _free_port()
        self.endpoint = f"tcp/127.0.0.1:{self._port}"
        self.gates = {name: Gate(self._port) for name in ("twin", *ASSETS)}
        self.clocks = {name: Dial(home / f"{name}.clock", 0.0) for name in ("twin", *ASSETS)}
        self.rates = {name: Dial(home / f"{name}.rate", RATE_HZ) for name in ASSETS}
        self.shards = shard_names(plan.shards)
        self._up = Dial(home / "shards.up", 0.0)
        self._pids = {name: Dial(home / f"{name}.pid", 0.0) for name in self.shards}
        self._running: dict[str, Any] = {}
        self._down: collections.Counter[str] = collections.Counter()
        self._again_s: dict[str, float] = {}
        self._limited: collections.Counter[str] = collections.Counter()
        self._lives: collections.Counter[str] = collections.Counter()
        self._over = False
        self._start: dict[str, Callable[[], Any]] = {
            "router": self._router,
            "twin": self._twin,
            **{name: lambda name=name: self._edge(name) for name in ASSETS},  # type: ignore[misc]
        }
        threading.Thread(target=self.ledger.read_all, daemon=True).start()

    def open(self) -> None:
        """Start everybody."""
        for name in self._start:
            self._begin(name)
        until_s = time.monotonic() + START_S
        while self._up.value < len(self.shards) and time.monotonic() < until_s:
            time.sleep(0.1)

    def down(self, name: str, by: signal.Signals) -> None:
        """End a process now, and start no other in its place until `up`."""
        self._down[name] += 1
        process = self._running.pop(name, None)
        if process is not None and process.is_alive():
            os.kill(process.pid, by)
            if by == signal.SIGTERM:
                os.kill(process.pid, signal.SIGCONT)
            process.join(12.0)
            if process.is_alive():
                self.said.append(f"{name} did not end by {by.name} within 12 s")
                process.kill()
                process.join()

    def up(self, name: str) -> None:
        """Take one reason away why a process is down."""
        self._down[name] -= 1
        self.tend()

    def freeze(self, name: str, frozen: bool) -> None:
        """Stop a process without ending it, or let it go on."""
        process = self._running.get(name)
        if process is not None and process.is_alive():
            os.kill(process.pid, signal.SIGSTOP if frozen else signal.SIGCONT)

    def shard(self, name: str) -> int:
        """Return the process of a shard; 0 while there is none, and of other names."""
        return int(self._pids[name].value) if name in self._pids else 0

    def fill_disk(self, name: str, by: int) -> None:
        """Let no file of a process grow any more; with `by` = -1 let them again."""
        self._limited[name] += by
        self._limit(name)

    def tend(self) -> None:
        """Start again who should run and does not, as a supervisor would."""
        if self._over:
            return
        for name in self._start:
            process = self._running.get(name)
            if self._down[name] > 0 or (process is not None and process.is_alive()):
                continue
            if process is not None:
                self.said.append(f"{name} ended by itself with {process.exitcode}")
                del self._running[name]
                self._again_s[name] = time.monotonic() + 0.5
            if time.monotonic() >= self._again_s.get(name, 0.0):
                self._begin(name)

    def alive(self, name: str) -> bool:
        """Whether a process runs."""
        process = self._running.get(name)
        return process is not None and bool(process.is_alive())

    def end(self) -> dict[str, int | None]:
        """End everybody in peace; give their exit statuses."""
        self._over = True
        found: dict[str, int | None] = {}
        for name in (*ASSETS, "twin", "router"):
            process = self._running.get(name)
            if process is not None:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process.pid, signal.SIGTERM)
                process.join(15.0 + 30.0 * len(self.shards))
                found[name] = process.exitcode
        return found

    def close(self) -> None:
        """End whatever is left."""
        self._over = True
        for process in self._running.values():
            if process.is_alive():
                process.kill()
                process.join()
        for gate in self.gates.values():
            gate.close()
        self.ledger.close()

    def url(self) -> str:
        """Where the twin server answers, or last did."""
        path = self.home / "twin.url"
        return path.read_text() if path.exists() else ""

    def _begin(self, name: str) -> None:
        self._running[name] = self._start[name]()
        self._limit(name)

    def _limit(self, name: str) -> None:
        process = self._running.get(name)
        if process is not None and process.is_alive():
            soft = 1 if self._limited[name] > 0 else UNLIMITED
            shards = [pid for pid in map(self.shard, self.shards) if pid and name == "twin"]
            for pid in (process.pid, *shards):
                with contextlib.suppress(ProcessLookupError):
                    resource.prlimit(pid, resource.RLIMIT_FSIZE, (soft, UNLIMITED))

    def _process(self, target: Callable[..., None], *given: Any) -> Any:
        process = self._context.Process(target=target, args=(self.home, *given))
        process.daemon = target is not processes.fleet  # which has children
        process.start()
        return process

    def _router(self) -> Any:
        return self._process(processes.router, self.endpoint)

    def _twin(self) -> Any:
        settings = {
            "port": 0,
            "database": self.database,
            "connect": (self.gates["twin"].endpoint,),
            "connect_timeout_s": 600.0,
            "zenoh": RETRY,
            "healing": {"max_backoff_s": 2.0},
        }
        if not self.shards:
            return self._process(processes.twin, settings)
        return self._process(processes.fleet, settings | {"shards": self._fleet()})

    def _fleet(self) -> dict[str, Any]:
        return {"count": len(self.shards), "max_backoff_s": 2.0}

    def _edge(self, name: str) -> Any:
        life = self._lives[name]
        self._lives[name] += 1
        settings = {
            "site": "lab",
            "asset": name,
            "connect": (self.gates[name].endpoint,),
            "connect_wait_s": 0.5,
            "zenoh": RETRY,
            "extract": {"method": "peak"},
            "spool": {
                "folder": self.home / "spool",
                "max_bytes": self.plan.spool_bytes,
                "segment_bytes": 8192,
            },
            "publish": {"linger_s": 0.0} | (GATHERED if self.plan.link != "lab" else {}),
            "link": self.plan.link,
        }
        ours, theirs = self._context.Pipe(duplex=False)
        self.ledger.add(ours)
        old = (self.plan.seed + life) % 3 == 0
        process = self._process(
            processes.edge, settings, theirs, 100_000 * life, self.plan.time_base, old
        )
        theirs.close()
        return process


GATHERED = {"features_every_s": 3.0, "health_every_s": 3.0, "lease_s": 2.0}
"""Minutes of a link that costs as seconds, so that faults of seconds befall each of them."""

RETRY = {
    "connect/retry": {
        "period_init_ms": 100,
        "period_max_ms": 1000,
        "period_increase_factor": 1.5,
    }
}


def _free_port() -> int:
    """Find one that no outgoing connection is given while the router is away."""
    while True:
        port = random.randrange(20_000, 32_000)
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
