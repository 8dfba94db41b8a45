"""What runs in each process of the house: the real thing, with the harness's clock in it."""

import contextlib
import functools
import json
import logging
import multiprocessing
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

import edge_agent.__main__ as edge_process
import edge_agent.publish.publisher as publisher
import twin_server.__main__ as twin_process
import twin_server.shards.process as shard_process
import twin_server.shards.supervisor as supervising
from edge_agent.settings import EdgeSettings
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, TimeBase
from slowtime_services import router as router_process
from slowtime_services.shutdown import ended_by_signals
from twin_server.settings import TwinSettings
from twin_server.shards import run as run_shards

from .instruments import Dial, FaultySource, SkewedClock, ledger_spool


def router(home: Path, endpoint: str) -> None:
    """Run a router."""
    _begin(home, "router")
    router_process.run([endpoint])


def twin(home: Path, settings: dict[str, Any]) -> None:
    """Run a twin server."""
    _begin(home, "twin")
    clock = SkewedClock(Dial(home / "twin.clock"))

    def ready(url: str) -> None:
        (home / "twin.url").write_text(url)

    sys.exit(twin_process.run(TwinSettings(**settings), clock=clock, ready=ready))


def fleet(home: Path, settings: dict[str, Any], quick: bool = True) -> None:
    """Run the front of a fleet of shards, and tell the process of each shard.

    With `quick`, shards are forked off a process that has imported everything.
    """
    _begin(home, "twin")
    given = TwinSettings(**settings)
    supervising.serve_shard = functools.partial(shard, home)  # type: ignore[attr-defined]
    as_usual = supervising.Supervisor.__init__

    def quickly(self: supervising.Supervisor, *things: Any, **named: Any) -> None:
        as_usual(self, *things, **named)
        if quick:
            made = multiprocessing.get_context("forkserver")
            made.set_forkserver_preload(["tests.faults.processes"])
            self._context = made

    supervising.Supervisor.__init__ = quickly  # type: ignore[method-assign]
    dials = [Dial(home / f"shard-{index}.pid") for index in range(given.shards.count)]
    up = Dial(home / "shards.up")

    def tell(supervisor: supervising.Supervisor) -> None:
        while True:
            for index, dial in enumerate(dials):
                dial.value = float(supervisor.pid(index) or 0)
            up.value = float(
                sum(supervisor.url(index) is not None for index in range(len(dials)))
            )
            time.sleep(0.05)

    def ready(url: str, supervisor: Any) -> None:
        (home / "twin.url").write_text(url)
        threading.Thread(target=tell, args=(supervisor,), daemon=True).start()

    sys.exit(run_shards(given, ready=ready))


def shard(home: Path, settings: TwinSettings, *rest: Any) -> None:
    """Run one shard of a fleet."""
    _begin(home, f"shard-{settings.shards.index}")
    clock = SkewedClock(Dial(home / "twin.clock"))
    twin_process.run = functools.partial(twin_process.run, clock=clock)
    shard_process.serve_shard(settings, *rest)


def edge(
    home: Path,
    settings: dict[str, Any],
    ledger: Any,
    first_epoch: int,
    time_base: TimeBase,
    old: bool,
) -> None:
    """Run an edge agent; an `old` one speaks the version of features before this one."""
    asset = settings["asset"]
    _begin(home, asset)
    given = EdgeSettings(**settings)
    clock = SkewedClock(Dial(home / f"{asset}.clock"))
    edge_process.Spool = ledger_spool(ledger)  # type: ignore[attr-defined]
    if old:
        publisher.encode = _encode_as_before  # type: ignore[attr-defined]
    with contextlib.ExitStack() as stack:
        stop = stack.enter_context(ended_by_signals())
        source = FaultySource(
            clock, Dial(home / f"{asset}.rate"), stop, first_epoch, len(asset), time_base
        )
        bus = stack.enter_context(edge_process._connected(given, clock, stop))
        sys.exit(edge_process.run(given, bus=bus, clock=clock, source=source, stop=stop))


def _encode_as_before(message: Any) -> bytes:
    if not isinstance(message, Features):
        return encode(message)
    plain = json.loads(encode(message)) | {"version": 1}
    del plain["channels"]
    for mode in plain["modes"]:
        for name in ("identity", "kind", "shape"):
            del mode[name]
    return json.dumps(plain, separators=(",", ":")).encode()


def _begin(home: Path, name: str) -> None:
    log = os.open(home / f"{name}.log", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.close(log)
    logging.basicConfig(
        level=logging.INFO, format="%(asctime)s %(process)d %(levelname)-7s %(message)s"
    )
    logging.info("%s begins.", name)
